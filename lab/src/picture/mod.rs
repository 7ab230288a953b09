//! Draws a damaged and a sound shoulder of an archive: the two damage maps, a tap over a crack and one on sound rubber.
//!
//! `tapline-lab picture demo/casings/SIM-0001.h5 --out docs/picture.svg`

mod plots;
mod ring;
mod tap;

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;
use tapline_store::{Reader, regions};
use tapline_wire::{DamageCell, Geometry, Judgement, Scan, SourceKind, Verdict};

use self::ring::Ring;
use self::tap::Tap;
use crate::written::WrittenArgs;
use tapline_draw::canvas::{self, Area, BLUE, INK, PALE_INK, Point, VERMILLION};

/// Okabe and Ito's sky blue.
const SKY: RGBColor = RGBColor(86, 180, 233);
/// Size of the picture.
const SIZE: (u32, u32) = (1000, 742);
/// Centres of the damage maps.
const RINGS: [Point; 2] = [(196.0, 222.0), (196.0, 533.0)];

/// A shoulder and what was found on it.
struct Shoulder<'a> {
    scan: &'a Scan,
    judgement: Judgement,
    cells: Vec<DamageCell>,
    /// Locations known to be cracked.
    cracked: BTreeSet<u32>,
    /// Where the index is greatest.
    peak: DamageCell,
}

impl Shoulder<'_> {
    fn verdict(&self) -> String {
        Verdict::from_code(self.judgement.verdict).map_or_else(String::new, |verdict| verdict.to_string())
    }
}

/// Draws the archive at `archive`, which must be of rings of which one is damaged, into the file `out`.
///
/// # Errors
/// An archive that cannot be read or drawn, or an error of the file system.
pub fn write(archive: &Path, out: &Path, written: WrittenArgs) -> Result<()> {
    let reader = Reader::open(archive)?;
    ensure!(reader.plan().geometry == Geometry::Ring, "{} holds no ring, and this draws rings", archive.display());
    let svg = draw(&reader)?;
    written.write(&[(out.to_owned(), svg)])
}

fn draw(reader: &Reader) -> Result<String> {
    let mut shoulders = shoulders(reader)?;
    shoulders.sort_by(|a, b| b.peak.damage_index.total_cmp(&a.peak.damage_index));
    let [damaged, .., sound] = shoulders.as_slice() else { bail!("fewer than two shoulders are judged") };
    ensure!(damaged.peak.region != 0, "no shoulder is damaged");
    let taps = [
        Tap::at(reader, damaged.scan, sound_cell(damaged)?, "sound", BLUE)?,
        Tap::at(reader, damaged.scan, damaged.peak, "cracked", VERMILLION)?,
    ];
    // Thirds of it are written beside the ring.
    let greatest = 3.0 * (damaged.peak.damage_index / 3.0).ceil();
    let rings = RINGS.map(|center| Ring { center, greatest });
    canvas::svg(SIZE, |area| {
        title(area, reader, damaged, &taps[0])?;
        rings[0].draw(area, damaged)?;
        rings[1].draw(area, sound)?;
        taps.iter().try_for_each(|tap| rings[0].mark(area, tap))?;
        ring::legend(area)?;
        plots::draw(area, reader, &taps)
    })
}

fn shoulders(reader: &Reader) -> Result<Vec<Shoulder<'_>>> {
    let mut shoulders = Vec::new();
    for (scan, judged) in reader.plan().scans().iter().zip(reader.judgements()?) {
        let Some((judgement, mut cells)) = judged else { continue };
        let part_deg = 360.0 / cells.len() as f64;
        for cell in cells.iter_mut().filter(|cell| !cell.angle_deg.is_finite()) {
            cell.angle_deg = f64::from(cell.location) * part_deg;
        }
        let known = cells.iter().filter(|cell| cell.damage_index.is_finite());
        let Some(highest) = known.clone().max_by(|a, b| a.damage_index.total_cmp(&b.damage_index)) else { continue };
        // The index has a ceiling that a whole crack reaches: its middle is the place to show.
        let ceiling: Vec<&DamageCell> = known
            .filter(|c| c.damage_index.total_cmp(&highest.damage_index).is_eq() && c.region == highest.region)
            .collect();
        let peak = *ceiling[ceiling.len() / 2];
        let here = reader.truth().iter().filter(|&(&(tyre, side, _), _)| (tyre, side) == (scan.tyre, scan.shoulder));
        let cracked = here.filter(|&(_, &is_cracked)| is_cracked).map(|(&(_, _, location), _)| location).collect();
        shoulders.push(Shoulder { scan, judgement, cells, cracked, peak });
    }
    Ok(shoulders)
}

/// The most ordinary location of the shoulder: its index is the median of those outside of every region.
fn sound_cell(shoulder: &Shoulder<'_>) -> Result<DamageCell> {
    let is_sound = |cell: &&DamageCell| {
        cell.region == 0 && cell.damage_index.is_finite() && !shoulder.cracked.contains(&cell.location)
    };
    let mut cells: Vec<DamageCell> = shoulder.cells.iter().filter(is_sound).copied().collect();
    cells.sort_by(|a, b| a.damage_index.total_cmp(&b.damage_index));
    cells.get(cells.len() / 2).copied().context("the damaged shoulder has no sound location")
}

fn title(area: &Area<'_>, reader: &Reader, shoulder: &Shoulder<'_>, tap: &Tap) -> Result<()> {
    let Judgement { planned_count, received_count, limit_reject, .. } = shoulder.judgement;
    let Shoulder { scan, peak, .. } = shoulder;
    let head = format!("Tyre {}, shoulder {}: {}", scan.tyre, scan.shoulder, shoulder.verdict());
    canvas::write(area, &head, (28.0, 28.0), 21.0, INK, HPos::Left, true)?;
    let source = SourceKind::from_code(tap.header.source).map_or("", SourceKind::name);
    let region_count = regions(reader.plan().geometry, &shoulder.cells).len();
    let (index, deg) = (peak.damage_index, peak.angle_deg);
    let found = format!(
        "{received_count} of {planned_count} taps ({source}); regions of damage: {region_count}; \
         damage index up to {index:.2} at {deg:.0}°, rejected from {limit_reject:.2} on"
    );
    canvas::write(area, &found, (28.0, 53.0), 13.0, PALE_INK, HPos::Left, false)
}
