//! A summary of a reference by the default index, for people and other programs to read.

use serde::{Deserialize, Serialize};
use tapline_wire::Discriminator;

/// Scales and limits of a reference.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Summary {
    /// Scale of every discriminator in every condition.
    pub scales: Vec<ScaleLine>,
    /// Names of the discriminators that enter the index.
    pub discriminators: Vec<String>,
    /// Locations that count as sound.
    pub sound_count: usize,
    /// Locations that are labelled as cracked.
    pub cracked_count: usize,
    /// Casings that the limits rest on.
    pub casing_count: usize,
    /// Lowest rate of false calls that they support; `None` for fewer than two casings.
    pub supported_rate: Option<f64>,
    /// Strongest arc of each shoulder, judged by the other casings; with known cracks, the one to expect if all of it were sound.
    pub strongest: Vec<f64>,
    /// Serial numbers of casings that stand out from the others: they may be cracked, and the limits rest on them.
    pub standing_out: Vec<String>,
    /// Probability that a sound shoulder is not passed.
    pub re_inspect_rate: f64,
    /// Probability that a sound shoulder is rejected.
    pub reject_rate: f64,
    /// Damage index from which a shoulder must be inspected again.
    pub limit_re_inspect: f64,
    /// Damage index from which it is rejected.
    pub limit_reject: f64,
    /// What `limit_re_inspect` would be if the shoulders showed nothing but noise; `None` for fewer than two casings. A far higher one
    /// means that many of them are cracked, or that they are very uneven.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit_of_noise: Option<f64>,
}

/// Scale of one discriminator in one condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaleLine {
    /// Offset from the belt edge.
    pub offset_mm: Option<f64>,
    /// Least velocity of the class.
    pub velocity_m_per_s: Option<f64>,
    /// Which discriminator.
    pub discriminator: Discriminator,
    /// Median of the turns' medians, in SI units.
    pub level: f64,
    /// Robust standard deviation of a tap about its turn's level, as a fraction of it.
    pub spread: f64,
    /// Standard deviation of the casings' levels, as a fraction of them; `None` of fewer than three.
    pub level_spread: Option<f64>,
}
