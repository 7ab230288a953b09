//! What the figures and claims say of a list of numbers.

/// The quantile `q`, linear between the sorted values; `None` of nothing.
pub(super) fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = q * (sorted.len().checked_sub(1)? as f64);
    let below = place.floor();
    let (low, high) = (sorted[below as usize], sorted[(place.ceil() as usize).min(sorted.len() - 1)]);
    Some(low + (high - low) * (place - below))
}

/// The median; `None` of nothing.
pub(super) fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// The mean; `None` of nothing.
pub(super) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Standard deviation with n - 1; `None` of fewer than two.
pub(super) fn sd(values: &[f64]) -> Option<f64> {
    let mean = mean(values)?;
    let sum: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    (values.len() > 1).then(|| (sum / (values.len() - 1) as f64).sqrt())
}

/// Largest less least; `None` of nothing.
pub(super) fn range(values: &[f64]) -> Option<f64> {
    Some(quantile(values, 1.0)? - quantile(values, 0.0)?)
}

/// Root of the mean square of the differences of pairs.
pub(super) fn rmse(pairs: &[(f64, f64)]) -> Option<f64> {
    let squares: Vec<f64> = pairs.iter().map(|(a, b)| (a - b).powi(2)).collect();
    mean(&squares).map(f64::sqrt)
}

/// Nor_RMSE of two repetitions (Eq. 54): their root-mean-square difference over the range of both together.
pub(super) fn nor_rmse(pairs: &[(f64, f64)]) -> Option<f64> {
    let all: Vec<f64> = pairs.iter().flat_map(|&(a, b)| [a, b]).collect();
    Some(rmse(pairs)? / range(&all).filter(|range| *range > 0.0)?)
}

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

    fn near(a: Option<f64>, b: f64) -> bool {
        a.is_some_and(|a| (a - b).abs() < 1e-12)
    }

    /// Catches a quantile of the wrong rank, a spread by n in place of n - 1, and a statistic of nothing.
    #[test]
    fn statistics_are_those_by_hand() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert!(near(quantile(&values, 0.25), 1.75) && near(median(&values), 2.5) && near(range(&values), 3.0));
        assert!(near(mean(&values), 2.5) && near(sd(&values), (5.0_f64 / 3.0).sqrt()));
        assert!(near(quantile(&[7.0], 0.9), 7.0) && sd(&[7.0]).is_none());
        assert!(quantile(&[], 0.5).is_none() && mean(&[]).is_none() && Quartiles::of(&[]).is_none());
    }

    /// Catches Eq. 54 with the range of one repetition, and a constant divided by its range of zero.
    #[test]
    fn nor_rmse_is_eq_54() {
        assert!(near(nor_rmse(&[(1.0, 2.0), (3.0, 5.0)]), 2.5_f64.sqrt() / 4.0));
        assert!(nor_rmse(&[(1.0, 1.0), (1.0, 1.0)]).is_none());
    }

    /// Catches a whisker that reaches an outlier.
    #[test]
    fn whiskers_end_before_outliers() {
        let of = Quartiles::of(&[1.0, 2.0, 3.0, 4.0, 100.0]).unwrap();
        assert_eq!(of.outliers, [100.0]);
        assert!(near(Some(of.whiskers.1), 4.0) && near(Some(of.whiskers.0), 1.0) && near(Some(of.spread()), 2.0));
    }
}
