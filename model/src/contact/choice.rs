//! The cheapest rung that is accurate enough.

use std::fmt;

use crate::contact::compliance::{Compliance, bound_of_stiffening};
use crate::error::within;
use crate::{Contact, DampedContact, DampingLaw, DomainCheck, Error, Impact, Rung, Scene};

/// A contact on the cheapest rung that is known to be accurate enough, and why that rung was chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// The contact.
    pub contact: Contact,
    /// Largest relative difference from the full rung that is allowed in any of the four quantities.
    pub tolerance: f64,
    /// Error bounds of the rungs.
    pub bounds: ErrorBounds,
    /// Whether the bounds are errors found by running every rung, not bounds computed beforehand.
    pub is_measured: bool,
}

/// Upper bounds of each rung's error against the full rung, computed without running it.
///
/// An error is the largest relative difference of peak force, contact time, deflection and restitution
/// ([`Contact::error_against`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorBounds {
    /// Bound of the closed form; infinite if none is known.
    pub closed: f64,
    /// Bound of the integral table; infinite if none is known.
    pub integral: f64,
    /// Bound of the plate's motion; infinite if none is known.
    pub plate: f64,
    /// The ratio that places this scene outside the map of errors. The closed form and the table then have no known
    /// bound.
    pub outside: Option<DomainCheck>,
}

impl ErrorBounds {
    /// The error bound of `rung`; the full rung's is 0.
    pub fn of(&self, rung: Rung) -> f64 {
        match rung {
            Rung::Closed => self.closed,
            Rung::Integral => self.integral,
            Rung::Plate => self.plate,
            Rung::Full => 0.0,
        }
    }
}

/// The contact of `scene`, with damping after `law`, on the cheapest rung whose error against the full rung stays within
/// `tolerance`.
///
/// The full rung is not run. The contact on a rigid target comes from a table, and a map of the layer's effect over
/// restitution, frequency and stiffness bounds how far the full rung can differ from it. The bounds are conservative: a rung
/// that is accurate enough may be rejected, but one that is not is never chosen. Outside the map the full rung is chosen.
///
/// # Errors
/// [`Error::OutOfRange`] if a quantity of the scene, or the tolerance, is outside its bounds; [`Error::TooStiff`] if an
/// integration does not end.
///
/// ```
/// use tapline_model::{DampingLaw, Rung, Scene, choose};
///
/// let deep = Scene { h_m: 80e-3, l_m: 20e-3, ..Scene::default() };
/// let choice = choose(&deep, DampingLaw::Exact, 0.1)?;
/// assert_eq!(choice.contact.rung, Rung::Integral);
/// assert!(choice.why().starts_with("integral is within 0.0"));
/// # Ok::<(), tapline_model::Error>(())
/// ```
pub fn choose(scene: &Scene, law: DampingLaw, tolerance: f64) -> Result<Choice, Error> {
    let tolerance = within("tolerance", tolerance, 0.0, 1.0)?;
    scene.validate()?;
    let chi = law.chi(scene.restitution)?;
    let damped = DampedContact::new(chi)?;
    let full = Impact { chi, ..Impact::full(scene)? };
    let closed = Rung::Closed.contact(scene, law)?;
    let integral = Contact::integral(law, scene, scene.k_c_n_per_m1_5(), 1.0 / scene.mass_factor_per_kg(), &damped);
    // The full rung with a rigid layer: its K_c is the baseline's, and its target does not move.
    let rigid = Contact::integral(law, scene, full.k_c_n_per_m1_5, full.mass_kg, &damped);
    let bounds = bounds(scene, &full, &damped, closed.error_against(&rigid), integral.error_against(&rigid));
    let contact = match Rung::ALL.into_iter().find(|&rung| bounds.of(rung) <= tolerance).unwrap_or(Rung::Full) {
        Rung::Closed => closed,
        Rung::Integral => integral,
        rung @ (Rung::Plate | Rung::Full) => rung.contact(scene, law)?,
    };
    Ok(Choice { contact, tolerance, bounds, is_measured: false })
}

/// As [`choose`], but by running every rung: exact, and slow.
///
/// # Errors
/// As [`choose`].
pub fn choose_by_trial(scene: &Scene, law: DampingLaw, tolerance: f64) -> Result<Choice, Error> {
    let tolerance = within("tolerance", tolerance, 0.0, 1.0)?;
    let contacts = Rung::ALL.map(|rung| rung.contact(scene, law));
    let [closed, integral, plate, full] = contacts;
    let (closed, integral, plate, full) = (closed?, integral?, plate?, full?);
    let error = |contact: &Contact| contact.error_against(&full);
    let bounds =
        ErrorBounds { closed: error(&closed), integral: error(&integral), plate: error(&plate), outside: None };
    let rungs = [closed, integral, plate, full];
    let contact = rungs.into_iter().find(|contact| bounds.of(contact.rung) <= tolerance).unwrap_or(full);
    Ok(Choice { contact, tolerance, bounds, is_measured: true })
}

/// The bounds in `scene`. `full` is its impact on the full rung, `damped` its contact with a rigid layer, from which the errors
/// of the closed form and the integral table are known.
fn bounds(scene: &Scene, full: &Impact, damped: &DampedContact, closed: f64, integral: f64) -> ErrorBounds {
    let (stiffening, loss_tangent) = (scene.shear_factor(), scene.loss_tangent());
    let bent = bound_of_stiffening(full, damped.restitution, loss_tangent, stiffening);
    match Compliance::new(full, damped, loss_tangent) {
        Err(outside) => ErrorBounds {
            closed: f64::INFINITY,
            integral: f64::INFINITY,
            plate: chained(0.0, bent),
            outside: Some(outside),
        },
        Ok(compliance) => ErrorBounds {
            closed: chained(closed, compliance.bound()),
            integral: chained(integral, compliance.bound()),
            plate: chained(0.0, lesser(bent, compliance.bound_when_stiffened(stiffening))),
            outside: None,
        },
    }
}

/// Bound of |a/c - 1| where |a/b - 1| is within `first` and |c/b - 1| within `second`.
fn chained(first: f64, second: f64) -> f64 {
    if second < 1.0 { (1.0 + first) / (1.0 - second) - 1.0 + ROUNDING } else { f64::INFINITY }
}

fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Relative error of the table and of the integrations themselves.
const ROUNDING: f64 = 3e-7;

impl Choice {
    /// Why this rung was chosen, in a sentence.
    pub fn why(&self) -> String {
        self.to_string()
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rung, tolerance) = (self.contact.rung, self.tolerance);
        let (known, off) = if self.is_measured { ("", "is") } else { (" known to be", "may be") };
        if rung == Rung::Full {
            write!(f, "full: nothing cheaper is{known} within {tolerance} of it")?;
        } else {
            write!(f, "{rung} is within {:.6} of full; {tolerance} is asked for", self.bounds.of(rung))?;
        }
        for cheaper in Rung::ALL.into_iter().take_while(|&cheaper| cheaper < rung) {
            match self.bounds.of(cheaper) {
                bound if bound.is_finite() => write!(f, "; {cheaper} {off} off by {bound:.6}")?,
                _ => write!(f, "; nothing is known of {cheaper}")?,
            }
        }
        if let Some(DomainCheck { name, value, low, high }) = self.bounds.outside {
            write!(f, " ({name} is {value:.4}; the map of errors has {low:.4} to {high:.4})")?;
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "choice_tests.rs"]
mod tests;
