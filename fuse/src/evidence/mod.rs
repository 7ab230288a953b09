//! How far a vector of scores stands out in the direction of damage.
//!
//! Damage raises some discriminators and leaves others as they are, and nobody knows beforehand which. So the evidence is that
//! of the weighted sum that shows most: the greatest w'z / sqrt(w'Sw) over all weights w >= 0, where z are the scores and S is
//! their covariance on sound places (Roy's union-intersection principle, 1953). S takes away what a place that is only softer
//! than others moves together, and no weight is below 0: a discriminator that moves the wrong way does not count against the
//! others.

pub(crate) mod covariance;

use std::sync::LazyLock;

use faer::Mat;
use rand::Rng;
use rand_distr::{Distribution as _, StandardNormal};
use tapline_wire::Discriminator;

use crate::evidence::covariance::Covariance;

/// One score a discriminator, in the order in which they are configured; NaN where it is absent, and beyond the last one.
pub(crate) type Vector = [f64; WIDTH];

/// The scores of a place of which nothing is known.
pub(crate) const ABSENT: Vector = [f64::NAN; WIDTH];

/// Most discriminators.
const WIDTH: usize = Discriminator::COUNT;

/// 1 over the root of a count, NaN of 0: sums over few places are asked for by the million.
static INVERSE_ROOTS: LazyLock<[f64; 64]> =
    LazyLock::new(|| std::array::from_fn(|count| if count > 0 { 1.0 / (count as f64).sqrt() } else { f64::NAN }));

/// A variance at or below this is rounding: that of what counts is near 1.
const VARIANCE_MIN: f64 = 1e-12;

/// What rounding may take from a bound, as a part of its square.
pub(crate) const ROUNDING: f64 = 1e-9;

/// How often a bound is lowered along each discriminator.
const BOUND_SWEEPS: usize = 2;

/// Most weights that are set free; as many as there are discriminators are usual at most.
const ROUNDS_MAX: usize = 4 * WIDTH;

/// Whether anything is known of a place.
pub(crate) fn has_value(scores: &Vector) -> bool {
    scores.iter().any(|score| score.is_finite())
}

/// The sum of scores, of each discriminator by itself.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sum {
    sum: [f64; WIDTH],
    count: [u32; WIDTH],
}

impl Sum {
    /// Adds what `scores` have.
    pub(crate) fn add(&mut self, scores: &Vector) {
        // Without branches, so that the compiler can use vectors.
        for (d, score) in scores.iter().enumerate() {
            self.sum[d] += if score.is_finite() { *score } else { 0.0 };
            self.count[d] += u32::from(score.is_finite());
        }
    }

    /// How many have been added of discriminator number `d`.
    pub(crate) fn count(&self, d: usize) -> u32 {
        self.count[d]
    }

    /// Their mean; NaN of none.
    pub(crate) fn mean(&self) -> Vector {
        std::array::from_fn(|d| self.sum[d] / f64::from(self.count[d]))
    }

    /// The sum over the root of how many there are, which scatters as one of them where they are independent.
    pub(crate) fn over_root(&self) -> Vector {
        std::array::from_fn(|d| match INVERSE_ROOTS.get(self.count[d] as usize) {
            Some(inverse) => self.sum[d] * inverse,
            None => self.sum[d] / f64::from(self.count[d]).sqrt(),
        })
    }
}

/// How scores of sound places scatter together.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scatter {
    covariance: [[f64; WIDTH]; WIDTH],
    /// Lower triangle whose product with itself is the covariance.
    factor: [[f64; WIDTH]; WIDTH],
    /// The columns of the factor's inverse, 0 where nothing varies.
    whitening: [[f64; WIDTH]; WIDTH],
    /// The inverse of the covariance of those that vary, 0 elsewhere.
    precision: [[f64; WIDTH]; WIDTH],
    /// 1 over its diagonal, 0 elsewhere.
    inverse_diagonal: Vector,
    /// Those that vary.
    used: Vec<usize>,
}

