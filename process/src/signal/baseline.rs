//! The level of a channel before the impact, and its scatter.

#[cfg(target_arch = "x86_64")]
use pulp::x86::V4;

use crate::signal::record::{Count, Key};
use crate::signal::wide::Kernel;

/// Median of normal values over their mean, both counted from the least of them; and the same of their distances from the median.
const MEDIAN_OF_NORMAL: f32 = 1.0;
const MEDIAN_DISTANCE_OF_NORMAL: f32 = 0.845;

/// How often a median is looked for around a guess.
const GUESSES: u32 = 2;
/// The median of a few hundred normal values, or of their distances, mostly lies within a 48th of their range from the guess.
const REACH: i64 = 48;

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
        self.middle(samples, MEDIAN_OF_NORMAL, |x| x.key(), |key| C::from_key(key).into())
    }

    /// Standard deviation of `samples` around `base`, which is a median of samples. It is estimated as 1.4826 times the
    /// median of their magnitudes, so that an impact that began too early does not count as noise, and is never below
    /// the converter's rounding.
    pub(crate) fn noise_counts<C: Count>(&mut self, samples: &[C], base: f64) -> f64 {
        let middle = self.middle(
            samples,
            MEDIAN_DISTANCE_OF_NORMAL,
            |x| x.distance_key(base),
            |key| C::from_distance_key(key, base),
        );
        let sigma = 1.4826 * middle;
        if sigma > C::ROUNDING_COUNTS { sigma } else { C::ROUNDING_COUNTS }
    }

    /// The mean of the middle two of `samples` in the order of their `key`, which `from_key` reverses; 0 if there are none. Of integers
    /// the middle is first looked for at the part `at` of their mean.
    fn middle<C: Count>(
        &mut self,
        samples: &[C],
        at: f32,
        key: impl Fn(C) -> C::Key,
        from_key: impl Fn(C::Key) -> f64,
    ) -> f64 {
        self.keys.resize(samples.len(), 0);
        let keys = &mut bytemuck::cast_slice_mut(&mut self.keys)[..samples.len()];
        let middle = Middle { samples, at, key, keys }.wide();
        middle.map_or(0.0, |(lower, upper)| f64::midpoint(from_key(lower), from_key(upper)))
    }
}

/// The middle two of the `samples` by their `key`, equal if their number is odd; `None` if there are none. Fills `keys`.
///
/// Counting keys below a value uses vectors, where sorting needs comparisons. Of integers two narrow guesses are tried first, which hold
/// for most noise; then the range of the median is quartered up to 16 times.
struct Middle<'a, C: Count, F> {
    samples: &'a [C],
    /// The first guess at where the middle of integers lies, as a part of their mean; both counted from the least.
    at: f32,
    key: F,
    keys: &'a mut [C::Key],
}

impl<C: Count, F: Fn(C) -> C::Key> Kernel for Middle<'_, C, F> {
    type Output = Option<(C::Key, C::Key)>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        self.find(counts)
    }

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn run_with_masks(self, simd: V4) -> Self::Output {
        self.find(|keys, at| C::Key::counts(simd, keys, at))
    }
}

impl<C: Count, F: Fn(C) -> C::Key> Middle<'_, C, F> {
    /// The middle two; `counts` says for each of three values how many keys do not exceed it.
    #[inline(always)]
    fn find(self, counts: impl Fn(&[C::Key], [C::Key; 3]) -> [usize; 3]) -> Option<(C::Key, C::Key)> {
        let Self { samples, at, key, keys } = self;
        let first = key(*samples.first()?);
        let (mut low, mut high, mut sum) = (first, first, 0_i32);
        for (to, &x) in keys.iter_mut().zip(samples) {
            let key = key(x);
            *to = key;
            low = low.min(key);
            high = high.max(key);
            sum = sum.wrapping_add(key.into() as i32);
        }
        let keys = &*keys;
        // The upper of the two is the least value that more than half of the keys do not exceed.
        let half = keys.len() / 2;
        let (mut from, mut to): (i64, i64) = (low.into(), high.into());
        // How many keys are below `from`, and how many do not exceed `to`.
        let (mut below, mut through) = (0, keys.len());
        let mut guesses = 0;
        // The keys of floats are no scale on which a part of the range is a guess.
        let guesses_max = if C::NEEDS_GAIN { 0 } else { GUESSES };
        while from < to {
            let width = to - from + 1;
            let pivots = if guesses < guesses_max && width > 4 {
                let (guess, reach) = if guesses == 0 {
                    // A sum that has overflowed is a bad guess, and no more.
                    let mean = sum as f32 / keys.len() as f32 - from as f32;
                    (from + (at * mean) as i64, (width / REACH).max(1))
                } else {
                    // Where it lies if all values of the range are equally frequent.
                    let part = (half - below) as f32 / (through - below) as f32;
                    (from + (part * width as f32) as i64, (width / 16).max(1))
                };
                guesses += 1;
                [guess - reach, guess, guess + reach]
            } else {
                // The last values of all quarters but the last.
                let step = (width - 1) / 4 + 1;
                [1, 2, 3].map(|quarter| from + quarter * step - 1)
            };
            let pivots = pivots.map(|pivot| pivot.clamp(from, to - 1));
            let counts = counts(keys, pivots.map(|pivot| C::Key::try_from(pivot).unwrap_or(low)));
            // Arithmetic instead of branches, which could not be predicted.
            for (pivot, count) in pivots.into_iter().zip(counts) {
                (from, below) = if count <= half { (pivot + 1, count) } else { (from, below) };
            }
            for (pivot, count) in pivots.into_iter().zip(counts).rev() {
                (to, through) = if count > half { (pivot, count) } else { (to, through) };
            }
        }
        let upper = C::Key::try_from(from).unwrap_or(high);
        if !keys.len().is_multiple_of(2) || below < half {
            return Some((upper, upper));
        }
        let mut lower = low;
        for &key in keys {
            lower = lower.max(if key < upper { key } else { low });
        }
        Some((lower, upper))
    }
}

