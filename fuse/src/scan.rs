//! The circular scan statistic: the arc of the ring that stands out most, at several lengths at once.
//!
//! References: Kulldorff, Communications in Statistics 26 (1997) 1481; Olshen and others, Biostatistics 5 (2004) 557.

use tapline_wire::Geometry;

use crate::shuffles::{LANES, Shuffles};

/// Lengths of arcs that are looked at, in locations: from the least crack to a fifth of a ring.
pub const ARC_LENGTHS: [usize; 7] = [1, 2, 3, 5, 8, 13, 20];

/// An arc of a ring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc {
    /// Its first place.
    pub first: usize,
    /// How many places it has, those without a value counted too.
    pub length: usize,
    /// Sum of its values over the root of their count: a standard normal where all of the ring is sound and white.
    pub value: f64,
}

/// How a scan's chance is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Permutation {
    /// Places that stay together: as many as neighbours are known to be alike over.
    pub block_length: usize,
    /// How many permutations are drawn; the least chance that can be found is one over this and one.
    pub count: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for Permutation {
    fn default() -> Self {
        Self { block_length: 3, count: 499, seed: 1 }
    }
}

/// The arc of the ring or line of `z` with the largest sum over the root of its count, the first of equals.
///
/// A place without a value, or whose value is no number, adds neither to the sum nor to the count. Arcs as long as the
/// ring and longer are not looked at; `None` when no arc has a value. O(places x lengths) by prefix sums.
pub fn scan(z: &[Option<f64>], geometry: Geometry) -> Option<Arc> {
    let mut prefix = Prefix::default();
    prefix.fill(z.iter().copied());
    prefix.best(geometry)
}

/// The highest arcs of rings whose places are those of `z`, exchanged in blocks: ascending, one a permutation that has any.
///
/// Places without a value are closed up first: what is left of the ring is the background that chance has to offer.
pub fn arc_null(z: &[Option<f64>], geometry: Geometry, permutation: Permutation) -> Vec<f64> {
    let values = background(z);
    arc_null_by(&values, geometry, &Shuffles::draw(values.len(), permutation))
}

/// The values that a permutation exchanges.
pub(crate) fn background(z: &[Option<f64>]) -> Vec<f64> {
    z.iter().flatten().copied().filter(|value| value.is_finite()).collect()
}

/// [`arc_null`] of `values` by permutations of as many places that were drawn before.
///
/// Several permutations go side by side, so that none waits for its own last sum.
pub(crate) fn arc_null_by(values: &[f64], geometry: Geometry, shuffles: &Shuffles) -> Vec<f64> {
    let mut sums = Vec::new();
    let mut highest = Vec::with_capacity(shuffles.count());
    for (lane_count, places) in shuffles.side_by_side() {
        sum_up(&mut sums, values, geometry, places);
        let of_lanes = highest_of_lanes(&sums, values.len(), geometry, [true; ARC_LENGTHS.len()]);
        highest.extend(of_lanes[..lane_count].iter().copied().filter(|value| value.is_finite()));
    }
    highest.sort_unstable_by(f64::total_cmp);
    highest
}

/// Fills in the `sums` of the first n places of permutations side by side, run through twice as far as arcs reach.
pub(crate) fn sum_up(sums: &mut Vec<[f64; LANES]>, values: &[f64], geometry: Geometry, places: &[[u32; LANES]]) {
    let end = lengths(values.len(), geometry).map(|(length, first_count)| length + first_count).max().unwrap_or(0);
    let mut sum = [0.0; LANES];
    sums.clear();
    sums.reserve(end);
    sums.push(sum);
    for places in places.iter().chain(places).take(end.saturating_sub(1)) {
        for (sum, &place) in sum.iter_mut().zip(places) {
            *sum += values[place as usize];
        }
        sums.push(sum);
    }
}

/// The chance that a ring whose places are exchangeable in blocks has an arc as high as the highest of `z`: one chance for
/// all places and lengths together. `None` when no arc has a value.
///
/// An arc that is real takes part in its own permutations: one that two blocks hold comes together again in about one of
/// as many permutations as there are blocks, so that a block should not be longer than a third of the arcs that count.
pub fn scan_p_value(z: &[Option<f64>], geometry: Geometry, permutation: Permutation) -> Option<f64> {
    let found = scan(z, geometry)?.value;
    let null = arc_null(z, geometry, permutation);
    let at_least = null.len() - null.partition_point(|&value| value < found);
    // The ring as it is is one of them.
    Some((at_least + 1) as f64 / (permutation.count as f64 + 1.0))
}

