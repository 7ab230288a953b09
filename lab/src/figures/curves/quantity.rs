//! What figures draw: one quantity of one scene on one rung.

use super::Axis;
use tapline_model::{DampingLaw, Error, Flags, Impact, Outcome, Rung, Scene, defect_contact, integral_contact};

/// A quantity of a contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    /// Peak force F_max.
    Force,
    /// Duration: tau of the closed form, contact time of the others.
    Duration,
    /// Largest local deformation alpha_max.
    Local,
    /// Largest bending delta_fmax of the layer.
    Bending,
    /// Largest deformation of the surface d_max.
    Deformation,
    /// Flexural energy loss lambda_f.
    Loss,
}

/// What is hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Subject {
    /// A block without a crack.
    Sound,
    /// A block with one.
    Cracked,
}

pub(super) const FORCE: Axis = Axis { name: "f_max_n", label: "Peak force", unit: "N", per_si: 1.0 };
pub(super) const DURATION: Axis = Axis { name: "tau_s", label: "Impact duration", unit: "ms", per_si: 1e3 };
pub(super) const LOCAL: Axis = Axis { name: "alpha_max_m", label: "Contact deformation", unit: "mm", per_si: 1e3 };
pub(super) const DEFORMATION: Axis = Axis { name: "d_max_m", label: "Deformation", unit: "mm", per_si: 1e3 };
pub(super) const LOSS: Axis = Axis { name: "lambda_f", label: "Flexural energy loss", unit: "", per_si: 1.0 };

impl Subject {
    /// The closed form, and the more accurate rungs.
    pub(super) fn rungs(self) -> &'static [Rung] {
        match self {
            Self::Sound => &[Rung::Closed, Rung::Integral],
            Self::Cracked => &[Rung::Closed, Rung::Plate, Rung::Full],
        }
    }

    /// Whether h/l of `scene` is within the domain of `rung`.
    pub(super) fn is_in_domain(self, rung: Rung, scene: &Scene) -> bool {
        // h/l comes first and needs no contact.
        self == Self::Sound || !Flags::new(rung, DampingLaw::Exact, scene, 0.0, 0.0).all()[0].is_raised()
    }

    /// `quantity` of `scene` on `rung`.
    pub(super) fn value(self, quantity: Quantity, rung: Rung, scene: &Scene) -> Result<f64, Error> {
        match (self, rung) {
            (Self::Sound, Rung::Closed) => integral_closed(quantity, scene),
            (Self::Cracked, Rung::Closed) => defect_closed(quantity, scene),
            (_, Rung::Integral) => {
                let contact = rung.contact(scene, DampingLaw::Exact)?;
                Ok(match quantity {
                    Quantity::Force => contact.f_max_n,
                    Quantity::Duration => contact.contact_time_s,
                    Quantity::Local | Quantity::Deformation => contact.d_max_m,
                    Quantity::Bending | Quantity::Loss => 0.0,
                })
            }
            (_, Rung::Plate) => in_time(quantity, scene, |s| Impact::plate(s)?.outcome()),
            (_, Rung::Full) => in_time(quantity, scene, |s| Impact::full(s)?.outcome()),
        }
    }
}

fn integral_closed(quantity: Quantity, scene: &Scene) -> Result<f64, Error> {
    let contact = integral_contact(scene)?;
    Ok(match quantity {
        Quantity::Force => contact.f_max_n,
        Quantity::Duration => contact.tau_s,
        Quantity::Local | Quantity::Deformation => contact.alpha_max_m,
        Quantity::Bending | Quantity::Loss => 0.0,
    })
}

fn defect_closed(quantity: Quantity, scene: &Scene) -> Result<f64, Error> {
    let contact = defect_contact(scene)?;
    Ok(match quantity {
        Quantity::Force => contact.f_max_n,
        Quantity::Duration => contact.tau_s,
        Quantity::Local => contact.alpha_max_m,
        Quantity::Bending => contact.d_max_m - contact.alpha_max_m,
        Quantity::Deformation => contact.d_max_m,
        Quantity::Loss => contact.lambda_f,
    })
}

fn in_time(quantity: Quantity, scene: &Scene, run: impl Fn(&Scene) -> Result<Outcome, Error>) -> Result<f64, Error> {
    if quantity == Quantity::Loss {
        let returned = run(&Scene { restitution: 1.0, ..*scene })?.restitution;
        return Ok(1.0 - returned * returned); // Eq. 3
    }
    let outcome = run(scene)?;
    Ok(match quantity {
        Quantity::Force => outcome.f_max_n,
        Quantity::Duration => outcome.contact_time_s,
        Quantity::Local => outcome.alpha_max_m,
        Quantity::Bending => outcome.deflection_max_m,
        Quantity::Deformation | Quantity::Loss => outcome.d_max_m,
    })
}
