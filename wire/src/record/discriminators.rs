//! The seven discriminators of a tap and the record that carries them.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::record::flags::flags;
use crate::{Channel, TapId};

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

    /// The channels without which it cannot be had; A_2 and the powers need the sound alone.
    pub fn channels(self) -> &'static [Channel] {
        match self {
            Self::FMax | Self::Tau => &[Channel::Force],
            Self::A1 => &[Channel::Force, Channel::Sound],
            Self::A2 | Self::Pr | Self::Pf | Self::Ef => &[Channel::Sound],
        }
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

flags! {
    /// Why features of a tap may be absent or doubtful: a set of flags.
    Quality {
        /// The tap was refused before it reached a kernel.
        REFUSED = "refused",
        /// A sample is not a finite number.
        NON_FINITE = "non_finite",
        /// The record has no force channel.
        NO_FORCE = "no_force",
        /// The record has no sound channel.
        NO_SOUND = "no_sound",
        /// Too few pre-trigger samples for a baseline.
        NO_BASELINE = "no_baseline",
        /// No pulse stands out of the force, or none crosses the levels its width needs.
        NO_PULSE = "no_pulse",
        /// No onset stands out of the sound.
        NO_ONSET = "no_onset",
        /// The bands of the configuration hold no bin of this record's spectrum.
        NO_BAND = "no_band",
        /// The record is set aside and the tap asked for again: no result rests on it, and no archive holds it.
        RETAKE = "retake",
        /// A channel ran into the end of its range.
        CLIPPED = "clipped",
        /// The trigger came too late: the pulse is cut, or lies where the baseline should.
        LATE_TRIGGER = "late_trigger",
        /// The impactor hit twice.
        DOUBLE_HIT = "double_hit",
        /// Too few samples for the pulse, or too low a rate for the bands.
        UNDERSAMPLED = "undersampled",
        /// Mains hum in the sound.
        HUM = "hum",
        /// The signal does not stand far enough out of the noise.
        LOW_SNR = "low_snr",
        /// Another station's tap is heard in the record.
        NEIGHBOUR = "neighbour",
        /// The measured velocity is not the planned one.
        VELOCITY_OFF = "velocity_off",
        /// The contact time is none that a casing has: the sample rate may be another.
        RATE_IMPLAUSIBLE = "rate_implausible",
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
