//! What the closing tap of a turn tells: how far the rig has drifted since the first.

use tapline_wire::Discriminator;

use crate::compare::Compared;
use crate::fusion::Fusion;
use crate::stats::median;

impl Fusion {
    /// Change of each discriminator from the first location's taps to the closing tap in the same condition, as a share of
    /// the casing's level, the median of all closing taps; NaN where there is none.
    ///
    /// Only what the index is formed of has a level to be a share of.
    pub(crate) fn drift(&self, scan: usize, compared: &Compared) -> [f64; Discriminator::COUNT] {
        let planned = &self.plan.scans()[scan];
        let level = &compared.casing.levels[compared.number];
        let discriminators = compared.standard.fit.yardstick().discriminators();
        let Some(&(first_location, _)) = planned.locations.first() else { return [f64::NAN; Discriminator::COUNT] };
        let mut changes: [Vec<f64>; Discriminator::COUNT] = Default::default();
        // Shares of the level at the first location, and at the end, by slot.
        let slot_count = compared.conditions.count() * discriminators.len();
        let mut first = vec![(0.0, 0_u32); slot_count];
        let mut closing: Vec<(usize, Discriminator, f64)> = Vec::new();
        for &row in &planned.taps {
            let tap = &self.plan.taps()[row as usize];
            let is_first = tap.id.location == first_location && !tap.is_closing;
            let seen = self.seen[row as usize].filter(|seen| !seen.is_refused);
            let (Some(seen), true) = (seen, is_first || tap.is_closing) else { continue };
            let meant = tap.id.with_velocity_m_per_s(self.plan.velocity_nominal_m_per_s(row)).unwrap_or(tap.id);
            let Some(condition) = compared.conditions.number(&meant) else { continue };
            for (slot, &(which, _)) in (condition * discriminators.len()..).zip(discriminators) {
                let Some(share) = seen.values.get(which).and_then(|x| level.share(slot, x)) else { continue };
                if tap.is_closing {
                    closing.push((slot, which, share));
                } else {
                    first[slot] = (first[slot].0 + share, first[slot].1 + 1);
                }
            }
        }
        for (slot, which, share) in closing {
            let (sum, count) = first[slot];
            if count > 0 {
                changes[which as usize].push(share - sum / f64::from(count));
            }
        }
        changes.map(|mut changes| median(&mut changes).filter(|m| m.is_finite()).unwrap_or(f64::NAN))
    }
}
