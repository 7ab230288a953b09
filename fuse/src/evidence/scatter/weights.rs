//! How far scores stand out, and by which weights.

use std::borrow::Cow;

use crate::evidence::scatter::orthant::Orthant;
use crate::evidence::scatter::{Scatter, Square, pairs};
use crate::evidence::{ROUNDING, Vector, WIDTH, dot};

impl Scatter {
    /// How many standard deviations `scores` stand out in the direction of damage; NaN of none.
    pub(crate) fn evidence(&self, scores: &Vector) -> f64 {
        greater(self.restricted_to(scores).orthants(scores).map(|orthant| orthant.greatest()))
    }

    /// How far `scores` stand out if no two discriminators moved together: the length of those above 0, each by its own deviation; 0 of
    /// none.
    pub(crate) fn evidence_apart(&self, scores: &Vector) -> f64 {
        let above = self.used().map(|d| if scores[d] > 0.0 { scores[d] / self.deviation(d) } else { 0.0 });
        above.map(|above| above * above).sum::<f64>().sqrt()
    }

    /// The evidence of `scores` if it is above `least`; mostly faster than to compute it and compare.
    pub(crate) fn evidence_above(&self, least: f64, scores: &Vector) -> Option<f64> {
        if least <= 0.0 {
            return Some(self.evidence(scores)).filter(|evidence| *evidence > least);
        }
        let limit = least * least * (1.0 - ROUNDING);
        // Over weights of any sign the square is z'S^-1 z, which few arcs bring beyond the limit. Not a number where one is absent.
        let b = self.of_used(scores);
        if dot(&b, &times(&self.precision, &b)) < limit {
            return None;
        }
        let present = self.restricted_to(scores);
        let orthants = present.orthants(scores);
        let of = |orthant: Orthant<'_>| {
            if orthant.is_bounded_by(limit) { f64::NEG_INFINITY } else { orthant.greatest() }
        };
        Some(greater(orthants.map(of))).filter(|evidence| *evidence > least)
    }

    /// The weights that show most of `scores`; all 0 where nothing speaks for damage.
    pub(crate) fn weights(&self, scores: &Vector) -> Vector {
        let present = self.restricted_to(scores);
        let [by_weights, by_shifts] = present.orthants(scores);
        let (weights, shifts) = (by_weights.descend(), by_shifts.descend());
        if dot(&weights, &by_weights.b) >= dot(&shifts, &by_shifts.b) {
            return weights;
        }
        times(&present.precision, &shifts)
    }

    /// How many standard deviations `scores` stand out by `weights` that were chosen without them; NaN where they lack what
    /// counts. Of what they lack in part, the others count as they would had the weights been chosen of them alone.
    ///
    /// The scores are about medians of controls, of which there are 1 over `of_controls`, in places.
    pub(crate) fn along(&self, weights: &Vector, scores: &Vector, of_controls: f64) -> f64 {
        let present = self.restricted_to(scores);
        // What the weights look for: S^-1 of this are the weights. Beside the greatest shift a small one is rounding.
        let mut shift = times(&self.covariance, weights);
        let least = ROUNDING * shift.iter().fold(0.0, |most, x: &f64| if x.abs() > most { x.abs() } else { most });
        let counts: [bool; WIDTH] = std::array::from_fn(|d| shift[d].abs() > least && present.used.contains(&d));
        shift.iter_mut().zip(counts).filter(|(_, counts)| !counts).for_each(|(shift, _)| *shift = 0.0);
        let weights = times(&present.precision, &shift);
        let sum: f64 = present.used().map(|d| weights[d] * scores[d]).sum();
        let variance = |(i, j): (usize, usize)| {
            let (of_both, deviations) = (present.covariance[i][j], present.deviation(i) * present.deviation(j));
            // Medians of two normal scores with the correlation r have the covariance asin r, where means have r.
            let of_medians = deviations * (of_both / deviations).clamp(-1.0, 1.0).asin();
            weights[i] * weights[j] * (of_both + of_controls * of_medians)
        };
        sum / pairs(&present.used).map(variance).sum::<f64>().sqrt()
    }

    /// The scatter of the discriminators that `scores` have.
    pub(crate) fn restricted_to(&self, scores: &Vector) -> Cow<'_, Self> {
        let is_there = |d: usize| scores[d].is_finite();
        if self.used().all(is_there) {
            return Cow::Borrowed(self);
        }
        Cow::Owned(self.with(|i, j| if is_there(i) && is_there(j) { self.covariance[i][j] } else { 0.0 }))
    }

    /// `scores`, and 0 where one does not count.
    fn of_used(&self, scores: &Vector) -> Vector {
        // Without a branch or an index, so that the compiler can use vectors.
        std::array::from_fn(|d| if self.covariance_steps[d] > 0.0 { scores[d] } else { 0.0 })
    }

    /// The weights that are nowhere below 0, and the shifts that are nowhere below 0, for `scores` that lack nothing that is used.
    fn orthants(&self, scores: &Vector) -> [Orthant<'_>; 2] {
        let b = self.of_used(scores);
        let (used, pull) = (&self.used[..], times(&self.precision, &b));
        [
            Orthant { matrix: &self.covariance, inverse: &self.precision, steps: &self.precision_steps, used, b },
            Orthant {
                matrix: &self.precision,
                inverse: &self.covariance,
                steps: &self.covariance_steps,
                used,
                b: pull,
            },
        ]
    }
}

