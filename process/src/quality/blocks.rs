//! A record in blocks of a millisecond, which is all that the slow rules need of it.

use std::f64::consts::TAU;

use crate::Real;

/// Blocks of one second, nearly: a block has whole samples.
const BLOCKS_PER_S: f64 = 1000.0;
/// Samples without which a block does not average anything, and the record has no blocks.
const BLOCK_SAMPLES: usize = 4;

/// What a block holds, in the unit of the signal.
#[derive(Debug, Clone, Copy, PartialEq)]
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
        self.all.clear();
        let count = samples_per_block(sample_rate_hz);
        self.rate_hz = sample_rate_hz / count as f64;
        if count < BLOCK_SAMPLES {
            return;
        }
        self.all.extend(signal.chunks_exact(count).map(block_of));
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

/// Mean, mean square and greatest magnitude of `block`, in one pass.
///
/// Lanes, because neither a sum nor a maximum of floats in one variable may be reordered into SIMD; a block is short
/// enough for `T`.
fn block_of<T: Real>(block: &[T]) -> Block {
    const LANES: usize = 8;
    let (mut sum, mut square, mut peak) = ([T::zero(); LANES], [T::zero(); LANES], [T::zero(); LANES]);
    let mut rows = block.chunks_exact(LANES);
    for row in rows.by_ref() {
        for lane in 0..LANES {
            let x = row[lane];
            let magnitude = x.abs();
            sum[lane] += x;
            square[lane] += x * x;
            peak[lane] = if magnitude > peak[lane] { magnitude } else { peak[lane] };
        }
    }
    for (lane, &x) in rows.remainder().iter().enumerate() {
        sum[lane] += x;
        square[lane] += x * x;
        peak[lane] = if x.abs() > peak[lane] { x.abs() } else { peak[lane] };
    }
    let total = |lanes: [T; LANES]| lanes.iter().map(|x| x.widened()).sum::<f64>();
    let count = block.len() as f64;
    let greatest = peak.into_iter().fold(T::zero(), |a, b| if b > a { b } else { a });
    Block { mean: total(sum) / count, mean_square: total(square) / count, peak: greatest.widened() }
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
}
