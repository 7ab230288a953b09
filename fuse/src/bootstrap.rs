//! How far an AUC would have come out elsewhere, had other arcs of the ring been drawn.

use crate::auc;
use crate::resample::Blocks;
use crate::scale::percentile;

/// Fewest resamples that had both classes, for their percentiles to mean anything.
const RESAMPLES_MIN: usize = 100;

/// How an interval is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bootstrap {
    /// Places that are drawn together: as many as neighbours are known to be alike over. 1 is the naive bootstrap, whose
    /// intervals are too narrow where they are.
    pub block_length: usize,
    /// How many rings are drawn.
    pub count: usize,
    /// Chance that the interval is to hold the value.
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
    let mut blocks = Blocks::new(bootstrap.block_length, bootstrap.seed);
    let mut places = vec![0; scores.len()];
    let (mut drawn_scores, mut drawn_labels) = (Vec::new(), Vec::new());
    let mut values = Vec::new();
    for _ in 0..bootstrap.count {
        blocks.resample(&mut places);
        drawn_scores.clear();
        drawn_scores.extend(places.iter().map(|&place| scores[place]));
        drawn_labels.clear();
        drawn_labels.extend(places.iter().map(|&place| labels[place]));
        values.extend(auc(&drawn_scores, &drawn_labels));
    }
    values.sort_by(f64::total_cmp);
    let tail = 0.5 * (1.0 - bootstrap.level);
    (values.len() >= RESAMPLES_MIN).then(|| (percentile(&values, tail), percentile(&values, 1.0 - tail)))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

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