/// The greater of two values; NaN of none.
fn greater([a, b]: [f64; 2]) -> f64 {
    if a >= b { a } else { b }
}

/// The product of a symmetric matrix and a vector.
fn times(matrix: &Square, vector: &Vector) -> Vector {
    // Whole columns, so that the compiler can use vectors.
    let mut product = [0.0; WIDTH];
    for (column, x) in matrix.iter().zip(vector) {
        product.iter_mut().zip(column).for_each(|(product, part)| *product += part * x);
    }
    product
}

#[cfg(test)]
mod tests {
    use faer::linalg::solvers::DenseSolveCore as _;
    use faer::{Mat, Side};
    use proptest::prelude::*;

    use super::*;
    use crate::evidence::ABSENT;
    use crate::evidence::scatter::tests::drawn;

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

    /// The obvious way: the greatest x'b / sqrt(x'Mx) where only a subset of x is not 0, by its inverse, over every subset that leaves
    /// none below 0.
    fn greatest_by_subsets(matrix: &Mat<f64>, b: &[f64]) -> f64 {
        let mut most = f64::NEG_INFINITY;
        for mask in 1..1_u32 << b.len() {
            let of: Vec<usize> = (0..b.len()).filter(|d| mask >> d & 1 == 1).collect();
            let part = Mat::from_fn(of.len(), of.len(), |i, j| matrix[(of[i], of[j])]);
            let inverse = part.llt(Side::Lower).unwrap().inverse();
            let x: Vec<f64> = (0..of.len()).map(|i| (0..of.len()).map(|j| inverse[(i, j)] * b[of[j]]).sum()).collect();
            let squared: f64 = x.iter().zip(&of).map(|(x, &d)| x * b[d]).sum();
            if x.iter().all(|&x| x >= 0.0) {
                most = if squared.sqrt() > most { squared.sqrt() } else { most };
            }
            if let [alone] = of[..] {
                let value = b[alone] / matrix[(alone, alone)].sqrt();
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
            // Catches a descent that stops early, an entry below 0, weights that are not those of the evidence, and a bound that cuts
            // off what stands out.
            let scatter = scatter(&root, 5);
            let covariance = Mat::from_fn(5, 5, |i, j| scatter.covariance[i][j]);
            let precision = covariance.llt(Side::Lower).unwrap().inverse();
            let pull: Vec<f64> = (0..5).map(|i| (0..5).map(|j| precision[(i, j)] * z[j]).sum()).collect();
            let expected = greater([greatest_by_subsets(&covariance, &z), greatest_by_subsets(&precision, &pull)]);
            let z = vector(&z);
            let found = scatter.evidence(&z);
            prop_assert!((found - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{found} {expected}");
            if found > 0.0 {
                let along = scatter.along(&scatter.weights(&z), &z, 0.0);
                prop_assert!((along - expected).abs() < 1e-6 * (1.0 + expected), "{along} {expected}");
            }
            prop_assert_eq!(scatter.evidence_above(found - 1e-6, &z), Some(found));
            prop_assert_eq!(scatter.evidence_above(found + 1e-6, &z), None);
        }
    }

    #[test]
    fn what_a_soft_place_moves_together_is_no_damage() {
        // Catches a sum that knows no correlation: two scores that go against each other on sound places, as tau and PR do.
        let scatter = Scatter::new(&Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { -0.9 }));
        assert!(scatter.evidence(&vector(&[2.0, -1.8])) < 2.1);
        assert!(scatter.evidence(&vector(&[1.0, 1.0])) > 4.0);
    }

    #[test]
    fn apart_from_each_other_scores_count_as_by_a_scatter_without_correlation() {
        // Catches a fall that counts, a variance for a deviation, and one that is absent or does not vary.
        let matrix = |correlation| {
            Mat::from_fn(4, 4, |i, j| {
                if i == 3 || j == 3 {
                    0.0
                } else if i == j {
                    4.0
                } else {
                    correlation
                }
            })
        };
        let (scatter, apart) = (Scatter::new(&matrix(3.0)), Scatter::new(&matrix(0.0)));
        for scores in [[2.0, -6.0, 4.0, 9.0], [2.0, 6.0, f64::NAN, 9.0], [-1.0, 5.0, -2.0, 9.0]] {
            let found = scatter.evidence_apart(&vector(&scores));
            assert!((found - apart.evidence(&vector(&scores))).abs() < 1e-12, "{scores:?}: {found}");
        }
        assert!(scatter.evidence_apart(&vector(&[-1.0, -2.0, -3.0])).abs() < 1e-12);
    }

    #[test]
    fn a_crack_in_a_stiff_place_stands_out() {
        // Catches evidence that forgets what the others let expect: two scores that rise together on sound places, of which one falls
        // and the other does not follow.
        let scatter = Scatter::new(&Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { 0.9 }));
        assert!(scatter.evidence(&vector(&[0.5, -2.0])) > 5.0);
        assert!(scatter.evidence(&vector(&[-2.0, -2.0])) < 0.0);
    }

    #[test]
    fn what_moves_the_wrong_way_does_not_hide_what_moves_the_right_one() {
        // Catches a direction that is wrong for a casing: beside such a fall even more of a rise would be expected.
        let scatter = Scatter::new(&Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { -0.9 }));
        assert!(scatter.evidence(&vector(&[6.0, -6.0])) >= 6.0);
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
        assert!((scatter.evidence(&vector(&[6.0])) - 3.0).abs() < 1e-9);
        let weights = scatter.weights(&vector(&[2.0, -1.0]));
        assert!((scatter.along(&weights, &vector(&[-2.0, 7.0]), 0.0) + 1.0).abs() < 1e-9);
        assert!(scatter.along(&weights, &vector(&[f64::NAN, 7.0]), 0.0).is_nan());
    }

