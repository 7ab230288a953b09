//! The rungs of the ladder of models, by name.

use std::fmt;

use serde::Deserialize;

/// A step of the ladder, the cheapest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rung {
    /// The dissertation's closed form over a crack, see [`ClosedForm`](crate::ClosedForm).
    Closed,
    /// The damped contact of a casing without a crack, see [`IntegralTable`](crate::IntegralTable).
    Integral,
    /// The plate above the crack, integrated in time, see [`PlateMotion`](crate::PlateMotion).
    Plate,
    /// The same with shear and membrane, see [`FullMotion`](crate::FullMotion).
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
