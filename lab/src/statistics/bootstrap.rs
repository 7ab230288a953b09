//! Bootstrap interval of an AUC, by resampling arcs of the ring.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_draw::stats::quantile;
use tapline_fuse::auc;

/// Fewest resamples with both classes from which percentiles are taken.
const RESAMPLES_MIN: usize = 100;

/// How an interval is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bootstrap {
    /// Places that are drawn together: as many as are alike. 1 is the naive bootstrap, whose intervals are too
    /// narrow if neighbours are alike.
    pub block_length: usize,
    /// How many rings are drawn.
    pub count: usize,
    /// Confidence level, such as 0.95.
    pub level: f64,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for Bootstrap {
    fn default() -> Self {
        Self { block_length: 10, count: 1000, level: 0.95, seed: 1 }
    }
}

/// Percentile interval of the AUC of one ring's `scores`, NaN where there is none, resampled by circular blocks.
///
/// `None` when a class is empty, when fewer than 100 resamples had both, or for a level outside 0 to 1. O(count n log n).
///
/// # Panics
/// If there are not as many labels as scores.
pub fn auc_interval(scores: &[f64], labels: &[bool], bootstrap: Bootstrap) -> Option<(f64, f64)> {
    auc(scores, labels)?;
    if !(0.0..=1.0).contains(&bootstrap.level) {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(bootstrap.seed);
    let mut places = vec![0; scores.len()];
    let (mut drawn_scores, mut drawn_labels) = (Vec::new(), Vec::new());
    let mut values = Vec::new();
    for _ in 0..bootstrap.count {
        resample(&mut places, bootstrap.block_length, &mut rng);
        drawn_scores.clear();
        drawn_scores.extend(places.iter().map(|&place| scores[place]));
        drawn_labels.clear();
        drawn_labels.extend(places.iter().map(|&place| labels[place]));
        values.extend(auc(&drawn_scores, &drawn_labels));
    }
    let tail = 0.5 * (1.0 - bootstrap.level);
    if values.len() < RESAMPLES_MIN {
        return None;
    }
    Some((quantile(&values, tail)?, quantile(&values, 1.0 - tail)?))
}

/// Fills `places` with a resample of 0 to their count: blocks of `length` that start anywhere on the ring, until it is full.
fn resample(places: &mut [usize], length: usize, rng: &mut ChaCha8Rng) {
    let count = places.len();
    for block in places.chunks_mut(length.clamp(1, usize::MAX)) {
        let start = rng.random_range(0..count);
        for (step, to) in block.iter_mut().enumerate() {
            *to = (start + step) % count;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

    proptest! {
        #[test]
        fn a_resample_is_made_of_whole_blocks(count in 1_usize..60, length in 1_usize..70, seed in any::<u64>()) {
            // Catches places outside the ring and blocks that end at the seam.
            let mut places = vec![usize::MAX; count];
            resample(&mut places, length, &mut ChaCha8Rng::seed_from_u64(seed));
            prop_assert!(places.iter().all(|&p| p < count));
            let breaks = places.windows(2).filter(|w| w[1] != (w[0] + 1) % count).count();
            prop_assert!(breaks < count.div_ceil(length));
        }
    }

    #[test]
    fn on_white_scores_the_naive_interval_is_that_of_theory() {
        // Catches resamples that are not of full size, tails swapped, and a level not kept. For normal scores shifted by
        // d = 1 the AUC is 0.76; Hanley and McNeil (1982): Q1 = A/(2-A), Q2 = 2A^2/(1+A).
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let labels: Vec<bool> = (0..400).map(|i| i % 4 == 0).collect();
        let normal = |is_cracked: &bool| {
            f64::from(u8::from(*is_cracked)) + {
                let z: f64 = StandardNormal.sample(&mut rng);
                z
            }
        };
        let scores: Vec<f64> = labels.iter().map(normal).collect();
        let a = auc(&scores, &labels).unwrap();
        let (q_1, q_2) = (a / (2.0 - a), 2.0 * a * a / (1.0 + a));
        let sd = ((a * (1.0 - a) + 99.0 * (q_1 - a * a) + 299.0 * (q_2 - a * a)) / (100.0 * 300.0)).sqrt();
        let naive = Bootstrap { block_length: 1, ..Bootstrap::default() };
        let (low, high) = auc_interval(&scores, &labels, naive).unwrap();
        assert!(low < a && a < high);
        assert!(((high - low) / (2.0 * 1.96 * sd) - 1.0).abs() < 0.15, "{low} {high} {sd}");
        let (low_50, high_50) = auc_interval(&scores, &labels, Bootstrap { level: 0.5, ..naive }).unwrap();
        assert!(low < low_50 && high_50 < high);
    }

    #[test]
    fn nothing_is_made_up() {
        // Catches an interval of one class, of too few resamples, or of a level that is none.
        let (scores, labels) = ([0.1, 0.4, 0.2, 0.9], [false, true, false, true]);
        assert!(auc_interval(&scores, &labels, Bootstrap::default()).is_some());
        assert_eq!(auc_interval(&scores, &[false; 4], Bootstrap::default()), None);
        assert_eq!(auc_interval(&scores, &labels, Bootstrap { count: 99, ..Bootstrap::default() }), None);
        assert_eq!(auc_interval(&scores, &labels, Bootstrap { level: f64::NAN, ..Bootstrap::default() }), None);
        assert_eq!(auc_interval(&[], &[], Bootstrap::default()), None);
    }
}
