//! What a box of a boxplot shows of a list of numbers.

use tapline_draw::stats::{mean, median, quantile};

/// A box of a boxplot.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Quartiles {
    pub(super) count: usize,
    pub(super) low: f64,
    pub(super) median: f64,
    pub(super) high: f64,
    /// Farthest values within 1.5 interquartile ranges of the box.
    pub(super) whiskers: (f64, f64),
    pub(super) mean: f64,
    pub(super) outliers: Vec<f64>,
}

impl Quartiles {
    /// The box of `values`; `None` of nothing.
    pub(super) fn of(values: &[f64]) -> Option<Self> {
        let (low, high) = (quantile(values, 0.25)?, quantile(values, 0.75)?);
        let reach = 1.5 * (high - low);
        let (inside, outliers): (Vec<f64>, Vec<f64>) =
            values.iter().partition(|x| (low - reach..=high + reach).contains(*x));
        Some(Self {
            count: values.len(),
            low,
            median: median(values)?,
            high,
            whiskers: (quantile(&inside, 0.0)?, quantile(&inside, 1.0)?),
            mean: mean(values)?,
            outliers,
        })
    }

    /// Height of the box.
    pub(super) fn spread(&self) -> f64 {
        self.high - self.low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a whisker that reaches an outlier, and a box of nothing.
    #[test]
    fn whiskers_end_before_outliers() {
        let of = Quartiles::of(&[1.0, 2.0, 3.0, 4.0, 100.0]).unwrap();
        assert_eq!((of.outliers.as_slice(), of.count), (&[100.0][..], 5));
        for (got, expected) in [(of.whiskers.0, 1.0), (of.whiskers.1, 4.0), (of.spread(), 2.0), (of.median, 3.0)] {
            assert!((got - expected).abs() < 1e-12, "{got} {expected}");
        }
        assert!(Quartiles::of(&[]).is_none());
    }
}
