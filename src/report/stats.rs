//! The few numbers that pictures need of a handful of values.

/// Makes the median of magnitudes a standard deviation, where values are normal.
const MAD_TO_SIGMA: f64 = 1.4826;

/// The mean, `None` of nothing.
pub(super) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The median, `None` of nothing.
pub(super) fn median(values: &[f64]) -> Option<f64> {
    quantile(&sorted(values), 0.5)
}

/// The robust standard deviation, from the median magnitude about the median; `None` of nothing.
pub(super) fn spread(values: &[f64]) -> Option<f64> {
    let center = median(values)?;
    let magnitudes: Vec<f64> = values.iter().map(|value| (value - center).abs()).collect();
    Some(MAD_TO_SIGMA * median(&magnitudes)?)
}

/// `values`, ascending.
pub(super) fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// The value below which the share `q` of the ascending values lies, linear between two; `None` of nothing.
pub(super) fn quantile(ascending: &[f64], q: f64) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    let place = q.clamp(0.0, 1.0) * last as f64;
    let (below, part) = (place.floor() as usize, place.fract());
    let above = ascending[(below + 1).min(last)];
    Some(ascending[below] + part * (above - ascending[below]))
}

/// Least and greatest of the numbers, `None` of nothing.
pub(super) fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let known = values.filter(|value| value.is_finite());
    known.fold(None, |range, value| match range {
        None => Some((value, value)),
        Some((low, high)) => Some((if value < low { value } else { low }, if value > high { value } else { high })),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a quartile taken at the wrong place, and a number invented for no values.
    #[test]
    fn quantiles_are_linear_between_values() {
        let values = [1.0, 2.0, 3.0, 5.0];
        let at = |q| quantile(&values, q).unwrap();
        assert!((at(0.5) - 2.5).abs() < 1e-12 && (at(0.25) - 1.75).abs() < 1e-12 && (at(0.75) - 3.5).abs() < 1e-12);
        assert!((at(0.0) - 1.0).abs() < 1e-12 && (at(1.0) - 5.0).abs() < 1e-12);
        assert_eq!((quantile(&[], 0.5), mean(&[]), median(&[]), spread(&[])), (None, None, None, None));
        assert_eq!(range([f64::NAN, 2.0, -1.0].into_iter()), Some((-1.0, 2.0)));
    }
}