impl Scatter {
    /// Of the covariance `matrix`; what has no variance in it does not count.
    pub(crate) fn new(matrix: &Mat<f64>) -> Self {
        let used: Vec<usize> = (0..matrix.ncols()).filter(|&d| matrix[(d, d)] > VARIANCE_MIN).collect();
        let mut scatter = Self { used, ..Self::default() };
        for (i, j) in pairs(&scatter.used) {
            scatter.covariance[i][j] = matrix[(i, j)];
        }
        scatter.factor();
        scatter
    }

    /// The factor of Cholesky, row by row.
    fn factor(&mut self) {
        for &i in &self.used {
            for &j in self.used.iter().take_while(|&&j| j <= i) {
                let before: f64 = (0..j).map(|k| self.factor[i][k] * self.factor[j][k]).sum();
                let rest = self.covariance[i][j] - before;
                self.factor[i][j] = match i == j {
                    true if rest > 0.0 => rest.sqrt(),
                    false if self.factor[j][j] > 0.0 => rest / self.factor[j][j],
                    _ => 0.0,
                };
            }
        }
        // Column by column: what the factor makes 1 in its place and 0 elsewhere.
        for &column in &self.used {
            for &i in self.used.iter().filter(|&&i| i >= column) {
                let before: f64 = (column..i).map(|k| self.factor[i][k] * self.whitening[column][k]).sum();
                self.whitening[column][i] = (f64::from(u8::from(i == column)) - before) / self.factor[i][i];
            }
        }
        for (i, j) in pairs(&self.used) {
            self.precision[i][j] = (0..WIDTH).map(|k| self.whitening[i][k] * self.whitening[j][k]).sum();
            self.inverse_diagonal[i] = 1.0 / self.precision[i][i];
        }
    }

    /// Of the scores of sound places, shrunk as far as they are few (Ledoit and Wolf). What most places lack does not count;
    /// places that lack any of the rest teach nothing.
    pub(crate) fn of(places: impl Iterator<Item = Vector>) -> Self {
        let places: Vec<Vector> = places.collect();
        let has_most = |d: &usize| 2 * places.iter().filter(|place| place[*d].is_finite()).count() > places.len();
        let columns: Vec<usize> = (0..WIDTH).filter(has_most).collect();
        let rows: Vec<&Vector> = places.iter().filter(|place| columns.iter().all(|&d| place[d].is_finite())).collect();
        let covariance =
            Covariance::ledoit_wolf(Mat::from_fn(rows.len(), columns.len(), |i, j| rows[i][columns[j]]).as_ref());
        let mut matrix = Mat::zeros(WIDTH, WIDTH);
        let varies = |&j: &usize| !covariance.is_constant[j];
        for (i, j) in pairs(&(0..columns.len()).filter(varies).collect::<Vec<_>>()) {
            matrix[(columns[i], columns[j])] = covariance.matrix[(i, j)];
        }
        Self::new(&matrix)
    }

    /// Of the scores of places any of which may be cracked: those below 0 tell how far each discriminator scatters, as damage
    /// lies above.
    pub(crate) fn of_own(places: impl Iterator<Item = Vector>) -> Self {
        let places: Vec<Vector> = places.collect();
        let scatter = Self::of(places.iter().copied());
        let times = |d: usize| {
            let below = places.iter().map(|place| place[d]).filter(|score| *score <= 0.0);
            let (sum, count) = below.fold((0.0, 0_u32), |(sum, count), score| (sum + score * score, count + 1));
            (sum / f64::from(count)).sqrt() / scatter.deviation(d)
        };
        scatter.scaled(&std::array::from_fn(times))
    }

    /// The same where each discriminator scatters `times` as far.
    pub(crate) fn scaled(&self, times: &Vector) -> Self {
        self.with(|i, j| times[i] * times[j] * self.covariance[i][j])
    }

    /// The same without what two discriminators move together.
    pub(crate) fn uncorrelated(&self) -> Self {
        self.with(|i, j| if i == j { self.covariance[i][j] } else { 0.0 })
    }

    /// The same drawn towards `other` by the part `fraction`.
    pub(crate) fn mixed(&self, other: &Self, fraction: f64) -> Self {
        self.with(|i, j| (1.0 - fraction) * self.covariance[i][j] + fraction * other.covariance[i][j])
    }

