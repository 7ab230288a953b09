//! What an archive holds, shoulder by shoulder, in the form that the pages need.

pub(super) mod condition;
pub(super) mod samples;
pub(super) mod spectra;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use anyhow::Result;
use tapline_fuse::{Fusion, OffsetMap, ReferenceSet};
use tapline_store::{Judged, Reader, Region, regions};
use tapline_wire::{
    DamageCell, Discriminators, Geometry, Judgement, Quality, Reasons, Recording, Scan, Serial, SourceKind, TapState,
    Verdict,
};

use crate::config::Config;
use crate::config::reference::fusion_of;
use crate::report::evidence::condition::Condition;
use crate::shown::refused::RefusedTaps;
use crate::shown::whole::Whole;

/// Everything that the pages of one archive show, except samples.
pub(crate) struct Evidence {
    /// Name of the archive's file.
    pub archive: String,
    /// Number of further archives whose tyres were added.
    pub others: usize,
    pub plan_digest: u64,
    pub source_digest: u64,
    /// Version of the program that made the archive.
    pub written_by: Option<String>,
    /// The key of its lineage, which `explain` spells out.
    pub lineage_key: String,
    /// The text of the configuration.
    pub config_toml: String,
    /// The same, parsed; the defaults if this program cannot parse it.
    pub config: Config,
    /// The reference in the archive, if the run read one from a file and this program can read it.
    pub reference: Option<Arc<ReferenceSet>>,
    /// Why the configuration cannot be read.
    pub config_problem: Option<String>,
    pub geometry: Geometry,
    pub recording: Recording,
    /// What the taps came from.
    pub source: Option<SourceKind>,
    /// In the order of their first taps.
    pub tyres: Vec<Tyre>,
    /// Whether cracks are known of any location.
    pub has_truth: bool,
}

/// One casing.
pub(crate) struct Tyre {
    pub serial: Serial,
    pub shoulders: Vec<Shoulder>,
    /// The offset and velocity that show its damage best. Only these are drawn where all would be too many.
    pub condition: Option<Condition>,
}

/// One shoulder, or one line of a slab.
pub(crate) struct Shoulder {
    pub number: u16,
    pub station: u16,
    /// RE-INSPECT if nothing is judged, because a missing verdict is not a PASS.
    pub verdict: Verdict,
    pub reasons: Reasons,
    /// Why taps of it were refused.
    pub refused: Option<RefusedTaps>,
    /// Probabilities that a sound shoulder is not passed, and that it is rejected, for which the limits were set.
    pub rates: Option<[f64; 2]>,
    /// The evidence from which an arc is suspect, and from which it is damage.
    pub limits: Option<Limits>,
    /// How far the strongest arc stands out; the limits apply to it.
    pub strongest_arc: Option<f64>,
    /// The same for only the first reading, if anything was tapped again.
    pub first_strongest_arc: Option<f64>,
    pub whole: Whole,
    /// Ascending by location; without an index if nothing is judged.
    pub cells: Vec<Cell>,
    /// Whether its places are angles around a ring, and not numbers of locations.
    pub is_round: bool,
    pub regions: Vec<Region>,
    /// Every planned tap.
    pub taps: Vec<Tap>,
    /// The index of each offset by itself, ascending; empty if the plan has only one offset.
    pub offsets: Vec<OffsetMap>,
}

/// The two limits of a verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limits {
    pub re_inspect: f64,
    pub reject: f64,
}

/// One location.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cell {
    pub location: u32,
    /// Where it is drawn: degrees on a ring, the location's number on a line.
    pub place: f64,
    pub index: Option<f64>,
    /// Number of its region; 0 outside of all regions.
    pub region: u32,
    /// Whether it is known to be cracked or sound.
    pub is_cracked: Option<bool>,
}

/// One planned tap and what became of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tap {
    /// Row in the plan.
    pub row: u32,
    pub location: u32,
    /// As [`Cell::place`]; the closing tap of a ring is at the ring's end.
    pub place: f64,
    pub condition: Condition,
    pub repetition: u16,
    pub is_closing: bool,
    pub is_second_reading: bool,
    pub state: TapState,
    pub found: Option<Discriminators>,
    /// Time of the impact, ns since the Unix epoch.
    pub time_ns: Option<i64>,
}

