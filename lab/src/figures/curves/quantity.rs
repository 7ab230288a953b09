//! What figures draw: one quantity of one scene on one rung.

use super::Axis;
use tapline_model::{DampingLaw, Error, Flags, Impact, Rung, Scene, defect_contact, integral_contact};

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

    pub(super) fn value(self, quantity: Quantity, rung: Rung, scene: &Scene) -> Result<f64, Error> {
        // In the order of the quantities.
        let all = match (self, rung) {
            (Self::Sound, Rung::Closed) => {
                let c = integral_contact(scene)?;
                [c.f_max_n, c.tau_s, c.alpha_max_m, 0.0, c.alpha_max_m, 0.0]
            }
            (Self::Cracked, Rung::Closed) => {
                let c = defect_contact(scene)?;
                [c.f_max_n, c.tau_s, c.alpha_max_m, c.d_max_m - c.alpha_max_m, c.d_max_m, c.lambda_f]
            }
            (_, Rung::Integral) => {
                let c = rung.contact(scene, DampingLaw::Exact)?;
                [c.f_max_n, c.contact_time_s, c.d_max_m, 0.0, c.d_max_m, 0.0]
            }
            (_, Rung::Plate | Rung::Full) => {
                let impact = if rung == Rung::Plate { Impact::plate } else { Impact::full };
                if quantity == Quantity::Loss {
                    let returned = impact(&Scene { restitution: 1.0, ..*scene })?.outcome()?.restitution;
                    return Ok(1.0 - returned * returned); // Eq. 3
                }
                let o = impact(scene)?.outcome()?;
                [o.f_max_n, o.contact_time_s, o.alpha_max_m, o.deflection_max_m, o.d_max_m, f64::NAN]
            }
        };
        Ok(all[quantity as usize])
    }
}
