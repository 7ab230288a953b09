//! Estimators that stand beside the default ones, and the keys of `[process]` that choose them.
//!
//! Which of them is good for what is measured in `docs/estimators.md`. One that a record does not allow falls back, as
//! each says, rather than leave the value out.

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
    /// The maximum of the quartic that fits the samples above 70 % of the peak best; of fewer than nine, the parabola's.
    Polynomial,
}

/// How tau is found; all of them return the base of a half-sine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DurationEstimator {
    /// From the width at 10 % of F_max.
    #[default]
    HalfSine,
    /// From the width at 2 % of F_max; of a record that ends before, from that at 10 %.
    #[serde(rename = "width_02")]
    Width02,
    /// From the width at 50 % of F_max.
    #[serde(rename = "width_50")]
    Width50,
    /// From the impulse J, as pi J/(2 F_max).
    Impulse,
}

/// What the sound's power is taken of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SpectrumEstimator {
    /// The whole record.
    #[default]
    Whole,
    /// `gate_s` from the sound's onset, referred to the whole record; without a baseline or an onset, the whole record.
    Gate,
}

/// What is taken from the sound, as it was before the trigger; nothing without a baseline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Subtraction {
    /// Nothing.
    #[default]
    None,
    /// The noise's power, from PR, P_f and E_f, and its magnitude, from A_2; a band that holds no more than noise is none.
    Noise,
    /// A sine of `mains_hz`, from every value of the sound; not of a baseline shorter than a quarter of its period.
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
    /// By the part of its width that is in the band. P_f is looked for among whole bins all the same.
    Fractional,
}
