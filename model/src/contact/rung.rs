//! The rungs of the ladder of models, by name.

use std::fmt;

use serde::Deserialize;

/// A step of the ladder, the cheapest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rung {
    /// The dissertation's closed form over a crack ([`defect_contact`](crate::defect_contact)): energy balance between Hertz's
    /// contact and static bending.
    ///
    /// The contact has no damping. Its restitution is 1, as tau by Eq. 20 implies: the half-sine of that duration and peak
    /// has the impulse 2 m_1 V.
    Closed,
    /// The damped contact of a casing without a crack, from the table of [`DampedContact`](crate::DampedContact); the target
    /// moves as a free body.
    Integral,
    /// The plate above the crack, integrated in time, with inertia, damping, loss of contact and further contacts
    /// ([`Impact::plate`](crate::Impact::plate)).
    Plate,
    /// The plate, integrated in time, softened by shear and stiffened by its membrane
    /// ([`Impact::full`](crate::Impact::full)): the top of the ladder.
    Full,
}

impl Rung {
    /// All of them, the cheapest first.
    pub const ALL: [Self; 4] = [Self::Closed, Self::Integral, Self::Plate, Self::Full];

    /// The name that the command line uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::Integral => "integral",
            Self::Plate => "plate",
            Self::Full => "full",
        }
    }
}

impl fmt::Display for Rung {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
