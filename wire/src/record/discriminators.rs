//! The discriminators of a tap and the record that carries them.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::record::calibration::Calibration;
use crate::{Channel, Quality, TapId};

/// Which way a crack moves a discriminator.
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

/// The part of a record from which a discriminator is computed: a fault in that part spoils it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordPart {
    /// The pulse of the force.
    Pulse,
    /// An area of the sound over time.
    SoundArea,
    /// The sound's spectrum.
    SoundSpectrum,
}

/// What is known of a discriminator besides its computation.
#[derive(Debug)]
struct Attributes {
    /// In configurations and summaries.
    name: &'static str,
    /// The column in tables and archives: with the unit, unless that follows from the scale of a channel.
    column: &'static str,
    /// The unit of that column.
    unit: UnitOf,
    /// In plain letters, as the source has it.
    symbol: &'static str,
    /// Its symbol as pages print it.
    printed: &'static str,
    /// In words.
    meaning: &'static str,
    /// The part of the record that it is computed from.
    part: RecordPart,
    /// The channels that it is computed from.
    channels: &'static [Channel],
    /// Which way it moves where there is a crack, unless a configuration says otherwise.
    direction: Direction,
}

/// What a discriminator is measured in.
#[derive(Debug, Clone, Copy)]
enum UnitOf {
    /// Always the same: the unit; how many of the printed unit make one of it; the printed unit.
    Fixed(&'static str, f64, &'static str),
    /// A power of a channel's unit, times the rest.
    Scaled(Channel, Power, &'static str),
}

/// A power of a channel's unit.
#[derive(Debug, Clone, Copy)]
enum Power {
    First,
    Second,
}

macro_rules! discriminators {
    ($($(#[$doc:meta])* $variant:ident { $($field:ident: $value:expr),* $(,)? })*) => {
        /// One of the quantities that differ between cracked and sound casings (section 2 of the method).
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
    /// Peak force, N where the force is scaled.
    FMax {
        name: "f_max", column: "f_max", unit: UnitOf::Scaled(Channel::Force, Power::First, ""), symbol: "F_max", printed: "F_max",
        meaning: "peak force", part: RecordPart::Pulse, channels: &[Channel::Force], direction: Direction::Falls,
    }
    /// Contact time, s.
    Tau {
        name: "tau", column: "tau_s", unit: UnitOf::Fixed("s", 1e3, "ms"), symbol: "tau", printed: "\u{3c4}",
        meaning: "contact time", part: RecordPart::Pulse, channels: &[Channel::Force], direction: Direction::Rises,
    }
    /// Initial area of the sound, V s or Pa s where it is scaled.
    A1 {
        name: "a_1", column: "a_1", unit: UnitOf::Scaled(Channel::Sound, Power::First, " s"), symbol: "A_1", printed: "A\u{2081}",
        meaning: "initial area of the sound", part: RecordPart::SoundArea, channels: &[Channel::Force, Channel::Sound], direction: Direction::Rises,
    }
    /// Ringing area of the sound, V s or Pa s where it is scaled.
    A2 {
        name: "a_2", column: "a_2", unit: UnitOf::Scaled(Channel::Sound, Power::First, " s"), symbol: "A_2", printed: "A\u{2082}",
        meaning: "ringing area of the sound", part: RecordPart::SoundArea, channels: &[Channel::Sound], direction: Direction::Rises,
    }
    /// Power ratio, dimensionless.
    ///
    /// Deviation: sections 5.4.3-5.4.4 treat it as falling; Table 13 and recorded taps say that it rises.
    Pr {
        name: "pr", column: "pr", unit: UnitOf::Fixed("1", 1.0, ""), symbol: "PR", printed: "PR",
        meaning: "power ratio", part: RecordPart::SoundSpectrum, channels: &[Channel::Sound], direction: Direction::Rises,
    }
    /// Largest flexural power density, V^2/Hz or Pa^2/Hz where the sound is scaled.
    Pf {
        name: "p_f", column: "p_f", unit: UnitOf::Scaled(Channel::Sound, Power::Second, "/Hz"), symbol: "P_f", printed: "P_f",
        meaning: "largest flexural density", part: RecordPart::SoundSpectrum, channels: &[Channel::Sound], direction: Direction::Rises,
    }
    /// Flexural energy, V^2 or Pa^2 where the sound is scaled.
    Ef {
        name: "e_f", column: "e_f", unit: UnitOf::Scaled(Channel::Sound, Power::Second, ""), symbol: "E_f", printed: "E_f",
        meaning: "flexural energy", part: RecordPart::SoundSpectrum, channels: &[Channel::Sound], direction: Direction::Rises,
    }
    /// Spectral centroid of the sound, Hz; none of the source's seven.
    Centroid {
        name: "centroid", column: "centroid_hz", unit: UnitOf::Fixed("Hz", 1.0, "Hz"), symbol: "centroid", printed: "centroid",
        meaning: "spectral centroid of the sound", part: RecordPart::SoundSpectrum, channels: &[Channel::Sound],
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

    /// The column in tables and archives: with the unit, unless that follows from the scale of a channel.
    pub fn column(self) -> &'static str {
        self.attributes().column
    }

    /// Unit of that column for taps of `calibration`, `1` where it has none.
    pub fn unit(self, calibration: &Calibration) -> String {
        match self.attributes().unit {
            UnitOf::Fixed(unit, ..) => unit.to_owned(),
            UnitOf::Scaled(channel, Power::First, rest) => format!("{}{rest}", calibration.unit(channel).name()),
            UnitOf::Scaled(channel, Power::Second, rest) => format!("{}^2{rest}", calibration.unit(channel).name()),
        }
    }

    /// Its symbol in plain letters.
    pub fn symbol(self) -> &'static str {
        self.attributes().symbol
    }

    /// Unit of that column where it does not follow from the scale of a channel.
    pub fn fixed_unit(self) -> Option<&'static str> {
        match self.attributes().unit {
            UnitOf::Fixed(unit, ..) => Some(unit),
            UnitOf::Scaled(..) => None,
        }
    }

    /// Its symbol as pages print it.
    pub fn printed(self) -> &'static str {
        self.attributes().printed
    }

    /// How many of the unit that pages print make one of [`Discriminator::unit`], and that unit.
    pub fn printed_unit(self, calibration: &Calibration) -> (f64, String) {
        match self.attributes().unit {
            UnitOf::Fixed(_, printed_count, printed) => (printed_count, printed.to_owned()),
            UnitOf::Scaled(..) => (1.0, self.unit(calibration).replace("^2", "\u{b2}")),
        }
    }

    /// What it is, in words.
    pub fn meaning(self) -> &'static str {
        self.attributes().meaning
    }

    /// The part of the record that it is computed from.
    pub fn part(self) -> RecordPart {
        self.attributes().part
    }

    /// The channels that it is computed from; A_2 and the powers need only the sound.
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
            .ok_or_else(|| format!("{name:?} is not a discriminator; known: {}", Self::ALL.map(Self::name).join(", ")))
    }
}

impl From<Discriminator> for String {
    fn from(which: Discriminator) -> Self {
        which.name().to_owned()
    }
}

/// Values of the discriminators of one tap; each is present or absent, and zero never stands for a missing one.
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
    /// The value of `which` in its [unit](Discriminator::unit), `None` when absent.
    #[inline] // called tens of thousands of times per tyre, from another crate
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

impl Discriminators {
    /// The record of the refused tap `id` in row `plan_index`: it has no values.
    pub fn refused(id: TapId, plan_index: u32) -> Self {
        let quality = Quality::REFUSED;
        Self { id, plan_index, quality, velocity_measured_m_per_s: f64::NAN, ..Self::default() }
    }
}
