//! The table `[fuse]` of the configuration.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tapline_wire::{Direction, Discriminator, Serial};

use crate::Error;

/// How the discriminators of a location in one condition become one damage index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IndexKind {
    /// Mean of signed robust z values, clipped.
    Robust,
    /// Mean of the scaled magnitudes of Eqs. 55-56, location by location.
    Dissertation,
    /// Mean of signed values between the 5th and 95th percentile of the reference.
    Percentile,
    /// Mean of robust z values weighted by how well a discriminator repeats (section 6.4); all alike where nothing was
    /// repeated.
    #[default]
    Repeatability,
    /// Mean of robust z values weighted by how well each alone tells cracked from sound. Needs labels.
    Auc,
    /// Linear discriminant with a shrunk covariance. Needs labels.
    Lda,
    /// Distance from the sound mean, by a shrunk covariance of sound locations.
    Mahalanobis,
    /// Log-odds of a crack, by logistic regression. Needs labels.
    LogOdds,
}

impl IndexKind {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Robust,
        Self::Dissertation,
        Self::Percentile,
        Self::Repeatability,
        Self::Auc,
        Self::Lda,
        Self::Mahalanobis,
        Self::LogOdds,
    ];

    /// Name in configurations and tables.
    pub fn name(self) -> &'static str {
        ["robust", "dissertation", "percentile", "repeatability", "auc", "lda", "mahalanobis", "log_odds"]
            [self as usize]
    }
}

/// How the conditions (offsets, velocities) of a location become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Combine {
    /// Their mean: a crack that all of them see gains the most.
    Mean,
    /// The largest over runs of neighbouring offsets of the mean over them and their velocities, brought back to the scale
    /// of one: a crack that few offsets see is not thinned out by those that see past it.
    #[default]
    Largest,
    /// A linear discriminant of them. Needs labels.
    Fitted,
}

impl Combine {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Mean, Self::Largest, Self::Fitted];

    /// Name in configurations and tables.
    pub fn name(self) -> &'static str {
        ["mean", "largest", "fitted"][self as usize]
    }
}

/// How far a region reaches from a location that is suspect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Extent {
    /// As long as the index stays above half of what makes it suspect.
    #[default]
    Half,
    /// As far as the most likely states of a hidden Markov model say that the crack does.
    Hidden,
}

/// What a casing's values are divided by before its locations are compared with the reference's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Centre {
    /// The casing's own medians: one of another construction, or heard by a microphone of another gain, is not damaged
    /// for that. Its level as a whole is compared with the reference's by itself.
    #[default]
    Own,
    /// The reference's: for casings of one construction on one rig.
    Reference,
}

/// The direction of each discriminator: a table of those that move otherwise than [`Discriminator::direction`] says.
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
    /// All shoulders of the same tyre together, the judged one among them. Damage all round does not show.
    ///
    /// Pooled, because one shoulder of which half is cracked has no majority left that is sound: on
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
    /// How they become one index.
    pub index: IndexKind,
    /// How the conditions of a location become one.
    pub combine: Combine,
    /// What a shoulder is compared with; nothing is judged without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<Reference>,
    /// What a casing's values are divided by.
    pub centre: Centre,
    /// Largest magnitude of a single robust z.
    pub z_clip: f64,
    /// How far a region reaches.
    pub extent: Extent,
    /// Chance that a sound shoulder is not passed: it sets the limits.
    pub false_call_rate: f64,
    /// Whether F_max and tau are brought from the measured to the planned velocity, by powers of it that are fitted to the
    /// reference; nothing is changed where it does not tell the powers, or a velocity was not measured.
    pub normalise_velocity: bool,
    /// Which way each discriminator moves with damage.
    pub directions: Directions,
}

impl Default for FuseConfig {
    fn default() -> Self {
        use Discriminator::{A1, Ef, FMax, Pf, Pr, Tau};
        Self {
            discriminators: vec![FMax, Tau, A1, Pr, Pf, Ef],
            index: IndexKind::default(),
            combine: Combine::default(),
            reference: None,
            centre: Centre::default(),
            z_clip: 6.0,
            extent: Extent::default(),
            false_call_rate: 1e-3,
            normalise_velocity: false,
            directions: Directions::default(),
        }
    }
}

impl FuseConfig {
    /// The defaults, with shoulders compared with `reference`.
    pub fn by(reference: Reference) -> Self {
        Self { reference: Some(reference), ..Self::default() }
    }

    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::NoDiscriminators`], [`Error::TwiceListed`] or [`Error::OutOfRange`], for the first that fails.
    pub fn validate(&self) -> Result<(), Error> {
        if self.discriminators.is_empty() {
            return Err(Error::NoDiscriminators);
        }
        for (place, which) in self.discriminators.iter().enumerate() {
            if self.discriminators[..place].contains(which) {
                return Err(Error::TwiceListed { name: which.name() });
            }
        }
        within("z_clip", self.z_clip, 1.0, 1e3)?;
        within("false_call_rate", self.false_call_rate, 1e-6, 0.5)
    }

    /// The discriminators that enter the index, each with its direction.
    pub(crate) fn directed(&self) -> Vec<(Discriminator, Direction)> {
        self.discriminators.iter().map(|&d| (d, self.directions.of(d))).collect()
    }
}

fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), Error> {
    // Written so that NaN fails.
    if (low..=high).contains(&value) { Ok(()) } else { Err(Error::OutOfRange { name, value, low, high }) }
}

#[cfg(test)]
#[path = "config_tests.rs"]
mod tests;
