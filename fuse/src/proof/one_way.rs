//! Repeatability without operators, and agreement as one number.
//!
//! The intraclass correlations are those of Shrout and Fleiss, Psychological Bulletin 86 (1979) 420: the part of the
//! variance of one reading that is the parts' own, so 1 for a perfect gauge.

use super::Refusal;
use super::anova::{AnovaRow, Shape, Sums, at_least};
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
    let (parts, repeats, repeat_count) = one_way_rows(readings, part_count)?;
    let repeatability = repeats.mean_square;
    let part = above_zero((parts.mean_square - repeats.mean_square) / repeat_count);
    let of = |variance| Component::of(variance, part + repeatability);
    Ok(OneWay {
        parts,
        repeats,
        repeatability: of(repeatability),
        part: of(part),
        total: of(part + repeatability),
        ndc: categories(part, repeatability),
    })
}

/// ICC(1,1): agreement of single readings, each by whoever it was. Below 0 where parts differ less than their readings.
///
/// # Errors
/// As [`one_way`].
pub fn icc_1_1(readings: &[Option<f64>], part_count: usize) -> Result<f64, Refusal> {
    let (parts, repeats, k) = one_way_rows(readings, part_count)?;
    let (between, within) = (parts.mean_square, repeats.mean_square);
    finite((between - within) / (between + (k - 1.0) * within))
}

/// ICC(2,1): absolute agreement of single readings by operators, or in turns, that each read every part once; part by
/// part.
///
/// # Errors
/// As [`one_way`]; its operators are the readings of a part.
pub fn icc_2_1(readings: &[Option<f64>], part_count: usize) -> Result<f64, Refusal> {
    let operator_count = per_part("operators", readings, part_count)?;
    let Sums { parts, operators, interaction, .. } =
        Sums::of(readings, Shape { parts: part_count, operators: operator_count, repeats: 1 })?;
    let (n, k) = (part_count as f64, operator_count as f64);
    let (between, error) = (parts.mean_square, interaction.mean_square);
    finite((between - error) / (between + (k - 1.0) * error + k * (operators.mean_square - error) / n))
}

/// Mean squares of parts and of readings within them, and how many readings a part has.
fn one_way_rows(readings: &[Option<f64>], part_count: usize) -> Result<(AnovaRow, AnovaRow, f64), Refusal> {
    let repeats = per_part("repeats", readings, part_count)?;
    let sums = Sums::of(readings, Shape { parts: part_count, operators: 1, repeats })?;
    Ok((sums.parts, sums.repeats, repeats as f64))
}

fn per_part(name: &'static str, readings: &[Option<f64>], part_count: usize) -> Result<usize, Refusal> {
    at_least("parts", part_count, 2)?;
    let each = readings.len() / part_count;
    at_least(name, each, 2)?;
    Ok(each)
}

/// A ratio whose denominator is above 0.
fn finite(ratio: f64) -> Result<f64, Refusal> {
    if ratio.is_finite() { Ok(ratio) } else { Err(Refusal::NoScatter { name: "readings" }) }
}
