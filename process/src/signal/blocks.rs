//! A sound in blocks of a millisecond. Its sums and the slow rules need no more than these.
//!
//! Memory, not arithmetic, limits passes over a record, so the blocks are computed while the signal is written.

use std::array::from_fn;
use std::f64::consts::TAU;

use crate::Real;
use crate::signal::record::Count as _;
use crate::signal::wide::Kernel;

/// Blocks per second, within a ninth: a block has whole samples and, if it is long, whole rows of lanes.
const BLOCKS_PER_S: f64 = 1000.0;
/// Fewest samples of a block that averages anything; the rules see no blocks if they are shorter.
const BLOCK_SAMPLES: usize = 4;

/// Mean and mean square of a signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moments {
    pub mean: f64,
    pub mean_square: f64,
}

/// The blocks of a record, in the unit of the signal; their memory is reused for the next record.
#[derive(Debug, Default)]
pub(crate) struct Blocks {
    means: Vec<f64>,
    mean_squares: Vec<f64>,
    mean_magnitudes: Vec<f64>,
    /// Greatest magnitudes.
    peaks: Vec<f64>,
    /// Samples per block.
    count: usize,
    are_short: bool,
    rate_hz: f64,
    keys: Vec<i32>,
}

impl Blocks {
    /// Lets `write` fill the `signal` stretch by stretch, given where each begins, and computes the blocks. Samples at
    /// the end that do not fill a block are written but are in no block.
    pub(crate) fn fill<T: Real>(&mut self, signal: &mut [T], sample_rate_hz: f64, write: impl FnMut(usize, &mut [T])) {
        let asked_for = samples_per_block(sample_rate_hz);
        self.are_short = asked_for < BLOCK_SAMPLES;
        self.count = asked_for.max(BLOCK_SAMPLES);
        self.rate_hz = sample_rate_hz / asked_for as f64;
        let blocks = [&mut self.means, &mut self.mean_squares, &mut self.mean_magnitudes, &mut self.peaks].map(|all| {
            all.resize(signal.len() / self.count, 0.0);
            &mut all[..]
        });
        Fill { signal, write, count: self.count, blocks }.wide();
    }

    /// The means of the last record's blocks, for the rules; none if blocks are too short.
    pub(crate) fn means(&self) -> &[f64] {
        if self.are_short { &[] } else { &self.means }
    }

    /// The greatest magnitudes of the last record's blocks, for the rules; none if blocks are too short.
    pub(crate) fn peaks(&self) -> &[f64] {
        if self.are_short { &[] } else { &self.peaks }
    }

    /// Blocks per second.
    pub(crate) fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Mean and mean square of the `signal` that the blocks were computed from.
    pub(crate) fn moments<T: Real>(&self, signal: &[T]) -> Moments {
        let count = signal.len() as f64;
        Moments {
            mean: self.sum(signal, 0, &self.means, |x| x) / count,
            mean_square: self.sum(signal, 0, &self.mean_squares, |x| x * x) / count,
        }
    }

    /// Sum of the magnitudes of the same `signal`, from sample `first` on.
    pub(crate) fn magnitude<T: Real>(&self, signal: &[T], first: usize) -> f64 {
        self.sum(signal, first, &self.mean_magnitudes, f64::abs)
    }

    /// Sum over the same `signal` from sample `first` on: whole blocks by their `means`, the other samples one by one.
    fn sum<T: Real>(&self, signal: &[T], first: usize, means: &[f64], term: impl Fn(f64) -> f64) -> f64 {
        let whole = first.div_ceil(self.count).min(means.len());
        let before = signal.get(first..whole * self.count).unwrap_or_default();
        let behind = signal.get((means.len() * self.count).max(first)..).unwrap_or_default();
        let beside: f64 = before.iter().chain(behind).map(|x| term(x.widened())).sum();
        self.count as f64 * folded_in_lanes(&means[whole..], |mean| mean, |a, b| a + b) + beside
    }

    /// Noise: the root of the median of the mean squares of blocks `from` to before `to`, around their common mean. The
    /// median ignores events in less than half of the blocks. `None` without blocks.
    pub(crate) fn noise(&mut self, from: usize, to: usize) -> Option<f64> {
        let of_all = mean_of(self.means().get(from..to)?);
        // The mean square around another level, from that around 0.
        self.root_of_median(from, to, |mean, square| square - 2.0 * of_all * mean + of_all * of_all)
    }

