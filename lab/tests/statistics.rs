//! What a study claims, against statsmodels, scipy and published examples.

mod a_hat;
mod gauge;
mod hit_miss;
mod rate;
mod reference;

pub(crate) use gauge::AIAG;
pub(crate) use reference::{A_HAT, HIT_MISS};

/// Whether two numbers are the same to a part `tolerance` of the second.
fn is_near(got: f64, expected: f64, tolerance: f64) -> bool {
    (got - expected).abs() <= tolerance * expected.abs()
}

/// As [`is_near`] for covariances: to a part of the variances, since a covariance may be close to 0.
fn is_near_covariance<const N: usize>(got: &[[f64; N]; N], expected: &[f64], tolerance: f64) -> bool {
    let variance = |i: usize| expected[i * N + i];
    (0..N).all(|i| {
        (0..N).all(|j| (got[i][j] - expected[i * N + j]).abs() <= tolerance * (variance(i) * variance(j)).sqrt())
    })
}