    #[test]
    fn what_is_absent_lets_expect_nothing() {
        // Catches a 0 in the place of what is absent, and weights of a difference whose other half is gone: a fall is no damage then.
        let scatter = Scatter::new(&Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { 0.9 }));
        let alone = vector(&[f64::NAN, -2.0]);
        assert!((scatter.evidence(&alone) + 2.0).abs() < 1e-9);
        let weights = scatter.weights(&vector(&[0.5, -2.0]));
        assert!(weights[1] < 0.0 && scatter.along(&weights, &vector(&[0.5, -2.0]), 0.0) > 5.0);
        assert!(scatter.along(&weights, &vector(&[-3.0, f64::NAN]), 0.0) < 0.0);
        assert!(scatter.along(&weights, &alone, 0.0).is_nan(), "what remains shifts by nothing");
    }

    #[test]
    fn medians_of_controls_move_as_drawn_ones_do() {
        // Catches a level that moves a difference as little as means would.
        let scatter = Scatter::new(&Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { 0.9 }));
        let difference_of_medians = |controls: &[Vector]| {
            let median =
                |d: usize| crate::stats::median(&mut controls.iter().map(|c| c[d]).collect::<Vec<_>>()).unwrap();
            median(0) - median(1)
        };
        let drawn = drawn(&scatter, 25 * 4000);
        let drawn = drawn.chunks(25).map(|controls| difference_of_medians(controls).powi(2)).sum::<f64>() / 4000.0;
        let mut weights = [0.0; WIDTH];
        (weights[0], weights[1]) = (1.0, -1.0);
        let value = |of_controls| scatter.along(&weights, &vector(&[1.0, 0.0]), of_controls);
        let of_level = value(1.0 / 25.0).powi(-2) - value(0.0).powi(-2);
        assert!((of_level / drawn - 1.0).abs() < 0.15, "{of_level} {drawn}");
    }
}
