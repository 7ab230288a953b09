//! How scores of sound places scatter together.

mod orthant;
mod weights;

use faer::Mat;

use crate::evidence::covariance::Covariance;
use crate::evidence::{Columns, STRATIFIED, Vector, WIDTH};
use crate::stats::{mean, quantile};

/// A variance at or below this is rounding: that of what counts is near 1.
const VARIANCE_MIN: f64 = 1e-12;

/// The fraction of each discriminator's variance taken to be its own, whatever the reference shows. What two of them hardly ever do
/// apart, a rogue tap does, and without this fraction it would stand out. With less, sound shoulders of rough casings are called more
/// often than stated; with more, more faint cracks pass (`docs/rates.md`).
const UNRELATED: f64 = 0.1;

/// One row and column a discriminator.
type Square = [Vector; WIDTH];

/// How scores of sound places scatter together.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scatter {
    covariance: Square,
    /// The columns of the lower triangle whose product with itself is the covariance.
    factor: Square,
    /// The columns of the factor's inverse, 0 where nothing varies.
    whitening: Square,
    /// The inverse of the covariance of those that vary, 0 elsewhere.
    precision: Square,
    /// 1 over the diagonals of covariance and precision, 0 elsewhere.
    covariance_steps: Vector,
    precision_steps: Vector,
    /// The discriminators that vary.
    used: Vec<usize>,
}

impl Scatter {
    /// The scatter with the covariance `matrix`; a discriminator without variance does not count.
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
                let before: f64 = (0..j).map(|k| self.factor[k][i] * self.factor[k][j]).sum();
                let rest = self.covariance[i][j] - before;
                self.factor[j][i] =
                    if i > j { rest / self.factor[j][j] } else { root_of_rest(rest, self.covariance[i][i]) };
            }
        }
        // Column by column: what the factor makes 1 in its place and 0 elsewhere.
        for &column in &self.used {
            for &i in self.used.iter().filter(|&&i| i >= column) {
                let before: f64 = (column..i).map(|k| self.factor[k][i] * self.whitening[column][k]).sum();
                self.whitening[column][i] = (f64::from(u8::from(i == column)) - before) / self.factor[i][i];
            }
        }
        for (i, j) in pairs(&self.used) {
            self.precision[i][j] = (0..WIDTH).map(|k| self.whitening[i][k] * self.whitening[j][k]).sum();
            self.precision_steps[i] = 1.0 / self.precision[i][i];
            self.covariance_steps[i] = 1.0 / self.covariance[i][i];
        }
    }

    /// The scatter of the scores of sound places: the covariance of Ledoit and Wolf, who shrink it the more the fewer places there are,
    /// with correlations reduced by [`UNRELATED`]. A discriminator that most places lack does not count; a place that lacks any other is
    /// left out.
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
            let correlated = if i == j { 1.0 } else { 1.0 - UNRELATED };
            matrix[(columns[i], columns[j])] = correlated * covariance.matrix[(i, j)];
        }
        Self::new(&matrix)
    }

    /// The scatter of the scores of places any of which may be cracked: those below 0 give the deviation of each discriminator, because
    /// damage lies above.
    pub(crate) fn of_own(places: impl Iterator<Item = Vector>) -> Self {
        let places: Vec<Vector> = places.collect();
        let scatter = Self::of(places.iter().copied());
        let times = |d: usize| {
            let below = places.iter().map(|place| place[d]).filter(|score| *score <= 0.0);
            mean(below.map(|score| score * score)).unwrap_or(f64::NAN).sqrt() / scatter.deviation(d)
        };
        scatter.scaled(&std::array::from_fn(times))
    }

    /// This scatter, with each discriminator scattering `times` as far.
    pub(crate) fn scaled(&self, times: &Vector) -> Self {
        self.with(|i, j| times[i] * times[j] * self.covariance[i][j])
    }

    /// This scatter, drawn towards `other` by the part `fraction`.
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

    /// `scores` as values that are independent on sound places, each of variance 1. The length of those of a place is not less than its
    /// evidence, but for the rounding.
    pub(crate) fn whitened(&self, scores: &Columns) -> Columns {
        self.product(&self.whitening, |k| &scores[self.used[k]])
    }

    /// Scores with this scatter from independent values of variance 1: one column of `white` for each discriminator that varies, so that
    /// one that does not vary changes nothing.
    pub(crate) fn coloured(&self, white: &Columns) -> Columns {
        self.product(&self.factor, |k| &white[k])
    }

    /// The product of a `triangle` with the values of each place, of which `values` has one for each discriminator that varies; 0 of the
    /// others.
    fn product<'a>(&self, triangle: &Square, values: impl Fn(usize) -> &'a Vec<f32>) -> Columns {
        let mut products = Columns::default();
        let place_count = if self.used.is_empty() { 0 } else { values(0).len() };
        products.iter_mut().for_each(|product| product.resize(place_count, 0.0));
        for (number, &d) in self.used.iter().enumerate() {
            for (k, &of_k) in self.used[..=number].iter().enumerate() {
                let part = triangle[of_k][d] as f32;
                products[d].iter_mut().zip(values(k)).for_each(|(product, value)| *product += part * value);
            }
        }
        products
    }

    /// What [`Self::evidence_apart`] of scores that scatter so exceeds with probability `rate`; 0 where nothing varies.
    pub(crate) fn limit_apart(&self, rate: f64) -> f64 {
        let drawn = self.coloured(&STRATIFIED);
        let mut squares = vec![0.0; STRATIFIED[0].len()];
        for d in self.used() {
            for (square, score) in squares.iter_mut().zip(&drawn[d]) {
                let above = if *score > 0.0 { f64::from(*score) / self.deviation(d) } else { 0.0 };
                *square += above * above;
            }
        }
        quantile(&mut squares, 1.0 - rate).map_or(0.0, f64::sqrt)
    }
}

