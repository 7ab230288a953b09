//! An axis that has numbers only at chosen places.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use tapline_draw::canvas::{Point, number};
use tapline_draw::scale::Scale;

/// One axis.
pub(crate) struct Axis {
    /// Name and unit.
    pub label: String,
    pub range: Point,
    pub ticks: Vec<f64>,
}

impl Axis {
    /// Covers `range`, with a margin around it and room for a word above, with about `count` numbers.
    pub(crate) fn around(label: impl Into<String>, (low, high): Point, count: usize) -> Self {
        let room = if high > low { 0.06 * (high - low) } else { 0.5 * high.abs() + f64::MIN_POSITIVE };
        Self::from_to(label, (low - room, high + 3.0 * room), count)
    }

    /// Covers exactly `range`, with about `count` numbers.
    pub(crate) fn from_to(label: impl Into<String>, range: Point, count: usize) -> Self {
        let ticks = Scale::linear(range).ticks(count).into_iter().map(|tick| tick.value).collect();
        Self { label: label.into(), range, ticks }
    }
}

/// A linear coordinate with its ticks.
pub(crate) struct Ticked {
    linear: RangedCoordf64,
    ticks: Vec<f64>,
}

impl Ticked {
    /// The coordinate of `axis`.
    pub(crate) fn new(axis: &Axis) -> Self {
        Self { linear: RangedCoordf64::from(axis.range.0..axis.range.1), ticks: axis.ticks.clone() }
    }
}

impl Ranged for Ticked {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.linear.map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.linear.range()
    }
}

impl ValueFormatter<f64> for Ticked {
    fn format(value: &f64) -> String {
        number(*value)
    }
}
