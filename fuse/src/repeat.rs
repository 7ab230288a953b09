//! How well a tap that is repeated at the same place gives the same value again, as the reference's repetitions tell.

use crate::FuseConfig;
use crate::fit::Kept;
use crate::level::Level;
use crate::shares::{LANES, Shares};
use crate::shoulder::Shoulder;
use crate::yardstick::Yardstick;

/// Standard deviation of a repeated tap's score, by discriminator: the mean over the conditions that have one.
pub(crate) fn score_sds(yardstick: &Yardstick, repeats: &[Option<f64>]) -> Vec<Option<f64>> {
    let width = yardstick.width();
    let mean = |which: usize| {
        let slots = (which..repeats.len()).step_by(width);
        let sds = slots.filter_map(|slot| Some(repeats[slot]? / yardstick.sigma(slot)?)).filter(|sd| sd.is_finite());
        let (sum, count) = sds.fold((0.0, 0_u32), |(sum, count), sd| (sum + sd, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    };
    (0..width).map(mean).collect()
}

/// Standard deviation of a repeated tap's share of the level, by slot: pooled over the kept places with two taps and more.
pub(crate) fn repeat_sds(
    config: &FuseConfig,
    condition_count: usize,
    reference: &[Shoulder],
    kept: &Kept,
    levels: &[Level],
) -> Vec<Option<f64>> {
    let discriminators = config.directed();
    let width = discriminators.len();
    let mut pooled = vec![[(0.0, 0.0); LANES]; condition_count];
    for ((shoulder, kept), level) in reference.iter().zip(kept).zip(levels) {
        let shares = Shares::of(level, &discriminators, condition_count);
        let place_count = shoulder.ring.len();
        // By condition and place: a turn taps place after place in one condition.
        let mut places = vec![Repeats::default(); condition_count * place_count];
        for tap in shoulder.taps.iter().filter(|tap| kept[tap.place]) {
            places[tap.condition * place_count + tap.place].add(shares.of_reading(tap));
        }
        for (number, place) in places.iter().enumerate() {
            place.pool(&mut pooled[number / place_count]);
        }
    }
    let sd = |&(sum, free): &(f64, f64)| (free > 0.0).then(|| (sum / free).sqrt());
    pooled.iter().flat_map(|lanes| lanes[..width].iter().map(sd)).collect()
}

/// How often each discriminator came at one place in one condition, their means, and their sums of squares about them
/// (Welford).
#[derive(Clone, Default)]
struct Repeats {
    counts: [f64; LANES],
    means: [f64; LANES],
    squares: [f64; LANES],
}

impl Repeats {
    /// Takes in the shares of one more tap, of which those that are NaN did not come.
    fn add(&mut self, shares: [f64; LANES]) {
        let lanes = self.counts.iter_mut().zip(&mut self.means).zip(&mut self.squares);
        for (((count, mean), squares), share) in lanes.zip(shares) {
            let is_there = !share.is_nan();
            // What did not come is at the mean, which changes nothing.
            let share = if is_there { share } else { *mean };
            let off = share - *mean;
            *mean += off / (*count + 1.0);
            *squares += off * (share - *mean);
            *count += if is_there { 1.0 } else { 0.0 };
        }
    }

    /// Adds the sums of squares and their degrees of freedom.
    fn pool(&self, pooled: &mut [(f64, f64); LANES]) {
        for (lane, (sum, free)) in pooled.iter_mut().enumerate() {
            if self.counts[lane] > 1.0 && self.squares[lane].is_finite() {
                (*sum, *free) = (*sum + self.squares[lane], *free + self.counts[lane] - 1.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;
    use tapline_wire::{Discriminator, Geometry, Values};

    use super::*;
    use crate::ring::Ring;
    use crate::shoulder::Reading;

    const PLACES: usize = 4;
    const CONDITIONS: usize = 2;

    /// The slow twin: the values of each place and condition put together, their mean taken, then the squares about it.
    fn repeat_sds_slow(config: &FuseConfig, reference: &[Shoulder], kept: &Kept, levels: &[Level]) -> Vec<Option<f64>> {
        let discriminators = config.directed();
        let width = discriminators.len();
        let sd = |slot: usize| {
            let mut groups: BTreeMap<(usize, usize), Vec<f64>> = BTreeMap::new();
            for (number, shoulder) in reference.iter().enumerate() {
                let meant = shoulder.taps.iter().filter(|tap| tap.condition == slot / width && kept[number][tap.place]);
                for tap in meant {
                    let share = tap.values.get(discriminators[slot % width].0);
                    let share = share.and_then(|x| levels[number].share(slot, x));
                    groups.entry((number, tap.place)).or_default().extend(share);
                }
            }
            let repeated = groups.into_values().filter(|shares| shares.len() > 1);
            let (sum, free) = repeated.fold((0.0, 0), |(sum, free), shares| {
                let mean = shares.iter().sum::<f64>() / shares.len() as f64;
                (sum + shares.iter().map(|share| (share - mean).powi(2)).sum::<f64>(), free + shares.len() - 1)
            });
            (free > 0).then(|| (sum / free as f64).sqrt())
        };
        (0..CONDITIONS * width).map(sd).collect()
    }

    fn casing(tyre: usize, taps: Vec<Reading>) -> Shoulder {
        let locations: Vec<_> = (0..u32::try_from(PLACES).unwrap()).map(|l| (l, None)).collect();
        let ring = Ring::of(Geometry::Line, &locations, None);
        Shoulder { ring, tyre, taps, is_cracked: vec![None; PLACES] }
    }

    #[test]
    fn a_place_that_overflows_is_left_out() {
        // Catches one place's squares that make the spread of all infinite.
        let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::default() };
        let tap = |place: usize, pr: f64| {
            let mut values = Values::default();
            values.set(Discriminator::Pr, Some(pr));
            Reading { place, condition: 0, values }
        };
        let level = Level::of(&config.directed(), 1, [tap(0, 1.0)].iter());
        let taps = vec![tap(0, 1.7e308), tap(0, -1.7e308), tap(1, 1.0), tap(1, 1.2), tap(2, 5.0)];
        let sds = repeat_sds(&config, 1, &[casing(0, taps)], &vec![vec![true; PLACES]], &[level]);
        assert!(matches!(sds[..], [Some(sd)] if (sd - 0.02_f64.sqrt()).abs() < 1e-12), "{sds:?}");
    }

    proptest! {
        #[test]
        fn lanes_pool_what_groups_do(
            taps in prop::collection::vec(
                (0_usize..2, 0..PLACES, 0..CONDITIONS, prop::collection::vec(prop::option::weighted(0.8, 1.0..9.0_f64), 7)),
                0..80,
            ),
            kept in prop::collection::vec(any::<bool>(), 2 * PLACES),
        ) {
            // Catches a spread between places, conditions or casings that counts, places that are not kept, absent values
            // that count, and freedom of one tap too many.
            let config = FuseConfig::default();
            let of_casing = |number: usize| {
                let reading = |(_, place, condition, of): &(usize, usize, usize, Vec<Option<f64>>)| {
                    let mut values = Values::default();
                    Discriminator::ALL.into_iter().zip(of).for_each(|(which, value)| values.set(which, *value));
                    Reading { place: *place, condition: *condition, values }
                };
                casing(number, taps.iter().filter(|tap| tap.0 == number).map(reading).collect())
            };
            let reference = [of_casing(0), of_casing(1)];
            let levels = reference.each_ref().map(|s| Level::of(&config.directed(), CONDITIONS, s.taps.iter()));
            let kept: Kept = kept.chunks(PLACES).map(<[bool]>::to_vec).collect();
            let fast = repeat_sds(&config, CONDITIONS, &reference, &kept, &levels);
            let slow = repeat_sds_slow(&config, &reference, &kept, &levels);
            prop_assert_eq!(fast.len(), slow.len());
            for (fast, slow) in fast.into_iter().zip(slow) {
                prop_assert_eq!(fast.is_some(), slow.is_some());
                prop_assert!((fast.unwrap_or(0.0) - slow.unwrap_or(0.0)).abs() < 1e-9, "{:?} {:?}", fast, slow);
            }
        }
    }
}
