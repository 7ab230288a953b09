//! From readings to the index map of a shoulder and the limits on it: the whole computation, without state.

use crate::index::{LocationIndex, Shoulder};
use crate::limits::Limits;
use crate::reference::Yardstick;
use crate::{FuseConfig, IndexKind};

/// Spreads above its centre at which a location of a shoulder that is its own reference leaves it.
///
/// On a recorded slab of which 22 % is cracked it raises the part of the crack that is suspect from
/// 0.09 to 0.6; on simulated sound rings it costs at most 3 false calls in 10 000 shoulders. At 3.5 it
/// costs twice as many and gains nothing.
const TRIM_AT: f64 = 4.0;

/// The same for a location's index alone, without the step along the ring: only what is beyond doubt leaves.
const TRIM_ALONE_AT: f64 = 5.0;

/// Fewest locations below their reference that put it in doubt: as many as the least crack has.
const INVERTED_MIN: usize = 3;

/// Fewest values, each with all of its neighbours in the reference, that the limits are taken from alone.
const UNTOUCHED_MIN: usize = 16;

/// Most rounds of trimming. Recorded and simulated sets settle within six.
const TRIM_ROUNDS_MAX: usize = 10;

/// Shoulders that are compared, by reference.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Comparison<'a> {
    /// The shoulders that make the reference.
    pub(crate) reference: &'a [Shoulder],
    /// The shoulder that is judged.
    pub(crate) judged: &'a Shoulder,
    /// Whether the judged shoulder is a part of the reference, which then may hold cracks.
    pub(crate) is_own: bool,
    /// Conditions of all of them.
    pub(crate) condition_count: usize,
}

/// The index map of one shoulder.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct IndexMap {
    /// Location by location, before the step along the ring.
    pub(crate) locations: Vec<LocationIndex>,
    /// The damage index of each location.
    pub(crate) index: Vec<Option<f64>>,
    /// What the reference allows; `None` where it allows no statement.
    pub(crate) limits: Option<Limits>,
    /// Whether locations lie as far below their own reference as damage lies above: then what is
    /// cracked may be the rule, and what stands out the sound rest.
    pub(crate) is_inverted: bool,
}

/// Which locations of each reference shoulder serve as reference.
type Kept = Vec<Vec<bool>>;

/// What a yardstick says of the reference shoulders themselves.
#[derive(Debug, Clone)]
struct Measured {
    yardstick: Yardstick,
    maps: Vec<Vec<Option<f64>>>,
    limits: Option<Limits>,
}

/// Whether the index is taken with or without the step along the ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Alone,
    AlongRing,
}

impl Comparison<'_> {
    /// The index map of the judged shoulder.
    pub(crate) fn map(&self, config: &FuseConfig) -> IndexMap {
        let all: Kept = self.reference.iter().map(|s| vec![true; s.ring.len()]).collect();
        let is_own = self.is_own && config.index == IndexKind::Robust;
        let Measured { yardstick, maps, limits } = if is_own {
            // Location by location first: the step along the ring makes five cracked ones of three, and many narrow
            // cracks would be the majority.
            let alone = self.trimmed(config, &all, Step::Alone);
            let along = self.trimmed(config, &alone, Step::AlongRing);
            self.measure(config, &along, &alone, Step::AlongRing)
        } else {
            self.measure(config, &all, &all, Step::AlongRing)
        };
        let (locations, index) = indexed(config.index, Step::AlongRing, &yardstick, self.judged);
        let is_below = |value: &f64| limits.is_some_and(|limits| limits.is_mirrored(*value));
        let below = maps.iter().flatten().flatten().filter(|&value| is_below(value)).count();
        let is_inverted = is_own && below >= INVERTED_MIN;
        IndexMap { locations, index, limits, is_inverted }
    }

    /// Those of `kept` that stay when the ones that stand out of them leave, round by round.
    fn trimmed(&self, config: &FuseConfig, kept: &Kept, step: Step) -> Kept {
        let mut now = kept.clone();
        for _ in 0..TRIM_ROUNDS_MAX {
            let measured = self.measure(config, &now, kept, step);
            let Some(limits) = measured.limits else { break };
            let at = if step == Step::Alone { TRIM_ALONE_AT } else { TRIM_AT };
            let next = within(kept, &measured.maps, &limits, at);
            if next == now || !is_majority(&next) {
                break;
            }
            now = next;
        }
        now
    }

    /// The yardstick of the kept locations, the reference's maps by it, and the limits of the kept of them.
    ///
    /// Along the ring only those give limits whose neighbours are all among `calm`: one that is cracked speaks in the
    /// mean of three.
    fn measure(&self, config: &FuseConfig, kept: &Kept, calm: &Kept, step: Step) -> Measured {
        let readings = self
            .reference
            .iter()
            .zip(kept)
            .flat_map(|(shoulder, kept)| shoulder.readings().iter().filter(|reading| kept[reading.place]));
        let yardstick = Yardstick::of(config, self.condition_count, readings);
        let maps: Vec<_> = self.reference.iter().map(|s| indexed(config.index, step, &yardstick, s).1).collect();
        let mut values = selected(&maps, kept);
        if step == Step::AlongRing {
            let untouched = selected(&maps, &self.untouched(kept, calm));
            values = if untouched.len() < UNTOUCHED_MIN { values } else { untouched };
        }
        let limits = Limits::of(config, &mut values);
        Measured { yardstick, maps, limits }
    }

    /// Those of `kept` that are amid `calm` ones.
    fn untouched(&self, kept: &Kept, calm: &Kept) -> Kept {
        let amid = self.reference.iter().zip(calm).map(|(shoulder, calm)| shoulder.ring.amid(calm));
        amid.zip(kept).map(|(amid, kept)| amid.into_iter().zip(kept).map(|(a, &k)| a && k).collect()).collect()
    }
}

