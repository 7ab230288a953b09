//! Distance from the sound places, for a reference that knows no crack.
//!
//! d^2 = (x - m)' S^-1 (x - m), with m and S the mean and the Ledoit-Wolf covariance of sound examples: scikit-learn's
//! `LedoitWolf().fit(X).mahalanobis(x)`, to 1e-8. A distance has no direction, and a place sounder than the mean would
//! look as damaged as one that is worse. Here what lies on the healthy side of a discriminator's mean counts as its
//! mean.
//!
//! The value is d over its root mean square on sound places, as a normal distribution of that covariance has it, of
//! those discriminators that are present: so sound places have a mean square of 1, complete or not, and one limit
//! serves both.
//!
//! It weighs what sound places never do, not what cracks do: of discriminators that move together, it is one without
//! the others that stands out, and the index *falls* when the others follow. On the scores of [`Lda`](super::Lda)'s
//! table, 100 sound places, its AUC was 0.855 where the plain mean has 0.866; with both directions 0.749.

use std::f64::consts::PI;

use faer::Mat;

use super::classes::Classes;
use super::quadratic::inverse;
use super::{Example, Index, LearnError, dot, score_of};
use crate::covariance::{Covariance, block};

const NAME: &str = "the Mahalanobis distance";

/// One-sided Mahalanobis distance.
#[derive(Debug, Clone)]
pub struct Mahalanobis {
    /// Discriminators used; what follows has an element for each.
    columns: Vec<usize>,
    mean: Vec<f64>,
    covariance: Mat<f64>,
    /// Of all of `columns`.
    complete: Metric,
}

/// What squares a distance in some of the discriminators.
#[derive(Debug, Clone)]
struct Metric {
    /// Inverse of the covariance.
    inverse: Mat<f64>,
    /// Mean square of the one-sided distance on sound places.
    null_square: f64,
}

impl Mahalanobis {
    /// The distance from the sound ones of `examples`.
    ///
    /// # Errors
    /// [`LearnError::TooFewSound`] for less than 20 sound places, [`LearnError::NoWeight`] if no discriminator
    /// scatters.
    pub fn learn(examples: &[Example]) -> Result<Self, LearnError> {
        let classes = Classes::only_sound(NAME, examples)?;
        let all = Covariance::ledoit_wolf(classes.sound.as_ref());
        let used: Vec<usize> = (0..classes.columns.len()).filter(|&j| !all.is_constant[j]).collect();
        let covariance = block(&all.matrix, &used);
        let reason = "none scatters over sound places";
        let complete =
            Metric::of(&covariance).ok_or(LearnError::NoWeight { index: NAME, count: classes.count, reason })?;
        let columns = used.iter().map(|&j| classes.columns[j]).collect();
        Ok(Self { columns, mean: used.iter().map(|&j| all.mean[j]).collect(), covariance, complete })
    }

    /// The squared distance in both directions, unscaled: scikit-learn's `mahalanobis`. `None` where a score is absent.
    pub fn squared_both_ways(&self, scores: &[Option<f64>]) -> Option<f64> {
        let off = self.columns.iter().zip(&self.mean).map(|(&column, mean)| Some(score_of(scores, column)? - mean));
        Some(self.complete.squared(&off.collect::<Option<Vec<f64>>>()?)).filter(|d| d.is_finite())
    }
}

impl Metric {
    /// `None` if there is no discriminator.
    fn of(covariance: &Mat<f64>) -> Option<Self> {
        let n = covariance.nrows();
        let inverse = inverse(covariance)?;
        let terms = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
        let null_square = terms.map(|(i, j)| inverse[(i, j)] * half_moment(covariance, i, j)).sum();
        (null_square > 0.0).then_some(Self { inverse, null_square })
    }

    fn squared(&self, x: &[f64]) -> f64 {
        let rows = self.inverse.row_iter().map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum());
        dot(&rows.collect::<Vec<f64>>(), x)
    }
}

/// Mean of max(0, x_i) max(0, x_j) of normal x with mean 0 and this covariance.
///
/// s_i s_j (sin a + (pi - a) cos a)/(2 pi) with cos a the correlation (Cho and Saul, "Kernel methods for deep
/// learning", 2009, Eq. 6).
fn half_moment(covariance: &Mat<f64>, i: usize, j: usize) -> f64 {
    let scale = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
    let correlation = (covariance[(i, j)] / scale).clamp(-1.0, 1.0);
    let angle = correlation.acos();
    scale * (angle.sin() + (PI - angle) * correlation) / (2.0 * PI)
}

impl Index for Mahalanobis {
    fn value(&self, scores: &[Option<f64>]) -> Option<f64> {
        let beyond = |(k, &column): (usize, &usize)| {
            let off = score_of(scores, column)? - self.mean[k];
            Some((k, if off > 0.0 { off } else { 0.0 }))
        };
        let (present, beyond): (Vec<usize>, Vec<f64>) = self.columns.iter().enumerate().filter_map(beyond).unzip();
        let root = |metric: &Metric| {
            let squared = metric.squared(&beyond) / metric.null_square;
            // Rounding may take a distance of nothing below it.
            if squared < 0.0 { 0.0 } else { squared.sqrt() }
        };
        let value = if present.len() == self.columns.len() {
            root(&self.complete)
        } else {
            root(&Metric::of(&block(&self.covariance, &present))?)
        };
        value.is_finite().then_some(value)
    }

    fn weights(&self) -> Option<Vec<f64>> {
        None
    }
}