/// For each of the values `at`, how many `keys` do not exceed it.
#[inline(always)]
fn counts<K: Key>(keys: &[K], at: [K; 3]) -> [usize; 3] {
    let mut counts = [0; 3];
    // Counted in keys, so that both have lanes of one width.
    for keys in keys.chunks(K::MAX) {
        let mut of_chunk = [K::from(false); 3];
        for &key in keys {
            for (count, at) in of_chunk.iter_mut().zip(at) {
                *count += K::from(key <= at);
            }
        }
        counts.iter_mut().zip(of_chunk).for_each(|(count, of_chunk)| *count += of_chunk.into() as usize);
    }
    counts
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::signal::wide::in_all_vectors;

    fn middle<C: Count, F: Fn(C) -> C::Key>(samples: &[C], at: f32, key: F) -> Middle<'_, C, F> {
        Middle { samples, at, key, keys: vec![bytemuck::Zeroable::zeroed(); samples.len()].leak() }
    }

    /// Floats that have the bits of `keys`, and a key's.
    fn as_floats(keys: &[i32]) -> Vec<f32> {
        keys.iter().map(|&key| f32::from_bits(key as u32)).collect()
    }
    fn of_float(x: f32) -> i32 {
        x.to_bits() as i32
    }

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

        /// Catches a bracket that leaves the middle out where the range of keys ends, and equal keys: few of them, close
        /// together at either end, and a guess that is far from them.
        #[test]
        fn middles_at_the_ends_of_the_range(
            steps in prop::collection::vec(0_i16..50, 1..50), is_at_top: bool, at in 0.0..3.0_f32
        ) {
            let end = if is_at_top { (i16::MAX, i32::MAX, -1) } else { (i16::MIN, i32::MIN, 1) };
            let keys: Vec<i16> = steps.iter().map(|step| end.0 + end.2 * step).collect();
            let wide: Vec<i32> = steps.iter().map(|&step| end.1 + i32::from(end.2 * step)).collect();
            let mut sorted = keys.clone();
            sorted.sort_unstable();
            let expected = (sorted[(keys.len() - 1) / 2], sorted[keys.len() / 2]);
            prop_assert_eq!(middle(&keys, at, |x: i16| x).wide(), Some(expected));
            let widened = |key: i16| end.1 + (i32::from(key) - i32::from(end.0));
            let expected = Some((widened(expected.0), widened(expected.1)));
            prop_assert_eq!(middle(&as_floats(&wide), at, of_float).wide(), expected);
        }

        /// Catches middles that differ with the machine's vectors.
        #[test]
        fn middles_are_the_same_on_every_machine(keys in prop::collection::vec(any::<i32>(), 0..90), at in 0.0..3.0_f32) {
            let mut sorted = keys.clone();
            sorted.sort_unstable();
            let expected = sorted.get(keys.len() / 2).map(|&upper| (sorted[(keys.len() - 1) / 2], upper));
            let samples = as_floats(&keys);
            prop_assert_eq!(in_all_vectors(|| middle(&samples, at, of_float)), [expected; 3]);
        }
    }

    /// Catches distances that overflow, a half count lost or added on one side, and keys that are counted beyond what one of them
    /// can count: the twin sorts.
    #[test]
    fn noise_of_counts_like_a_sort() {
        let mut medians = Medians::default();
        for (count, least, largest) in
            [(9, -3, 4), (10, -3, 4), (10, i16::MIN, i16::MAX), (40_000, -7, 0), (70_001, i16::MIN, i16::MAX)]
        {
            let spread = i64::from(largest) - i64::from(least) + 1;
            let samples: Vec<i16> =
                (0..count).map(|i: i64| (i64::from(least) + i * i * 7919 % spread) as i16).collect();
            let middle = |mut values: Vec<f64>| {
                values.sort_by(f64::total_cmp);
                f64::midpoint(values[(values.len() - 1) / 2], values[values.len() / 2])
            };
            let base = middle(samples.iter().map(|&x| f64::from(x)).collect());
            let distances = |base: f64| middle(samples.iter().map(|&x| (f64::from(x) - base).abs()).collect());
            assert_eq!(medians.median(&samples).to_bits(), base.to_bits());
            for base in
                [base, base - 0.5, -0.5, 0.5, 7.5, f64::from(i16::MIN), f64::from(i16::MAX), -32_767.5, 32_766.5]
            {
                let (found, expected) = (medians.noise_counts(&samples, base), 1.4826 * distances(base));
                assert_eq!(found.to_bits(), expected.to_bits(), "{count} from {least} to {largest}, {base}");
            }
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
