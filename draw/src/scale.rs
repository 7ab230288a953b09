//! A scale: where a value lies along an axis, linear or logarithmic, and its ticks.

use crate::canvas::{Point, number, superscript};

/// Number of decades above which a logarithmic scale has ticks only at powers of ten.
const DECADES_MANY: f64 = 2.5;
/// Decades up to which it has the ticks of a linear one.
const DECADES_FEW: f64 = 0.8;

/// A value's place along an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
    is_log: bool,
}

/// A tick of a scale.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// Its value.
    pub value: f64,
    /// The value as text; empty between labelled ones.
    pub label: String,
}

impl Scale {
    /// A linear scale from `low` to `high`; one of no length is widened.
    pub fn linear((low, high): Point) -> Self {
        let room = if high > low { 0.0 } else { 0.5 };
        Self { low: low - room, high: high + room, is_log: false }
    }

    /// A logarithmic scale from `low` to `high`, which are above 0; one of less than a factor 1.2 is widened.
    pub fn log((low, high): Point) -> Self {
        let (low, high) = (low.log10(), high.log10());
        let room = if high - low > 0.08 { 0.0 } else { 0.08 };
        Self { low: low - room, high: high + room, is_log: true }
    }

    /// The same with `part` of its length more at either end.
    pub fn with_room(self, part: f64) -> Self {
        let room = part * (self.high - self.low);
        Self { low: self.low - room, high: self.high + room, ..self }
    }

    /// Whether it is logarithmic.
    pub fn is_log(&self) -> bool {
        self.is_log
    }

    /// The value at its end.
    pub fn end(&self) -> f64 {
        self.value(self.high)
    }

    /// The value at its beginning.
    pub fn begin(&self) -> f64 {
        self.value(self.low)
    }

    fn value(&self, place: f64) -> f64 {
        if self.is_log { 10.0_f64.powf(place) } else { place }
    }

    /// Where `value` lies between the ends, from 0 to 1. On a logarithmic scale, a value not above 0 lies at the
    /// beginning; NaN lies there too.
    pub fn part(&self, value: f64) -> f64 {
        let place = if self.is_log { value.log10() } else { value };
        let part = (place - self.low) / (self.high - self.low);
        if part.is_nan() { 0.0 } else { part.clamp(0.0, 1.0) }
    }

    /// About `count` ticks, ascending, within the ends.
    pub fn ticks(&self, count: usize) -> Vec<Tick> {
        match self.is_log {
            true if self.high - self.low > DECADES_FEW => self.log_ticks(count),
            // Within so little a logarithm is straight.
            true => linear_ticks((self.begin(), self.end()), count),
            false => linear_ticks((self.low, self.high), count),
        }
    }

    fn log_ticks(&self, count: usize) -> Vec<Tick> {
        let decades = self.high - self.low;
        let digits: &[f64] = if decades > DECADES_MANY { &[1.0] } else { &[1.0, 2.0, 5.0] };
        // Of many decades some are labelled.
        let every = ((decades / count.max(1) as f64).ceil() as i32).max(1);
        let mut ticks = Vec::new();
        for power in self.low.floor() as i32..=self.high.ceil() as i32 {
            for &digit in digits {
                let value = digit * 10.0_f64.powi(power);
                if (self.low - 1e-9..=self.high + 1e-9).contains(&value.log10()) {
                    let label = if power % every == 0 { short(value) } else { String::new() };
                    ticks.push(Tick { value, label });
                }
            }
        }
        ticks
    }
}

fn linear_ticks((low, high): Point, count: usize) -> Vec<Tick> {
    let wanted = (high - low) / count.max(1) as f64;
    let power = 10.0_f64.powf(wanted.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * power).into_iter().find(|step| *step >= 0.999 * wanted);
    let step = step.unwrap_or(10.0 * power);
    if !(step.is_finite() && step > 0.0) {
        return Vec::new();
    }
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    let tick = |k: i64| Tick { value: k as f64 * step, label: short(k as f64 * step) };
    (first..=last).map(tick).collect()
}

/// A number as an axis has it: powers of ten below a thousandth and from a hundred thousand on.
fn short(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || (0.999e-3..0.999e5).contains(&size) {
        return number(value);
    }
    let power = size.log10().floor() as i32;
    let digit = value / 10.0_f64.powi(power);
    let exponent = superscript(power);
    if (digit - 1.0).abs() < 1e-6 { format!("10{exponent}") } else { format!("{}·10{exponent}", number(digit)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale, count: usize) -> Vec<String> {
        scale.ticks(count).into_iter().map(|tick| tick.label).filter(|label| !label.is_empty()).collect()
    }

    /// Catches ticks at odd numbers, outside of the scale, or so many that they run into each other.
    #[test]
    fn ticks_are_round_and_few() {
        assert_eq!(labels(Scale::linear((0.0, 41.0)), 5), ["0", "10", "20", "30", "40"]);
        assert_eq!(labels(Scale::linear((0.9, 1.0)), 5), ["0.9", "0.92", "0.94", "0.96", "0.98", "1"]);
        assert_eq!(labels(Scale::log((20.0, 1000.0)), 6), ["20", "50", "100", "200", "500", "1000"]);
        assert_eq!(labels(Scale::log((1e-9, 1.0)), 5), ["10⁻⁸", "10⁻⁶", "10⁻⁴", "0.01", "1"]);
        assert!(labels(Scale::log((5.0, 5.0)), 5).len() > 1);
        assert!(labels(Scale::linear((3.0, 3.0)), 5).len() > 1);
    }

    /// Catches a value that leaves the picture, and one that is not a number.
    #[test]
    fn places_stay_within_the_ends() {
        let log = Scale::log((1.0, 100.0));
        let parts = [10.0, 1.0, 0.0, -3.0, f64::NAN, f64::INFINITY].map(|value| log.part(value));
        assert_eq!(parts.map(|part| (part * 100.0).round() as i32), [50, 0, 0, 0, 0, 100]);
        assert!((Scale::linear((2.0, 4.0)).with_room(0.5).part(3.0) - 0.5).abs() < 1e-12);
        assert!((log.end() - 100.0).abs() < 1e-9 && (log.begin() - 1.0).abs() < 1e-9);
    }
}
