//! Boxplots by Tukey's rule: a box from the lower to the upper quartile, whiskers to the farthest values within 1.5
//! interquartile ranges of the box, a ring for each value beyond.

use anyhow::Result;
use plotters::coord::ranged1d::Ranged;
use plotters::prelude::*;

use crate::canvas::{INK, line, units};
use crate::stats::{mean, median, quantile};

/// Longest whisker, in heights of the box.
const WHISKER_MAX: f64 = 1.5;

/// Maximum number of outliers drawn; of more, only every second or third, because they overlap.
const OUTLIERS_DRAWN_MAX: usize = 400;

/// The numbers that the box of a list shows.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxStats {
    /// Number of values.
    pub count: usize,
    /// Lower quartile.
    pub low: f64,
    /// Median.
    pub median: f64,
    /// Upper quartile.
    pub high: f64,
    /// Farthest values within 1.5 interquartile ranges of the box.
    pub whiskers: (f64, f64),
    /// Mean.
    pub mean: f64,
    /// Values beyond the whiskers.
    pub outliers: Vec<f64>,
}

impl BoxStats {
    /// The box of `values`; `None` if there are none.
    pub fn new(values: &[f64]) -> Option<Self> {
        let (low, high) = (quantile(values, 0.25)?, quantile(values, 0.75)?);
        let reach = WHISKER_MAX * (high - low);
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

    /// Height of the box: the interquartile range.
    pub fn height(&self) -> f64 {
        self.high - self.low
    }

    /// Draws the box around `x`, `half` wide to either side, in the coordinates of `chart`.
    ///
    /// # Errors
    /// Those of the library.
    pub fn draw<X, Y>(
        &self,
        chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<X, Y>>,
        (x, half): (f64, f64),
        color: RGBColor,
    ) -> Result<()>
    where
        X: Ranged<ValueType = f64>,
        Y: Ranged<ValueType = f64>,
    {
        let stroke = line(color, 1.5);
        let body = [(x - half, self.low), (x + half, self.high)];
        chart.draw_series([Rectangle::new(body, color.mix(0.25).filled()), Rectangle::new(body, stroke)])?;
        let across = |y: f64, half: f64| vec![(x - half, y), (x + half, y)];
        let ((low, high), cap) = (self.whiskers, half * 3.0 / 7.0);
        let strokes =
            [vec![(x, self.low), (x, low)], vec![(x, self.high), (x, high)], across(low, cap), across(high, cap)];
        chart.draw_series(strokes.map(|points| PathElement::new(points, stroke)))?;
        chart.draw_series([PathElement::new(across(self.median, half), line(INK, 2.0))])?;
        let every = self.outliers.len() / OUTLIERS_DRAWN_MAX + 1;
        let outliers = self.outliers.iter().step_by(every);
        chart.draw_series(outliers.map(|&y| Circle::new((x, y), units(2.0), line(color, 1.0))))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a whisker that reaches an outlier, and a box of no values.
    #[test]
    fn whiskers_end_before_outliers() {
        let stats = BoxStats::new(&[1.0, 2.0, 3.0, 4.0, 100.0]).unwrap();
        assert_eq!((stats.outliers.as_slice(), stats.count), (&[100.0][..], 5));
        let (low, high) = stats.whiskers;
        for (got, expected) in [(low, 1.0), (high, 4.0), (stats.height(), 2.0), (stats.median, 3.0)] {
            assert!((got - expected).abs() < 1e-12, "{got} {expected}");
        }
        assert!(BoxStats::new(&[]).is_none());
    }
}
