//! Areas under the ROC curve, tyre against tyre, so that intervals can be drawn by whole tyres.

use crate::statistics::{Bootstrap, auc_interval};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_fuse::auc;

use super::judge::ShoulderResult;

/// Resamples of an interval.
const RESAMPLES: u32 = 1000;

/// Places drawn together within a ring: an index that is a mean over three, on waves of a third of the ring and longer.
const BLOCK: usize = 10;

/// Cracked and sound locations of tyres, and how often those of one score above those of another.
#[derive(Debug, Clone)]
pub(super) struct Areas {
    /// Of (cracked tyre, sound tyre), tyres numbered in order: pairs won, ties counting half.
    wins: Vec<Vec<f64>>,
    /// Pairs there are.
    pairs: Vec<Vec<f64>>,
    scores: Vec<f64>,
    labels: Vec<bool>,
}

impl Areas {
    /// Of the damage indices of `judged`.
    pub(super) fn new(judged: &[ShoulderResult]) -> Self {
        let tyres: Vec<&[ShoulderResult]> = judged.chunk_by(|a, b| a.tyre == b.tyre).collect();
        let of_class = |tyre: &[ShoulderResult], class: bool| -> Vec<f64> {
            let places = tyre.iter().flat_map(|j| j.index.iter().zip(&j.is_cracked));
            places.filter(|&(x, &label)| label == class && !x.is_nan()).map(|(&x, _)| x).collect()
        };
        let [cracked, sound] = [true, false].map(|class| tyres.iter().map(|t| of_class(t, class)).collect::<Vec<_>>());
        let pairs = |f: &dyn Fn(&Vec<f64>, &Vec<f64>) -> f64| -> Vec<Vec<f64>> {
            cracked.iter().map(|c| sound.iter().map(|s| f(c, s)).collect()).collect()
        };
        let area = |c: &Vec<f64>, s: &Vec<f64>| {
            let labels: Vec<bool> = c.iter().map(|_| true).chain(s.iter().map(|_| false)).collect();
            auc(&[&c[..], s].concat(), &labels).unwrap_or(0.0)
        };
        let count = |c: &Vec<f64>, s: &Vec<f64>| c.len() as f64 * s.len() as f64;
        Self {
            wins: pairs(&|c, s| area(c, s) * count(c, s)),
            pairs: pairs(&count),
            scores: judged.iter().flat_map(|j| j.index.iter().copied()).collect(),
            labels: judged.iter().flat_map(|j| j.is_cracked.iter().copied()).collect(),
        }
    }

    /// The area of all tyres together.
    pub(super) fn auc(&self) -> Option<f64> {
        auc(&self.scores, &self.labels)
    }

    /// 95 % interval by blocks of locations.
    pub(super) fn by_blocks(&self, seed: u64) -> Option<(f64, f64)> {
        auc_interval(
            &self.scores,
            &self.labels,
            Bootstrap { block_length: BLOCK, seed, count: 400, ..Bootstrap::default() },
        )
    }

    /// 95 % interval by whole tyres.
    pub(super) fn by_tyres(&self, seed: u64) -> Option<(f64, f64)> {
        interval(seed, self.pairs.len(), |drawn| self.drawn(drawn))
    }

    /// 95 % interval by whole tyres of how much the area exceeds that of `other`, of the same tyres.
    pub(super) fn above_by_tyres(&self, other: &Self, seed: u64) -> Option<(f64, f64)> {
        interval(seed, self.pairs.len(), |drawn| Some(self.drawn(drawn)? - other.drawn(drawn)?))
    }

    /// The area of tyres as often as they are drawn.
    fn drawn(&self, drawn: &[f64]) -> Option<f64> {
        let sum = |of: &[Vec<f64>]| -> f64 {
            let rows = of.iter().zip(drawn).filter(|(_, times)| **times > 0.0);
            rows.map(|(row, times)| times * row.iter().zip(drawn).map(|(x, times)| x * times).sum::<f64>()).sum()
        };
        let pairs = sum(&self.pairs);
        (pairs > 0.0).then(|| sum(&self.wins) / pairs)
    }
}

/// The middle 95 % of `value` over resamples of `count` things, from how often each is drawn.
pub(super) fn interval(seed: u64, count: usize, value: impl Fn(&[f64]) -> Option<f64>) -> Option<(f64, f64)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut drawn = vec![0.0; count];
    let mut values = Vec::new();
    for _ in 0..RESAMPLES {
        drawn.fill(0.0);
        for _ in 0..count {
            drawn[rng.random_range(0..count)] += 1.0;
        }
        values.extend(value(&drawn));
    }
    values.sort_by(f64::total_cmp);
    let at = |q: f64| values[(q * (values.len() - 1) as f64).round() as usize];
    (values.len() >= 100).then(|| (at(0.025), at(0.975)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches pairs lost between tyres, NaN counted, and an interval that does not hold the area.
    #[test]
    fn tyres_add_up_to_the_area_of_all() {
        let tyres = [
            ShoulderResult::with_index("A", &[3.0, 1.0, 2.0, f64::NAN], &[true, false, false, true]),
            ShoulderResult::with_index("B", &[0.5, 2.5, 2.0], &[false, false, true]),
            ShoulderResult::with_index("C", &[0.0, 4.0, 1.0], &[false, false, false]),
        ];
        let areas = Areas::new(&tyres);
        let (auc, all) = (areas.auc().unwrap(), areas.drawn(&[1.0; 3]).unwrap());
        assert!((auc - all).abs() < 1e-12, "{auc} {all}");
        // Only the first: 3 is above 1 and 2.
        assert!((areas.drawn(&[2.0, 0.0, 0.0]).unwrap() - 1.0).abs() < 1e-12);
        assert_eq!(areas.drawn(&[0.0, 0.0, 3.0]), None);
        let (low, high) = areas.by_tyres(1).unwrap();
        assert!(low <= auc && auc <= high && low < high);
        let (low, high) = areas.above_by_tyres(&areas, 1).unwrap();
        assert!(low.abs() < 1e-12 && high.abs() < 1e-12);
    }
}
