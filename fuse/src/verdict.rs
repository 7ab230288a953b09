//! From an index map and the state of its scan to regions, reasons and a verdict.

use tapline_wire::{DamageCell, Reasons, Verdict};

use crate::map::IndexMap;
use crate::ring::Ring;

/// The verdict that `reasons` demand: PASS only when there is none but that the shoulder was its own reference.
pub(crate) fn verdict_of(reasons: Reasons) -> Verdict {
    if reasons.contains(Reasons::DAMAGE) {
        Verdict::Reject
    } else if reasons.bits() & !Reasons::SELF_REFERENCE.bits() == 0 {
        Verdict::Pass
    } else {
        Verdict::ReInspect
    }
}

/// The cells of the damage map, and what it gives reason for.
pub(crate) fn cells_of(ring: &Ring, locations: &[(u32, Option<f64>)], map: &IndexMap) -> (Vec<DamageCell>, Reasons) {
    let regions = match &map.limits {
        Some(limits) => ring.regions(&map.index, limits.re_inspect, limits.grow),
        None => vec![0; ring.len()],
    };
    let cell = |place: usize| {
        let (location, angle_deg) = locations[place];
        let p_value = map.limits.and_then(|limits| Some(limits.p_value(map.index[place]?)));
        DamageCell {
            location,
            region: regions[place],
            angle_deg: angle_deg.unwrap_or(f64::NAN),
            damage_index: map.index[place].unwrap_or(f64::NAN),
            p_value: p_value.unwrap_or(f64::NAN),
            tap_count: map.locations[place].tap_count,
            absent_count: map.locations[place].absent_count,
        }
    };
    ((0..ring.len()).map(cell).collect(), reasons_of(&regions, map))
}

fn reasons_of(regions: &[u32], map: &IndexMap) -> Reasons {
    let mut reasons = Reasons::default();
    if map.index.iter().any(Option::is_none) {
        reasons.insert(Reasons::LOCATION_BLIND);
    }
    let Some(limits) = map.limits else {
        reasons.insert(Reasons::NO_INDEX);
        return reasons;
    };
    if map.is_inverted || map.index.iter().all(Option::is_none) {
        reasons.insert(Reasons::NO_INDEX);
    }
    // By the word of the reference, whose the limits are: a median of its own calls such a damage normal.
    let suspect = map.index.iter().flatten().filter(|&&value| value >= limits.re_inspect).count();
    if 2 * suspect > map.index.len() {
        reasons.insert(Reasons::NO_SOUND_MAJORITY);
    }
    for region in 1..=regions.iter().copied().max().unwrap_or(0) {
        let inside = regions.iter().zip(&map.index).filter(|&(&r, _)| r == region);
        let is_damage = inside.filter_map(|(_, &value)| value).any(|v| v >= limits.reject);
        reasons.insert(if is_damage { Reasons::DAMAGE } else { Reasons::SUSPECT });
    }
    reasons
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_no_reason_passes() {
        // Catches a verdict that forgets a reason: all sets of flags.
        for bits in 0..1 << 10 {
            let reasons = Reasons::from_bits(bits);
            let expected = match bits {
                0 | 128 => Verdict::Pass, // nothing, or SELF_REFERENCE
                _ if bits % 2 == 1 => Verdict::Reject,
                _ => Verdict::ReInspect,
            };
            assert_eq!(verdict_of(reasons), expected, "{reasons}");
        }
        assert_eq!(verdict_of(Reasons::from_bits(1 << 20)), Verdict::ReInspect, "a reason nobody knows yet");
    }
}
