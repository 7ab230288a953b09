//! The weights that show most of what a place scores.

use crate::evidence::scatter::{Scatter, pairs};
use crate::evidence::{ROUNDING, Vector, WIDTH, dot};

/// How often a bound is lowered along each discriminator.
const BOUND_SWEEPS: usize = 2;

/// Most weights that are set free; as many as there are discriminators are usual at most.
const ROUNDS_MAX: usize = 4 * WIDTH;

impl Scatter {
    /// How many standard deviations `scores` stand out in the direction of damage; NaN of none.
    pub(crate) fn evidence(&self, scores: &Vector) -> f64 {
        let mut most = f64::NAN;
        for d in self.there(scores) {
            let alone = scores[d] / self.deviation(d);
            most = if most >= alone { most } else { alone };
        }
        if most > 0.0 {
            let weights = self.descend(scores);
            // At the least of w'Sw - 2 w'z both terms are the same but for the 2.
            self.there(scores).map(|d| weights[d] * scores[d]).sum::<f64>().sqrt()
        } else {
            most
        }
    }

    /// The evidence of `scores` if it is above `least`; mostly faster than to compute it and compare.
    pub(crate) fn evidence_above(&self, least: f64, scores: &Vector) -> Option<f64> {
        if least > 0.0 && self.is_bounded_by(least * least * (1.0 - ROUNDING), scores) {
            return None;
        }
        Some(self.evidence(scores)).filter(|evidence| *evidence > least)
    }

    /// Whether it is plain that the square of the evidence of `scores` is below `limit`.
    ///
    /// That square is the least of y'S^-1 y over all y that are nowhere below the scores: the dual of the greatest over the weights. Any
    /// such y is a bound, and a few steps, each along one discriminator, lead to one that is near.
    fn is_bounded_by(&self, limit: f64, scores: &Vector) -> bool {
        // What is absent bounds nothing. All that follows runs over whole vectors, so that the compiler can use registers.
        let mut y = scores.map(|score| if score > 0.0 { score } else { 0.0 });
        let mut slope = [0.0; WIDTH];
        for (column, y) in self.precision.iter().zip(&y) {
            (0..WIDTH).for_each(|d| slope[d] += column[d] * y);
        }
        for _ in 0..BOUND_SWEEPS {
            if dot(&y, &slope) < limit {
                return true;
            }
            for k in 0..WIDTH {
                let free = y[k] - slope[k] * self.inverse_diagonal[k];
                let step = if free < scores[k] { scores[k] } else { free } - y[k];
                y[k] += step;
                (0..WIDTH).for_each(|d| slope[d] += self.precision[k][d] * step);
            }
        }
        dot(&y, &slope) < limit
    }

    /// The weights that show most of `scores`, none below 0; all 0 where nothing speaks for damage.
    pub(crate) fn weights(&self, scores: &Vector) -> Vector {
        self.descend(scores)
    }

    /// How many standard deviations `scores` stand out by `weights` that were chosen without them; NaN where they lack what
    /// counts.
    pub(crate) fn along(&self, weights: &Vector, scores: &Vector) -> f64 {
        let there: Vec<usize> = self.there(scores).filter(|&d| weights[d] > 0.0).collect();
        let variance: f64 = pairs(&there).map(|(i, j)| weights[i] * self.covariance[i][j] * weights[j]).sum();
        there.iter().map(|&d| weights[d] * scores[d]).sum::<f64>() / variance.sqrt()
    }

    /// Those that vary and that `scores` have.
    fn there<'a>(&'a self, scores: &'a Vector) -> impl Iterator<Item = usize> + Clone + 'a {
        self.used.iter().copied().filter(|&d| scores[d].is_finite())
    }