    fn with(&self, covariance: impl Fn(usize, usize) -> f64) -> Self {
        let used: Vec<usize> = self.used().filter(|&d| covariance(d, d) > VARIANCE_MIN).collect();
        let mut found = Self { used, ..Self::default() };
        pairs(&found.used).for_each(|(i, j)| found.covariance[i][j] = covariance(i, j));
        found.factor();
        found
    }

    /// The discriminators that vary.
    pub(crate) fn used(&self) -> impl Iterator<Item = usize> + '_ {
        self.used.iter().copied()
    }

    /// Standard deviation of discriminator number `d`; 0 of one that does not count.
    pub(crate) fn deviation(&self, d: usize) -> f64 {
        self.covariance[d][d].sqrt()
    }

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
        for k in 0..WIDTH {
            (0..WIDTH).for_each(|d| slope[d] += self.precision[k][d] * y[k]);
        }
        let is_below = |y: &Vector, slope: &Vector| {
            let part: Vector = std::array::from_fn(|d| y[d] * slope[d]);
            ((part[0] + part[4]) + (part[2] + part[6])) + ((part[1] + part[5]) + (part[3] + part[7])) < limit
        };
        for _ in 0..BOUND_SWEEPS {
            if is_below(&y, &slope) {
                return true;
            }
            for k in 0..WIDTH {
                let free = y[k] - slope[k] * self.inverse_diagonal[k];
                let step = if free < scores[k] { scores[k] } else { free } - y[k];
                y[k] += step;
                (0..WIDTH).for_each(|d| slope[d] += self.precision[k][d] * step);
            }
        }
        is_below(&y, &slope)
    }

    /// `scores` as values that are independent on sound places, each of variance 1: but for [`ROUNDING`], their length is not less than
    /// the evidence. NaN where any that counts is absent.
    pub(crate) fn whitened(&self, scores: &Vector) -> Vector {
        // Whole columns, so that the compiler can use vectors.
        let mut white = [0.0; WIDTH];
        for &k in &self.used {
            for (white, part) in white.iter_mut().zip(&self.whitening[k]) {
                *white += part * scores[k];
            }
        }
        white
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

    /// Scores drawn from noise that scatters so.
    pub(crate) fn draw(&self, rng: &mut impl Rng) -> Vector {
        let (mut drawn, mut normal) = (ABSENT, [0.0; WIDTH]);
        for &i in &self.used {
            normal[i] = StandardNormal.sample(rng);
            drawn[i] = (0..=i).map(|k| self.factor[i][k] * normal[k]).sum();
        }
        drawn
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
            let step = |d: usize| w[d] / (w[d] - best[d]);
            let Some(step) = self.used().filter(falls).map(step).min_by(f64::total_cmp) else {
                *w = best;
                return;
            };
            for &d in self.used.iter().filter(|&&d| is_free[d]) {
                w[d] += step * (best[d] - w[d]);
            }
            for &d in &self.used {
                if is_free[d] && w[d] <= 1e-12 * best[d].abs() {
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

/// The sum of the squares, in four lanes, so that the compiler can use vectors.
pub(crate) fn squared_length(vector: &Vector) -> f64 {
    let mut lanes = [0.0; 4];
    vector.iter().enumerate().for_each(|(d, x)| lanes[d % 4] += x * x);
    (lanes[0] + lanes[2]) + (lanes[1] + lanes[3])
}

fn pairs(of: &[usize]) -> impl Iterator<Item = (usize, usize)> + '_ {
    of.iter().flat_map(move |&i| of.iter().map(move |&j| (i, j)))
}

#[cfg(test)]
mod tests {
    use faer::Side;
    use faer::linalg::solvers::DenseSolveCore as _;
    use proptest::prelude::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;

    use super::*;

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

    #[test]
    fn noise_scatters_as_it_is_told() {
        // Catches a factor of another matrix.
        let scatter = scatter(&[0.9, -0.3, 0.2, 0.1, 0.8, -0.5, 0.4, 0.2, 0.7], 3);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let drawn: Vec<Vector> = (0..20_000).map(|_| scatter.draw(&mut rng)).collect();
        for (i, j) in pairs(&[0, 1, 2]) {
            let found = drawn.iter().map(|z| z[i] * z[j]).sum::<f64>() / 20_000.0;
            assert!((found - scatter.covariance[i][j]).abs() < 0.05, "{i} {j} {found}");
        }
    }
}
