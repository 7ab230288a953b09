//! A point of the chart: what something costs, how wrong it is, and what is known about both.

use crate::statistics::{Rate, mean_interval};
use tapline_draw::stats::quantile;

/// Confidence of every interval.
pub(crate) const LEVEL: f64 = 0.95;

/// A cost over repetitions that took turns with those of its rivals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cost {
    pub median: f64,
    /// Quartiles.
    pub low: f64,
    pub high: f64,
}

impl Cost {
    /// Of repetitions; NaN if none.
    pub(crate) fn of(values: &[f64]) -> Self {
        let at = |q| quantile(values, q).unwrap_or(f64::NAN);
        Self { median: at(0.5), low: at(0.25), high: at(0.75) }
    }

    /// A cost that is counted, not measured: bytes, or seconds of a plan.
    pub(crate) fn exact(value: f64) -> Self {
        Self { median: value, low: value, high: value }
    }
}

/// An error, with its 95 % interval.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Error {
    pub value: f64,
    pub low: f64,
    pub high: f64,
    /// The error of each seed, in order: errors of one seed come from the same taps, so they can be compared in pairs.
    pub by_seed: Vec<f64>,
}

impl Error {
    /// The mean of one error per seed, none of which can be below 0.
    pub(crate) fn mean_of(by_seed: Vec<f64>) -> Self {
        let none = Rate { rate: f64::NAN, low: f64::NAN, high: f64::NAN };
        let Rate { rate, low, high } = mean_interval(&by_seed, LEVEL).unwrap_or(none);
        Self { value: rate, low: if low < 0.0 { 0.0 } else { low }, high, by_seed }
    }

    /// With an interval computed differently, such as one over whole tyres.
    pub(crate) fn with_interval(self, interval: Option<(f64, f64)>) -> Self {
        match interval {
            Some((low, high)) => Self { low, high, ..self },
            None => self,
        }
    }
}

/// A stability limit that a point fails.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Failure {
    /// The limit, with the number of its stability case if it has one.
    pub case: &'static str,
    pub measured: f64,
    pub limit: f64,
}

/// One configuration.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Point {
    /// Its name in a table.
    pub name: String,
    /// Its short label next to the point.
    pub label: String,
    /// Points of one family are drawn alike.
    pub family: usize,
    /// Points of other groups do not compete: each group has its own front.
    pub group: usize,
    pub cost: Cost,
    pub error: Error,
    /// Whether it is what the program does by default.
    pub is_default: bool,
    /// The stability limits that it fails: if any, it is drawn hollow and is not on the front.
    pub failures: Vec<Failure>,
    /// How many taps, shoulders or scenes the error is from.
    pub n: usize,
    pub remark: String,
}

impl Point {
    pub(crate) fn new(name: impl Into<String>, label: impl Into<String>, cost: Cost, error: Error, n: usize) -> Self {
        Self {
            name: name.into(),
            label: label.into(),
            family: 0,
            group: 0,
            cost,
            error,
            is_default: false,
            failures: Vec::new(),
            n,
            remark: String::new(),
        }
    }

    pub(crate) fn family(self, family: usize) -> Self {
        Self { family, ..self }
    }

    pub(crate) fn group(self, group: usize) -> Self {
        Self { group, ..self }
    }

    pub(crate) fn default_if(self, is_default: bool) -> Self {
        Self { is_default, ..self }
    }

    pub(crate) fn failing(self, failures: Vec<Failure>) -> Self {
        Self { failures, ..self }
    }

    pub(crate) fn remark(self, remark: impl Into<String>) -> Self {
        Self { remark: remark.into(), ..self }
    }

    /// Whether it keeps every stability limit.
    pub(crate) fn is_stable(&self) -> bool {
        self.failures.is_empty()
    }
}

/// The failure of `case` if `measured` exceeds `limit` or is NaN.
pub(crate) fn exceeds(case: &'static str, measured: f64, limit: f64) -> Option<Failure> {
    // Written so that NaN fails.
    let is_kept = measured <= limit;
    (!is_kept).then_some(Failure { case, measured, limit })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches NaN that passes, and a limit that excludes itself.
    #[test]
    fn a_limit_is_kept_up_to_itself() {
        assert_eq!(exceeds("C1", 0.5, 0.5), None);
        assert!(exceeds("C1", 0.6, 0.5).is_some() && exceeds("C1", f64::NAN, 0.5).is_some());
    }

    /// Catches an interval below 0, and one from a single seed.
    #[test]
    fn errors_have_intervals_of_their_seeds() {
        let error = Error::mean_of(vec![0.0, 0.0, 0.3]);
        assert!((error.value - 0.1).abs() < 1e-12 && error.low.abs() < 1e-12 && error.high > 0.3);
        assert!(Error::mean_of(vec![0.2]).high.is_infinite());
        let by_tyres = Error::mean_of(vec![0.2]).with_interval(Some((0.1, 0.4)));
        assert!((by_tyres.high - 0.4).abs() < 1e-12 && (by_tyres.value - 0.2).abs() < 1e-12);
    }
}
