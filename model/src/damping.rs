//! The damping of a contact that returns a given restitution, exactly.

use crate::Error;
use crate::error::within;

/// Damping ratio chi in F = K_c a^1.5 (1 + chi a'/V) for which contact ends with a' = -e V.
///
/// In the units of the method the integral model is a'' = -a^1.5 (1 + chi a'); with v = a' that is
/// v dv/(1 + chi v) = -a^1.5 da, so a falls back to 0 where chi (1 + e) = ln((1 + chi)/(1 - chi e)): no integration is
/// needed. chi(0.5) = 1.4328; it depends on e alone.
///
/// Deviation from Eq. 12, whose 3 (1 - e^2)/4 returns e = 0.725 when asked for 0.5.
///
/// # Errors
/// [`Error::OutOfRange`] when e is outside 0.1 to 1: below, the damped peak exceeds the elastic one.
///
/// ```
/// let chi = tapline_model::chi_for_restitution(0.5)?;
/// assert!((chi - 1.4328).abs() < 5e-5);
/// # Ok::<(), tapline_model::Error>(())
/// ```
pub fn chi_for_restitution(restitution: f64) -> Result<f64, Error> {
    const HALVINGS: usize = 200;
    let e = within("restitution", restitution, 0.1, 1.0)?;
    if e > 0.9999 {
        // The first terms of the series: below 1e-7 relative here, where rounding would spoil the difference.
        return Ok(1.5 * (1.0 - e * e) / (1.0 + e.powi(3)));
    }
    // Divided by chi^2 the difference loses its double root at 0 and rises through the one that is wanted.
    let excess = |chi: f64| (chi.ln_1p() - (-chi * e).ln_1p() - chi * (1.0 + e)) / (chi * chi);
    let (mut low, mut high) = (0.0, 1.0 / e);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if excess(middle) > 0.0 { high = middle } else { low = middle }
    }
    Ok(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a wrong sign or branch: the values are those of an integration of the ODE (scipy, DOP853).
    #[test]
    fn chi_returns_the_restitution_asked_for() {
        assert!((chi_for_restitution(0.5).unwrap() - 1.432_8).abs() < 5e-5);
        assert!(chi_for_restitution(1.0).unwrap().abs() < 1e-15);
    }

    /// Catches a jump where the series takes over, and a chi that does not fall with e.
    #[test]
    fn chi_falls_smoothly() {
        let mut last = f64::INFINITY;
        for i in 0..=9000 {
            let e = 0.1 + f64::from(i) * 1e-4;
            let chi = chi_for_restitution(e.clamp(0.1, 1.0)).unwrap();
            assert!(chi < last, "chi({e}) = {chi} after {last}");
            last = chi;
        }
        let (series, root) = (chi_for_restitution(0.999_900_01).unwrap(), chi_for_restitution(0.999_899_99).unwrap());
        assert!((root - series - 1.5 * 2e-8).abs() < 1e-10, "{root} {series}");
    }

    /// Catches a bound that is not kept.
    #[test]
    fn other_restitutions_are_refused() {
        for e in [0.0, 0.09, 1.01, -0.5, f64::NAN] {
            assert!(matches!(chi_for_restitution(e), Err(Error::OutOfRange { name: "restitution", .. })));
        }
    }
}
