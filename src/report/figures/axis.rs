//! A coordinate whose numbers are at chosen places only.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use tapline_draw::canvas::{Point, number};

/// One axis.
pub(crate) struct Axis {
    /// Name and unit.
    pub label: String,
    pub range: Point,
    pub ticks: Vec<f64>,
}

impl Axis {
    /// Covers `range`, with a margin around it and room for a word above, with at most `count` numbers.
    pub(crate) fn around(label: impl Into<String>, (low, high): Point, count: usize) -> Self {
        let room = if high > low { 0.06 * (high - low) } else { 0.5 * high.abs() + f64::MIN_POSITIVE };
        Self::from_to(label, (low - room, high + 3.0 * room), count)
    }

    /// Covers exactly `range`, with at most `count` numbers.
    pub(crate) fn from_to(label: impl Into<String>, range: Point, count: usize) -> Self {
        Self { label: label.into(), range, ticks: ticks(range, count) }
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

/// Round numbers within `range`, at most `count`.
pub(crate) fn ticks((low, high): Point, count: usize) -> Vec<f64> {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) || count == 0 {
        return Vec::new();
    }
    let least = span / count as f64;
    let decade = 10f64.powf(least.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0, 10.0].iter().map(|&m| m * decade).find(|step| span / step <= count as f64);
    let step = step.unwrap_or(10.0 * decade);
    let first = (low / step).ceil() as i64;
    // An integer count, so that rounding adds no tick beyond the range.
    (0..=count as i64).map(|k| (first + k) as f64 * step).filter(|tick| *tick <= high + 1e-9 * span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches ticks that are not round, too close, or outside their axis.
    #[test]
    fn ticks_are_few_round_and_inside() {
        assert_eq!(ticks((0.0, 6.2), 5), [0.0, 2.0, 4.0, 6.0]);
        assert_eq!(ticks((-0.3, 1.1), 5).len(), 3);
        assert_eq!(ticks((0.0, 360.0), 4), [0.0, 100.0, 200.0, 300.0]);
        for range in [(1e-9, 3e-9), (-5.0, 1e6), (0.1, 0.100_01), (7.0, 1e3)] {
            let ticks = ticks(range, 5);
            assert!((1..=5).contains(&ticks.len()), "{range:?} {ticks:?}");
            let room = 1e-9 * (range.1 - range.0);
            let is_inside = |tick: &f64| (range.0 - room..=range.1 + room).contains(tick);
            assert!(ticks.iter().all(is_inside), "{range:?} {ticks:?}");
        }
        assert_eq!(ticks((1.0, 1.0), 5), Vec::<f64>::new());
    }
}
