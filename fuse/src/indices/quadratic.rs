//! The least of a quadratic form, with and without bounds: min x'Ax/2 - b'x, A symmetric and not negative.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};

use crate::covariance::block;

/// Parts of a sum below this share of its terms are rounding.
const ROUNDING: f64 = 1e-12;

/// A pivot of a matrix with unit diagonal at or below this is that of a column which others determine.
const PIVOT_LEAST: f64 = 1e-10;

/// The x that solves A x = b, of least length if there are many; `None` if A has no decomposition or x is no number.
pub(super) fn solved(a: &Mat<f64>, b: &[f64]) -> Option<Vec<f64>> {
    let x = solved_all(a, &Mat::from_fn(b.len(), 1, |i, _| b[i]))?;
    Some(x.col(0).iter().copied().collect())
}

/// The inverse of A, or what takes its place if it has none; `None` if A has no decomposition.
pub(super) fn inverse(a: &Mat<f64>) -> Option<Mat<f64>> {
    solved_all(a, &Mat::identity(a.nrows(), a.nrows()))
}

/// The X that solves A X = B.
///
/// A is brought to a unit diagonal first, so that its rank does not depend on the units of its columns. A column whose
/// diagonal is not above zero gets 0.
fn solved_all(a: &Mat<f64>, b: &Mat<f64>) -> Option<Mat<f64>> {
    let size = a.nrows();
    let scale: Vec<f64> = (0..size).map(|j| a[(j, j)]).map(|d| if d > 0.0 { d.sqrt().recip() } else { 0.0 }).collect();
    let unit = Mat::from_fn(size, size, |i, j| a[(i, j)] * scale[i] * scale[j]);
    let right = Mat::from_fn(size, b.ncols(), |i, j| b[(i, j)] * scale[i]);
    let solved = match by_cholesky(&unit, &right) {
        Some(solved) => solved,
        None => by_eigenvalues(&unit, &right)?,
    };
    let x = Mat::from_fn(size, b.ncols(), |i, j| solved[(i, j)] * scale[i]);
    let is_number = x.col_iter().all(|column| column.iter().all(|x| x.is_finite()));
    is_number.then_some(x)
}

/// `None` where columns determine each other.
fn by_cholesky(unit: &Mat<f64>, right: &Mat<f64>) -> Option<Mat<f64>> {
    let factors = unit.llt(Side::Lower).ok()?;
    let pivots = factors.L();
    (0..unit.nrows()).all(|j| pivots[(j, j)] * pivots[(j, j)] > PIVOT_LEAST).then(|| factors.solve(right))
}

/// For any rank: directions that the matrix does not have get 0.
fn by_eigenvalues(unit: &Mat<f64>, right: &Mat<f64>) -> Option<Mat<f64>> {
    let eigen = unit.self_adjoint_eigen(Side::Lower).ok()?;
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    let largest = values.iter().copied().max_by(f64::total_cmp)?;
    let mut along = vectors.transpose() * right;
    for (row, &value) in along.row_iter_mut().zip(values.iter()) {
        let has_it = value > largest * f64::EPSILON * unit.nrows() as f64;
        row.iter_mut().for_each(|x| *x = if has_it { *x / value } else { 0.0 });
    }
    Some(vectors * along)
}

/// The x that minimises the form where its first `bounded` elements must not be negative, by the active set of Lawson
/// and Hanson (*Solving Least Squares Problems*, 1974, chapter 23); what it returns is never negative there.
pub(super) fn non_negative(a: &Mat<f64>, b: &[f64], bounded: usize) -> Option<Vec<f64>> {
    let n = b.len();
    // What no bound holds is the least, and one solution in place of several.
    let unbound = solved(a, b)?;
    if unbound[..bounded].iter().all(|&x| x >= 0.0) {
        return Some(unbound);
    }
    let mut is_free: Vec<bool> = (0..n).map(|j| j >= bounded).collect();
    let mut x = freely(a, b, &is_free)?;
    // Each round frees one; in exact arithmetic none repeats, and a few rounds an element are enough.
    for _ in 0..10 * n + 10 {
        let Some(next) = steepest(a, b, &x, &is_free) else { break };
        is_free[next] = true;
        // Each round binds at least one, so that n rounds end it.
        for _ in 0..=n {
            let z = freely(a, b, &is_free)?;
            // 0/0 is an element that was freed at 0 and stays there.
            let step = |j: usize| if x[j] > 0.0 { x[j] / (x[j] - z[j]) } else { 0.0 };
            let steps: Vec<(f64, usize)> =
                (0..bounded).filter(|&j| is_free[j] && z[j] <= 0.0).map(|j| (step(j), j)).collect();
            let Some(least) = steps.iter().map(|&(step, _)| step).min_by(f64::total_cmp) else {
                x = z;
                break;
            };
            x.iter_mut().zip(&z).for_each(|(x, z)| *x += least * (z - *x));
            for (_, j) in steps.into_iter().filter(|&(step, _)| step <= least) {
                (is_free[j], x[j]) = (false, 0.0);
            }
        }
    }
    x[..bounded].iter_mut().for_each(|x| *x = if *x > 0.0 { *x } else { 0.0 });
    Some(x)
}

