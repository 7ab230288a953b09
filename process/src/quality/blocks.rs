//! A record in blocks of a millisecond, which is all that the slow rules need of it.

use std::f64::consts::TAU;

use crate::Real;
use crate::wide::Kernel;

/// Blocks of one second, nearly: a block has whole samples.
const BLOCKS_PER_S: f64 = 1000.0;
/// Samples without which a block does not average anything, and the record has no blocks.
const BLOCK_SAMPLES: usize = 4;

/// What a block holds, in the unit of the signal.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Block {
    pub(crate) mean: f64,
    pub(crate) mean_square: f64,
    /// Greatest magnitude.
    pub(crate) peak: f64,
}

/// The blocks of a record, with room for the next record's.
#[derive(Debug, Default)]
pub(crate) struct Blocks {
    all: Vec<Block>,
    rate_hz: f64,
    order: Vec<f64>,
}

impl Blocks {
    /// Fills the blocks from `signal`; samples that fill no block at its end are left out.
    pub(crate) fn fill<T: Real>(&mut self, signal: &[T], sample_rate_hz: f64) {
        let count = samples_per_block(sample_rate_hz);
        self.rate_hz = sample_rate_hz / count as f64;
        let block_count = if count < BLOCK_SAMPLES { 0 } else { signal.len() / count };
        self.all.resize(block_count, Block::default());
        Fill { signal, count, blocks: &mut self.all }.wide();
    }

    /// The blocks of the last record.
    pub(crate) fn all(&self) -> &[Block] {
        &self.all
    }

    /// Blocks of one second.
    pub(crate) fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Root of the median of the mean squares of blocks `from` to before `to` about their mean: noise, with what events
    /// there are in less than half of the blocks left out; `None` of none.
    pub(crate) fn noise(&mut self, from: usize, to: usize) -> Option<f64> {
        let blocks = self.all.get(from..to)?;
        let mean = blocks.iter().map(|block| block.mean).sum::<f64>() / blocks.len() as f64;
        // The mean square about another level, from that about 0.
        self.root_of_median(from, to, |b| b.mean_square - 2.0 * mean * b.mean + mean * mean)
    }

    /// The same about the mean of each block, less what a sine of `amplitude` and `turns` a block changes within one:
    /// noise beside hum.
    pub(crate) fn noise_beside(&mut self, from: usize, to: usize, amplitude: f64, turns: f64) -> Option<f64> {
        // A slope s has the variance s^2/12 in a block, and the median of the sine's squared slopes is half the greatest.
        let of_sine = (TAU * turns * amplitude).powi(2) / 24.0;
        self.root_of_median(from, to, |b| b.mean_square - b.mean * b.mean - of_sine)
    }

    fn root_of_median(&mut self, from: usize, to: usize, square: impl Fn(&Block) -> f64) -> Option<f64> {
        let blocks = self.all.get(from..to).filter(|blocks| !blocks.is_empty())?;
        self.order.clear();
        self.order.extend(blocks.iter().map(square));
        let middle = self.order.len() / 2;
        let median = *self.order.select_nth_unstable_by(middle, f64::total_cmp).1;
        Some(if median > 0.0 { median.sqrt() } else { 0.0 })
    }
}

/// Samples of a block; one at least.
pub(crate) fn samples_per_block(sample_rate_hz: f64) -> usize {
    let count = (sample_rate_hz / BLOCKS_PER_S).round();
    if count > 1.0 { count as usize } else { 1 }
}

/// Lanes of a block's sums.
const LANES: usize = 8;
/// Blocks whose lanes are stored before they are added up: it is at stores that the compiler sees vectors.
const GROUP: usize = 8;

/// Fills `blocks` with those of `count` samples of `signal`: mean, mean square and greatest magnitude in one pass.
///
/// Lanes, because neither a sum nor a maximum of floats in one variable may be reordered into SIMD; a block is short
/// enough for `T`.
struct Fill<'a, T> {
    signal: &'a [T],
    count: usize,
    blocks: &'a mut [Block],
}

impl<T: Real> Kernel for Fill<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { signal, count, blocks } = self;
        let (mut stored, part) = ([Lanes::default(); GROUP], 1.0 / count as f64);
        let mut from = 0;
        for group in blocks.chunks_mut(GROUP) {
            for lanes in &mut stored[..group.len()] {
                *lanes = Lanes::of(&signal[from..], count);
                from += count;
            }
            for (block, lanes) in group.iter_mut().zip(&stored) {
                *block = lanes.block(part);
            }
        }
    }
}

/// Sum, sum of squares and greatest magnitude of every eighth sample of a block.
#[derive(Debug, Clone, Copy)]
struct Lanes<T> {
    sum: [T; LANES],
    square: [T; LANES],
    peak: [T; LANES],
}

