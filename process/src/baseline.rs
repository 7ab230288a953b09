//! The level of a channel before the impact, and how much it scatters.

use crate::record::Count;

/// Samples that a baseline is taken from: the first floor(0.75 p) of a record of `sample_count`.
///
/// `None` without any, and when the trigger lies outside the record, because then p is not to be believed.
pub(crate) fn baseline_count(pre_trigger_samples: usize, sample_count: usize) -> Option<usize> {
    let count = (pre_trigger_samples / 4) * 3 + (pre_trigger_samples % 4) * 3 / 4;
    (count > 0 && pre_trigger_samples <= sample_count).then_some(count)
}

/// Finds medians, with one scratch for all of them.
#[derive(Debug, Default)]
pub(crate) struct Medians {
    order: Vec<f32>,
}

impl Medians {
    /// Median of `samples` in counts, the mean of the middle two when their number is even; 0 of none.
    pub(crate) fn median<C: Count>(&mut self, samples: &[C]) -> f64 {
        self.order.clear();
        self.order.extend(samples.iter().map(|x| x.exact_f32()));
        self.median_of_order()
    }

    /// Standard deviation of `samples` about `base`, estimated as 1.4826 times the median of their magnitudes so
    /// that an impact which began too early does not count as noise; never below the converter's rounding.
    pub(crate) fn noise_counts<C: Count>(&mut self, samples: &[C], base: f64) -> f64 {
        self.order.clear();
        self.order.extend(samples.iter().map(|&x| (x.into() - base).abs() as f32));
        let sigma = 1.4826 * self.median_of_order();
        if sigma > C::ROUNDING_COUNTS { sigma } else { C::ROUNDING_COUNTS }
    }

    fn median_of_order(&mut self) -> f64 {
        let count = self.order.len();
        if count == 0 {
            return 0.0;
        }
        let (lower, &mut upper_middle, _) = self.order.select_nth_unstable_by(count / 2, f32::total_cmp);
        if count % 2 == 1 {
            return f64::from(upper_middle);
        }
        let lower_middle = lower.iter().copied().max_by(f32::total_cmp).unwrap_or(upper_middle);
        f64::midpoint(f64::from(lower_middle), f64::from(upper_middle))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Catches floor(0.75 p) computed as 3 floor(p / 4), or past the end of what a record has.
    #[test]
    fn three_quarters_rounded_down() {
        for pre_trigger in 0..1000_usize {
            let expected = (0.75 * pre_trigger as f64).floor() as usize;
            assert_eq!(baseline_count(pre_trigger, 1000).unwrap_or(0), expected);
        }
        assert_eq!(baseline_count(1, 10), None);
        assert_eq!(baseline_count(11, 10), None);
        assert_eq!(baseline_count(10, 10), Some(7));
        assert_eq!(baseline_count(usize::MAX, 10), None);
    }

    proptest! {
        /// Catches a wrong middle: the median of sorted samples, odd and even.
        #[test]
        fn median_like_a_sort(samples in prop::collection::vec(any::<i16>(), 1..50)) {
            let mut sorted: Vec<f64> = samples.iter().map(|&x| f64::from(x)).collect();
            sorted.sort_by(f64::total_cmp);
            let n = sorted.len();
            let expected = (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0;
            prop_assert!((Medians::default().median(&samples) - expected).abs() < 1e-12);
        }
    }

    /// Catches noise measured as a standard deviation, which one early impact inflates, and a quiet converter
    /// taken for one without rounding.
    #[test]
    fn noise_ignores_an_early_impact() {
        let mut samples = [0_i16, 10, -10, 10, -10, 10, -10, 10, -10, 10];
        samples[9] = 30_000;
        let sigma = Medians::default().noise_counts(&samples, 0.0);
        assert!((sigma - 14.826).abs() < 1e-9);
        let quiet = Medians::default().noise_counts(&[5_i16; 10], 5.0);
        assert!((quiet - 1.0 / 12.0_f64.sqrt()).abs() < 1e-15);
        assert!(Medians::default().noise_counts(&[5.0_f32; 10], 5.0).abs() < 1e-15);
    }
}
