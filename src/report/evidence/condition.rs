//! Offset and velocity of a tap, and the condition that shows a tyre's damage best.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use tapline_draw::stats::{mean, median, spread};
use tapline_fuse::FuseConfig;
use tapline_wire::Discriminator;

use crate::report::evidence::{Shoulder, Tyre};

/// Offset and velocity of a tap, as integers, which can be compared exactly.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Condition {
    offset_um: Option<i64>,
    velocity_um_per_s: Option<i64>,
}

impl Condition {
    /// The condition of an offset in mm and a planned velocity in m/s.
    pub(crate) fn new(offset_mm: Option<f64>, velocity_m_per_s: Option<f64>) -> Self {
        let scaled = |value: f64, scale: f64| (value * scale).round() as i64;
        Self {
            offset_um: offset_mm.map(|value| scaled(value, 1e3)),
            velocity_um_per_s: velocity_m_per_s.map(|value| scaled(value, 1e6)),
        }
    }

    /// As text: "offset 5 mm, 1.85 m/s".
    pub(crate) fn words(self) -> String {
        let offset = self.offset_um.map(|um| format!("offset {} mm", um as f64 / 1e3));
        let velocity = self.velocity_um_per_s.map(|um| format!("{} m/s", (um as f64 / 1e4).round() / 1e2));
        let known: Vec<String> = offset.into_iter().chain(velocity).collect();
        if known.is_empty() { "offset and velocity not recorded".to_owned() } else { known.join(", ") }
    }

    /// Nearest to the belt edge first, then the fastest: the order of preference.
    fn preference(self) -> (i64, i64) {
        (self.offset_um.map_or(0, i64::abs), -self.velocity_um_per_s.unwrap_or(0))
    }
}

/// The condition under which the regions of `tyre` stand out most from its other locations; if there are no regions,
/// the fastest of those nearest to the belt edge. `None` if no tap is archived.
pub(crate) fn strongest(config: &FuseConfig, tyre: &Tyre) -> Option<Condition> {
    let mut conditions: Vec<Condition> =
        tyre.taps().filter(|tap| tap.found.is_some()).map(|tap| tap.condition).collect();
    conditions.sort_unstable_by_key(|condition| (condition.preference(), *condition));
    conditions.dedup();
    let judged = conditions.iter().map(|&condition| (contrast(config, tyre, condition), condition));
    // Of equal ones, the first is preferred.
    let better = |best: (Option<f64>, Condition), next: (Option<f64>, Condition)| match (best.0, next.0) {
        (Some(a), Some(b)) if b.total_cmp(&a) == Ordering::Greater => next,
        (None, Some(_)) => next,
        _ => best,
    };
    judged.reduce(better).map(|(_, condition)| condition)
}

/// How far the regions stand out from the other locations, in robust standard deviations of those, averaged over the
/// discriminators of the index. `None` if there are no regions, or nothing to compare.
fn contrast(config: &FuseConfig, tyre: &Tyre, condition: Condition) -> Option<f64> {
    let contrast_of = |&which: &Discriminator| {
        let (mut found, mut rest) = (Vec::new(), Vec::new());
        for shoulder in &tyre.shoulders {
            let means = location_means(shoulder, condition, which);
            for cell in &shoulder.cells {
                let Some(&value) = means.get(&cell.location) else { continue };
                if cell.region == 0 { rest.push(value) } else { found.push(value) }
            }
        }
        let (center, spread) = (median(&rest)?, spread(&rest).filter(|spread| *spread > 0.0)?);
        Some(config.directions.of(which).sign() * (mean(&found)? - center) / spread)
    };
    mean(&config.discriminators.iter().filter_map(contrast_of).collect::<Vec<f64>>())
}

/// How much the discriminators of the index change in region number `region` of `shoulder`: the mean in it divided by
/// the median outside all regions, the largest change first. Empty if there is nothing outside.
pub(crate) fn changes(
    config: &FuseConfig,
    shoulder: &Shoulder,
    condition: Condition,
    region: u32,
) -> Vec<(Discriminator, f64)> {
    let change_of = |&which: &Discriminator| {
        let means = location_means(shoulder, condition, which);
        let of = |number: u32| -> Vec<f64> {
            let cells = shoulder.cells.iter().filter(|cell| cell.region == number);
            cells.filter_map(|cell| means.get(&cell.location).copied()).collect()
        };
        let (rest, found) = (of(0), mean(&of(region))?);
        let (center, spread) = (median(&rest)?, spread(&rest).filter(|spread| *spread > 0.0)?);
        Some((which, found / center, ((found - center) / spread).abs())).filter(|_| center > 0.0)
    };
    let mut changes: Vec<_> = config.discriminators.iter().filter_map(change_of).collect();
    changes.sort_by(|a, b| b.2.total_cmp(&a.2));
    changes.into_iter().map(|(which, ratio, _)| (which, ratio)).collect()
}

/// The mean of a discriminator over the repetitions, by location; closing taps are left out.
pub(crate) fn location_means(shoulder: &Shoulder, condition: Condition, which: Discriminator) -> BTreeMap<u32, f64> {
    let mut values: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
    for tap in shoulder.taps.iter().filter(|tap| tap.condition == condition && !tap.is_closing) {
        if let Some(value) = tap.found.and_then(|found| found.values.get(which)) {
            values.entry(tap.location).or_default().push(value);
        }
    }
    values.into_iter().filter_map(|(location, values)| Some((location, mean(&values)?))).collect()
}
