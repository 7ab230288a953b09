//! The drift of the rig, from the first tap of a turn to its closing tap.

use std::collections::BTreeMap;

use tapline_wire::{Discriminator, Values};

use crate::fusion::Fusion;
use crate::stats::median;

/// What came at one offset and velocity.
#[derive(Default)]
struct Condition {
    all: Vec<Values>,
    /// The taps of the first location.
    first: Vec<Values>,
    closing: Vec<Values>,
}

impl Fusion {
    /// Change of each discriminator from the first location's taps to the closing tap at the same offset and velocity, over
    /// the median of all taps there; the median of all closing taps, NaN where there is none.
    pub(super) fn drift(&self, scan: usize) -> [f64; Discriminator::COUNT] {
        let planned = &self.plan.scans()[scan];
        let first = planned.locations.first().map(|&(location, _)| location);
        let mut conditions: BTreeMap<_, Condition> = BTreeMap::new();
        for &row in &planned.taps {
            let tap = &self.plan.taps()[row as usize];
            let Some(seen) = self.seen[row as usize].filter(|seen| !seen.is_refused) else { continue };
            let bits = |of: Option<f64>| of.map(f64::to_bits);
            let name = (bits(tap.id.offset_mm()), bits(self.plan.velocity_nominal_m_per_s(row)));
            let condition = conditions.entry(name).or_default();
            if tap.is_closing() {
                condition.closing.push(seen.values);
                continue;
            }
            condition.all.push(seen.values);
            if Some(tap.id.location) == first {
                condition.first.push(seen.values);
            }
        }
        Discriminator::ALL.map(|which| {
            let changes = |condition: &Condition| {
                let values = |of: &[Values]| of.iter().filter_map(|values| values.get(which)).collect::<Vec<f64>>();
                let first = values(&condition.first);
                let first = first.iter().sum::<f64>() / first.len() as f64;
                let level = median(&mut values(&condition.all)).unwrap_or(f64::NAN);
                let closing = values(&condition.closing).into_iter();
                closing.map(|last| (last - first) / level).filter(|change| change.is_finite()).collect::<Vec<f64>>()
            };
            median(&mut conditions.values().flat_map(changes).collect::<Vec<f64>>()).unwrap_or(f64::NAN)
        })
    }
}
