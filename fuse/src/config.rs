//! The table `[fuse]` of the configuration.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tapline_wire::{Direction, Discriminator, Serial};

use crate::Error;

/// How the taps of a place become its damage index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IndexKind {
    /// Scores against the level of their turn, weighted by repeatability and correlation.
    #[default]
    Fused,
    /// Mean of the scaled magnitudes of Eqs. 55-56, location by location.
    Dissertation,
}

impl IndexKind {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Fused, Self::Dissertation];
}

tapline_wire::named!(IndexKind, Fused = "fused", Dissertation = "dissertation");

/// The direction of each discriminator: a table of those that deviate from [`Discriminator::direction`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "BTreeMap<Discriminator, Direction>", into = "BTreeMap<Discriminator, Direction>")]
pub struct Directions([Direction; Discriminator::COUNT]);

impl Default for Directions {
    fn default() -> Self {
        Self(Discriminator::ALL.map(Discriminator::direction))
    }
}

impl From<BTreeMap<Discriminator, Direction>> for Directions {
    fn from(others: BTreeMap<Discriminator, Direction>) -> Self {
        let mut directions = Self::default();
        others.into_iter().for_each(|(which, direction)| directions.set(which, direction));
        directions
    }
}

impl From<Directions> for BTreeMap<Discriminator, Direction> {
    fn from(directions: Directions) -> Self {
        Discriminator::ALL.into_iter().zip(directions.0).collect()
    }
}

impl Directions {
    /// Sets the direction of `which`.
    pub fn set(&mut self, which: Discriminator, direction: Direction) {
        self.0[which as usize] = direction;
    }

    /// The direction of `which`.
    pub fn of(&self, which: Discriminator) -> Direction {
        self.0[which as usize]
    }
}

/// What a shoulder is compared with; `self`, `TYRE/SHOULDER` or the name of a `.json` file in a configuration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Reference {
    /// All shoulders of the same tyre together, including the judged one. Damage all round does not show.
    ///
    /// Pooled, because a shoulder that is half cracked has no sound majority left: on
    /// three recorded slabs, line by line, the AUC was 0.77 / 0.96 / 0.93; pooled it is 0.99 / 1.00 / 0.98.
    Own,
    /// One shoulder of the same run, stated to be sound.
    Shoulder {
        /// Serial number of its casing.
        tyre: Serial,
        /// Its side.
        shoulder: u16,
    },
    /// A file of shoulders of earlier runs.
    File(PathBuf),
}

impl TryFrom<String> for Reference {
    type Error = Error;

    fn try_from(text: String) -> Result<Self, Error> {
        if text == "self" {
            return Ok(Self::Own);
        }
        if text.ends_with(".json") {
            return Ok(Self::File(text.into()));
        }
        let named = text.rsplit_once('/').and_then(|(tyre, shoulder)| {
            Some(Self::Shoulder { tyre: Serial::new(tyre).ok()?, shoulder: shoulder.parse().ok()? })
        });
        named.ok_or(Error::ReferenceText { text })
    }
}

impl From<Reference> for String {
    fn from(reference: Reference) -> Self {
        reference.to_string()
    }
}

impl fmt::Display for Reference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Own => f.pad("self"),
            Self::Shoulder { tyre, shoulder } => write!(f, "{tyre}/{shoulder}"),
            Self::File(path) => write!(f, "{}", path.display()),
        }
    }
}

/// How taps are fused: the table `[fuse]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FuseConfig {
    /// Discriminators that enter the index. `a_2` is left out by default: it repeats worst (Eq. 54).
    pub discriminators: Vec<Discriminator>,
    /// How these become one index.
    pub index: IndexKind,
    /// What a shoulder is compared with; without it nothing is judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<Reference>,
    /// Probability that a sound shoulder is not passed.
    pub re_inspect_rate: f64,
    /// Probability that part of a sound shoulder is tapped again before it is judged, if the station can. Unless it is above
    /// `re_inspect_rate`, nothing is tapped again.
    pub confirm_rate: f64,
    /// Probability that a sound shoulder is rejected; at most `re_inspect_rate`.
    pub reject_rate: f64,
    /// Whether F_max and tau are corrected from the measured to the planned velocity, by power laws fitted to the
    /// reference; nothing is changed if it does not determine the exponents, or a velocity was not measured.
    pub normalise_velocity: bool,
    /// Whether a casing cannot pass if its channels have no calibration, or had an expired one when it was tapped.
    pub requires_calibration: bool,
    /// Which way each discriminator moves with damage.
    pub directions: Directions,
}

impl Default for FuseConfig {
    fn default() -> Self {
        use Discriminator::{A1, Ef, FMax, Pf, Pr, Tau};
        Self {
            discriminators: vec![FMax, Tau, A1, Pr, Pf, Ef],
            index: IndexKind::default(),
            reference: None,
            re_inspect_rate: 0.02,
            confirm_rate: 0.2,
            reject_rate: 1e-3,
            normalise_velocity: false,
            requires_calibration: false,
            directions: Directions::default(),
        }
    }
}

impl FuseConfig {
    /// The defaults, with shoulders compared with `reference`.
    pub fn by(reference: Reference) -> Self {
        Self { reference: Some(reference), ..Self::default() }
    }

    /// Whether anything is tapped again before it is judged.
    pub fn confirms(&self) -> bool {
        self.confirm_rate > self.re_inspect_rate
    }

    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::NoDiscriminators`], [`Error::TwiceListed`], [`Error::OutOfRange`] or [`Error::RejectRate`], for the first that fails.
    pub fn validate(&self) -> Result<(), Error> {
        if self.discriminators.is_empty() {
            return Err(Error::NoDiscriminators);
        }
        for (place, which) in self.discriminators.iter().enumerate() {
            if self.discriminators[..place].contains(which) {
                return Err(Error::TwiceListed { name: which.name() });
            }
        }
        within("re_inspect_rate", self.re_inspect_rate, 1e-6, 0.3)?;
        within("confirm_rate", self.confirm_rate, 0.0, 0.3)?;
        within("reject_rate", self.reject_rate, 1e-6, 0.3)?;
        let Self { reject_rate, re_inspect_rate, .. } = *self;
        if reject_rate <= re_inspect_rate { Ok(()) } else { Err(Error::RejectRate { reject_rate, re_inspect_rate }) }
    }
}

fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), Error> {
    // Written so that NaN fails.
    if (low..=high).contains(&value) { Ok(()) } else { Err(Error::OutOfRange { name, value, low, high }) }
}

#[cfg(test)]
#[path = "config_tests.rs"]
mod tests;
