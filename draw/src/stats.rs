//! Summary statistics of a list of values.

/// Factor from a median of magnitudes to a standard deviation, for normal values.
const MAD_TO_SIGMA: f64 = 1.4826;

/// The mean; `None` if there are no values.
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The value below which the fraction `q` (0 to 1) of `values` lies, linear between values; `None` if there are none.
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut ascending = values.to_vec();
    ascending.sort_by(f64::total_cmp);
    let last = ascending.len().checked_sub(1)?;
    let place = q.clamp(0.0, 1.0) * last as f64;
    let (below, part) = (place.floor() as usize, place.fract());
    let above = ascending[(below + 1).min(last)];
    Some(ascending[below] + part * (above - ascending[below]))
}

/// The median; `None` if there are no values.
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// The standard deviation with the divisor n - 1; `None` for fewer than two values.
pub fn sd(values: &[f64]) -> Option<f64> {
    let mean = mean(values)?;
    let sum: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    (values.len() > 1).then(|| (sum / (values.len() - 1) as f64).sqrt())
}

/// The robust standard deviation, from the median magnitude around the median; `None` if there are no values.
pub fn spread(values: &[f64]) -> Option<f64> {
    let center = median(values)?;
    let magnitudes: Vec<f64> = values.iter().map(|value| (value - center).abs()).collect();
    Some(MAD_TO_SIGMA * median(&magnitudes)?)
}

/// Smallest and largest of the numbers among `values`; `None` if there are none.
pub fn extent(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    let known = values.into_iter().filter(|value| value.is_finite());
    known.fold(None, |extent, value| match extent {
        None => Some((value, value)),
        Some((low, high)) => Some((if value < low { value } else { low }, if value > high { value } else { high })),
    })
}

/// The largest minus the smallest of the numbers among `values`; `None` if there are none.
pub fn range(values: &[f64]) -> Option<f64> {
    extent(values.iter().copied()).map(|(low, high)| high - low)
}

/// Root of the mean square difference of `pairs`; `None` if there are none.
pub fn rmse(pairs: &[(f64, f64)]) -> Option<f64> {
    let squares: Vec<f64> = pairs.iter().map(|(a, b)| (a - b).powi(2)).collect();
    mean(&squares).map(f64::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a quantile at the wrong place, a wrong divisor, and a number invented for no values.
    #[test]
    fn statistics_are_those_by_hand() {
        let near = |a: Option<f64>, b: f64| assert!(a.is_some_and(|a| (a - b).abs() < 1e-12), "{a:?} {b}");
        let values = [4.0, 1.0, 3.0, 2.0];
        near(quantile(&values, 0.25), 1.75);
        near(quantile(&values, 0.0), 1.0);
        near(quantile(&values, 1.0), 4.0);
        near(median(&values), 2.5);
        near(mean(&values), 2.5);
        near(sd(&values), (5.0_f64 / 3.0).sqrt());
        near(spread(&values), 1.4826);
        near(range(&values), 3.0);
        near(quantile(&[7.0], 0.9), 7.0);
        near(rmse(&[(1.0, 4.0), (2.0, 2.0)]), 4.5_f64.sqrt());
        assert_eq!((sd(&[7.0]), quantile(&[], 0.5), mean(&[]), spread(&[]), rmse(&[])), (None, None, None, None, None));
        assert_eq!(extent([f64::NAN, 2.0, -1.0]), Some((-1.0, 2.0)));
    }
}
