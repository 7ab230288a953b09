//! The ladder: four models of the same contact, each more expensive and more accurate than the one before.

use crate::contact::rung::Rung;
use crate::{DampedContact, DampingLaw, Error, Flags, Impact, Outcome, Scene, defect_contact};

impl Rung {
    /// The contact of `scene` on this rung, with damping after `law`; the closed form has no damping to choose.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if a quantity of the scene is outside its bounds; [`Error::TooStiff`] if an integration does not
    /// end.
    pub fn contact(self, scene: &Scene, law: DampingLaw) -> Result<Contact, Error> {
        match self {
            Self::Closed => Contact::closed(scene),
            Self::Integral => {
                scene.validate()?;
                let contact = DampedContact::new(law.chi(scene.restitution)?)?;
                let mass_kg = 1.0 / scene.mass_factor_per_kg();
                Ok(Contact::integral(law, scene, scene.k_c_n_per_m1_5(), mass_kg, &contact))
            }
            Self::Plate => {
                let impact = Impact { chi: law.chi(scene.restitution)?, ..Impact::plate(scene)? };
                Ok(Contact::from_outcome(self, law, scene, &impact.outcome()?))
            }
            Self::Full => {
                let impact = Impact { chi: law.chi(scene.restitution)?, ..Impact::full(scene)? };
                Ok(Contact::from_outcome(self, law, scene, &impact.outcome()?))
            }
        }
    }
}

/// One contact as a model computes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The rung that computed it.
    pub rung: Rung,
    /// Peak force.
    pub f_max_n: f64,
    /// Duration of the contact: tau (Eq. 20) for the closed form, the last instant with a force for the others.
    pub contact_time_s: f64,
    /// Deepest position of the impactor.
    pub d_max_m: f64,
    /// Velocity of the impactor after contact over that before, reversed.
    pub restitution: f64,
    /// Which assumptions of the rung hold in the scene.
    pub flags: Flags,
}

impl Contact {
    /// The largest relative difference of the four quantities from those of `truth`; infinite if one is NaN.
    pub fn error_against(&self, truth: &Self) -> f64 {
        let mut worst = 0.0;
        for (mine, true_one) in self.quantities().into_iter().zip(truth.quantities()) {
            let error = (mine / true_one - 1.0).abs();
            if error.is_nan() {
                return f64::INFINITY;
            }
            worst = if error > worst { error } else { worst };
        }
        worst
    }

    pub(crate) fn quantities(&self) -> [f64; 4] {
        [self.f_max_n, self.contact_time_s, self.d_max_m, self.restitution]
    }

    fn closed(scene: &Scene) -> Result<Self, Error> {
        let defect = defect_contact(scene)?;
        let bending_m = defect.f_max_n / defect.k_f_n_per_m;
        Ok(Self {
            rung: Rung::Closed,
            f_max_n: defect.f_max_n,
            contact_time_s: defect.tau_s,
            d_max_m: defect.d_max_m,
            restitution: 1.0,
            flags: Flags::new(Rung::Closed, DampingLaw::Exact, scene, defect.alpha_max_m, bending_m),
        })
    }

    /// `contact` in SI units, for a body of mass `m` and contact stiffness `k` in `scene`.
    pub(crate) fn integral(law: DampingLaw, scene: &Scene, k: f64, m: f64, contact: &DampedContact) -> Self {
        let v = scene.velocity_m_per_s;
        let length_m = (m * v * v / k).powf(0.4);
        let f_max_n = contact.f_max * m * v * v / length_m;
        let alpha_max_m = contact.alpha_max * length_m;
        Self {
            rung: Rung::Integral,
            f_max_n,
            contact_time_s: contact.contact_time * length_m / v,
            d_max_m: alpha_max_m,
            restitution: contact.restitution,
            // The deflection of the layer, which this model leaves out.
            flags: Flags::new(Rung::Integral, law, scene, alpha_max_m, f_max_n / scene.k_f_n_per_m()),
        }
    }

    fn from_outcome(rung: Rung, law: DampingLaw, scene: &Scene, outcome: &Outcome) -> Self {
        Self {
            rung,
            f_max_n: outcome.f_max_n,
            contact_time_s: outcome.contact_time_s,
            d_max_m: outcome.d_max_m,
            restitution: outcome.restitution,
            flags: Flags::new(rung, law, scene, outcome.alpha_max_m, outcome.deflection_max_m),
        }
    }
}

#[cfg(test)]
#[path = "ladder_tests.rs"]
mod tests;
