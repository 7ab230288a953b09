//! Probabilities of counts and variance ratios: the regularised incomplete beta function and its inverse.

use statrs::function::beta::checked_beta_reg;

/// Halvings of 0 to 1: the last is below the rounding of any rate that a count can give.
const HALVINGS: usize = 64;

/// I_x(a, b), 0 to 1; 0 below x = 0 and 1 above x = 1. `a` and `b` above 0.
pub(super) fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    // Only a, b <= 0 and x outside 0 to 1 are refused.
    checked_beta_reg(a, b, x).unwrap_or(1.0)
}

/// The x at which I_x(a, b) reaches `probability`, by bisection, which needs no start and cannot fail.
pub(super) fn beta_quantile(a: f64, b: f64, probability: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if incomplete_beta(a, b, middle) < probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Probability that a ratio of two equal variances' estimates with these degrees of freedom exceeds `ratio`.
pub(super) fn f_upper_tail(ratio: f64, over_degrees: f64, under_degrees: f64) -> f64 {
    incomplete_beta(0.5 * under_degrees, 0.5 * over_degrees, under_degrees / (under_degrees + over_degrees * ratio))
}
