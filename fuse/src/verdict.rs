//! From an index map and the state of its scan to regions, reasons and a verdict.

use tapline_wire::{DamageCell, Reasons, Verdict};

use crate::Extent;
use crate::hidden::{Hidden, fitted_shift, hidden_states};
use crate::limits::Limits;
use crate::ring::Ring;
use crate::standard::IndexMap;
use crate::stats::Spread;

/// Reasons that tell how a verdict was reached and ask for nothing.
const REMARKS: [Reasons; 2] = [Reasons::SELF_REFERENCE, Reasons::FELL_BACK];

/// The verdict that `reasons` demand: PASS only when there is none but remarks.
pub(crate) fn verdict_of(reasons: Reasons) -> Verdict {
    if reasons.contains(Reasons::DAMAGE) {
        Verdict::Reject
    } else if REMARKS.iter().fold(reasons.bits(), |bits, remark| bits & !remark.bits()) == 0 {
        Verdict::Pass
    } else {
        Verdict::ReInspect
    }
}

/// A shoulder's map with all that its verdict rests on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) ring: &'a Ring,
    /// Locations with their angles.
    pub(crate) locations: &'a [(u32, Option<f64>)],
    pub(crate) map: &'a IndexMap,
    pub(crate) limits: Option<Limits>,
    /// Spread of a location's index at sound places, before the step along the ring.
    pub(crate) usual: Option<Spread>,
    /// Taps that a location of the reference usually has.
    pub(crate) usual_tap_count: f64,
    /// Whether the casing lies below its own level as damage lies above.
    pub(crate) is_inverted: bool,
}

impl View<'_> {
    /// The number of the region of each location; 0 outside of every one.
    pub(crate) fn regions(&self, extent: Extent) -> Vec<u32> {
        let Some(limits) = self.limits else { return vec![0; self.ring.len()] };
        let states = match extent {
            Extent::Half => None,
            Extent::Hidden => self.states(),
        };
        let Some(is_cracked) = states else {
            return self.ring.regions(&self.map.index, limits.re_inspect, limits.grow);
        };
        let is_suspect = |place: usize| self.map.index[place].is_some_and(|value| value >= limits.re_inspect);
        self.ring.numbered(|place| is_cracked[place] || is_suspect(place), is_suspect)
    }

    /// Most likely states of the locations, by their index before the step along the ring.
    fn states(&self) -> Option<Vec<bool>> {
        let Spread { centre, sigma } = self.usual?;
        let z: Vec<Option<f64>> = self.map.locations.iter().map(|l| l.value.map(|v| (v - centre) / sigma)).collect();
        let is_ring = self.ring.is_closed();
        // The defaults are within their bounds, and a shift that is fitted stays within them.
        let shift = fitted_shift(&z, is_ring, Hidden::default()).ok()?;
        Some(hidden_states(&z, is_ring, Hidden { shift, ..Hidden::default() }).ok()?.is_cracked)
    }

    /// Half width of the guard band at `place`: a location that fewer taps speak for scatters more.
    fn guard(&self, place: usize) -> Option<f64> {
        let tap_count = f64::from(self.map.locations[place].tap_count);
        let share = if tap_count < self.usual_tap_count { self.usual_tap_count / tap_count } else { 1.0 };
        Some(self.limits?.guard * share.sqrt()).filter(|guard| guard.is_finite())
    }

    /// The cells of the damage map, with the `regions` that its locations lie in.
    pub(crate) fn cells(&self, regions: &[u32]) -> Vec<DamageCell> {
        let cell = |place: usize| {
            let (location, angle_deg) = self.locations[place];
            let p_value = self.limits.and_then(|limits| Some(limits.p_value(self.map.index[place]?)));
            DamageCell {
                location,
                region: regions[place],
                angle_deg: angle_deg.unwrap_or(f64::NAN),
                damage_index: self.map.index[place].unwrap_or(f64::NAN),
                p_value: p_value.unwrap_or(f64::NAN),
                guard: self.map.index[place].and(self.guard(place)).unwrap_or(f64::NAN),
                tap_count: self.map.locations[place].tap_count,
                absent_count: self.map.locations[place].absent_count,
                ..DamageCell::default()
            }
        };
        (0..self.ring.len()).map(cell).collect()
    }

    /// What the map gives reason for.
    pub(crate) fn reasons(&self, regions: &[u32]) -> Reasons {
        let index = &self.map.index;
        let mut reasons = Reasons::default();
        if index.iter().any(Option::is_none) {
            reasons.insert(Reasons::LOCATION_BLIND);
        }
        let Some(limits) = self.limits else {
            reasons.insert(Reasons::NO_INDEX);
            return reasons;
        };
        if self.is_inverted || index.iter().all(Option::is_none) {
            reasons.insert(Reasons::NO_INDEX);
        }
        // By the word of the reference, whose the limits are: a median of its own calls such a damage normal.
        let suspect = index.iter().flatten().filter(|&&value| value >= limits.re_inspect).count();
        if 2 * suspect > index.len() {
            reasons.insert(Reasons::NO_SOUND_MAJORITY);
        }
        let exceeds = |place: usize| {
            let limit = self.guard(place).map(|guard| limits.re_inspect + guard);
            matches!((index[place], limit), (Some(value), Some(limit)) if value >= limit)
        };
        for region in 1..=regions.iter().copied().max().unwrap_or(0) {
            let is_damage = (0..index.len()).any(|place| regions[place] == region && exceeds(place));
            reasons.insert(if is_damage { Reasons::DAMAGE } else { Reasons::SUSPECT });
        }
        reasons
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_no_reason_passes() {
        // Catches a verdict that forgets a reason: all sets of flags.
        let known = Reasons::ALL.iter().fold(0, |bits, (flag, _)| bits | flag.bits());
        let remarks = Reasons::SELF_REFERENCE.bits() | Reasons::FELL_BACK.bits();
        for bits in 0..=known {
            let reasons = Reasons::from_bits_retain(bits);
            let expected = if reasons.contains(Reasons::DAMAGE) {
                Verdict::Reject
            } else if bits & !remarks == 0 {
                Verdict::Pass
            } else {
                Verdict::ReInspect
            };
            assert_eq!(verdict_of(reasons), expected, "{reasons}");
        }
        assert_eq!(verdict_of(Reasons::from_bits_retain(1 << 20)), Verdict::ReInspect, "a reason nobody knows yet");
    }
}