impl<T: Real> Lanes<T> {
    /// Of the first `count` samples of `signal`.
    #[inline(always)]
    fn of(signal: &[T], count: usize) -> Self {
        let mut lanes = Self::default();
        let (rows, rest) = signal.split_at(count - count % LANES);
        for row in rows.as_chunks::<LANES>().0 {
            lanes.add(row);
        }
        // Zeros change no lane: none of them is -0. Samples behind the block are read, but not used.
        let mut last = [T::zero(); LANES];
        match rest.first_chunk::<LANES>() {
            Some(row) => {
                for lane in 0..LANES {
                    last[lane] = if lane < count % LANES { row[lane] } else { T::zero() };
                }
            }
            None => last[..count % LANES].copy_from_slice(&rest[..count % LANES]),
        }
        lanes.add(&last);
        lanes
    }

    #[inline(always)]
    fn add(&mut self, row: &[T; LANES]) {
        for (lane, &x) in row.iter().enumerate() {
            let magnitude = x.abs();
            self.sum[lane] += x;
            self.square[lane] += x * x;
            self.peak[lane] = if magnitude > self.peak[lane] { magnitude } else { self.peak[lane] };
        }
    }

    /// The block; `part` is one over the number of its samples.
    #[inline(always)]
    fn block(&self, part: f64) -> Block {
        // By halves, which are vectors too.
        let fold = |lanes: &[T; LANES], of_two: fn(T, T) -> T| {
            let four: [T; 4] = std::array::from_fn(|lane| of_two(lanes[lane], lanes[lane + 4]));
            let two: [T; 2] = std::array::from_fn(|lane| of_two(four[lane], four[lane + 2]));
            of_two(two[0], two[1]).widened()
        };
        let sum = |a, b| a + b;
        Block {
            mean: fold(&self.sum, sum) * part,
            mean_square: fold(&self.square, sum) * part,
            peak: fold(&self.peak, |a, b| if b > a { b } else { a }),
        }
    }
}

impl<T: Real> Default for Lanes<T> {
    fn default() -> Self {
        Self { sum: [T::zero(); LANES], square: [T::zero(); LANES], peak: [T::zero(); LANES] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a lost sample, a signed peak and a sum for a mean.
    #[test]
    fn blocks_of_a_ramp() {
        let signal: Vec<f64> = (0..99).map(|i| -f64::from(i)).collect();
        let mut blocks = Blocks::default();
        blocks.fill(&signal, 10_000.0);
        assert_eq!(blocks.all().len(), 9);
        assert_eq!(
            blocks.all()[2],
            Block { mean: -24.5, mean_square: (20..30).map(|i| f64::from(i * i)).sum::<f64>() / 10.0, peak: 29.0 }
        );
        assert!((samples_per_block(1.0), samples_per_block(f64::MAX)).0 == 1);
    }

    /// Catches a mean in place of the median, and a level taken for noise.
    #[test]
    fn noise_leaves_events_and_level_out() {
        let mut signal: Vec<f32> = (0..1000).map(|i| if i % 2 == 0 { 9.5 } else { 8.5 }).collect();
        let mut blocks = Blocks::default();
        blocks.fill(&signal, 10_000.0);
        assert!((blocks.noise(0, 100).unwrap() - 0.5).abs() < 1e-6);
        signal[33] = 30.0;
        blocks.fill(&signal, 10_000.0);
        assert!((blocks.noise(0, 100).unwrap() - 0.5).abs() < 1e-2);
        assert_eq!((blocks.noise(3, 3), blocks.noise(99, 101)), (None, None));
        blocks.fill(&signal, 2000.0);
        assert!(blocks.all().is_empty());
    }

    /// Catches lanes, or an order of summation, that differ with the machine's vectors or from the definition, and a
    /// sample behind the block that counts: the twin is sample by sample, and all bits are compared.
    #[test]
    fn blocks_have_the_same_bits_on_every_machine() {
        fn twin<T: Real>(block: &[T]) -> Block {
            let mut lanes = [[T::zero(); LANES]; 3];
            for (i, &x) in block.iter().enumerate() {
                let lane = i % LANES;
                lanes[0][lane] += x;
                lanes[1][lane] += x * x;
                lanes[2][lane] = if x.abs() > lanes[2][lane] { x.abs() } else { lanes[2][lane] };
            }
            let sum = |lanes: [T; LANES]| {
                let pair = |lane: usize| lanes[lane] + lanes[lane + 4];
                ((pair(0) + pair(2)) + (pair(1) + pair(3))).widened()
            };
            let peak = lanes[2].iter().fold(0.0, |a, x| if x.widened() > a { x.widened() } else { a });
            let part = 1.0 / block.len() as f64;
            Block { mean: sum(lanes[0]) * part, mean_square: sum(lanes[1]) * part, peak }
        }
        fn check<T: Real>(count: usize) {
            let signal: Vec<T> = (0..count * 21 + 5).map(|i| T::rounded((i as f64 * 0.7).sin() * 1.9)).collect();
            let expected: Vec<Block> = signal.chunks_exact(count).map(twin).collect();
            let mut blocks = vec![Block::default(); expected.len()];
            Fill { signal: &signal, count, blocks: &mut blocks }.run();
            assert_eq!(blocks, expected, "{count}");
            blocks.fill(Block::default());
            Fill { signal: &signal, count, blocks: &mut blocks }.wide();
            assert_eq!(blocks, expected, "{count}");
        }
        for count in (4..50).chain([192]) {
            check::<f32>(count);
            check::<f64>(count);
        }
    }
}