    /// Noise beside hum: as [`Blocks::noise`], but around the mean of each block, less what a sine of `amplitude` and
    /// `turns` per block changes within a block.
    pub(crate) fn noise_beside(&mut self, from: usize, to: usize, amplitude: f64, turns: f64) -> Option<f64> {
        // A slope s has the variance s^2/12 in a block, and the median of the sine's squared slopes is half the greatest.
        let of_sine = (TAU * turns * amplitude).powi(2) / 24.0;
        self.root_of_median(from, to, |mean, square| square - mean * mean - of_sine)
    }

    /// The root of the median of the `value` of blocks `from` to before `to`, by their means and mean squares.
    fn root_of_median(&mut self, from: usize, to: usize, value: impl Fn(f64, f64) -> f64) -> Option<f64> {
        let Self { means, mean_squares, are_short, keys, .. } = self;
        let means = means.get(from..to).filter(|means| !*are_short && !means.is_empty())?;
        keys.clear();
        keys.extend(
            means.iter().zip(&mean_squares[from..to]).map(|(&mean, &square)| (value(mean, square) as f32).key()),
        );
        let middle = keys.len() / 2;
        let median = f64::from(f32::from_key(*keys.select_nth_unstable(middle).1));
        Some(if median > 0.0 { median.sqrt() } else { 0.0 })
    }
}

pub(crate) fn mean_of(values: &[f64]) -> f64 {
    folded_in_lanes(values, |value| value, |a, b| a + b) / values.len() as f64
}

/// What `of_each` makes of all `values`, folded into one by `of_two`. If `of_two` is not a sum, nothing may be below 0.
///
/// Uses lanes, because each step of a fold in one variable waits for the one before.
pub(crate) fn folded_in_lanes(values: &[f64], of_each: impl Fn(f64) -> f64, of_two: impl Fn(f64, f64) -> f64) -> f64 {
    let mut lanes = [0.0; FOLD_LANES];
    for values in values.chunks(FOLD_LANES) {
        for (lane, &value) in lanes.iter_mut().zip(values) {
            *lane = of_two(*lane, of_each(value));
        }
    }
    lanes.into_iter().fold(0.0, of_two)
}

/// Samples per block: at least one, and whole rows of lanes where that changes the block by at most a ninth.
pub(crate) fn samples_per_block(sample_rate_hz: f64) -> usize {
    let count = (sample_rate_hz / BLOCKS_PER_S).round();
    let count = if count > 1.0 { count as usize } else { 1 };
    if count < 4 * LANES { count } else { count.saturating_add(LANES / 2) / LANES * LANES }
}

/// Lanes of folds over blocks.
const FOLD_LANES: usize = 8;
/// Lanes of a block's sums.
const LANES: usize = 8;
/// Lanes of two blocks side by side, which fill the widest vectors.
const OF_TWO: usize = 2 * LANES;
/// Blocks whose lanes are stored before they are added up; the compiler makes vectors at stores.
const GROUP: usize = 16;

/// Lets `write` fill `signal`, and computes `blocks` of `count` samples each: their means, mean squares, mean magnitudes and
/// greatest magnitudes.
///
/// Uses lanes, because the compiler may not reorder a sum or a maximum of floats into SIMD. A block is short enough for
/// `T`: up to 1 MHz a lane has 125 terms, of which an `f32` loses at most 1e-5.
struct Fill<'a, T, W> {
    signal: &'a mut [T],
    write: W,
    count: usize,
    blocks: [&'a mut [f64]; 4],
}

impl<T: Real, W: FnMut(usize, &mut [T])> Kernel for Fill<'_, T, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { signal, mut write, count, mut blocks } = self;
        let part = 1.0 / count as f64;
        let block_count = blocks[0].len();
        let mut sums: [[T; GROUP * LANES]; 4] = [[T::zero(); GROUP * LANES]; 4];
        for from in (0..block_count).step_by(GROUP) {
            let to = if from + GROUP < block_count { from + GROUP } else { block_count };
            let samples = &mut signal[from * count..to * count];
            write(from * count, samples);
            for (number, two) in samples.chunks(2 * count).enumerate() {
                // The last of an odd number of blocks is taken twice, the second time into lanes that no block has.
                let (first, second) = if two.len() > count { two.split_at(count) } else { (two, two) };
                let of_two = Lanes::of_two(first, second);
                for (sums, of_two) in sums.iter_mut().zip(of_two.0) {
                    sums.as_chunks_mut().0[number] = of_two;
                }
            }
            let sum = |a, b| a + b;
            let of_group = [
                folded(&sums[0], sum),
                folded(&sums[1], sum),
                folded(&sums[2], sum),
                folded(&sums[3], |a, b| if b > a { b } else { a }),
            ];
            for ((blocks, of_group), part) in blocks.iter_mut().zip(&of_group).zip([part, part, part, 1.0]) {
                for (block, of_block) in blocks[from..to].iter_mut().zip(of_group) {
                    *block = of_block.widened() * part;
                }
            }
        }
        let from = block_count * count;
        write(from, &mut signal[from..]);
    }
}

