//! Which planted cracks are found, against their length across the shoulder.
//!
//! Size is the crack's length across the shoulder in mm, which bends. Each depth is a class of its own, since a
//! crack of the same length has less effect if deeper. A crack is found if a location of its arc lies in a region;
//! its response is its greatest index, which is
//! that of three neighbours: a longer arc finds cracks whose response is below the limit.

use crate::evaluation::{DETECTION_COLUMNS, Detection, Table, Target, cell, yes_or_no};
use anyhow::Result;
use tapline_fuse::FuseConfig;

use super::judge::judge;
use super::sets::{Cracks, Set, cracked, sound};
use super::size::Size;

/// Depths in mm between classes.
const DEPTHS_MM: [f64; 4] = [6.0, 12.0, 18.0, 24.0];
/// The cracks that are looked for.
const CRACKS: Cracks =
    Cracks { depth_mm: (6.0, 24.0), length_mm: (4.0, 30.0), offset_mm: (0.0, 0.0), location_count: (1, 6) };

/// Looks for the cracks of many tyres of `set`, with the default index and other sound tyres as reference.
pub(super) fn detection(set: &Set, size: &Size, seed: u64) -> Result<Vec<Detection>> {
    let references = (0..size.target_reference).map(|k| sound(format!("reference-{k:03}")));
    let targets = (0_u64..).take(size.target_tyres);
    let targets = targets.map(|k| cracked(format!("target-{k:03}"), &CRACKS, size.location_count, seed, 500_000 + k));
    let tyres: Vec<_> = references.chain(targets).collect();
    let dataset = size.turns.scan(&set.simulation, tyres.clone(), (seed, size.location_count))?;
    let by = dataset.reference(&FuseConfig::default(), |tyre| tyre.starts_with("reference"))?;
    let judged = judge(&FuseConfig::default(), &dataset.of_tyres(|tyre| tyre.starts_with("target"))?, Some(&by))?;
    let mut found = Vec::new();
    for shoulder in &judged {
        let cracks = tyres.iter().filter(|t| t.serial == shoulder.tyre).flat_map(|t| &t.crack);
        for crack in cracks.filter(|c| c.shoulder == shoulder.shoulder) {
            let arc = || {
                let places = (0..).zip(shoulder.index.iter().zip(&shoulder.is_called));
                places.filter(|&(l, _)| crack.covers(shoulder.shoulder, l, size.location_count)).map(|(_, place)| place)
            };
            found.push(Target {
                size_mm: crack.length_mm,
                depth_mm: Some(crack.depth_mm),
                location_count: crack.location_count,
                is_found: arc().any(|(_, &is_called)| is_called),
                response: arc().map(|(&x, _)| x).filter(|x| !x.is_nan()).max_by(f64::total_cmp).unwrap_or(f64::NAN),
                limit: shoulder.limit,
            });
        }
    }
    let mut classes = vec![Detection::new("all depths".to_owned(), found.clone())];
    for depths in DEPTHS_MM.windows(2) {
        let within = found
            .iter()
            .filter(|t| (depths[0]..depths[1]).contains(&t.depth_mm.unwrap_or(f64::NAN)))
            .cloned()
            .collect();
        classes.push(Detection::new(format!("{} to {} mm deep", depths[0], depths[1]), within));
    }
    Ok(classes)
}

pub(super) fn table(detections: &[Detection]) -> Table {
    let mut table = Table::new(
        "detection",
        "Finds against the length of the crack across the shoulder, in mm: by hit/miss, and by the response",
        DETECTION_COLUMNS,
    );
    detections.iter().for_each(|detection| detection.push(&mut table));
    table
}

/// Every target of all depths.
pub(super) fn targets_table(detections: &[Detection]) -> Table {
    let columns = ["length_mm", "depth_mm", "location_count", "found", "index", "limit"];
    let mut table = Table::long(
        "targets",
        "Every crack looked for, with its greatest index and the limit of its shoulder",
        columns,
    );
    for t in detections.first().iter().flat_map(|d| &d.targets) {
        table.push([
            cell(t.size_mm),
            cell(t.depth_mm),
            (t.location_count as usize).into(),
            yes_or_no(t.is_found),
            cell(t.response),
            cell(t.limit),
        ]);
    }
    table
}
