//! The ladder: four models of the same contact behind one trait, each more expensive and more accurate than the one before.

use crate::contact::rung::Rung;
use crate::{DampedContact, DampingLaw, Error, Flags, Impact, Outcome, Scene, defect_contact};

impl Rung {
    /// The contact of `scene` on this rung, with damping after `law`; the closed form has no damping to choose.
    ///
    /// # Errors
    /// As [`ContactModel::contact`].
    pub fn contact(self, scene: &Scene, law: DampingLaw) -> Result<Contact, Error> {
        match self {
            Self::Closed => ClosedForm.contact(scene),
            Self::Integral => IntegralTable { law }.contact(scene),
            Self::Plate => PlateMotion { law }.contact(scene),
            Self::Full => FullMotion { law }.contact(scene),
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

/// A model of the contact between impactor and casing.
pub trait ContactModel {
    /// Which step of the ladder it is.
    fn rung(&self) -> Rung;

    /// The contact of `scene`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if a quantity of the scene is outside its bounds; [`Error::TooStiff`] if an integration does not
    /// end.
    fn contact(&self, scene: &Scene) -> Result<Contact, Error>;
}

/// The closed form over a crack ([`defect_contact`]): energy balance between Hertz's contact and static bending.
///
/// The contact has no damping. Its restitution is 1, as tau by Eq. 20 implies: the half-sine of that duration and peak
/// has the impulse 2 m_1 V.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClosedForm;

impl ContactModel for ClosedForm {
    fn rung(&self) -> Rung {
        Rung::Closed
    }

    fn contact(&self, scene: &Scene) -> Result<Contact, Error> {
        let defect = defect_contact(scene)?;
        let bending_m = defect.f_max_n / defect.k_f_n_per_m;
        Ok(Contact {
            rung: Rung::Closed,
            f_max_n: defect.f_max_n,
            contact_time_s: defect.tau_s,
            d_max_m: defect.d_max_m,
            restitution: 1.0,
            flags: Flags::new(Rung::Closed, DampingLaw::Exact, scene, defect.alpha_max_m, bending_m),
        })
    }
}

/// The damped contact of a casing without a crack, from the table of [`DampedContact`]; the target moves as a free body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IntegralTable {
    /// How the damping follows from the wanted restitution.
    pub law: DampingLaw,
}

impl ContactModel for IntegralTable {
    fn rung(&self) -> Rung {
        Rung::Integral
    }

    fn contact(&self, scene: &Scene) -> Result<Contact, Error> {
        scene.validate()?;
        let contact = DampedContact::new(self.law.chi(scene.restitution)?)?;
        Ok(Self::scaled(self.law, scene, scene.k_c_n_per_m1_5(), 1.0 / scene.mass_factor_per_kg(), &contact))
    }
}

impl IntegralTable {
    /// `contact` in SI units, for a body of mass `m` and contact stiffness `k` in `scene`.
    pub(crate) fn scaled(law: DampingLaw, scene: &Scene, k: f64, m: f64, contact: &DampedContact) -> Contact {
        let v = scene.velocity_m_per_s;
        let length_m = (m * v * v / k).powf(0.4);
        let f_max_n = contact.f_max * m * v * v / length_m;
        let alpha_max_m = contact.alpha_max * length_m;
        Contact {
            rung: Rung::Integral,
            f_max_n,
            contact_time_s: contact.contact_time * length_m / v,
            d_max_m: alpha_max_m,
            restitution: contact.restitution,
            // The deflection of the layer, which this model leaves out.
            flags: Flags::new(Rung::Integral, law, scene, alpha_max_m, f_max_n / scene.k_f_n_per_m()),
        }
    }
}

/// The plate above the crack, integrated in time, with inertia, damping, loss of contact and further contacts
/// ([`Impact::plate`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PlateMotion {
    /// How the damping follows from the wanted restitution.
    pub law: DampingLaw,
}

impl ContactModel for PlateMotion {
    fn rung(&self) -> Rung {
        Rung::Plate
    }

    fn contact(&self, scene: &Scene) -> Result<Contact, Error> {
        let impact = Impact { chi: self.law.chi(scene.restitution)?, ..Impact::plate(scene)? };
        Ok(Contact::from_outcome(Rung::Plate, self.law, scene, &impact.outcome()?))
    }
}

/// The plate, integrated in time, softened by shear and stiffened by its membrane ([`Impact::full`]): the top of the
/// ladder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FullMotion {
    /// How the damping follows from the wanted restitution.
    pub law: DampingLaw,
}

impl ContactModel for FullMotion {
    fn rung(&self) -> Rung {
        Rung::Full
    }

    fn contact(&self, scene: &Scene) -> Result<Contact, Error> {
        let impact = Impact { chi: self.law.chi(scene.restitution)?, ..Impact::full(scene)? };
        Ok(Contact::from_outcome(Rung::Full, self.law, scene, &impact.outcome()?))
    }
}

#[cfg(test)]
#[path = "ladder_tests.rs"]
mod tests;
