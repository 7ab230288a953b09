//! The level of a channel before the impact, and its scatter.

use crate::signal::record::Count;
use crate::signal::wide::Kernel;

/// Number of samples that the baseline is computed from: the first floor(0.75 p) of a record of `sample_count`.
///
/// `None` if there are none, or if the trigger lies outside the record, because p is wrong then.
pub(crate) fn baseline_count(pre_trigger_samples: usize, sample_count: usize) -> Option<usize> {
    let count = (pre_trigger_samples / 4) * 3 + (pre_trigger_samples % 4) * 3 / 4;
    (count > 0 && pre_trigger_samples <= sample_count).then_some(count)
}

/// Finds medians; all of them share one scratch.
#[derive(Debug, Default)]
pub(crate) struct Medians {
    keys: Vec<i32>,
}

impl Medians {
    /// Median of `samples` in counts; the mean of the middle two if their number is even, 0 if there are none.
    pub(crate) fn median<C: Count>(&mut self, samples: &[C]) -> f64 {
        self.keys.resize(samples.len(), 0);
        Keys { samples, key: |x: C| x.key(), keys: &mut self.keys }.wide();
        self.median_of_keys::<C>()
    }

    /// Standard deviation of `samples` around `base`, which is a median of samples. It is estimated as 1.4826 times the
    /// median of their magnitudes, so that an impact that began too early does not count as noise, and is never below
    /// the converter's rounding.
    pub(crate) fn noise_counts<C: Count>(&mut self, samples: &[C], base: f64) -> f64 {
        self.keys.resize(samples.len(), 0);
        Keys { samples, key: |x: C| x.distance_key(base), keys: &mut self.keys }.wide();
        let sigma = 1.4826 * self.median_of_keys::<C>();
        if sigma > C::ROUNDING_COUNTS { sigma } else { C::ROUNDING_COUNTS }
    }

    fn median_of_keys<C: Count>(&self) -> f64 {
        let Some((lower, upper)) = Middle { keys: &self.keys }.wide() else { return 0.0 };
        f64::midpoint(C::from_key(lower), C::from_key(upper))
    }
}

/// Fills `keys` with the `key` of each sample.
struct Keys<'a, C, F> {
    samples: &'a [C],
    key: F,
    keys: &'a mut [i32],
}

impl<C: Count, F: Fn(C) -> i32> Kernel for Keys<'_, C, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (to, &x) in self.keys.iter_mut().zip(self.samples) {
            *to = (self.key)(x);
        }
    }
}

/// The middle two of `keys`, equal if their number is odd; `None` if there are none.
///
/// Counting the keys below a value uses vectors, where sorting needs comparisons: the range of the median is quartered
/// up to 16 times.
struct Middle<'a> {
    keys: &'a [i32],
}

impl Kernel for Middle<'_> {
    type Output = Option<(i32, i32)>;

    #[inline(always)]
    fn run(self) -> Option<(i32, i32)> {
        let first = *self.keys.first()?;
        let (mut low, mut high) = (first, first);
        for &key in self.keys {
            low = low.min(key);
            high = high.max(key);
        }
        // The upper of the two is the least value that more than half of the keys do not exceed.
        let half = self.keys.len() / 2;
        while low < high {
            let span = i64::from(high) - i64::from(low);
            let at = [span / 4, span / 2, 3 * span / 4].map(|part| (i64::from(low) + part) as i32);
            // Arithmetic instead of a branch, which could not be predicted.
            let quarter: usize = self.counts(at).into_iter().map(|count| usize::from(count <= half)).sum();
            (low, high) = ([low, at[0] + 1, at[1] + 1, at[2] + 1][quarter], [at[0], at[1], at[2], high][quarter]);
        }
        let upper = low;
        let (mut lower, mut below) = (i32::MIN, 0_u32);
        for &key in self.keys {
            below += u32::from(key < upper);
            lower = lower.max(if key < upper { key } else { i32::MIN });
        }
        let is_pair = self.keys.len().is_multiple_of(2) && below as usize == half;
        Some((if is_pair { lower } else { upper }, upper))
    }
}

impl Middle<'_> {
    /// For each of the values `at`, how many keys do not exceed it.
    #[inline(always)]
    fn counts(&self, at: [i32; 3]) -> [usize; 3] {
        let mut counts = [0_u32; 3];
        for &key in self.keys {
            for (count, at) in counts.iter_mut().zip(at) {
                *count += u32::from(key <= at);
            }
        }
        counts.map(|count| count as usize)
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
        /// Catches a wrong middle: the twin sorts, for odd and even numbers of samples.
        #[test]
        fn median_like_a_sort(samples in prop::collection::vec(any::<i16>(), 1..50)) {
            let mut sorted: Vec<f64> = samples.iter().map(|&x| f64::from(x)).collect();
            sorted.sort_by(f64::total_cmp);
            let n = sorted.len();
            let expected = (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0;
            prop_assert!((Medians::default().median(&samples) - expected).abs() < 1e-12);
        }
    }

    proptest! {
        /// Catches floats that are ordered wrongly, or that do not come back from their keys: the twin sorts.
        #[test]
        fn median_and_noise_of_floats_like_a_sort(samples in prop::collection::vec(-1e30..1e30_f32, 1..50)) {
            let twin = |mut values: Vec<f32>| {
                values.sort_by(f32::total_cmp);
                let n = values.len();
                f64::midpoint(f64::from(values[(n - 1) / 2]), f64::from(values[n / 2]))
            };
            let mut medians = Medians::default();
            let base = medians.median(&samples);
            prop_assert_eq!(base.to_bits(), twin(samples.clone()).to_bits());
            let distances = samples.iter().map(|&x| (f64::from(x) - base).abs() as f32).collect();
            prop_assert_eq!(medians.noise_counts(&samples, base).to_bits(), (1.4826 * twin(distances)).to_bits());
        }

        /// Catches middles that differ with the machine's vectors.
        #[test]
        fn middles_are_the_same_on_every_machine(keys in prop::collection::vec(any::<i32>(), 0..90)) {
            let mut sorted = keys.clone();
            sorted.sort_unstable();
            let expected = sorted.get(keys.len() / 2).map(|&upper| (sorted[(keys.len() - 1) / 2], upper));
            prop_assert_eq!(Middle { keys: &keys }.run(), expected);
            prop_assert_eq!(Middle { keys: &keys }.wide(), expected);
        }
    }

    /// Catches noise measured as a standard deviation, which one early impact inflates, and a quiet converter that
    /// counts as free of rounding.
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
