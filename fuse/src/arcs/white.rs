//! Rings of white noise: the arcs of scores without any information.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::arcs::statistic::{ARC_MAX, ArcStatistic, Maps};
use crate::evidence::{Scatter, Sum, Vector, has_value};
use crate::index::Scores;
use crate::shoulder::ring::Ring;
use crate::stats::{mean_and_sd, median};

/// How many rings are drawn. The opposite of each counts as another ring. Against 6000 rings, the limits of a casing by itself are then
/// off by 1 % with one offset and by 1.5 % with four, as with 200 drawn rings.
const RING_COUNT: usize = 64;

/// What the rounding of sums in single precision may take from a bound, as a part of its square.
const ROUNDING_F32: f64 = 1e-4;

/// How the strongest arcs of rings of noise are distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct White {
    pub median: f64,
    pub sd: f64,
    /// How many discriminators they are the evidence of.
    pub width: usize,
    /// How many values of each the scatter was estimated from.
    pub value_count: usize,
}

/// The strongest arc of rings of noise that have values where `pattern` has; their scatter was estimated from `value_count` values.
///
/// The same for the same pattern: the seed is fixed.
pub(crate) fn strongest_arcs(
    statistic: &ArcStatistic,
    ring: &Ring,
    pattern: &Scores,
    value_count: usize,
) -> Option<White> {
    let statistic = statistic.of_white();
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    // What the offsets have in common, so that they are as correlated as those of the reference.
    let common = statistic.correlation().clamp(0.0, 1.0);
    let mut drawn = pattern.clone();
    let mut found: Vec<f64> = Vec::with_capacity(2 * RING_COUNT);
    let mut weakest = f64::INFINITY;
    let place_scatter = statistic.of_places().next()?;
    for _ in 0..RING_COUNT {
        for place in 0..ring.len() {
            let shared = if common > 0.0 { place_scatter.draw(&mut rng) } else { Vector::default() };
            for (drawn, pattern) in drawn.by_offset.iter_mut().zip(&pattern.by_offset) {
                if has_value(&pattern[place]) {
                    let own = place_scatter.draw(&mut rng);
                    let of_both =
                        |d: usize| common.sqrt() * shared[d] + (1.0 - common).sqrt() * own[d] + 0.0 * pattern[place][d];
                    drawn[place] = std::array::from_fn(of_both);
                }
            }
        }
        let maps = statistic.maps(&drawn.by_offset);
        let above = |least: f64| strongest_above(least, &statistic, ring, &maps);
        // Few rings show less than all that came before: most arcs are passed over from the first one on.
        let mut strongest = above(weakest);
        if strongest.contains(&None) {
            strongest = above(f64::NEG_INFINITY);
        }
        for value in strongest.into_iter().flatten() {
            weakest = if value < weakest { value } else { weakest };
            found.push(value);
        }
    }
    let width = place_scatter.used().count();
    Some(White { sd: mean_and_sd(&found)?.1, median: median(&mut found)?, width, value_count })
}

/// The evidence of the strongest arc of a ring, and of its opposite, if it is above `least`, as [`ArcStatistic::strongest`] finds it of a
/// statistic of noise. That is much faster, as arcs of every length scatter alike: the length of a sum of whitened scores tells what an
/// arc, and the opposite one, show at most, and few arcs are looked at.
fn strongest_above(least: f64, statistic: &ArcStatistic, ring: &Ring, maps: &Maps) -> [Option<f64>; 2] {
    // There is a first place: of a ring without places no reference is fitted.
    let mut most = [least; 2];
    for (scatter, map) in statistic.of_places().zip(maps) {
        let mut arcs = Whitened::of(scatter, map);
        for length in 1..=ARC_MAX {
            arcs.grow(length);
            for start in 0..ring.len() {
                let lesser = if most[0] < most[1] { most[0] } else { most[1] };
                if arcs.is_bounded_by(start, lesser) {
                    continue;
                }
                // Where the ring has an end, or is shorter, this is an arc that was looked at before.
                let mut scores = Sum::default();
                ring.from(start).take(length).for_each(|place| scores.add(&map[place]));
                let scores = scores.over_root();
                for (most, scores) in most.iter_mut().zip([scores, scores.map(|x| -x)]) {
                    *most = scatter.evidence_above(*most, &scores).unwrap_or(*most);
                }
            }
        }
    }
    most.map(|most| (most > least).then_some(most))
}

