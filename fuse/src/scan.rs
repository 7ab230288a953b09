//! The circular scan statistic: the arc of the ring that stands out most, at several lengths at once.
//!
//! References: Kulldorff, Communications in Statistics 26 (1997) 1481; Olshen and others, Biostatistics 5 (2004) 557.

use crate::resample::Blocks;

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
        Self { block_length: 3, count: 999, seed: 1 }
    }
}

/// The arc of the ring of `z` with the largest sum over the root of its count, the first of equals.
///
/// A place without a value, or whose value is no number, adds neither to the sum nor to the count. Arcs as long as the
/// ring and longer are not looked at; `None` when no arc has a value. O(places x lengths) by prefix sums.
pub fn scan(z: &[Option<f64>]) -> Option<Arc> {
    Prefix::of(z).best()
}

/// The chance that a ring whose places are exchangeable in blocks has an arc as high as the highest of `z`: one chance for
/// all places and lengths together. `None` when no arc has a value.
///
/// An arc that is real takes part in its own permutations: one that two blocks hold comes together again in about one of
/// as many permutations as there are blocks, so that a block should not be longer than a third of the arcs that count.
pub fn scan_p_value(z: &[Option<f64>], permutation: Permutation) -> Option<f64> {
    let found = scan(z)?.value;
    let mut blocks = Blocks::new(permutation.block_length, permutation.seed);
    let mut places = vec![0; z.len()];
    let mut shuffled = vec![None; z.len()];
    let mut at_least: usize = 1; // the ring as it is is one of them
    for _ in 0..permutation.count {
        blocks.permute(&mut places);
        for (to, &place) in shuffled.iter_mut().zip(&places) {
            *to = z[place];
        }
        at_least += usize::from(scan(&shuffled).is_some_and(|arc| arc.value >= found));
    }
    Some(at_least as f64 / (permutation.count as f64 + 1.0))
}

/// Sums and counts of the first n places of the ring, run through twice.
struct Prefix {
    sums: Vec<f64>,
    counts: Vec<f64>,
}

impl Prefix {
    fn of(z: &[Option<f64>]) -> Self {
        let (mut sums, mut counts) = (vec![0.0], vec![0.0]);
        let (mut sum, mut count) = (0.0, 0.0);
        for value in z.iter().chain(z) {
            if let Some(value) = value.filter(|v| v.is_finite()) {
                sum += value;
                count += 1.0;
            }
            sums.push(sum);
            counts.push(count);
        }
        Self { sums, counts }
    }

    fn best(&self) -> Option<Arc> {
        let place_count = self.sums.len() / 2;
        let mut best: Option<Arc> = None;
        for length in ARC_LENGTHS.into_iter().take_while(|&length| length < place_count) {
            for first in 0..place_count {
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

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
            match (scan(&z), scan_slow(&z)) {
                (None, None) => {}
                (Some(fast), Some(slow)) => prop_assert!((fast.value - slow).abs() < 1e-9, "{:?} {}", fast, slow),
                other => prop_assert!(false, "{:?}", other),
            }
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
        let arc = scan(&z).unwrap();
        assert!(arc.length >= 5 && (94..100).contains(&arc.first), "{arc:?}");
        let p_value = |block_length| scan_p_value(&z, Permutation { block_length, count: 999, seed: 1 }).unwrap();
        assert!(p_value(1) <= 0.002 && p_value(3) <= 0.02, "{} {}", p_value(1), p_value(3));
        assert_eq!((scan(&[]), scan(&[Some(1.0)]), scan(&[None; 30])), (None, None, None));
        let twice = [1, 1].map(|seed| scan_p_value(&z, Permutation { seed, count: 50, ..Permutation::default() }));
        assert_eq!(twice[0], twice[1]);
    }

    #[test]
    fn the_chance_is_one_for_the_family() {
        // Catches a p-value of one arc: among 35 000 arcs of sound rings the best would nearly always look rare.
        // 300 rings: a chance of 5 % gives 15 below it, within 3 standard deviations 4 to 26.
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let permutation = Permutation { block_length: 1, count: 99, seed: 7 };
        let below = (0..300).filter(|_| scan_p_value(&normal_ring(&mut rng), permutation).unwrap() <= 0.05).count();
        assert!((4..=26).contains(&below), "{below} of 300");
    }
}
