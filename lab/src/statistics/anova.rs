//! Analysis of variance of a complete crossed design.

use statrs::distribution::{ContinuousCDF as _, FisherSnedecor};

use super::Refusal;

/// One line of an analysis of variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnovaRow {
    /// Degrees of freedom.
    pub degrees: usize,
    /// Sum of squares, in the square of the readings' unit.
    pub sum_of_squares: f64,
    /// Sum of squares over degrees of freedom; 0 where there are none.
    pub mean_square: f64,
}

impl AnovaRow {
    pub(super) fn new(degrees: usize, sum_of_squares: f64) -> Self {
        let mean_square = if degrees == 0 { 0.0 } else { sum_of_squares / degrees as f64 };
        Self { degrees, sum_of_squares, mean_square }
    }

    /// Both in one.
    pub(super) fn pooled(self, other: Self) -> Self {
        Self::new(self.degrees + other.degrees, self.sum_of_squares + other.sum_of_squares)
    }

    /// Ratio of this mean square to that of `error`, and the probability of a greater one if neither had an effect of its
    /// own.
    ///
    /// `None` where `error` is 0 or either has no degrees of freedom.
    pub fn f_test(&self, error: &Self) -> Option<(f64, f64)> {
        let ratio = Some(self.mean_square / error.mean_square).filter(|ratio| ratio.is_finite())?;
        let of_ratios = FisherSnedecor::new(self.degrees as f64, error.degrees as f64).ok()?;
        Some((ratio, of_ratios.sf(ratio)))
    }
}

/// Shape of a crossed study. The reading of (part, operator, repeat) stands at (part x operators + operator) x repeats
/// + repeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crossed {
    /// Parts; 2 or more.
    pub part_count: usize,
    /// Operators or stations; 2 or more; 1 in a one-way study.
    pub operator_count: usize,
    /// Readings of each part by each operator; 2 or more.
    pub repeat_count: usize,
}

/// Sums of squares of a complete design.
pub(super) struct Sums {
    pub parts: AnovaRow,
    pub operators: AnovaRow,
    pub interaction: AnovaRow,
    pub repeats: AnovaRow,
}

/// Sums of squares at or below this part of that of the readings themselves are rounding.
const ROUNDING: f64 = 1e-28;

impl Sums {
    /// Of the `readings` of `study`.
    pub(super) fn new(readings: &[Option<f64>], study: Crossed) -> Result<Self, Refusal> {
        let values = complete(readings, study)?;
        let Crossed { part_count: parts, operator_count: operators, repeat_count: repeats } = study;
        let mean = |of: &dyn Fn(usize, usize) -> bool| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (place, value) in values.iter().enumerate() {
                let cell = place / repeats;
                if of(cell / operators, cell % operators) {
                    sum += value;
                    count += 1.0;
                }
            }
            sum / count
        };
        let all = mean(&|_, _| true);
        let of_part: Vec<f64> = (0..parts).map(|part| mean(&|p, _| p == part) - all).collect();
        let of_operator: Vec<f64> = (0..operators).map(|operator| mean(&|_, o| o == operator) - all).collect();
        let of_cell: Vec<f64> = values.chunks(repeats).map(|c| c.iter().sum::<f64>() / c.len() as f64 - all).collect();
        let squares = |effects: &mut dyn Iterator<Item = f64>, times: usize| {
            times as f64 * effects.map(|effect| effect * effect).sum::<f64>()
        };
        let floor = values.iter().map(|value| value * value).sum::<f64>() * ROUNDING;
        let row = |degrees, sum: f64| AnovaRow::new(degrees, if sum > floor { sum } else { 0.0 });
        let interaction = &mut of_cell
            .iter()
            .enumerate()
            .map(|(cell, of_cell)| of_cell - of_part[cell / operators] - of_operator[cell % operators]);
        let within = &mut values.iter().enumerate().map(|(place, value)| value - all - of_cell[place / repeats]);
        let sums = Self {
            parts: row(parts - 1, squares(&mut of_part.iter().copied(), operators * repeats)),
            operators: row(operators - 1, squares(&mut of_operator.iter().copied(), parts * repeats)),
            interaction: row((parts - 1) * (operators - 1), squares(interaction, repeats)),
            repeats: row(parts * operators * (repeats - 1), squares(within, 1)),
        };
        let total = [&sums.parts, &sums.operators, &sums.interaction, &sums.repeats].map(|row| row.sum_of_squares);
        let total = total.iter().sum::<f64>();
        if total.is_finite() && total > 0.0 { Ok(sums) } else { Err(Refusal::NoScatter("readings")) }
    }
}

/// All readings of a design of at least one of each, or the first hole.
fn complete(readings: &[Option<f64>], study: Crossed) -> Result<Vec<f64>, Refusal> {
    let Crossed { part_count: parts, operator_count: operators, repeat_count: repeats } = study;
    let expected = parts.saturating_mul(operators).saturating_mul(repeats);
    if readings.len() != expected {
        return Err(Refusal::Lengths("readings", readings.len(), "the design", expected));
    }
    let hole = |place: usize| {
        let cell = place / repeats;
        Refusal::Incomplete(cell / operators, cell % operators, place % repeats)
    };
    let value = |(place, reading): (usize, &Option<f64>)| reading.filter(|v| v.is_finite()).ok_or_else(|| hole(place));
    readings.iter().enumerate().map(value).collect()
}

/// Refuses fewer than `least` of a thing.
pub(super) fn at_least(name: &'static str, got: usize, least: usize) -> Result<(), Refusal> {
    if got < least { Err(Refusal::TooFew(name, got, least)) } else { Ok(()) }
}