/// The root of what is left of `variance` when others are known. At 1e-12 of it that is rounding: it is never less.
fn root_of_rest(rest: f64, variance: f64) -> f64 {
    let least = 1e-12 * variance;
    (if rest > least { rest } else { least }).sqrt()
}

fn pairs(of: &[usize]) -> impl Iterator<Item = (usize, usize)> + '_ {
    of.iter().flat_map(move |&i| of.iter().map(move |&j| (i, j)))
}

#[cfg(test)]
mod tests {
    use tapline_testing::noise::Noise;

    use super::*;
    use crate::evidence::{ABSENT, Normals};

    pub(super) fn drawn(scatter: &Scatter, count: usize) -> Vec<Vector> {
        let columns = scatter.coloured(&Normals::default().columns(count));
        let score =
            |place: usize, d: usize| if scatter.used.contains(&d) { f64::from(columns[d][place]) } else { f64::NAN };
        (0..count).map(|place| std::array::from_fn(|d| score(place, d))).collect()
    }

    #[test]
    fn noise_scatters_as_asked_for() {
        // Catches a factor of another matrix, and one that a discriminator that does not count has a part in.
        let root = Mat::from_fn(3, 3, |i, j| [[0.9, -0.3, 0.2], [0.1, 0.8, -0.5], [0.4, 0.2, 0.7]][i][j]);
        let matrix = root.transpose() * &root;
        let scatter = Scatter::new(&Mat::from_fn(4, 4, |i, j| if i < 3 && j < 3 { matrix[(i, j)] } else { 0.0 }));
        let drawn = drawn(&scatter, 20_000);
        for (i, j) in pairs(&[0, 1, 2]) {
            let found = drawn.iter().map(|z| z[i] * z[j]).sum::<f64>() / 20_000.0;
            assert!((found - scatter.covariance[i][j]).abs() < 0.05, "{i} {j} {found}");
        }
        assert!(drawn.iter().all(|z| z[3].is_nan()));
    }

    #[test]
    fn few_places_of_noise_are_beyond_their_limit() {
        // Catches a limit of independent scores where three go together, of variances, and of another part of the places.
        let matrix = Mat::from_fn(4, 4, |i, j| {
            if i == j {
                4.0
            } else if i < 3 && j < 3 {
                3.6
            } else {
                0.0
            }
        });
        let scatter = Scatter::new(&matrix);
        let beyond = drawn(&scatter, 20_000);
        let limit = scatter.limit_apart(0.05);
        let found = beyond.iter().filter(|scores| scatter.evidence_apart(scores) > limit).count() as f64 / 20_000.0;
        assert!((0.04..0.06).contains(&found), "{found} {limit}");
        assert!(Scatter::default().limit_apart(0.05).abs() < 1e-12);
        // Of one discriminator the limit is known. Catches one that a few draws put 3 % too low.
        let one = Scatter::new(&Mat::from_fn(1, 1, |_, _| 4.0));
        assert!((one.limit_apart(0.0228) - 2.0).abs() < 0.01, "{}", one.limit_apart(0.0228));
    }

    #[test]
    fn what_two_scores_never_did_apart_is_no_certainty() {
        // Catches a rogue tap that stands out because two discriminators went together in the reference: their difference was 1 in 100
        // there.
        let mut noise = Noise(1);
        let mut random = || noise.uniform() - 0.5;
        let place = |_| {
            let (common, apart) = (12.0_f64.sqrt() * random(), 0.02 * random());
            let mut place = ABSENT;
            (place[0], place[1]) = (common + apart, common - apart);
            place
        };
        let scatter = Scatter::of((0..2000).map(place).collect::<Vec<_>>().into_iter());
        let mut rogue = ABSENT;
        (rogue[0], rogue[1]) = (0.5, -0.5);
        let evidence = scatter.evidence(&rogue);
        // By a tenth of its own variance a difference scatters by the root of 0.2.
        assert!((evidence - 1.0 / 0.2_f64.sqrt()).abs() < 0.1, "{evidence}");
    }
}
