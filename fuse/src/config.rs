//! The table `[fuse]` of the configuration.

use std::fmt;

use serde::{Deserialize, Serialize};
use tapline_wire::{Discriminator, Serial};

use crate::Error;

/// How the damage index is formed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum IndexKind {
    /// Mean of signed robust z values, clipped, then the mean over three neighbouring locations.
    #[default]
    Robust,
    /// Mean of the scaled magnitudes of Eqs. 55-56, location by location.
    Dissertation,
}

/// Which way a discriminator moves where there is a crack.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// It rises with damage.
    Rises,
    /// It falls with damage.
    Falls,
}

impl Direction {
    /// +1 where damage raises the value, -1 where it lowers it.
    pub fn sign(self) -> f64 {
        match self {
            Self::Rises => 1.0,
            Self::Falls => -1.0,
        }
    }
}

/// The direction of each discriminator.
///
/// Deviation: sections 5.4.3-5.4.4 treat PR as falling; Table 13 and recorded taps say that it rises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Directions {
    /// Of the peak force.
    pub f_max: Direction,
    /// Of the contact time.
    pub tau: Direction,
    /// Of the initial area.
    pub a_1: Direction,
    /// Of the ringing area.
    pub a_2: Direction,
    /// Of the power ratio.
    pub pr: Direction,
    /// Of the largest flexural power density.
    pub p_f: Direction,
    /// Of the flexural energy.
    pub e_f: Direction,
}

impl Default for Directions {
    fn default() -> Self {
        use Direction::{Falls, Rises};
        Self { f_max: Falls, tau: Rises, a_1: Rises, a_2: Rises, pr: Rises, p_f: Rises, e_f: Rises }
    }
}

impl Directions {
    /// The direction of `which`.
    pub fn of(&self, which: Discriminator) -> Direction {
        match which {
            Discriminator::FMax => self.f_max,
            Discriminator::Tau => self.tau,
            Discriminator::A1 => self.a_1,
            Discriminator::A2 => self.a_2,
            Discriminator::Pr => self.pr,
            Discriminator::Pf => self.p_f,
            Discriminator::Ef => self.e_f,
        }
    }
}

/// What a shoulder is compared with; `self` or `TYRE/SHOULDER` in a configuration.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Reference {
    /// All shoulders of the same tyre together, the judged one among them.
    ///
    /// Pooled, because one shoulder of which half is cracked has no majority left that is sound: on
    /// three recorded slabs, line by line, the AUC was 0.77 / 0.96 / 0.93; pooled it is 0.99 / 1.00 / 0.98.
    #[default]
    Own,
    /// One shoulder of the same run, stated to be sound.
    Shoulder {
        /// Serial number of its casing.
        tyre: Serial,
        /// Its side.
        shoulder: u16,
    },
}

impl TryFrom<String> for Reference {
    type Error = Error;

    fn try_from(text: String) -> Result<Self, Error> {
        if text == "self" {
            return Ok(Self::Own);
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
        }
    }
}

/// How taps are fused: the table `[fuse]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FuseConfig {
    /// Discriminators that enter the index. `a_2` is left out by default: it repeats worst (Eq. 54).
    pub discriminators: Vec<Discriminator>,
    /// How the index is formed.
    pub index: IndexKind,
    /// What a shoulder is compared with.
    pub reference: Reference,
    /// Largest magnitude of a single robust z.
    pub z_clip: f64,
    /// Robust standard deviations of the reference's own index at which a location is suspect.
    pub re_inspect_at: f64,
    /// Robust standard deviations of the reference's own index at which a region is damage.
    pub reject_at: f64,
    /// Whether F_max and tau are brought from the measured to the planned velocity, by powers of it that are fitted to the
    /// reference; nothing is changed where it does not tell the powers, or a velocity was not measured.
    pub normalise_velocity: bool,
    /// Which way each discriminator moves with damage.
    pub directions: Directions,
}