    /// The weights of the least of w'Sw - 2 w'z over w >= 0: after a first guess, those above 0 are found one by one (Lawson and
    /// Hanson 1974).
    fn descend(&self, scores: &Vector) -> Vector {
        let mut w = [0.0; WIDTH];
        let mut is_free = [false; WIDTH];
        self.used.iter().for_each(|&d| is_free[d] = scores[d] > 0.0);
        self.settle(scores, &mut is_free, &mut w);
        for _ in 0..ROUNDS_MAX {
            let slope = |d: usize| scores[d] - self.used.iter().map(|&j| self.covariance[d][j] * w[j]).sum::<f64>();
            let held = self.there(scores).filter(|&d| !is_free[d]).map(|d| (d, slope(d) / self.deviation(d)));
            let Some((steepest, _)) = held.filter(|(_, slope)| *slope > 1e-9).max_by(|a, b| a.1.total_cmp(&b.1)) else {
                break;
            };
            is_free[steepest] = true;
            self.settle(scores, &mut is_free, &mut w);
        }
        w
    }

    /// Moves `w` to the least over the weights that are free, and holds at 0 those that would fall below it.
    fn settle(&self, scores: &Vector, is_free: &mut [bool; WIDTH], w: &mut Vector) {
        for _ in 0..WIDTH {
            let best = self.solved(scores, is_free);
            let falls = |d: &usize| is_free[*d] && best[*d] <= 0.0;
            // At 0 already: it stays there, and none of the others moves.
            let step = |d: usize| if w[d] > 0.0 { w[d] / (w[d] - best[d]) } else { 0.0 };
            let Some(step) = self.used().filter(falls).map(step).min_by(f64::total_cmp) else {
                *w = best;
                return;
            };
            for &d in self.used.iter().filter(|&&d| is_free[d]) {
                w[d] += step * (best[d] - w[d]);
            }
            for &d in &self.used {
                if is_free[d] && best[d] <= 0.0 && w[d] <= 1e-12 * best[d].abs() {
                    (is_free[d], w[d]) = (false, 0.0);
                }
            }
        }
    }

    /// S^-1 z of those that are free, 0 of the others.
    fn solved(&self, scores: &Vector, is_free: &[bool; WIDTH]) -> Vector {
        let (mut factor, mut x, mut count) = ([[0.0; WIDTH]; WIDTH], [0.0; WIDTH], 0);
        let mut free = [0; WIDTH];
        for &d in self.used.iter().filter(|&&d| is_free[d]) {
            (free[count], count) = (d, count + 1);
        }
        let free = &free[..count];
        // By the factor of Cholesky, forwards and back.
        for (i, &of_i) in free.iter().enumerate() {
            for (j, &of_j) in free[..=i].iter().enumerate() {
                let before: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
                let rest = self.covariance[of_i][of_j] - before;
                let least = 1e-12 * self.covariance[of_i][of_i];
                factor[i][j] =
                    if i > j { rest / factor[j][j] } else { (if rest > least { rest } else { least }).sqrt() };
            }
            let before: f64 = (0..i).map(|k| factor[i][k] * x[k]).sum();
            x[i] = (scores[of_i] - before) / factor[i][i];
        }
        for i in (0..count).rev() {
            let behind: f64 = (i + 1..count).map(|k| factor[k][i] * x[k]).sum();
            x[i] = (x[i] - behind) / factor[i][i];
        }
        let mut solved = [0.0; WIDTH];
        free.iter().zip(x).for_each(|(&d, x)| solved[d] = x);
        solved
    }
}

#[cfg(test)]
mod tests {
    use faer::linalg::solvers::DenseSolveCore as _;
    use faer::{Mat, Side};
    use proptest::prelude::*;

    use super::*;
    use crate::evidence::ABSENT;

    fn scatter(root: &[f64], width: usize) -> Scatter {
        let a = Mat::from_fn(width, width, |i, j| root[width * i + j]);
        let mut s = a.transpose() * &a;
        (0..width).for_each(|i| s[(i, i)] += 0.05);
        Scatter::new(&s)
    }

    fn vector(values: &[f64]) -> Vector {
        let mut vector = ABSENT;
        vector[..values.len()].copy_from_slice(values);
        vector
    }