/// The least of the form with all elements at 0 that are not free.
fn freely(a: &Mat<f64>, b: &[f64], is_free: &[bool]) -> Option<Vec<f64>> {
    let free: Vec<usize> = (0..b.len()).filter(|&j| is_free[j]).collect();
    let mut x = vec![0.0; b.len()];
    if free.is_empty() {
        return Some(x);
    }
    let inner = solved(&block(a, &free), &free.iter().map(|&j| b[j]).collect::<Vec<f64>>())?;
    free.into_iter().zip(inner).for_each(|(j, value)| x[j] = value);
    Some(x)
}

/// The bound element along which the form falls the most, measured in units of its own curvature.
fn steepest(a: &Mat<f64>, b: &[f64], x: &[f64], is_free: &[bool]) -> Option<usize> {
    let slope = |j: usize| {
        let (fall, terms) = (0..b.len())
            .map(|k| a[(j, k)] * x[k])
            .fold((b[j], b[j].abs()), |(fall, terms), term| (fall - term, terms + term.abs()));
        (fall > ROUNDING * terms && a[(j, j)] > 0.0).then(|| (fall / a[(j, j)].sqrt(), j))
    };
    let falls = (0..b.len()).filter(|&j| !is_free[j]).filter_map(slope);
    falls.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, j)| j)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn form(a: &Mat<f64>, b: &[f64], x: &[f64]) -> f64 {
        (0..b.len()).map(|i| x[i] * (0.5 * (0..b.len()).map(|j| a[(i, j)] * x[j]).sum::<f64>() - b[i])).sum()
    }

    /// R'R of a square R, with a little on the diagonal.
    fn positive(root: &[f64], size: usize) -> Mat<f64> {
        let root = Mat::from_fn(size, size, |i, j| root[i * size + j]);
        let mut a = root.transpose() * &root;
        (0..size).for_each(|j| a[(j, j)] += 0.05);
        a
    }

    /// The least over all choices of what is 0, as long as nothing bounded is negative.
    fn by_trying(a: &Mat<f64>, b: &[f64], bounded: usize) -> f64 {
        let tried = (0..1_usize << bounded).filter_map(|choice| {
            let is_free: Vec<bool> = (0..b.len()).map(|j| j >= bounded || choice >> j & 1 == 1).collect();
            let x = freely(a, b, &is_free)?;
            x[..bounded].iter().all(|&x| x >= -1e-12).then(|| form(a, b, &x))
        });
        tried.min_by(f64::total_cmp).unwrap()
    }

    proptest! {
        #[test]
        fn the_active_set_finds_what_trying_all_finds(
            root in prop::collection::vec(-1.0..1.0, 36), b in prop::collection::vec(-2.0..2.0, 6),
            bounded in 0..7_usize,
        ) {
            // Catches an active set that ends too early, one that frees the wrong element, and a bound on what has
            // none.
            let a = positive(&root, 6);
            let x = non_negative(&a, &b, bounded).unwrap();
            prop_assert!(x[..bounded].iter().all(|&x| x >= 0.0));
            let (found, least) = (form(&a, &b, &x), by_trying(&a, &b, bounded));
            prop_assert!(found <= least + 1e-9 * (1.0 + least.abs()), "{} {}", found, least);
        }

        #[test]
        fn the_solution_solves(
            root in prop::collection::vec(-1.0..1.0, 25), b in prop::collection::vec(-2.0..2.0, 5),
            units in prop::collection::vec(-6.0..6.0, 5),
        ) {
            // Catches a rank that falls where columns have very different units.
            let units: Vec<f64> = units.into_iter().map(|e| 10_f64.powf(e)).collect();
            let unscaled = positive(&root, 5);
            let a = Mat::from_fn(5, 5, |i, j| unscaled[(i, j)] * units[i] * units[j]);
            let x = solved(&a, &b).unwrap();
            for i in 0..5 {
                let products = (0..5).map(|j| a[(i, j)] * x[j]);
                let (sum, terms) = products.fold((0.0, b[i].abs()), |s, t| (s.0 + t, s.1 + t.abs()));
                prop_assert!((sum - b[i]).abs() <= 1e-10 * terms, "{} {}", sum, b[i]);
            }
        }
    }

    proptest! {
        #[test]
        fn both_decompositions_agree(
            root in prop::collection::vec(-1.0..1.0, 25), b in prop::collection::vec(-2.0..2.0, 5),
        ) {
            // Catches a solution that jumps where one decomposition takes over from the other.
            let (a, b) = (positive(&root, 5), Mat::from_fn(5, 1, |i, _| b[i]));
            let (one, other) = (by_cholesky(&a, &b).unwrap(), by_eigenvalues(&a, &b).unwrap());
            for j in 0..5 {
                prop_assert!((one[(j, 0)] - other[(j, 0)]).abs() < 1e-9, "{:?} {:?}", one, other);
            }
        }
    }

    #[test]
    fn what_is_not_determined_is_shared_or_zero() {
        // Catches a singular matrix that becomes an infinity: two columns alike, and one without scatter.
        let a = Mat::from_fn(3, 3, |i, j| if i < 2 && j < 2 { 2.0 } else { 0.0 });
        let x = solved(&a, &[4.0, 4.0, 1.0]).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-12 && (x[1] - 1.0).abs() < 1e-12, "{x:?}");
        assert_eq!(x[2].to_bits(), 0.0_f64.to_bits());
        let x = non_negative(&a, &[4.0, 4.0, 1.0], 3).unwrap();
        assert!((x[0] + x[1] - 2.0).abs() < 1e-12, "{x:?}");
    }
}