fn indexed(
    kind: IndexKind,
    step: Step,
    yardstick: &Yardstick,
    shoulder: &Shoulder,
) -> (Vec<LocationIndex>, Vec<Option<f64>>) {
    let locations = shoulder.index(yardstick);
    let values: Vec<Option<f64>> = locations.iter().map(|l| l.value).collect();
    let index = match (kind, step) {
        (IndexKind::Robust, Step::AlongRing) => shoulder.ring.mean_of_3(&values),
        (IndexKind::Robust, Step::Alone) | (IndexKind::Dissertation, _) => values,
    };
    (locations, index)
}

/// Values of the places that are `kept`.
fn selected(maps: &[Vec<Option<f64>>], kept: &Kept) -> Vec<f64> {
    let of_kept = maps.iter().zip(kept).flat_map(|(map, kept)| map.iter().zip(kept));
    of_kept.filter(|&(_, &kept)| kept).filter_map(|(&value, _)| value).collect()
}

/// Those of `kept` whose value is at most `at` spreads above the centre.
fn within(kept: &Kept, maps: &[Vec<Option<f64>>], limits: &Limits, at: f64) -> Kept {
    let is_calm = |value: &Option<f64>| value.is_none_or(|v| limits.standardised(v) <= at);
    let stays = |(&kept, value): (&bool, &Option<f64>)| kept && is_calm(value);
    kept.iter().zip(maps).map(|(kept, map)| kept.iter().zip(map).map(stays).collect()).collect()
}

/// A reference of less than half its locations is none: then the cracks are the rule.
fn is_majority(kept: &Kept) -> bool {
    let count = kept.iter().flatten().count();
    2 * kept.iter().flatten().filter(|&&k| k).count() >= count
}

#[cfg(test)]
mod tests {
    use tapline_wire::{Discriminator, Geometry, Values};

    use super::*;
    use crate::reference::Reading;
    use crate::ring::Ring;

    /// One tap a location with a PR that rises by 1 from location to location in a scrambled order, and
    /// by `shift` in the first `cracked` of them.
    fn slab(count: u32, cracked: u32, shift: f64) -> Shoulder {
        let locations: Vec<_> = (0..count).map(|l| (l, None)).collect();
        let tap = |location: u32| {
            let mut values = Values::default();
            let scatter = f64::from(location * 37 % count);
            values.set(Discriminator::Pr, Some(scatter + if location < cracked { shift } else { 0.0 }));
            Reading { place: location as usize, condition: 0, values }
        };
        let ring = Ring::of(Geometry::Line, &locations, None);
        Shoulder::new(IndexKind::Robust, 1, ring, (0..count).map(tap).collect())
    }

    #[test]
    fn cracks_leave_a_reference_of_their_own() {
        // Catches a reference that stays spoiled by the cracks in it, and a stated one that is trimmed:
        // the sound locations, here the last 80, then lie below the reference's centre.
        let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::default() };
        let shoulder = slab(101, 20, 500.0);
        let sound = |is_own| {
            let reference = std::slice::from_ref(&shoulder);
            let map = Comparison { reference, judged: &shoulder, is_own, condition_count: 1 }.map(&config);
            let limits = map.limits.unwrap();
            let mut sound: Vec<f64> = map.index[21..].iter().map(|v| limits.standardised(v.unwrap())).collect();
            crate::stats::median(&mut sound).unwrap()
        };
        let (own, stated) = (sound(true), sound(false));
        assert!(own.abs() < 0.1 && stated < -0.2, "{own} {stated}");
    }

    #[test]
    fn a_minority_is_no_reference() {
        // Catches trimming until what is left agrees with itself.
        assert!(is_majority(&vec![vec![true, false], vec![true, false]]));
        assert!(!is_majority(&vec![vec![true, true, false], vec![false, false]]));
    }
}
