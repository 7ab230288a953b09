//! The estimators that can be chosen in `[process]`.
//!
//! `docs/estimators.md` measures the merit of each. If a record does not allow an estimator, it falls back on
//! another, as documented here, so that the value is not lost.

use serde::{Deserialize, Serialize};

/// How F_max is found from the force about its largest sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PeakEstimator {
    /// The largest sample.
    Raw,
    /// The vertex of the parabola through the largest sample and its neighbours.
    #[default]
    Parabola,
    /// The maximum of the quartic fitted to the samples above 70 % of the peak; with fewer than nine samples, as
    /// `parabola`.
    Polynomial,
}

/// How tau is found; all of them return the base of a half-sine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DurationEstimator {
    /// From the width at 10 % of F_max.
    #[default]
    HalfSine,
    /// From the width at 2 % of F_max; if the record ends before that, from the width at 10 %.
    #[serde(rename = "width_02")]
    Width02,
    /// From the width at 50 % of F_max.
    #[serde(rename = "width_50")]
    Width50,
    /// From the impulse J, as pi J/(2 F_max).
    Impulse,
}

/// What is subtracted from the sound. It is estimated before the trigger.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Subtraction {
    /// Nothing.
    #[default]
    None,
    /// The noise: its power from PR, P_f and E_f, its magnitude from A_2. Bands that hold no more than noise are absent, and so
    /// are all powers if a baseline of less than 32 samples, or without a bin in a band, does not show the noise.
    Noise,
    /// A sine of `mains_hz`, from every value of the sound; nothing if the baseline is shorter than a quarter of its period.
    Hum,
    /// Both, the hum first.
    Both,
}

impl Subtraction {
    pub(crate) fn has_noise(self) -> bool {
        matches!(self, Self::Noise | Self::Both)
    }

    pub(crate) fn has_hum(self) -> bool {
        matches!(self, Self::Hum | Self::Both)
    }
}

/// How a bin at a band's edge counts in PR and E_f.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BandEdges {
    /// Wholly when its frequency is in the band, edges included.
    #[default]
    Bins,
    /// By the part of its width that is in the band. P_f is still searched among whole bins.
    Fractional,
}
