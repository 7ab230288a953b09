//! The discriminators of a tap and the record that carries them.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::{Channel, Quality, TapId};

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

/// What of a record a discriminator is taken from: a fault of the record spoils what is taken from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// The pulse of the force.
    Pulse,
    /// An area of the sound over time.
    SoundArea,
    /// The sound's spectrum.
    SoundSpectrum,
}

/// What is to be known of a discriminator beside how it is computed.
#[derive(Debug)]
struct Attributes {
    /// In configurations and summaries.
    name: &'static str,
    /// Name with unit: the column in tables and archives.
    column: &'static str,
    /// The unit of that column, `1` where it has none.
    unit: &'static str,
    /// In plain letters, as the source has it.
    symbol: &'static str,
    /// As pages print it: symbol, how many of the printed unit make one SI unit, and that unit.
    printed: (&'static str, f64, &'static str),
    /// In words.
    meaning: &'static str,
    /// What it is taken from.
    feature: Feature,
    /// The channels without which it cannot be had.
    channels: &'static [Channel],
    /// Which way it moves where there is a crack, unless a configuration says otherwise.
    direction: Direction,
}

macro_rules! discriminators {
    ($($(#[$doc:meta])* $variant:ident { $($field:ident: $value:expr),* $(,)? })*) => {
        /// One of the quantities that tell a cracked casing from a sound one (section 2 of the method).
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        #[serde(try_from = "String", into = "String")]
        pub enum Discriminator {
            $($(#[$doc])* $variant,)*
        }

        impl Discriminator {
            /// All of them, in the order of [`Values`] and of every table.
            pub const ALL: [Self; Self::COUNT] = [$(Self::$variant),*];

            /// How many there are.
            pub const COUNT: usize = [$(stringify!($variant)),*].len();
        }

        /// The attributes of each, in the order of [`Discriminator::ALL`].
        static ATTRIBUTES: [Attributes; Discriminator::COUNT] = [$(Attributes { $($field: $value),* }),*];
    };
}

discriminators! {
    /// Peak force, N.
    FMax {
        name: "f_max", column: "f_max_n", unit: "N", symbol: "F_max", printed: ("F_max", 1.0, "N"),
        meaning: "peak force", feature: Feature::Pulse, channels: &[Channel::Force], direction: Direction::Falls,
    }
    /// Contact time, s.
    Tau {
        name: "tau", column: "tau_s", unit: "s", symbol: "tau", printed: ("\u{3c4}", 1e3, "ms"),
        meaning: "contact time", feature: Feature::Pulse, channels: &[Channel::Force], direction: Direction::Rises,
    }
    /// Initial area of the sound, V s.
    A1 {
        name: "a_1", column: "a_1_v_s", unit: "V s", symbol: "A_1", printed: ("A\u{2081}", 1.0, "V s"),
        meaning: "initial area of the sound", feature: Feature::SoundArea, channels: &[Channel::Force, Channel::Sound], direction: Direction::Rises,
    }
    /// Ringing area of the sound, V s.
    A2 {
        name: "a_2", column: "a_2_v_s", unit: "V s", symbol: "A_2", printed: ("A\u{2082}", 1.0, "V s"),
        meaning: "ringing area of the sound", feature: Feature::SoundArea, channels: &[Channel::Sound], direction: Direction::Rises,
    }
    /// Power ratio, dimensionless.
    ///
    /// Deviation: sections 5.4.3-5.4.4 treat it as falling; Table 13 and recorded taps say that it rises.
    Pr {
        name: "pr", column: "pr", unit: "1", symbol: "PR", printed: ("PR", 1.0, ""),
        meaning: "power ratio", feature: Feature::SoundSpectrum, channels: &[Channel::Sound], direction: Direction::Rises,
    }
    /// Largest flexural power density, V^2/Hz.
    Pf {
        name: "p_f", column: "p_f_v2_per_hz", unit: "V^2/Hz", symbol: "P_f", printed: ("P_f", 1.0, "V\u{b2}/Hz"),
        meaning: "largest flexural density", feature: Feature::SoundSpectrum, channels: &[Channel::Sound], direction: Direction::Rises,
    }
    /// Flexural energy, V^2.
    Ef {
        name: "e_f", column: "e_f_v2", unit: "V^2", symbol: "E_f", printed: ("E_f", 1.0, "V\u{b2}"),
        meaning: "flexural energy", feature: Feature::SoundSpectrum, channels: &[Channel::Sound], direction: Direction::Rises,
    }
    /// Spectral centroid of the sound, Hz; none of the source's seven.
    Centroid {
        name: "centroid", column: "centroid_hz", unit: "Hz", symbol: "f_s", printed: ("f_s", 1.0, "Hz"),
        meaning: "spectral centroid of the sound", feature: Feature::SoundSpectrum, channels: &[Channel::Sound],
        direction: Direction::Rises,
    }
}

impl Discriminator {
    fn attributes(self) -> &'static Attributes {
        &ATTRIBUTES[self as usize]
    }

    /// Name in configurations and summaries.
    pub fn name(self) -> &'static str {
        self.attributes().name
    }

    /// Name with unit: the column in tables and archives.
    pub fn column(self) -> &'static str {
        self.attributes().column
    }

    /// Unit of that column, `1` where it has none.
    pub fn unit(self) -> &'static str {
        self.attributes().unit
    }

    /// Its symbol in plain letters.
    pub fn symbol(self) -> &'static str {
        self.attributes().symbol
    }

    /// As pages print it: its symbol, how many of the printed unit make one SI unit, and that unit.
    pub fn printed(self) -> (&'static str, f64, &'static str) {
        self.attributes().printed
    }

    /// What it is, in words.
    pub fn meaning(self) -> &'static str {
        self.attributes().meaning
    }

    /// What it is taken from.
    pub fn feature(self) -> Feature {
        self.attributes().feature
    }

    /// The channels without which it cannot be had; A_2 and the powers need the sound alone.
    pub fn channels(self) -> &'static [Channel] {
        self.attributes().channels
    }

    /// Which way it moves where there is a crack, unless a configuration says otherwise.
    pub fn direction(self) -> Direction {
        self.attributes().direction
    }
}

