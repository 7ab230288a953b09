//! A mean of few values, such as one per seed, with its interval.

use statrs::distribution::{ContinuousCDF as _, StudentsT};

use super::Rate;

/// The mean of `values` with its two-sided interval by Student's t; unbounded for a single value, `None` for no value, and
/// if one is NaN.
///
/// The values are to be independent and about normal: one per seed, each itself a mean or an area of many things.
pub fn mean_interval(values: &[f64], level: f64) -> Option<Rate> {
    if values.is_empty() || values.iter().any(|x| !x.is_finite()) || !(level > 0.0 && level < 1.0) {
        return None;
    }
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let reach = match values.len() {
        1 => f64::INFINITY,
        _ => {
            let variance = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0);
            let t = StudentsT::new(0.0, 1.0, n - 1.0).ok()?.inverse_cdf(0.5 + 0.5 * level);
            t * (variance / n).sqrt()
        }
    };
    Some(Rate { rate: mean, low: mean - reach, high: mean + reach })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a divisor n for n - 1, a normal quantile for Student's, and an interval made up of one value. By scipy:
    /// `scipy.stats.t.interval(0.95, 3, loc=2.5, scale=scipy.stats.sem([1, 2, 3, 4]))` is (0.4457397, 4.5542603).
    #[test]
    fn an_interval_of_four_values() {
        let Rate { rate, low, high } = mean_interval(&[1.0, 2.0, 3.0, 4.0], 0.95).unwrap();
        assert!((rate - 2.5).abs() < 1e-12 && (low - 0.445_739_7).abs() < 1e-6 && (high - 4.554_260_3).abs() < 1e-6);
        assert!(mean_interval(&[1.0], 0.95).unwrap().low.is_infinite());
        assert_eq!(mean_interval(&[], 0.95), None);
        assert_eq!(mean_interval(&[1.0, f64::NAN], 0.95), None);
    }
}
