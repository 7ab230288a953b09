//! The upper tail of the normal distribution where even its logarithm is small, and its hazard.

use std::f64::consts::PI;

use crate::statistics::normal::upper_tail;

/// The standard normal value below which 90 % lie (scipy.stats.norm.ppf).
pub(super) const Z_90: f64 = 1.281_551_565_544_600_4;

/// The standard normal value below which 95 % lie (scipy.stats.norm.ppf): of one-sided bounds.
pub(super) const Z_95: f64 = 1.644_853_626_951_472_2;

/// Logarithm of the probability Q(z) that a standard normal value exceeds `z`, and the hazard phi(z)/Q(z).
///
/// The probability itself underflows at z = 38; these do not.
pub(super) fn log_tail_and_hazard(z: f64) -> (f64, f64) {
    let log_density = -0.5 * z * z - 0.5 * (2.0 * PI).ln();
    if z < 5.0 {
        let tail = upper_tail(z);
        return (tail.ln(), log_density.exp() / tail);
    }
    // Abramowitz and Stegun 26.2.14: Q = phi/(z + 1/(z + 2/(z + 3/...))); 100 levels are exact from z = 5 on.
    let hazard = (1..=100_u32).rev().fold(z, |fraction, n| z + f64::from(n) / fraction);
    (log_density - hazard.ln(), hazard)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tail_is_that_of_scipy() {
        // scipy.stats.norm.logsf(z), exp(logpdf - logsf); catches a wrong branch, and digits lost far out.
        for (z, log_tail, hazard) in [
            (-30.0, -4.906_713_927_147_908e-198, 1.473_646_134_878_577e-196),
            (-2.0, -0.023_012_909_328_963_49, 0.055_247_862_678_989_95),
            (0.0, -std::f64::consts::LN_2, 0.797_884_560_802_865_4),
            (4.999, -15.059_812_373_671_578, 5.185_536_668_974_203),
            (5.001, -15.070_185_381_609_44, 5.187_471_276_103_27),
            (40.0, -804.608_442_013_753_9, 40.024_968_847_210_89),
        ] {
            let (got_tail, got_hazard) = log_tail_and_hazard(z);
            assert!((got_tail / log_tail - 1.0).abs() < 1e-10 || (got_tail - log_tail).abs() < 1e-15, "{z} {got_tail}");
            assert!((got_hazard / hazard - 1.0).abs() < 1e-10, "{z} {got_hazard}");
        }
    }
}
