//! Logistic regression: the log-odds of a crack, as linear in the scores as can be and calibrated.
//!
//! Weights w and intercept b minimise w'w/2 + the sum of log(1 + exp(-(b + w'x))) over cracked and of log(1 + exp(b +
//! w'x)) over sound examples: scikit-learn's `LogisticRegression(C=1.0)`, to 1e-8. The penalty keeps w finite where the
//! classes do not overlap; b bears none. exp of the value is the odds where cracks are as frequent as among the
//! examples; where they are not, the log of the ratio of the odds is to be added.
//!
//! **Absent scores.** The value cannot be b + w'x over the present ones, which would take the rest for 0, that is for
//! sound. The rest is foretold from those present by least squares, with the covariance of all examples, cracked and
//! sound; what remains uncertain of w'x, with variance v, draws the log-odds towards 0 by 1/sqrt(1 + pi v/8) (MacKay,
//! "The evidence framework applied to classification networks", Neural Computation 4, 1992). So odds remain odds, and a
//! place of which less is known is judged less surely.
//!
//! Signs are as [`Lda`](super::Lda) says; with [`Signs::NonNegative`] what foretells has no weight below 0 either.

use std::f64::consts::PI;

use faer::Mat;

use super::classes::Classes;
use super::quadratic::{non_negative, solved};
use super::{Example, Index, LearnError, Signs, dot, score_of, to_unit};
use crate::covariance::{Covariance, block, constant_columns};

const NAME: &str = "the logistic regression";

/// Newton's method takes some ten rounds, more where steps must be halved.
const ROUNDS_MAX: usize = 100;

/// A fall of the objective below this part of it is rounding: the quadratic model is then truer than the difference.
const FALL_LEAST: f64 = 1e-13;

/// Rounds in which the fall may be rounding before the least is taken for found.
const NEAR_ROUNDS: usize = 4;

/// Regularised logistic regression.
#[derive(Debug, Clone)]
pub struct LogOdds {
    /// Of each discriminator, 0 where it is not used.
    weights: Vec<f64>,
    intercept: f64,
    /// Discriminators used; what follows has an element for each.
    columns: Vec<usize>,
    used_weights: Vec<f64>,
    /// Mean and covariance of all examples.
    mean: Vec<f64>,
    covariance: Mat<f64>,
    signs: Signs,
}

impl LogOdds {
    /// The regression of the classes of `examples` on their scores.
    ///
    /// # Errors
    /// [`LearnError::TooFew`] for less than 20 places of a class, [`LearnError::NoWeight`] if no discriminator tells
    /// the classes apart, or none in the right direction, and [`LearnError::NotFound`] if Newton's method does not end.
    pub fn learn(examples: &[Example], signs: Signs) -> Result<Self, LearnError> {
        let classes = Classes::both(NAME, examples)?;
        let sound_count = classes.sound.nrows();
        let all = Mat::from_fn(sound_count + classes.cracked.nrows(), classes.columns.len(), |i, j| {
            if i < sound_count { classes.sound[(i, j)] } else { classes.cracked[(i - sound_count, j)] }
        });
        let together = Covariance::standardised(all.as_ref());
        let [sound, cracked] = [&classes.sound, &classes.cracked].map(|x| constant_columns(x.as_ref()));
        let used: Vec<usize> = (0..classes.columns.len()).filter(|&j| !(sound[j] && cracked[j])).collect();
        // A last column of 1 bears the intercept.
        let design =
            Mat::from_fn(all.nrows(), used.len() + 1, |i, j| used.get(j).map_or(1.0, |&column| all[(i, column)]));
        let count = classes.count;
        let mut used_weights = fitted(&design, sound_count, signs).ok_or(LearnError::NotFound {
            index: NAME,
            count,
            rounds: ROUNDS_MAX,
        })?;
        let intercept = used_weights.pop().unwrap_or(0.0);
        if !used_weights.iter().any(|&w| w != 0.0) {
            let reason = "none differs between the classes, or all fall where they should rise";
            return Err(LearnError::NoWeight { index: NAME, count, reason });
        }
        let columns: Vec<usize> = used.iter().map(|&j| classes.columns[j]).collect();
        let mut weights = vec![0.0; count];
        for (&column, &weight) in columns.iter().zip(&used_weights) {
            weights[column] = weight;
        }
        let mean = used.iter().map(|&j| together.mean[j]).collect();
        let covariance = block(&together.matrix, &used);
        Ok(Self { weights, intercept, columns, used_weights, mean, covariance, signs })
    }

    /// Log-odds per unit of each discriminator's score: scikit-learn's `coef_`.
    pub fn coefficients(&self) -> &[f64] {
        &self.weights
    }

    /// Log-odds where all scores are 0: scikit-learn's `intercept_`.
    pub fn intercept(&self) -> f64 {
        self.intercept
    }