/// Folds the [`LANES`] of each block into one value, pair by pair.
#[inline(always)]
fn folded<T: Real>(lanes: &[T; GROUP * LANES], of_two: impl Fn(T, T) -> T + Copy) -> [T; GROUP] {
    let four: [T; GROUP * 4] = from_fn(|i| of_two(lanes[2 * i], lanes[2 * i + 1]));
    let two: [T; GROUP * 2] = from_fn(|i| of_two(four[2 * i], four[2 * i + 1]));
    from_fn(|i| of_two(two[2 * i], two[2 * i + 1]))
}

/// Sum, sum of squares, sum of magnitudes and greatest magnitude of every eighth sample of two blocks, side by side.
struct Lanes<T>([[T; OF_TWO]; 4]);

impl<T: Real> Lanes<T> {
    #[inline(always)]
    fn of_two(first: &[T], second: &[T]) -> Self {
        let mut lanes = Self([[T::zero(); OF_TWO]; 4]);
        let ((rows, rest), (rows_2, rest_2)) = (first.as_chunks::<LANES>(), second.as_chunks::<LANES>());
        for (row, row_2) in rows.iter().zip(rows_2) {
            lanes.add(row, row_2);
        }
        if !rest.is_empty() {
            // Zeros change no lane, because no lane is -0.
            let padded = |rest: &[T]| from_fn(|i| rest.get(i).copied().unwrap_or(T::zero()));
            lanes.add(&padded(rest), &padded(rest_2));
        }
        lanes
    }

