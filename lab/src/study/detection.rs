//! Which planted cracks are found, against their length across the shoulder.
//!
//! Size is the crack's length in mm: of its two lengths the one that bends. Depth goes with it as its own class, since a
//! crack of the same length is felt less the deeper it lies. A crack is found if a location of its arc lies in a region;
//! its response is its greatest index, which is
//! that of three neighbours: a longer arc finds cracks whose response is below the limit.

use crate::statistics::{AHat, HitMiss, Refusal, Scale, Signal, a_hat, hit_miss};
use anyhow::Result;
use tapline_fuse::FuseConfig;

use super::dataset::Dataset;
use super::judge::{ComparedWith, judge};
use super::sets::{Cracks, Set, cracked, sound};
use super::size::Size;
use super::table::{Table, cell, yes_or_no};

/// Depths in mm at which classes part.
const DEPTHS_MM: [f64; 4] = [6.0, 12.0, 18.0, 24.0];
/// The cracks that are looked for.
const CRACKS: Cracks =
    Cracks { depth_mm: (6.0, 24.0), length_mm: (4.0, 30.0), offset_mm: (0.0, 0.0), location_count: (1, 6) };

/// One planted crack and what became of it.
#[derive(Debug, Clone)]
pub(super) struct Target {
    pub length_mm: f64,
    pub depth_mm: f64,
    pub location_count: u32,
    pub is_found: bool,
    /// Greatest index along its arc.
    pub response: f64,
}

/// The targets of a class, with both curves or why there is none.
#[derive(Debug)]
pub(super) struct Detection {
    pub class: String,
    pub targets: Vec<Target>,
    pub hit_miss: Result<HitMiss, Refusal>,
    pub a_hat: Result<AHat, Refusal>,
}

/// Looks for the cracks of many tyres of `set`, by the default index and sound tyres of another serial.
pub(super) fn detection(set: &Set, size: &Size, seed: u64, threads: usize) -> Result<Vec<Detection>> {
    let references = (0..size.target_reference).map(|k| sound(format!("reference-{k:03}")));
    let targets = (0_u64..).take(size.target_tyres);
    let targets = targets.map(|k| cracked(format!("target-{k:03}"), &CRACKS, size.location_count, seed, 500_000 + k));
    let tyres: Vec<_> = references.chain(targets).collect();
    let dataset = Dataset::scan(&set.simulation, tyres.clone(), &size.turns, (seed, size.location_count, threads))?;
    let by = ComparedWith::File(dataset.reference(|tyre| tyre.starts_with("reference"))?);
    let judged = judge(&FuseConfig::default(), &dataset.of_tyres(|tyre| tyre.starts_with("target"))?, &by)?;
    let mut found = Vec::new();
    let mut limit = f64::NAN;
    for shoulder in &judged {
        limit = shoulder.limit;
        let cracks = tyres.iter().filter(|t| t.serial == shoulder.tyre).flat_map(|t| &t.crack);
        for crack in cracks.filter(|c| c.shoulder == shoulder.shoulder) {
            let arc = || {
                let places = (0..).zip(shoulder.index.iter().zip(&shoulder.is_called));
                places.filter(|&(l, _)| crack.covers(shoulder.shoulder, l, size.location_count)).map(|(_, place)| place)
            };
            found.push(Target {
                length_mm: crack.length_mm,
                depth_mm: crack.depth_mm,
                location_count: crack.location_count,
                is_found: arc().any(|(_, &is_called)| is_called),
                response: arc().map(|(&x, _)| x).filter(|x| !x.is_nan()).max_by(f64::total_cmp).unwrap_or(f64::NAN),
            });
        }
    }
    let mut classes = vec![Detection::new("all depths".to_owned(), found.clone(), limit)];
    for depths in DEPTHS_MM.windows(2) {
        let within = found.iter().filter(|t| (depths[0]..depths[1]).contains(&t.depth_mm)).cloned().collect();
        classes.push(Detection::new(format!("{} to {} mm deep", depths[0], depths[1]), within, limit));
    }
    Ok(classes)
}

impl Detection {
    fn new(class: String, targets: Vec<Target>, limit: f64) -> Self {
        let sizes: Vec<f64> = targets.iter().map(|t| t.length_mm).collect();
        let is_found: Vec<bool> = targets.iter().map(|t| t.is_found).collect();
        let responses: Vec<f64> = targets.iter().map(|t| t.response).collect();
        let signal = Signal { scale: Scale::Linear, threshold: limit, noise: None, saturation: None };
        Self { class, hit_miss: hit_miss(&sizes, &is_found), a_hat: a_hat(&sizes, &responses, signal), targets }
    }
}

/// The table of both curves.
pub(super) fn table(detections: &[Detection]) -> Table {
    let mut table = Table::new(
        "detection",
        "Finds against the length of the crack across the shoulder, in mm: by hit and miss, and by the response",
        &["class", "method", "targets", "found", "a50_mm", "a90_mm", "a90_95_mm", "remark"],
    );
    for d in detections {
        let found = d.targets.iter().filter(|t| t.is_found).count();
        let mut push = |method: &str, sizes: Result<[Option<f64>; 3], String>| {
            let (sizes, remark) = match sizes {
                Ok(sizes) => (sizes, String::new()),
                Err(why) => ([None; 3], why),
            };
            let head = [d.class.clone().into(), method.into(), d.targets.len().into(), found.into()];
            table.push(head.into_iter().chain(sizes.map(cell)).chain([remark.into()]));
        };
        let of_hits = d.hit_miss.as_ref().map(|h| [h.a50, h.a90, h.a90_95_likelihood]);
        push("hit or miss", of_hits.map_err(ToString::to_string));
        let of_responses = d.a_hat.as_ref().map(|a| [a.a50, a.a90, a.a90_95_likelihood]);
        push("response", of_responses.map_err(ToString::to_string));
    }
    table
}

/// Every target of all depths.
pub(super) fn targets_table(detections: &[Detection]) -> Table {
    let columns = ["length_mm", "depth_mm", "location_count", "found", "index"];
    let mut table = Table::long("targets", "Every crack looked for, with its greatest index", &columns);
    for t in detections.first().iter().flat_map(|d| &d.targets) {
        table.push([
            cell(t.length_mm),
            cell(t.depth_mm),
            (t.location_count as usize).into(),
            yes_or_no(t.is_found),
            cell(t.response),
        ]);
    }
    table
}
