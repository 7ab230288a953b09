//! The damping that gives a contact a restitution: exact, and by approximations from the literature.

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::contact::scene::RESTITUTION_MIN;
use crate::error::within;

/// How the damping ratio chi of a contact, in F = K_c a^1.5 (1 + chi a'/V), follows from a wanted restitution e.
///
/// All but `Exact` are approximations: the contact's restitution differs from e, most of all for a small e.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DampingLaw {
    /// The chi that returns e, see [`chi_for_restitution`].
    #[default]
    Exact,
    /// 3 (1 - e^2)/4, the dissertation's (Eq. 12; Lankarani and Nikravesh 1990): for e = 0.5 it gives 0.725.
    LankaraniNikravesh,
    /// 8 (1 - e)/(5 e) (Flores and others 2011): for e = 0.5 it gives 0.470.
    Flores,
    /// (1 - e^2)/e (Gonthier and others 2004): for e = 0.5 it gives 0.488.
    Gonthier,
}

impl DampingLaw {
    /// The chi of this law for `restitution`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] when e is outside 0.1 to 1.
    pub fn chi(self, restitution: f64) -> Result<f64, Error> {
        let e = within("restitution", restitution, RESTITUTION_MIN, 1.0)?;
        Ok(match self {
            Self::Exact => chi_for_restitution(e)?,
            Self::LankaraniNikravesh => 0.75 * (1.0 - e * e),
            Self::Flores => 1.6 * (1.0 - e) / e,
            Self::Gonthier => (1.0 - e * e) / e,
        })
    }

    /// Smallest e for which the restitution is within 0.05 of e.
    pub fn restitution_min(self) -> f64 {
        match self {
            Self::Exact | Self::Flores | Self::Gonthier => RESTITUTION_MIN,
            Self::LankaraniNikravesh => 0.8,
        }
    }
}

/// Damping ratio chi in F = K_c a^1.5 (1 + chi a'/V) for which contact ends with a' = -e V.
///
/// In the units of the method the integral model is a'' = -a^1.5 (1 + chi a'). With v = a' this is v dv/(1 + chi v) =
/// -a^1.5 da, so a is 0 again where chi (1 + e) = ln((1 + chi)/(1 - chi e)). No integration is needed, and chi depends
/// on e alone: chi(0.5) = 1.4328.
///
/// Deviation from Eq. 12, whose 3 (1 - e^2)/4 gives e = 0.725 where 0.5 is wanted.
///
/// # Errors
/// [`Error::OutOfRange`] if e is outside 0.1 to 1: below, the damped peak exceeds the elastic one.
///
/// ```
/// let chi = tapline_model::chi_for_restitution(0.5)?;
/// assert!((chi - 1.4328).abs() < 5e-5);
/// # Ok::<(), tapline_model::Error>(())
/// ```
pub fn chi_for_restitution(restitution: f64) -> Result<f64, Error> {
    const STEPS_MAX: usize = 100;
    let e = within("restitution", restitution, RESTITUTION_MIN, 1.0)?;
    if e > SERIES_FROM {
        // The first terms of the series: within 1e-7 here, where rounding would dominate the difference.
        return Ok(1.5 * (1.0 - e * e) / (1.0 + e.powi(3)));
    }
    // Gonthier's chi is within a fifth of the root. Newton's method starts there, and bisects where a step leaves the
    // bracket.
    let (mut low, mut high) = (0.0, 1.0 / e);
    let mut chi = (1.0 - e * e) / e;
    for _ in 0..STEPS_MAX {
        let excess = excess(chi, e);
        if excess > 0.0 {
            high = chi
        } else {
            low = chi
        }
        let slope = (1.0 / (1.0 + chi) + e / (1.0 - chi * e) - (1.0 + e)) / (chi * chi) - 2.0 * excess / chi;
        let newton = chi - excess / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let is_settled = (next - chi).abs() <= 4.0 * f64::EPSILON * chi;
        chi = next;
        if is_settled {
            break;
        }
    }
    Ok(chi)
}

/// Restitution from which on the series for chi is used.
const SERIES_FROM: f64 = 0.9999;

/// The residual of chi for e. Division by chi^2 removes its double root at 0 and makes it rise through the other root.
fn excess(chi: f64, e: f64) -> f64 {
    (chi.ln_1p() - (-chi * e).ln_1p() - chi * (1.0 + e)) / (chi * chi)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::damped::DampedContact;

    /// The slow twin: bisection down to neighbouring numbers.
    fn chi_slow(e: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0 / e);
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if excess(middle, e) > 0.0 { high = middle } else { low = middle }
        }
        0.5 * (low + high)
    }

    /// Catches a Newton iteration that stops early or diverges; near e = 1 both are limited by rounding.
    #[test]
    fn newton_agrees_with_halving() {
        for i in 0..=899 {
            let e = 0.1 + f64::from(i) * 1e-3;
            let (fast, slow) = (chi_for_restitution(e).unwrap(), chi_slow(e));
            let rounding = 1e-14 / (slow * slow) + 1e-13;
            assert!((fast / slow - 1.0).abs() < rounding, "e = {e}: {fast} against {slow}");
        }
    }

    /// Catches a wrong law, by the values that an integration (scipy) gives for 0.5 and 0.3, and a stated domain in
    /// which a law is off by more than 0.05 or that could be wider.
    #[test]
    fn laws_return_what_is_known_of_them() {
        let returned = |law: DampingLaw, e: f64| DampedContact::new(law.chi(e).unwrap()).unwrap().restitution;
        for (law, e, known) in [
            (DampingLaw::LankaraniNikravesh, 0.5, 0.725),
            (DampingLaw::Flores, 0.5, 0.470),
            (DampingLaw::Flores, 0.3, 0.256),
            (DampingLaw::Gonthier, 0.5, 0.488),
            (DampingLaw::Gonthier, 0.1, 0.101),
            (DampingLaw::Exact, 0.5, 0.5),
        ] {
            assert!((returned(law, e) - known).abs() < 6e-4, "{law:?} returns {} for {e}", returned(law, e));
        }
        for law in [DampingLaw::Exact, DampingLaw::LankaraniNikravesh, DampingLaw::Flores, DampingLaw::Gonthier] {
            let least = law.restitution_min();
            let off = |e: f64| (returned(law, e) - e).abs();
            let worst = (0..=100)
                .map(|i| off(least + (1.0 - least) * f64::from(i) / 100.0))
                .fold(0.0, |a, b| if b > a { b } else { a });
            assert!(worst <= 0.05, "{law:?} is off by {worst}");
            assert!(least <= RESTITUTION_MIN || off(least - 0.02) > 0.05, "{law:?} is good below {least}");
        }
    }

    /// Catches a wrong sign or branch: the values are those of an integration of the ODE (scipy, DOP853).
    #[test]
    fn chi_returns_the_restitution_asked_for() {
        assert!((chi_for_restitution(0.5).unwrap() - 1.432_8).abs() < 5e-5);
        assert!(chi_for_restitution(1.0).unwrap().abs() < 1e-15);
    }

    /// Catches a jump where the series takes over, and a chi that does not fall as e rises.
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

    /// Catches a bound that is not checked.
    #[test]
    fn other_restitutions_are_refused() {
        for e in [0.0, 0.09, 1.01, -0.5, f64::NAN] {
            assert!(matches!(chi_for_restitution(e), Err(Error::OutOfRange { name: "restitution", .. })));
        }
    }
}