    #[inline(always)]
    fn add(&mut self, row: &[T; LANES], row_2: &[T; LANES]) {
        let mut x = [T::zero(); OF_TWO];
        x[..LANES].copy_from_slice(row);
        x[LANES..].copy_from_slice(row_2);
        let [sums, squares, magnitudes, peaks] = &mut self.0;
        for (lane, &x) in x.iter().enumerate() {
            let magnitude = x.abs();
            sums[lane] += x;
            squares[lane] += x * x;
            magnitudes[lane] += magnitude;
            peaks[lane] = if magnitude > peaks[lane] { magnitude } else { peaks[lane] };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::without_avx512;

    /// Catches a lost sample, a signed peak, and a sum instead of a mean.
    #[test]
    fn blocks_of_a_ramp() {
        let mut signal = vec![0.0_f64; 99];
        let mut blocks = Blocks::default();
        blocks.fill(&mut signal, 10_000.0, |from, to| (from..).zip(to).for_each(|(i, x)| *x = -(i as f64)));
        assert!((0..99).all(|i| signal[i].to_bits() == (-(i as f64)).to_bits()), "all is written");
        assert_eq!((blocks.means().len(), blocks.peaks().len()), (9, 9));
        let mean_square = (20..30).map(|i| f64::from(i * i)).sum::<f64>() / 10.0;
        assert_eq!((blocks.means[2], blocks.mean_squares[2]), (-24.5, mean_square));
        assert_eq!((blocks.mean_magnitudes[2], blocks.peaks[2]), (24.5, 29.0));
        let counts = [0.0, 1.0, 7000.0, 31_400.0, 36_000.0, 40_960.0, 44_100.0, 192_000.0].map(samples_per_block);
        assert_eq!(counts, [1, 1, 7, 31, 40, 40, 48, 192]);
        assert!(samples_per_block(f64::MAX) > 1 << 40);
    }

    /// Catches a mean instead of the median, and a level that counts as noise.
    #[test]
    fn noise_leaves_events_and_level_out() {
        let mut signal: Vec<f32> = (0..1000).map(|i| if i % 2 == 0 { 9.5 } else { 8.5 }).collect();
        let mut blocks = Blocks::default();
        blocks.fill(&mut signal, 10_000.0, |_, _| ());
        assert!((blocks.noise(0, 100).unwrap() - 0.5).abs() < 1e-6);
        signal[33] = 30.0;
        blocks.fill(&mut signal, 10_000.0, |_, _| ());
        assert!((blocks.noise(0, 100).unwrap() - 0.5).abs() < 1e-2);
        assert_eq!((blocks.noise(3, 3), blocks.noise(99, 101)), (None, None));
        blocks.fill(&mut signal, 2000.0, |_, _| ());
        assert!(blocks.means().is_empty() && blocks.peaks().is_empty());
        assert_eq!((blocks.noise(0, 1), blocks.noise_beside(0, 1, 0.0, 0.0)), (None, None));
    }

    /// Catches a sample left out of a sum or counted twice, wherever the sum begins, and sums that depend on the length
    /// of the blocks: the twin adds sample by sample.
    #[test]
    fn sums_like_a_loop() {
        let mut signal: Vec<f64> = (0..203).map(|i| (f64::from(i) * 0.7).sin() - 0.2).collect();
        let mut blocks = Blocks::default();
        for rate_hz in [100.0, 4000.0, 7000.0, 41_000.0, 1e6] {
            blocks.fill(&mut signal, rate_hz, |_, _| ());
            let mean_of = |term: fn(f64) -> f64| signal.iter().map(|&x| term(x)).sum::<f64>() / 203.0;
            let Moments { mean, mean_square } = blocks.moments(&signal);
            assert!((mean - mean_of(|x| x)).abs() < 1e-13, "{rate_hz}: {mean}");
            assert!((mean_square - mean_of(|x| x * x)).abs() < 1e-13, "{rate_hz}: {mean_square}");
            for first in 0..210 {
                let expected: f64 = signal.iter().skip(first).map(|x| x.abs()).sum();
                let found = blocks.magnitude(&signal, first);
                assert!((found - expected).abs() < 1e-11, "{rate_hz} from {first}: {found} {expected}");
            }
        }
    }

    /// Catches lanes, or an order of summation, that depend on the machine's vectors or differ from the definition, and
    /// a sample after the block that is counted: the twin goes sample by sample, and all bits are compared.
    #[test]
    fn blocks_have_the_same_bits_on_every_machine() {
        fn twin<T: Real>(block: &[T]) -> [f64; 4] {
            let mut lanes = [[T::zero(); LANES]; 4];
            for (i, &x) in block.iter().enumerate() {
                let lane = i % LANES;
                lanes[0][lane] += x;
                lanes[1][lane] += x * x;
                lanes[2][lane] += x.abs();
                lanes[3][lane] = if x.abs() > lanes[3][lane] { x.abs() } else { lanes[3][lane] };
            }
            let sum = |lanes: [T; LANES]| {
                let pair = |lane: usize| lanes[lane] + lanes[lane + 1];
                ((pair(0) + pair(2)) + (pair(4) + pair(6))).widened()
            };
            let peak = lanes[3].iter().fold(0.0, |a, x| if x.widened() > a { x.widened() } else { a });
            let part = 1.0 / block.len() as f64;
            let [mean, mean_square, mean_magnitude] = [0, 1, 2].map(|n| sum(lanes[n]) * part);
            [mean, mean_square, mean_magnitude, peak]
        }
        fn check<T: Real>(count: usize) {
            let signal: Vec<T> = (0..count * 21 + 5).map(|i| T::rounded((i as f64 * 0.7).sin() * 1.9)).collect();
            let of_blocks: Vec<[f64; 4]> = signal.chunks_exact(count).map(twin).collect();
            let expected: [Vec<f64>; 4] = from_fn(|n| of_blocks.iter().map(|block| block[n]).collect());
            let zeros = || from_fn(|_| vec![0.0; of_blocks.len()]);
            let write = |from: usize, to: &mut [T]| to.copy_from_slice(&signal[from..][..to.len()]);
            let (mut written, mut found): (_, [Vec<f64>; 4]) = (vec![T::zero(); signal.len()], zeros());
            Fill { signal: &mut written, write, count, blocks: found.each_mut().map(|all| &mut all[..]) }.run();
            assert_eq!(written, signal, "{count}");
            assert_eq!(found, expected, "{count}");
            for is_narrow in [true, false] {
                without_avx512(is_narrow);
                let mut found = zeros();
                let blocks = found.each_mut().map(|all| &mut all[..]);
                Fill { signal: &mut written, write: |_: usize, _: &mut [T]| (), count, blocks }.wide();
                assert_eq!(found, expected, "{count}");
            }
        }
        for count in (4..50).chain([192]) {
            check::<f32>(count);
            check::<f64>(count);
        }
    }
}
