//! Repeatability without operators.

use super::Refusal;
use super::anova::{AnovaRow, Crossed, Sums, at_least};
use super::gauge::{Component, above_zero, categories};

/// What repeated readings of several parts find. The components are as in [`Gauge`](super::Gauge).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct OneWay {
    /// Analysis of variance: parts.
    pub parts: AnovaRow,
    /// Readings within parts.
    pub repeats: AnovaRow,
    /// The same part again: all of the gauge that such a study can see.
    pub repeatability: Component,
    /// The parts.
    pub part: Component,
    /// Both.
    pub total: Component,
    /// Distinct categories; `None` where readings repeat exactly.
    pub ndc: Option<u64>,
}

/// Judges a gauge from the same number of `readings` of each of `part_count` parts, part by part.
///
/// # Errors
/// [`Refusal::TooFew`] parts or repeats (2 of each); [`Refusal::Lengths`] for readings that the parts do not share
/// evenly; [`Refusal::Incomplete`]; [`Refusal::NoScatter`].
pub fn one_way(readings: &[Option<f64>], part_count: usize) -> Result<OneWay, Refusal> {
    at_least("parts", part_count, 2)?;
    let repeat_count = readings.len() / part_count;
    at_least("repeats", repeat_count, 2)?;
    let Sums { parts, repeats, .. } = Sums::new(readings, Crossed { part_count, operator_count: 1, repeat_count })?;
    let repeatability = repeats.mean_square;
    let part = above_zero((parts.mean_square - repeats.mean_square) / repeat_count as f64);
    let of = |variance| Component::new(variance, part + repeatability);
    Ok(OneWay {
        parts,
        repeats,
        repeatability: of(repeatability),
        part: of(part),
        total: of(part + repeatability),
        ndc: categories(part, repeatability),
    })
}