impl Evidence {
    /// Reads the archive behind `reader`, which keeps `reference`.
    pub(crate) fn read(reader: &Reader, reference: Option<Arc<ReferenceSet>>) -> Result<Self> {
        let plan = reader.plan();
        let (mut config, config_problem) = match Config::parse(reader.config()) {
            Ok(config) => (config, None),
            Err(error) => (Config::default(), Some(format!("{error:#}"))),
        };
        let headers = reader.headers()?;
        let found = reader.discriminators()?;
        if let Some(set) = &reference {
            config.fuse.directions = set.directions;
        }
        let tap = |row: u32, places: &Places| {
            let planned = &plan.taps()[row as usize];
            let place = if planned.is_closing() { places.end } else { places.at(planned.id.location) };
            Tap {
                row,
                location: planned.id.location,
                place,
                condition: Condition::new(planned.id.offset_mm(), plan.velocity_nominal_m_per_s(row)),
                repetition: planned.id.repetition,
                is_closing: planned.is_closing(),
                is_second_reading: planned.is_second_reading(),
                state: reader.ledger().taps()[row as usize],
                found: found[row as usize],
                time_ns: headers[row as usize].map(|header| header.tap_time_ns),
            }
        };
        // Without a readable configuration there is no fusion, and no map of an offset.
        let fusion = fusion_of(reader, &config.fuse, reference.clone())?;
        let mut tyres = tyres(reader, fusion, tap)?;
        for tyre in &mut tyres {
            tyre.shoulders.sort_by_key(|shoulder| shoulder.number);
            tyre.condition = condition::strongest(&config.fuse, tyre);
        }
        let source = headers.iter().flatten().next().and_then(|header| SourceKind::from_code(header.source));
        Ok(Self {
            archive: reader.path().file_name().unwrap_or_default().to_string_lossy().into_owned(),
            others: 0,
            plan_digest: plan.digest(),
            source_digest: plan.source_digest(),
            written_by: reader.written_by(),
            lineage_key: reader.lineage_key()?,
            config_toml: reader.config().to_owned(),
            config,
            config_problem,
            reference,
            geometry: plan.geometry,
            recording: plan.recording.clone(),
            source,
            tyres,
            has_truth: !reader.truth().is_empty(),
        })
    }

    /// Adds the tyres of another archive; the description stays that of the first archive.
    pub(crate) fn join(&mut self, other: Self) {
        self.others += 1 + other.others;
        self.has_truth |= other.has_truth;
        self.config_problem = self.config_problem.take().or(other.config_problem);
        self.tyres.extend(other.tyres);
    }

    /// Every shoulder of every tyre.
    pub(crate) fn shoulders(&self) -> impl Iterator<Item = &Shoulder> {
        self.tyres.iter().flat_map(|tyre| &tyre.shoulders)
    }
}

/// The tyres of an archive, in the order of their first taps. `tap` makes the tap of a row, at one of the places of its shoulder.
fn tyres(reader: &Reader, mut fusion: Option<Fusion>, tap: impl Fn(u32, &Places) -> Tap) -> Result<Vec<Tyre>> {
    let plan = reader.plan();
    let mut tyres: Vec<Tyre> = Vec::new();
    for (number, (scan, judged)) in plan.scans().iter().zip(reader.judgements()?).enumerate() {
        // If one angle of a casing is unknown, all its shoulders are drawn by location.
        let mut located = plan.scans().iter().filter(|other| other.tyre == scan.tyre).flat_map(|scan| &scan.locations);
        let has_angles = located.all(|(_, angle_deg)| angle_deg.is_some());
        let places = Places::of_scan(plan.geometry == Geometry::Ring && has_angles, scan);
        let taps = scan.taps.iter().map(|&row| tap(row, &places)).collect();
        let verdict = reader.verdict(number, judged.as_ref());
        let mut shoulder = shoulder(reader, scan, &places, verdict, judged, taps)?;
        // The map of a single offset repeats the whole.
        let maps = fusion.as_mut().and_then(|fusion| fusion.by_offset(number).ok());
        shoulder.offsets = maps.filter(|maps| maps.len() > 1).unwrap_or_default();
        match tyres.iter_mut().find(|tyre| tyre.serial == scan.tyre) {
            Some(tyre) => tyre.shoulders.push(shoulder),
            None => tyres.push(Tyre { serial: scan.tyre, shoulders: vec![shoulder], condition: None }),
        }
    }
    Ok(tyres)
}

fn shoulder(
    reader: &Reader,
    scan: &Scan,
    places: &Places,
    (verdict, reasons): (Verdict, Reasons),
    judged: Option<Judged>,
    taps: Vec<Tap>,
) -> Result<Shoulder> {
    let cracked = |location| reader.truth().get(&(scan.tyre, scan.shoulder, location)).copied();
    let blank = |&(location, _): &(u32, Option<f64>)| DamageCell { location, ..DamageCell::default() };
    let (judgement, map) = judged.unwrap_or_else(|| (Judgement::default(), scan.locations.iter().map(blank).collect()));
    let cell = |cell: &DamageCell| Cell {
        location: cell.location,
        place: places.at(cell.location),
        index: Some(cell.damage_index).filter(|index| index.is_finite()),
        region: cell.region,
        is_cracked: cracked(cell.location),
    };
    let known = |value: f64| Some(value).filter(|value| value.is_finite());
    let qualities = || taps.iter().filter_map(|tap| tap.found.map(|found| found.quality));
    let limits = known(judgement.limit_re_inspect).zip(known(judgement.limit_reject));
    Ok(Shoulder {
        number: scan.shoulder,
        station: scan.station,
        verdict,
        reasons,
        refused: RefusedTaps::of(reader, scan, judgement.absent_count)?,
        rates: known(judgement.re_inspect_rate).zip(known(judgement.reject_rate)).map(Into::into),
        limits: limits.map(|(re_inspect, reject)| Limits { re_inspect, reject }),
        strongest_arc: known(judgement.strongest_arc),
        first_strongest_arc: known(judgement.first_strongest_arc),
        whole: Whole::new(&judgement, qualities),
        cells: map.iter().map(cell).collect(),
        is_round: places.is_round,
        regions: regions(reader.plan().geometry, &map),
        taps,
        offsets: Vec::new(),
    })
}