/// Sums and counts of the first n places of the ring, run through twice.
#[derive(Default)]
struct Prefix {
    sums: Vec<f64>,
    counts: Vec<f64>,
}

impl Prefix {
    fn fill(&mut self, z: impl Iterator<Item = Option<f64>> + Clone) {
        self.sums.clear();
        self.counts.clear();
        self.sums.push(0.0);
        self.counts.push(0.0);
        let (mut sum, mut count) = (0.0, 0.0);
        for value in z.clone().chain(z) {
            if let Some(value) = value.filter(|v| v.is_finite()) {
                sum += value;
                count += 1.0;
            }
            self.sums.push(sum);
            self.counts.push(count);
        }
    }

    fn best(&self, geometry: Geometry) -> Option<Arc> {
        let mut best: Option<Arc> = None;
        for (length, first_count) in lengths(self.sums.len() / 2, geometry) {
            for first in 0..first_count {
                let count = self.counts[first + length] - self.counts[first];
                let value = (self.sums[first + length] - self.sums[first]) / count.sqrt();
                if count > 0.0 && value.is_finite() && best.is_none_or(|best| value > best.value) {
                    best = Some(Arc { first, length, value });
                }
            }
        }
        best
    }
}

/// Every length that is looked at on a ring or line of so many places, and how many arcs of it there are.
pub(crate) fn lengths(place_count: usize, geometry: Geometry) -> impl Iterator<Item = (usize, usize)> {
    let lengths = ARC_LENGTHS.into_iter().take_while(move |&length| length < place_count);
    lengths.map(move |length| match geometry {
        Geometry::Ring => (length, place_count),
        Geometry::Line => (length, place_count - length + 1),
    })
}

