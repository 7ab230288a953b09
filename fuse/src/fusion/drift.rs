//! What the closing tap of a turn says: how far the rig has drifted since the first.

use std::collections::BTreeMap;

use tapline_wire::{Discriminator, TapId};

use crate::fusion::{Fusion, Seen};
use crate::stats::median;

impl Fusion {
    /// Change of each discriminator from the first location's tap to the closing tap of the same turn, over the median of the
    /// turn; the median of all turns, NaN where none has a closing tap.
    pub(super) fn drift(&self, scan: usize) -> [f64; Discriminator::COUNT] {
        let planned = &self.plan.scans()[scan];
        let Some(&(first, _)) = planned.locations.first() else { return [f64::NAN; Discriminator::COUNT] };
        let turn_of = |id: &TapId| {
            let bits = |of: Option<f64>| of.map(f64::to_bits);
            (bits(id.offset_mm()), bits(id.velocity_m_per_s()), id.repetition)
        };
        let mut turns: BTreeMap<_, Vec<(&Seen, bool, bool)>> = BTreeMap::new();
        for &row in &planned.taps {
            let tap = &self.plan.taps()[row as usize];
            if let Some(seen) = self.seen[row as usize].as_ref().filter(|seen| !seen.is_refused) {
                let is_first = tap.id.location == first && !tap.is_closing;
                turns.entry(turn_of(&tap.id)).or_default().push((seen, is_first, tap.is_closing));
            }
        }
        turns.retain(|_, taps| taps.iter().any(|&(_, _, is_closing)| is_closing));
        Discriminator::ALL.map(|which| {
            let change = |taps: &Vec<(&Seen, bool, bool)>| {
                let value = |(seen, ..): &(&Seen, bool, bool)| seen.values.get(which);
                let first = taps.iter().find(|(_, is_first, _)| *is_first).and_then(value)?;
                let last = taps.iter().find(|(.., is_closing)| *is_closing).and_then(value)?;
                let level = median(&mut taps.iter().filter_map(value).collect::<Vec<f64>>())?;
                Some((last - first) / level).filter(|change| change.is_finite())
            };
            median(&mut turns.values().filter_map(change).collect::<Vec<f64>>()).unwrap_or(f64::NAN)
        })
    }
}