/// Positions of the locations of one shoulder in pictures.
struct Places {
    is_round: bool,
    places: BTreeMap<u32, f64>,
    end: f64,
}

impl Places {
    fn of_scan(is_round: bool, scan: &Scan) -> Self {
        let place = |&(location, angle_deg): &(u32, Option<f64>)| {
            (location, angle_deg.filter(|_| is_round).unwrap_or(f64::from(location)))
        };
        let places = scan.locations.iter().map(place).collect();
        let last = scan.locations.last().map_or(0, |&(location, _)| location);
        Self { is_round, places, end: if is_round { 360.0 } else { f64::from(last) } }
    }

    fn at(&self, location: u32) -> f64 {
        self.places.get(&location).copied().unwrap_or(if self.is_round { self.end } else { f64::from(location) })
    }
}

impl Tyre {
    /// The worst verdict of its shoulders, because one is enough to reject a casing.
    pub(crate) fn verdict(&self) -> Verdict {
        self.shoulders.iter().map(|shoulder| shoulder.verdict).max().unwrap_or(Verdict::ReInspect)
    }

    /// Whether the places of its shoulders are angles around a ring.
    pub(crate) fn is_round(&self) -> bool {
        self.shoulders.iter().all(|shoulder| shoulder.is_round)
    }

    /// Every tap of the tyre.
    pub(crate) fn taps(&self) -> impl Iterator<Item = &Tap> {
        self.shoulders.iter().flat_map(|shoulder| &shoulder.taps)
    }

    /// The stations that made its taps, ascending.
    pub(crate) fn stations(&self) -> BTreeSet<u16> {
        self.shoulders.iter().map(|shoulder| shoulder.station).collect()
    }

    /// The strongest arc of its shoulders, which the limits apply to.
    pub(crate) fn strongest_arc(&self) -> Option<f64> {
        self.shoulders.iter().filter_map(|shoulder| shoulder.strongest_arc).max_by(f64::total_cmp)
    }
}

impl Shoulder {
    /// Its reasons without those that merely follow from taps that were refused, which [`Shoulder::refused`] explains.
    pub(crate) fn reasons_left(&self) -> Reasons {
        let follows = self.refused.as_ref().map_or_else(Reasons::default, |refused| Reasons::named(&refused.covers));
        self.reasons.difference(follows)
    }

    /// The location with the highest index; of several equal ones, the middle one.
    pub(crate) fn peak(&self) -> Option<&Cell> {
        let known = || self.cells.iter().filter_map(|cell| cell.index.map(|index| (index, cell)));
        let highest = known().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let ceiling: Vec<&Cell> = known()
            .filter(|(index, cell)| index.total_cmp(&highest.0).is_eq() && cell.region == highest.1.region)
            .map(|(_, cell)| cell)
            .collect();
        ceiling.get(ceiling.len() / 2).copied()
    }

    /// The most ordinary location: its index is the median of the locations outside of regions.
    pub(crate) fn ordinary(&self) -> Option<&Cell> {
        let is_sound = |cell: &&Cell| cell.region == 0 && cell.index.is_some() && cell.is_cracked != Some(true);
        let mut cells: Vec<&Cell> = self.cells.iter().filter(is_sound).collect();
        cells.sort_by(|a, b| a.index.unwrap_or(f64::NAN).total_cmp(&b.index.unwrap_or(f64::NAN)));
        cells.get(cells.len() / 2).copied()
    }

    /// Number of taps in `state`.
    pub(crate) fn count(&self, state: TapState) -> usize {
        self.taps.iter().filter(|tap| tap.state == state).count()
    }
}

/// The number of `taps` with each flag, without flags that no tap has.
pub(crate) fn flags<'a>(taps: impl Iterator<Item = &'a Tap>) -> Vec<(Quality, usize)> {
    let qualities: Vec<Quality> = taps.filter_map(|tap| tap.found.map(|found| found.quality)).collect();
    let count = |flag| qualities.iter().filter(|quality| quality.contains(flag)).count();
    Quality::ALL.iter().map(|&(flag, _)| (flag, count(flag))).filter(|&(_, count)| count > 0).collect()
}
