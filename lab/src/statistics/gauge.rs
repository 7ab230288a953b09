//! Gauge repeatability and reproducibility of a crossed study: every operator, or station, reads every part several
//! times.
//!
//! Source: AIAG, Measurement Systems Analysis, 4th edition (2010), the analysis-of-variance method. A part may be a
//! location of a casing and an operator a station: reproducibility is then what stations differ by.

use super::Refusal;
use super::anova::{AnovaRow, Crossed, Sums, at_least};

/// The interaction is pooled with the repeats if the probability of one as large, without any, is above this: the level
/// usual with AIAG's method, so that an interaction stays unless it is clearly none.
pub const POOLED_ABOVE: f64 = 0.25;

/// Categories a gauge distinguishes per part variation over gauge variation: the root of 2, as AIAG rounds it.
const CATEGORIES: f64 = 1.41;

/// One source of variation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component {
    /// Variance, in the square of the readings' unit. An estimate below 0 is 0, as AIAG has it.
    pub variance: f64,
    /// Its root, in the unit of the readings.
    pub sd: f64,
    /// Part of the total variance, in per cent. The parts add up.
    pub contribution_percent: f64,
    /// Part of the total standard deviation, in per cent: AIAG's %study variation. The parts do not add up.
    pub study_percent: f64,
}

/// What a study finds.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Gauge {
    /// Analysis of variance: parts.
    pub parts: AnovaRow,
    /// Operators; of one alone they have no degrees of freedom.
    pub operators: AnovaRow,
    /// Parts by operators.
    pub interaction: AnovaRow,
    /// Readings within parts and operators, before pooling.
    pub repeats: AnovaRow,
    /// Chance of an interaction as large without any; `None` where readings repeat exactly.
    pub interaction_p: Option<f64>,
    /// Whether the interaction was pooled with the repeats, its probability being above [`POOLED_ABOVE`].
    pub is_pooled: bool,
    /// What the components are tested against: the repeats, with the interaction if that is pooled.
    pub error: AnovaRow,
    /// Equipment: the same operator and the same part again.
    pub repeatability: Component,
    /// Operators and, where it is not pooled, the interaction.
    pub reproducibility: Component,
    /// Operators alone.
    pub operator: Component,
    /// The interaction alone; 0 where it is pooled.
    pub by_part: Component,
    /// Repeatability and reproducibility.
    pub gauge: Component,
    /// The parts.
    pub part: Component,
    /// All.
    pub total: Component,
    /// Distinct categories: 1.41 times part over gauge, cut to a whole number; below 5 the gauge does not measure
    /// (AIAG). `None` where the gauge does not vary at all.
    pub ndc: Option<u64>,
}

/// Judges a gauge from `readings` of a complete crossed study.
///
/// # Errors
/// [`Refusal::TooFew`] of parts, operators or repeats; [`Refusal::Lengths`]; [`Refusal::Incomplete`] names the first
/// hole; [`Refusal::NoScatter`] of readings that are all the same.
pub fn crossed(readings: &[Option<f64>], study: Crossed) -> Result<Gauge, Refusal> {
    at_least("parts", study.part_count, 2)?;
    at_least("operators", study.operator_count, 2)?;
    judged(readings, study)
}

/// Judges a gauge from the same number of `readings` of each of `part_count` parts, part by part, by one operator.
///
/// # Errors
/// As [`crossed`]; [`Refusal::Lengths`] for readings that the parts do not share evenly.
pub fn one_way(readings: &[Option<f64>], part_count: usize) -> Result<Gauge, Refusal> {
    at_least("parts", part_count, 2)?;
    judged(readings, Crossed { part_count, operator_count: 1, repeat_count: readings.len() / part_count })
}

fn judged(readings: &[Option<f64>], study: Crossed) -> Result<Gauge, Refusal> {
    let Crossed { part_count, operator_count, repeat_count } = study;
    at_least("repeats", repeat_count, 2)?;
    let Sums { parts, operators, interaction, repeats } = Sums::new(readings, study)?;
    let interaction_p = interaction.f_test(&repeats).map(|(_, p)| p);
    // Without repeats' scatter there is nothing to pool with, but for an interaction that is none either.
    let is_pooled = interaction_p.map_or(interaction.sum_of_squares <= 0.0, |p| p > POOLED_ABOVE);
    let error = if is_pooled { interaction.pooled(repeats) } else { repeats };
    let against = if is_pooled { error } else { interaction };
    let (p, o, r) = (part_count as f64, operator_count as f64, repeat_count as f64);
    let repeatability = error.mean_square;
    let operator = above_zero((operators.mean_square - against.mean_square) / (p * r));
    let by_part = if is_pooled { 0.0 } else { above_zero((interaction.mean_square - repeats.mean_square) / r) };
    let part = above_zero((parts.mean_square - against.mean_square) / (o * r));
    let gauge = repeatability + operator + by_part;
    let total = gauge + part;
    let of = |variance| Component::new(variance, total);
    Ok(Gauge {
        parts,
        operators,
        interaction,
        repeats,
        interaction_p,
        is_pooled,
        error,
        repeatability: of(repeatability),
        reproducibility: of(operator + by_part),
        operator: of(operator),
        by_part: of(by_part),
        gauge: of(gauge),
        part: of(part),
        total: of(total),
        ndc: categories(part, gauge),
    })
}

impl Component {
    /// Of a total above 0; where that is 0 (each mean square is cancelled by another) nothing has a part in it.
    fn new(variance: f64, total: f64) -> Self {
        let fraction = if total > 0.0 { variance / total } else { 0.0 };
        let (contribution_percent, study_percent) = (100.0 * fraction, 100.0 * fraction.sqrt());
        Self { variance, sd: variance.sqrt(), contribution_percent, study_percent }
    }
}

/// Categories of parts that a gauge with these variances distinguishes.
fn categories(part: f64, gauge: f64) -> Option<u64> {
    let categories = CATEGORIES * (part / gauge).sqrt();
    // Truncation towards zero is what AIAG asks for; `as` also keeps what is too large for any integer at the largest.
    categories.is_finite().then_some(categories as u64)
}

/// Estimates of variances below 0 are 0.
fn above_zero(variance: f64) -> f64 {
    if variance > 0.0 { variance } else { 0.0 }
}
