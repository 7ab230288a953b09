//! The seven discriminators of a tap and the record that carries them.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::TapId;

/// One of the seven quantities that tell a cracked casing from a sound one (section 2 of the method).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Discriminator {
    /// Peak force, N.
    #[serde(rename = "f_max")]
    FMax,
    /// Contact time, s.
    #[serde(rename = "tau")]
    Tau,
    /// Initial area of the sound, V s.
    #[serde(rename = "a_1")]
    A1,
    /// Ringing area of the sound, V s.
    #[serde(rename = "a_2")]
    A2,
    /// Power ratio, dimensionless.
    #[serde(rename = "pr")]
    Pr,
    /// Largest flexural power density, V^2/Hz.
    #[serde(rename = "p_f")]
    Pf,
    /// Flexural energy, V^2.
    #[serde(rename = "e_f")]
    Ef,
}

impl Discriminator {
    /// All seven, in the order of [`Values`] and of every table.
    pub const ALL: [Self; 7] = [Self::FMax, Self::Tau, Self::A1, Self::A2, Self::Pr, Self::Pf, Self::Ef];

    /// Name in configurations and summaries.
    pub fn name(self) -> &'static str {
        ["f_max", "tau", "a_1", "a_2", "pr", "p_f", "e_f"][self as usize]
    }

    /// Name with unit: the column in tables and archives.
    pub fn column(self) -> &'static str {
        ["f_max_n", "tau_s", "a_1_v_s", "a_2_v_s", "pr", "p_f_v2_per_hz", "e_f_v2"][self as usize]
    }
}

/// Values of the seven discriminators of one tap; each is present or absent, never zero for want of a value.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, ZeroCopySend)]
pub struct Values([f64; 7]);

impl Default for Values {
    /// All absent.
    fn default() -> Self {
        Self([f64::NAN; 7])
    }
}

impl Values {
    /// The value of `which` in SI units, `None` when absent.
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

/// Why features of a tap may be absent or doubtful: a set of flags.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, ZeroCopySend)]
pub struct Quality(u32);

impl Quality {
    /// The tap was refused before it reached a kernel.
    pub const REFUSED: Self = Self(1);
    /// A sample is not a finite number.
    pub const NON_FINITE: Self = Self(1 << 1);
    /// The record has no force channel.
    pub const NO_FORCE: Self = Self(1 << 2);
    /// The record has no sound channel.
    pub const NO_SOUND: Self = Self(1 << 3);
    /// Too few pre-trigger samples for a baseline.
    pub const NO_BASELINE: Self = Self(1 << 4);
    /// No pulse stands out of the force, or none crosses the levels its width needs.
    pub const NO_PULSE: Self = Self(1 << 5);
    /// No onset stands out of the sound.
    pub const NO_ONSET: Self = Self(1 << 6);
    /// The bands of the configuration hold no bin of this record's spectrum.
    pub const NO_BAND: Self = Self(1 << 7);

    const NAMES: [(Self, &'static str); 8] = [
        (Self::REFUSED, "refused"),
        (Self::NON_FINITE, "non_finite"),
        (Self::NO_FORCE, "no_force"),
        (Self::NO_SOUND, "no_sound"),
        (Self::NO_BASELINE, "no_baseline"),
        (Self::NO_PULSE, "no_pulse"),
        (Self::NO_ONSET, "no_onset"),
        (Self::NO_BAND, "no_band"),
    ];

    /// No flag.
    pub fn clean() -> Self {
        Self(0)
    }

    /// Whether no flag is set.
    pub fn is_clean(self) -> bool {
        self.0 == 0
    }

    /// Whether every flag of `other` is set.
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Adds the flags of `other`.
    pub fn insert(&mut self, other: Self) {
        self.0 |= other.0;
    }

    /// The flags as a number, as the archive stores them.
    pub fn bits(self) -> u32 {
        self.0
    }

    /// The flags that `bits` stands for.
    pub fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// Every flag there is, with its name, in the order of the bits.
    pub fn all() -> impl Iterator<Item = (Self, &'static str)> {
        Self::NAMES.into_iter()
    }
}

impl fmt::Display for Quality {
    /// The names of the flags, joined by `|`; nothing for a clean tap.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (flag, name) in Self::NAMES {
            if self.contains(flag) {
                write!(f, "{separator}{name}")?;
                separator = "|";
            }
        }
        Ok(())
    }
}

impl fmt::Debug for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Quality({self})")
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
    /// The seven values.
    pub values: Values,
}