/// The value of [`Prefix::best`] for rings or lines side by side of which every place has a value, negative infinity where
/// it has none; `sums` are those of a [`Prefix`] each, as far as arcs reach. Of [`ARC_LENGTHS`] only those asked for count.
pub(crate) fn highest_of_lanes(
    sums: &[[f64; LANES]],
    place_count: usize,
    geometry: Geometry,
    is_asked: [bool; ARC_LENGTHS.len()],
) -> [f64; LANES] {
    let larger = |a: f64, b: f64| if b > a { b } else { a };
    let mut highest = [f64::NEG_INFINITY; LANES];
    for ((length, first_count), _) in lengths(place_count, geometry).zip(is_asked).filter(|&(_, is_asked)| is_asked) {
        let mut most = [f64::NEG_INFINITY; LANES];
        for (starts, ends) in sums[..first_count].iter().zip(&sums[length..]) {
            for ((most, start), end) in most.iter_mut().zip(starts).zip(ends) {
                *most = larger(*most, end - start);
            }
        }
        let root = (length as f64).sqrt();
        highest = std::array::from_fn(|lane| larger(highest[lane], most[lane] / root));
    }
    highest
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;
    use crate::resample::Blocks;

    /// The highest arc of one ring or line, alone in the last of the lanes.
    fn highest_of(sums: &[f64], geometry: Geometry) -> Option<f64> {
        let in_last = |&sum: &f64| std::array::from_fn(|lane| if lane + 1 == LANES { sum } else { 0.0 });
        let sums: Vec<[f64; LANES]> = sums.iter().map(in_last).collect();
        Some(highest_of_lanes(&sums, sums.len() / 2, geometry, [true; ARC_LENGTHS.len()])[LANES - 1])
            .filter(|value| value.is_finite())
    }

    /// The slow twin: permutation after permutation, all of its arcs by [`Prefix::best`].
    fn arc_null_slow(z: &[Option<f64>], geometry: Geometry, permutation: Permutation) -> Vec<f64> {
        let values = background(z);
        let mut blocks = Blocks::new(permutation.block_length, permutation.seed);
        let mut places = vec![0; values.len()];
        let mut prefix = Prefix::default();
        let mut highest = Vec::new();
        for _ in 0..permutation.count {
            blocks.permute(&mut places);
            prefix.fill(places.iter().map(|&place| Some(values[place])));
            highest.extend(prefix.best(geometry).map(|arc| arc.value));
        }
        highest.sort_by(f64::total_cmp);
        highest
    }

    proptest! {
        #[test]
        fn permutations_side_by_side_are_those_one_by_one(
            z in prop::collection::vec(prop::option::weighted(0.9, -9.0..9.0), 0..110),
            (is_ring, count, block_length, seed) in (any::<bool>(), 0_usize..40, 1_usize..6, any::<u64>()),
        ) {
            // Catches a lane that is lost or counted twice, sums that end before the arcs do, another order of draws.
            let geometry = if is_ring { Geometry::Ring } else { Geometry::Line };
            let permutation = Permutation { block_length, count, seed };
            let bits = |of: Vec<f64>| of.into_iter().map(f64::to_bits).collect::<Vec<_>>();
            prop_assert_eq!(bits(arc_null(&z, geometry, permutation)), bits(arc_null_slow(&z, geometry, permutation)));
        }
    }

    /// The slow twin: every arc summed on its own.
    fn scan_slow(z: &[Option<f64>]) -> Option<f64> {
        let arcs = ARC_LENGTHS.into_iter().filter(|&l| l < z.len()).flat_map(|l| (0..z.len()).map(move |f| (f, l)));
        let value = |(first, length): (usize, usize)| {
            let inside: Vec<f64> = (first..first + length).filter_map(|p| z[p % z.len()]).collect();
            (!inside.is_empty()).then(|| inside.iter().sum::<f64>() / (inside.len() as f64).sqrt())
        };
        arcs.filter_map(value).max_by(f64::total_cmp)
    }

    proptest! {
        #[test]
        fn prefix_sums_find_what_sums_find(z in prop::collection::vec(prop::option::of(-9.0..9.0), 0..50)) {
            // Catches an arc that ends at the seam, one too long, and gaps that count.
            match (scan(&z, Geometry::Ring), scan_slow(&z)) {
                (None, None) => {}
                (Some(fast), Some(slow)) => prop_assert!((fast.value - slow).abs() < 1e-9, "{:?} {}", fast, slow),
                other => prop_assert!(false, "{:?}", other),
            }
        }
    }

    proptest! {
        #[test]
        fn vectors_find_what_single_arcs_find(z in prop::collection::vec(-9.0..9.0, 0..60), is_ring in any::<bool>()) {
            // Catches arcs left out at the end of a vector, and a root of another length.
            let mut prefix = Prefix::default();
            prefix.fill(z.into_iter().map(Some));
            let geometry = if is_ring { Geometry::Ring } else { Geometry::Line };
            prop_assert_eq!(highest_of(&prefix.sums, geometry), prefix.best(geometry).map(|arc| arc.value));
        }
    }

    fn normal_ring(rng: &mut ChaCha8Rng) -> Vec<Option<f64>> {
        (0..100).map(|_| Some(StandardNormal.sample(rng))).collect()
    }

    #[test]
    fn an_arc_over_the_seam_is_found() {
        // Catches a scan that does not wrap: the arc of 8 from 96 to 3.
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut z = normal_ring(&mut rng);
        for place in [96, 97, 98, 99, 0, 1, 2, 3] {
            z[place] = z[place].map(|z| z + 3.0);
        }
        let arc = scan(&z, Geometry::Ring).unwrap();
        assert!(arc.length >= 5 && (94..100).contains(&arc.first), "{arc:?}");
        let p_value =
            |block_length| scan_p_value(&z, Geometry::Ring, Permutation { block_length, count: 999, seed: 1 }).unwrap();
        assert!(p_value(1) <= 0.002 && p_value(3) <= 0.02, "{} {}", p_value(1), p_value(3));
        let of = |z: &[Option<f64>]| scan(z, Geometry::Ring);
        assert_eq!((of(&[]), of(&[Some(1.0)]), of(&[None; 30])), (None, None, None));
        let on_line = scan(&z, Geometry::Line).unwrap();
        assert!(on_line.first + on_line.length <= 100 && on_line.value < arc.value, "{on_line:?}");
        let twice = [1, 1]
            .map(|seed| scan_p_value(&z, Geometry::Ring, Permutation { seed, count: 50, ..Permutation::default() }));
        assert_eq!(twice[0], twice[1]);
    }

    #[test]
    fn the_chance_is_one_for_the_family() {
        // Catches a p-value of one arc: among 35 000 arcs of sound rings the best would nearly always look rare.
        // 300 rings: a chance of 5 % gives 15 below it, within 3 standard deviations 4 to 26.
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let permutation = Permutation { block_length: 1, count: 99, seed: 7 };
        let below = (0..300)
            .filter(|_| scan_p_value(&normal_ring(&mut rng), Geometry::Ring, permutation).unwrap() <= 0.05)
            .count();
        assert!((4..=26).contains(&below), "{below} of 300");
    }
}