impl Default for FuseConfig {
    /// The limits hold the chance of a false call below 1e-3 a shoulder: of 10 000 simulated sound ones at
    /// most 4 were suspect by `self`, at most 8 by a named shoulder (the ignored test of `fusion`).
    fn default() -> Self {
        use Discriminator::{A1, Ef, FMax, Pf, Pr, Tau};
        Self {
            discriminators: vec![FMax, Tau, A1, Pr, Pf, Ef],
            index: IndexKind::Robust,
            reference: Reference::Own,
            z_clip: 6.0,
            re_inspect_at: 5.5,
            reject_at: 7.0,
            normalise_velocity: false,
            directions: Directions::default(),
        }
    }
}

impl FuseConfig {
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
        within("re_inspect_at", self.re_inspect_at, 0.1, 1e3)?;
        within("reject_at", self.reject_at, self.re_inspect_at, 1e3)
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
mod tests {
    use super::*;

    #[test]
    fn the_spelling_of_every_key_is_kept() {
        // Catches a renamed key or value: configurations in the field would stop parsing.
        let text = r#"
            discriminators = ["f_max", "tau", "a_1", "pr", "p_f", "e_f"]
            index = "robust"
            reference = "self"
            z_clip = 6.0
            re_inspect_at = 5.5
            reject_at = 7.0
            [directions]
            f_max = "falls"
            tau = "rises"
            a_1 = "rises"
            a_2 = "rises"
            pr = "rises"
            p_f = "rises"
            e_f = "rises"
        "#;
        assert_eq!(toml::from_str::<FuseConfig>(text).unwrap(), FuseConfig::default());
        let again: FuseConfig = toml::from_str(&toml::to_string(&FuseConfig::default()).unwrap()).unwrap();
        assert_eq!(again, FuseConfig::default());
    }

    #[test]
    fn one_key_changes_one_thing() {
        // Catches a missing serde default: naming one direction would unset or demand the others.
        let text = "reference = \"T 1/2\"\nindex = \"dissertation\"\ndirections = { pr = \"falls\" }";
        let config: FuseConfig = toml::from_str(text).unwrap();
        let expected = FuseConfig {
            reference: Reference::Shoulder { tyre: Serial::new("T 1").unwrap(), shoulder: 2 },
            index: IndexKind::Dissertation,
            directions: Directions { pr: Direction::Falls, ..Directions::default() },
            ..FuseConfig::default()
        };
        assert_eq!(config, expected);
    }

    #[test]
    fn what_is_not_understood_is_refused() {
        // Catches a typo in a configuration being ignored silently.
        for text in [
            "reject = 3.0",
            "directions = { prr = \"falls\" }",
            "directions = { pr = \"up\" }",
            "discriminators = [\"PR\"]",
            "index = \"mean\"",
            "reference = \"T1\"",
            "reference = \"T1/left\"",
            "reference = \"T1/2/2\"",
            "reference = \"/2\"",
            "reference = \"T1/70000\"",
        ] {
            assert!(toml::from_str::<FuseConfig>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn values_out_of_bounds_are_refused_by_name() {
        // Catches a bound that lets NaN or reversed limits through.
        let name_of = |config: FuseConfig| match config.validate() {
            Err(Error::OutOfRange { name, .. }) => name,
            other => panic!("{other:?}"),
        };
        let base = FuseConfig::default;
        assert_eq!(name_of(FuseConfig { z_clip: f64::NAN, ..base() }), "z_clip");
        assert_eq!(name_of(FuseConfig { re_inspect_at: 0.0, ..base() }), "re_inspect_at");
        assert_eq!(name_of(FuseConfig { reject_at: 5.4, ..base() }), "reject_at");
        assert_eq!(name_of(FuseConfig { reject_at: f64::INFINITY, ..base() }), "reject_at");
        assert_eq!(FuseConfig { discriminators: vec![], ..base() }.validate(), Err(Error::NoDiscriminators));
        let twice = FuseConfig { discriminators: vec![Discriminator::Pr, Discriminator::Pr], ..base() };
        assert_eq!(twice.validate(), Err(Error::TwiceListed { name: "pr" }));
        assert_eq!(base().validate(), Ok(()));
    }
}
