//! The cheapest rung that is true enough.

use std::fmt;

use crate::contact::compliance::{Compliance, bound_of_stiffening};
use crate::error::within;
use crate::{
    ClosedForm, Contact, ContactModel as _, DampedContact, DampingLaw, DomainCheck, Error, FullMotion, Impact,
    IntegralTable, PlateMotion, Rung, Scene,
};

/// A contact on the cheapest rung that is known to be true enough, and why it was that one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// The contact.
    pub contact: Contact,
    /// Largest relative difference from the full rung that was allowed to any of the four quantities.
    pub tolerance: f64,
    /// What was known of each rung.
    pub bounds: ErrorBounds,
    /// Whether that is what running all of them has shown, and not bounds had beforehand.
    pub is_measured: bool,
}

/// Bounds of each rung's error against the full rung, had without running that.
///
/// An error is the largest relative difference of peak force, contact time, deflection and restitution
/// ([`Contact::error_against`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorBounds {
    /// Of the closed form; infinite when nothing is known.
    pub closed: f64,
    /// Of the integral table; infinite when nothing is known.
    pub integral: f64,
    /// Of the plate's motion; infinite when nothing is known.
    pub plate: f64,
    /// The ratio that ends the map of errors before this scene: then nothing is known of the closed form and the table.
    pub outside: Option<DomainCheck>,
}

impl ErrorBounds {
    /// That of `rung`; the full rung's is 0.
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
/// The full rung is not run to find out. The contact upon a rigid target comes from a table, and how far the full rung
/// can be from that is bounded by a map of the layer's effect over restitution, frequency and stiffness. Bounds are
/// generous: a rung that would have done may be passed over, one that would not is never taken. Outside the map,
/// the choice is the full rung.
///
/// # Errors
/// [`Error::OutOfRange`] names a quantity of the scene that the formulas cannot take, or a tolerance outside 0 to 1;
/// [`Error::TooStiff`] when an integration does not end.
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
    let damped = DampedContact::of(chi)?;
    let full = Impact { chi, ..Impact::full(scene)? };
    let closed = ClosedForm.contact(scene)?;
    let integral = IntegralTable::scaled(law, scene, scene.k_c_n_per_m1_5(), 1.0 / scene.mass_factor_per_kg(), &damped);
    // What the full rung comes to when the layer is rigid: its K_c is the baseline's and its target stands still.
    let rigid = IntegralTable::scaled(law, scene, full.k_c_n_per_m1_5, full.mass_kg, &damped);
    let bounds = bounds(scene, &full, &damped, closed.error_against(&rigid), integral.error_against(&rigid));
    let contact = match Rung::ALL.into_iter().find(|&rung| bounds.of(rung) <= tolerance) {
        Some(Rung::Closed) => closed,
        Some(Rung::Integral) => integral,
        Some(Rung::Plate) => PlateMotion { law }.contact(scene)?,
        Some(Rung::Full) | None => FullMotion { law }.contact(scene)?,
    };
    Ok(Choice { contact, tolerance, bounds, is_measured: false })
}

/// As [`choose`], but by running every rung: exact, and of use where one scene is looked into rather than many computed.
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

/// Bounds in `scene`, of which `full` is the full rung and `damped` its contact were the layer rigid; from that the closed
/// form and the integral table are off by so much.
fn bounds(scene: &Scene, full: &Impact, damped: &DampedContact, closed: f64, integral: f64) -> ErrorBounds {
    let (stiffening, loss_tangent) = (scene.shear_factor(), scene.loss_tangent());
    let bent = bound_of_stiffening(full, damped.restitution, loss_tangent, stiffening);
    match Compliance::of(full, damped, loss_tangent) {
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

/// How true the table and the integration themselves are.
const ROUNDING: f64 = 3e-7;

impl Choice {
    /// Why it was this rung, in a sentence.
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
            write!(f, "{rung} is within {:.6} of full, {tolerance} is asked for", self.bounds.of(rung))?;
        }
        for cheaper in Rung::ALL.into_iter().take_while(|&cheaper| cheaper < rung) {
            match self.bounds.of(cheaper) {
                bound if bound.is_finite() => write!(f, "; {cheaper} {off} off by {bound:.6}")?,
                _ => write!(f, "; of {cheaper} nothing is known")?,
            }
        }
        if let Some(DomainCheck { name, value, low, high }) = self.bounds.outside {
            write!(f, " ({name} is {value:.4}, the map of errors has {low:.4} to {high:.4})")?;
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "choice_tests.rs"]
mod tests;