    /// The log-odds that the scores `off` the mean of the discriminators `present` foretell.
    fn foretold(&self, present: &[usize], off: &[f64]) -> Option<f64> {
        let w = &self.used_weights;
        let along: Vec<f64> = self.covariance.row_iter().map(|r| r.iter().zip(w).map(|(s, w)| s * w).sum()).collect();
        let shared: Vec<f64> = present.iter().map(|&k| along[k]).collect();
        let inner = block(&self.covariance, present);
        let by = match self.signs {
            Signs::NonNegative => non_negative(&inner, &shared, shared.len()),
            Signs::Free => solved(&inner, &shared),
        }?;
        let explained: f64 =
            inner.row_iter().zip(&by).map(|(r, a)| a * r.iter().zip(&by).map(|(s, b)| s * b).sum::<f64>()).sum();
        let left = dot(w, &along) - 2.0 * dot(&by, &shared) + explained;
        let variance = if left > 0.0 { left } else { 0.0 };
        let centre = self.intercept + dot(w, &self.mean) + dot(&by, off);
        by.iter().any(|&b| b != 0.0).then(|| centre / (1.0 + PI * variance / 8.0).sqrt())
    }
}

impl Index for LogOdds {
    fn value(&self, scores: &[Option<f64>]) -> Option<f64> {
        let found = |(k, &column): (usize, &usize)| Some((k, score_of(scores, column)?));
        let (present, found): (Vec<usize>, Vec<f64>) = self.columns.iter().enumerate().filter_map(found).unzip();
        let value = if present.len() == self.columns.len() {
            self.intercept + dot(&self.used_weights, &found)
        } else if present.is_empty() {
            return None;
        } else {
            let off: Vec<f64> = present.iter().zip(&found).map(|(&k, x)| x - self.mean[k]).collect();
            self.foretold(&present, &off)?
        };
        value.is_finite().then_some(value)
    }

    fn weights(&self) -> Option<Vec<f64>> {
        Some(to_unit(&self.weights))
    }
}

/// Weights and, last, intercept, by Newton's method with halved steps; the first `sound_count` rows are sound.
fn fitted(design: &Mat<f64>, sound_count: usize, signs: Signs) -> Option<Vec<f64>> {
    let (rows, size) = (design.nrows(), design.ncols());
    let mut x = vec![0.0; size];
    x[size - 1] = ((rows - sound_count) as f64 / sound_count as f64).ln();
    let mut near = 0;
    for _ in 0..ROUNDS_MAX {
        let (value, slope, curvature) = model(design, sound_count, &x);
        let target: Vec<f64> =
            (0..size).map(|i| (0..size).map(|j| curvature[(i, j)] * x[j]).sum::<f64>() - slope[i]).collect();
        let next = match signs {
            Signs::NonNegative => non_negative(&curvature, &target, size - 1),
            Signs::Free => solved(&curvature, &target),
        }?;
        let step: Vec<f64> = next.iter().zip(&x).map(|(next, x)| next - x).collect();
        let fall = -dot(&slope, &step);
        if fall <= FALL_LEAST * (1.0 + value) {
            x = next;
            near += 1;
            if near == NEAR_ROUNDS {
                return Some(x);
            }
            continue;
        }
        let along = |share: f64| x.iter().zip(&step).map(|(x, step)| x + share * step).collect::<Vec<f64>>();
        let falls = |share: &f64| objective(design, sound_count, &along(*share)) <= value - 1e-4 * share * fall;
        // 1/2^40 of a step is none.
        let share = (0..40).map(|halvings| 0.5_f64.powi(halvings)).find(falls)?;
        x = along(share);
    }
    None
}

/// The penalised negative log-likelihood.
fn objective(design: &Mat<f64>, sound_count: usize, x: &[f64]) -> f64 {
    let penalty = 0.5 * dot(&x[..x.len() - 1], &x[..x.len() - 1]);
    let loss = |(row, of): (usize, f64)| {
        let margin = if row < sound_count { -of } else { of };
        let beyond = if margin < 0.0 { -margin } else { 0.0 };
        beyond + (-margin.abs()).exp().ln_1p()
    };
    penalty + log_odds(design, x).into_iter().enumerate().map(loss).sum::<f64>()
}

/// The objective, its slope and its curvature at `x`.
fn model(design: &Mat<f64>, sound_count: usize, x: &[f64]) -> (f64, Vec<f64>, Mat<f64>) {
    let chances: Vec<f64> = log_odds(design, x).into_iter().map(|of| 1.0 / (1.0 + (-of).exp())).collect();
    let weighted =
        Mat::from_fn(design.nrows(), design.ncols(), |i, j| chances[i] * (1.0 - chances[i]) * design[(i, j)]);
    let mut curvature = design.transpose() * &weighted;
    let excess = |i: usize| if i < sound_count { chances[i] } else { chances[i] - 1.0 };
    let mut slope: Vec<f64> =
        design.col_iter().map(|column| column.iter().enumerate().map(|(i, x)| excess(i) * x).sum()).collect();
    for j in 0..x.len() - 1 {
        slope[j] += x[j];
        curvature[(j, j)] += 1.0;
    }
    (objective(design, sound_count, x), slope, curvature)
}

fn log_odds(design: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    design.row_iter().map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect()
}