    /// The obvious way: the best weights of every subset of the discriminators, by its inverse, where none is below 0.
    fn evidence_by_subsets(scatter: &Scatter, z: &[f64]) -> f64 {
        let mut most = f64::NEG_INFINITY;
        for mask in 1..1_u32 << z.len() {
            let of: Vec<usize> = (0..z.len()).filter(|d| mask >> d & 1 == 1).collect();
            let s = Mat::from_fn(of.len(), of.len(), |i, j| scatter.covariance[of[i]][of[j]]);
            let inverse = s.llt(Side::Lower).unwrap().inverse();
            let weight = |i: usize| (0..of.len()).map(|j| inverse[(i, j)] * z[of[j]]).sum::<f64>();
            let weights: Vec<f64> = (0..of.len()).map(weight).collect();
            if weights.iter().all(|&w| w >= 0.0) {
                let squared: f64 = weights.iter().zip(&of).map(|(w, &d)| w * z[d]).sum();
                most = if squared.sqrt() > most { squared.sqrt() } else { most };
            }
            if let [alone] = of[..] {
                let value = z[alone] / scatter.deviation(alone);
                most = if value > most { value } else { most };
            }
        }
        most
    }

    proptest! {
        #[test]
        fn the_evidence_is_that_of_the_best_subset(
            root in prop::collection::vec(-1.0..1.0_f64, 25), z in prop::collection::vec(-4.0..4.0_f64, 5)
        ) {
            // Catches a descent that stops early, a weight below 0, and a bound that cuts off what stands out.
            let scatter = scatter(&root, 5);
            let (found, expected) = (scatter.evidence(&vector(&z)), evidence_by_subsets(&scatter, &z));
            prop_assert!((found - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{found} {expected}");
            prop_assert!(found <= 0.0 || !scatter.is_bounded_by(found * found * (1.0 - ROUNDING), &vector(&z)));
        }
    }

    #[test]
    fn what_a_soft_place_moves_together_is_no_damage() {
        // Catches a sum that knows no correlation: two scores that go against each other on sound places, as tau and PR do.
        let scatter = Scatter::new(&Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { -0.9 }));
        assert!(scatter.evidence(&vector(&[2.0, -1.8])) < 2.1);
        assert!(scatter.evidence(&vector(&[1.0, 1.0])) > 4.0);
        // Nor does one that falls count against one that rises.
        assert!(scatter.evidence(&vector(&[3.0, -6.0])) >= 3.0);
    }

    #[test]
    fn a_weight_of_exactly_0_is_no_hole() {
        // Catches a step of 0 / 0, which continuous scores do not show: the best weight of the first score is 0.
        for (correlation, variance, z, expected) in
            [(1.0, 2.0, [1.0, 2.0], 2.0_f64.sqrt()), (0.5, 1.0, [2.25, 4.5], 4.5)]
        {
            let matrix = [[1.0, correlation], [correlation, variance]];
            let scatter = Scatter::new(&Mat::from_fn(2, 2, |i, j| matrix[i][j]));
            let found = scatter.evidence(&vector(&z));
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn what_is_absent_does_not_count() {
        // Catches an absent score that makes all others worth nothing, and one that never varies taken for certain.
        let scatter = Scatter::new(&Mat::from_fn(3, 3, |i, j| if i == j && i < 2 { 4.0 } else { 0.0 }));
        assert!((scatter.evidence(&vector(&[f64::NAN, 6.0, 9.0])) - 3.0).abs() < 1e-9);
        assert!(scatter.evidence(&ABSENT).is_nan());
        assert!((scatter.evidence(&vector(&[-4.0, -8.0])) + 2.0).abs() < 1e-9);
        let weights = scatter.weights(&vector(&[2.0, -1.0]));
        assert!((scatter.along(&weights, &vector(&[-2.0, 7.0])) + 1.0).abs() < 1e-9);
        assert!(scatter.along(&weights, &vector(&[f64::NAN, 7.0])).is_nan());
    }
}