/// The whitened sums of all arcs of one length, by their first place: all starts together, so that the compiler can use vectors.
struct Whitened {
    /// `[discriminator][place]`, around the ring and on as far as the longest arc reaches; 0 of a place without a value.
    places: Vec<Vec<f32>>,
    /// 1 of a place with a value, else 0.
    counts: Vec<f32>,
    /// `[discriminator][start]`.
    sums: Vec<Vec<f32>>,
    /// The squared lengths of those sums, and how many values each is a sum of.
    squares: Vec<f32>,
    value_counts: Vec<f32>,
}

impl Whitened {
    /// Of arcs of no place.
    fn of(scatter: &Scatter, map: &[Vector]) -> Self {
        let of_place = |scores: &Vector| has_value(scores).then(|| scatter.whitened(scores));
        let whitened: Vec<Option<Vector>> = map.iter().map(of_place).collect();
        let around = || whitened.iter().cycle().take(map.len() + ARC_MAX);
        let of = |d: usize| around().map(|place| place.map_or(0.0, |place| place[d] as f32)).collect();
        let places: Vec<Vec<f32>> = scatter.used().map(of).collect();
        Self {
            counts: around().map(|place| f32::from(u8::from(place.is_some()))).collect(),
            sums: vec![vec![0.0; map.len()]; places.len()],
            squares: vec![0.0; map.len()],
            value_counts: vec![0.0; map.len()],
            places,
        }
    }

    /// Makes the arcs `length` places long, which before were one shorter: each place is added once.
    fn grow(&mut self, length: usize) {
        self.squares.fill(0.0);
        for (sums, places) in self.sums.iter_mut().zip(&self.places) {
            for ((sum, square), place) in sums.iter_mut().zip(&mut self.squares).zip(&places[length - 1..]) {
                *sum += place;
                *square += *sum * *sum;
            }
        }
        self.value_counts.iter_mut().zip(&self.counts[length - 1..]).for_each(|(sum, count)| *sum += count);
    }

    /// Whether the evidence of the arc from `start`, and of its opposite, is surely no more than `most`, or the arc has no value. An arc
    /// that lacks a discriminator somewhere has no length, which nothing bounds.
    fn is_bounded_by(&self, start: usize, most: f64) -> bool {
        let limit = (most * most * (1.0 - ROUNDING_F32)) as f32;
        let count = self.value_counts[start];
        count <= 0.0 || most > 0.0 && self.squares[start] <= limit * count
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tapline_wire::Geometry;

    use super::*;
    use crate::evidence::ABSENT;

    proptest! {
        /// Catches an arc, or an opposite one, that is passed over although it is the strongest: over the seam, behind a place without
        /// a value, and where a discriminator is absent.
        #[test]
        fn the_strongest_arc_is_that_of_the_statistic(
            values in prop::collection::vec(
                prop::collection::vec(prop::collection::vec(prop_oneof![20 => -3.0..3.0_f64, 1 => Just(f64::NAN)], 3), 30), 1..4),
            is_ring: bool, seed in 0_usize..30, count in 1_usize..31, is_gapped: bool
        ) {
            let geometry = if is_ring { Geometry::Ring } else { Geometry::Line };
            // A location that was skipped parts its neighbours.
            let skipped = |place: usize| u32::from(is_gapped && 2 * place >= count) * 3;
            let locations: Vec<_> = (0..count).map(|place| (place as u32 + skipped(place), None)).collect();
            let ring = Ring::of(geometry, &locations, None);
            let vector = |of: &Vec<f64>| std::array::from_fn(|d| of.get(d).copied().unwrap_or(f64::NAN));
            let mut by_offset: Vec<Vec<Vector>> = values.iter().map(|of| of[..count].iter().map(vector).collect()).collect();
            by_offset.iter_mut().for_each(|of_offset| of_offset[seed % count] = ABSENT);
            let scores = Scores { by_offset, ..Scores::default() };
            let offsets = (0..values.len()).collect();
            let statistic = ArcStatistic::fit(offsets, &[(&ring, scores.clone())], false).of_white();
            let maps = statistic.maps(&scores.by_offset);
            let opposite: Maps = maps.iter().map(|map| map.iter().map(|scores| scores.map(|x| -x)).collect()).collect();
            let expected = [&maps, &opposite].map(|maps| statistic.strongest(&ring, maps).map(|arc| arc.value));
            prop_assert_eq!(strongest_above(f64::NEG_INFINITY, &statistic, &ring, &maps), expected);
            for least in [0.0, 1.0, 2.0, 3.0, 4.0] {
                let expected = expected.map(|found| found.filter(|value| *value > least));
                prop_assert_eq!(strongest_above(least, &statistic, &ring, &maps), expected);
            }
        }
    }
}