impl TryFrom<String> for Discriminator {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|which| which.name() == name)
            .ok_or_else(|| format!("{name:?} is no discriminator; there are {}", Self::ALL.map(Self::name).join(", ")))
    }
}

impl From<Discriminator> for String {
    fn from(which: Discriminator) -> Self {
        which.name().to_owned()
    }
}

/// Values of the discriminators of one tap; each is present or absent, never zero for want of a value.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, ZeroCopySend)]
pub struct Values([f64; Discriminator::COUNT]);

impl Default for Values {
    /// All absent.
    fn default() -> Self {
        Self([f64::NAN; Discriminator::COUNT])
    }
}

impl Values {
    /// The value of `which` in SI units, `None` when absent.
    #[inline] // asked for tens of thousands of times a tyre, from another crate
    pub fn get(&self, which: Discriminator) -> Option<f64> {
        Some(self.0[which as usize]).filter(|v| v.is_finite())
    }

    /// Sets `which`; a value that is not finite is absent.
    pub fn set(&mut self, which: Discriminator, value: Option<f64>) {
        self.0[which as usize] = value.filter(|v| v.is_finite()).unwrap_or(f64::NAN);
    }
}

impl fmt::Debug for Values {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map().entries(Discriminator::ALL.map(|d| (d.column(), self.get(d)))).finish()
    }
}

/// What was found in one tap.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("tapline.Discriminators.v1")]
pub struct Discriminators {
    /// Name of the tap.
    pub id: TapId,
    /// Row of the tap in the scan plan.
    pub plan_index: u32,
    /// Flags that say why values are absent or doubtful.
    pub quality: Quality,
    /// Impact velocity as measured in m/s, NaN where it was not.
    pub velocity_measured_m_per_s: f64,
    /// The values.
    pub values: Values,
}
