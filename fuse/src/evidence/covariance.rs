//! Covariance of scores that few examples still determine: the estimate of Ledoit and Wolf.
//!
//! The empirical covariance S of p scores in n examples is drawn towards a multiple of the identity, (1 - a) S + a m I
//! with m = tr(S)/p, by the share a that minimises the expected squared error (Ledoit and Wolf, "A well-conditioned
//! estimator for large-dimensional covariance matrices", J. Multivariate Analysis 88, 2004). It can be inverted when n
//! is close to p, or below it.

use faer::{Mat, MatRef};

/// A spread at or below this is rounding: scores are standardised, so that sound places scatter by 1.
const ROUNDING: f64 = 1e-9;

/// How scores scatter together.
#[derive(Debug, Clone)]
pub(crate) struct Covariance {
    /// Shrunk covariance, as divided by n.
    pub matrix: Mat<f64>,
    /// Columns without scatter. They count in the trace, as a user of scikit-learn has it, but must not be inverted.
    pub is_constant: Vec<bool>,
}

impl Covariance {
    /// Ledoit-Wolf covariance of the columns of `x`, one example a row, as they are.
    pub(crate) fn ledoit_wolf(x: MatRef<'_, f64>) -> Self {
        let (mean, centred) = centred(x);
        Self { is_constant: constants(&mean, &centred), matrix: shrunk(&centred) }
    }
}

/// Mean of each column, 0 of no rows, and the columns less their means.
fn centred(x: MatRef<'_, f64>) -> (Vec<f64>, Mat<f64>) {
    let count = x.nrows().max(1) as f64;
    let mean: Vec<f64> = (0..x.ncols()).map(|j| x.col(j).iter().sum::<f64>() / count).collect();
    let centred = Mat::from_fn(x.nrows(), x.ncols(), |i, j| x[(i, j)] - mean[j]);
    (mean, centred)
}

fn constants(mean: &[f64], centred: &Mat<f64>) -> Vec<bool> {
    mean.iter().enumerate().map(|(j, mean)| spread(centred, j) <= ROUNDING * (1.0 + mean.abs())).collect()
}

fn spread(centred: &Mat<f64>, column: usize) -> f64 {
    (centred.col(column).iter().map(|x| x * x).sum::<f64>() / centred.nrows().max(1) as f64).sqrt()
}

/// The shrunk covariance of centred columns.
fn shrunk(centred: &Mat<f64>) -> Mat<f64> {
    let (n, p) = (centred.nrows().max(1) as f64, centred.ncols());
    let mut matrix = centred.transpose() * centred;
    matrix.col_iter_mut().for_each(|column| column.iter_mut().for_each(|x| *x /= n));
    let trace: f64 = (0..p).map(|j| matrix[(j, j)]).sum();
    let target = trace / p.max(1) as f64;
    // One column has no correlation to shrink.
    let shrinkage = if p < 2 { 0.0 } else { share(centred, &matrix, target) };
    matrix.col_iter_mut().for_each(|column| column.iter_mut().for_each(|x| *x *= 1.0 - shrinkage));
    for j in 0..p {
        matrix[(j, j)] += shrinkage * target;
    }
    matrix
}

/// Share of the identity: the variance of the empirical covariance, over its squared distance from the target.
fn share(centred: &Mat<f64>, matrix: &Mat<f64>, target: f64) -> f64 {
    let n = centred.nrows().max(1) as f64;
    // sum over i, j of the mean of (x_i x_j)^2 is the mean of (sum over i of x_i^2)^2.
    let fourth: f64 = centred.row_iter().map(|row| row.iter().map(|x| x * x).sum::<f64>().powi(2)).sum::<f64>() / n;
    let squares: f64 = matrix.col_iter().map(|column| column.iter().map(|x| x * x).sum::<f64>()).sum();
    let p = matrix.ncols() as f64;
    let distance = squares - p * target * target;
    let variance = (fourth - squares) / n;
    if distance > 0.0 { (variance / distance).clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// Scores of sound places and scikit-learn's `LedoitWolf().fit(x).covariance_` of them, case by case; by
    /// `tests/covariance_reference.py`.
    const REFERENCE: &str = include_str!("../../tests/covariance_reference.csv");

    #[test]
    fn the_covariance_is_that_of_ledoit_wolf() {
        // Catches n - 1 in place of n, a shrinkage of another formula, and one column that is shrunk.
        let mut cases: BTreeMap<&str, (Vec<Vec<f64>>, Vec<f64>)> = BTreeMap::new();
        for line in REFERENCE.lines() {
            let mut cells = line.split(',');
            let (case, name) = (cells.next().unwrap(), cells.next().unwrap());
            let numbers: Vec<f64> = cells.map(|cell| cell.parse().unwrap()).collect();
            let (rows, expected) = cases.entry(case).or_default();
            if name == "sound" { rows.push(numbers) } else { *expected = numbers }
        }
        assert_eq!(cases.len(), 5);
        for (case, (rows, expected)) in cases {
            let found = Covariance::ledoit_wolf(Mat::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j]).as_ref());
            let constants = found.is_constant.iter().filter(|&&constant| constant).count();
            assert_eq!(constants, usize::from(case == "constant"), "{case}");
            let width = rows[0].len();
            for (place, expected) in expected.iter().enumerate() {
                let got = found.matrix[(place / width, place % width)];
                assert!((got - expected).abs() <= 1e-8 * (1.0 + expected.abs()), "{case}: {got} {expected}");
            }
        }
    }
}
