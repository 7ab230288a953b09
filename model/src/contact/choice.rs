//! The cheapest rung that is accurate enough.

use std::fmt;

use crate::error::within;
use crate::{Contact, DampingLaw, Error, Rung, Scene};

/// The contact on the cheapest rung that is accurate enough, and why that rung was chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// The contact.
    pub contact: Contact,
    /// Largest relative difference from the full rung that is allowed in any of the four quantities.
    pub tolerance: f64,
    /// Errors of the rungs.
    pub errors: RungErrors,
}

/// The error of each rung against the full rung.
///
/// An error is the largest relative difference of peak force, contact time, deflection and restitution
/// ([`Contact::error_against`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RungErrors {
    /// Error of the closed form.
    pub closed: f64,
    /// Error of the integral table.
    pub integral: f64,
    /// Error of the plate's motion.
    pub plate: f64,
}

impl RungErrors {
    /// The error of `rung`; the full rung's is 0.
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
/// `tolerance`; every rung is run.
///
/// # Errors
/// [`Error::OutOfRange`] if a quantity of the scene, or the tolerance, is outside its bounds; [`Error::TooStiff`] if an
/// integration does not end.
///
/// ```
/// use tapline_model::{DampingLaw, Rung, Scene, choose_by_trial};
///
/// let deep = Scene { h_m: 80e-3, l_m: 20e-3, ..Scene::default() };
/// let choice = choose_by_trial(&deep, DampingLaw::Exact, 0.1)?;
/// assert_eq!(choice.contact.rung, Rung::Integral);
/// assert!(choice.to_string().starts_with("integral is within 0.0"));
/// # Ok::<(), tapline_model::Error>(())
/// ```
pub fn choose_by_trial(scene: &Scene, law: DampingLaw, tolerance: f64) -> Result<Choice, Error> {
    let tolerance = within("tolerance", tolerance, 0.0, 1.0)?;
    let contacts = Rung::ALL.map(|rung| rung.contact(scene, law));
    let [closed, integral, plate, full] = contacts;
    let (closed, integral, plate, full) = (closed?, integral?, plate?, full?);
    let error = |contact: &Contact| contact.error_against(&full);
    let errors = RungErrors { closed: error(&closed), integral: error(&integral), plate: error(&plate) };
    let rungs = [closed, integral, plate, full];
    let contact = rungs.into_iter().find(|contact| errors.of(contact.rung) <= tolerance).unwrap_or(full);
    Ok(Choice { contact, tolerance, errors })
}

/// Why this rung was chosen, in a sentence.
impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rung, tolerance) = (self.contact.rung, self.tolerance);
        if rung == Rung::Full {
            write!(f, "full: nothing cheaper is within {tolerance} of it")?;
        } else {
            write!(f, "{rung} is within {:.6} of full; {tolerance} is asked for", self.errors.of(rung))?;
        }
        for cheaper in Rung::ALL.into_iter().take_while(|&cheaper| cheaper < rung) {
            write!(f, "; {cheaper} is off by {:.6}", self.errors.of(cheaper))?;
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "choice_tests.rs"]
mod tests;
