//! What a reference looks like by the default index: for people and other programs to read.

use serde::{Deserialize, Serialize};
use tapline_wire::Discriminator;

/// Scales, covariance and limits of a reference.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Summary {
    /// Scale of every discriminator in every condition.
    pub scales: Vec<ScaleLine>,
    /// Names of the discriminators in the order of `covariance`.
    pub discriminators: Vec<String>,
    /// Covariance of the discriminators' scores at sound locations, each the mean over its conditions; row by row, `None`
    /// where too few locations have both.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// Locations that are taken to be sound.
    pub sound_count: usize,
    /// Locations that are labelled as cracked.
    pub cracked_count: usize,
    /// Centre and robust spread of the default index at the sound ones.
    pub index_centre: Option<f64>,
    /// See `index_centre`.
    pub index_spread: Option<f64>,
    /// Standard deviation of the index of a location that is measured again.
    pub index_repeat_sd: Option<f64>,
    /// Index at and above which a location is suspect.
    pub limit_re_inspect: Option<f64>,
    /// Index at and above which a region is damage.
    pub limit_reject: Option<f64>,
    /// Chance that a sound shoulder is not passed, which the limits are for.
    pub false_call_rate: f64,
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
    /// Median of the casings' levels, in SI units.
    pub level: f64,
    /// Robust standard deviation of a tap about its casing's level, as a share of it.
    pub spread: f64,
    /// Standard deviation of the casings' levels, as a share of it; `None` of fewer than three casings.
    pub level_spread: Option<f64>,
}
