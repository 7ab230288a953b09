//! The two arithmetics as one trait, which is sealed.

use std::ops::{AddAssign, SubAssign};

use bytemuck::Pod;
use rustfft::FftNum;

use crate::signal::wide::Kernel;

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// `f32` or `f64`: the arithmetic of the transform and of sums over a whole record.
pub trait Real: FftNum + Pod + PartialOrd + AddAssign + SubAssign + sealed::Sealed {
    /// The nearest number of this kind.
    fn rounded(value: f64) -> Self;
    /// The same number in double precision.
    fn widened(self) -> f64;
}

impl Real for f32 {
    fn rounded(value: f64) -> Self {
        value as f32
    }
    fn widened(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    fn rounded(value: f64) -> Self {
        value
    }
    fn widened(self) -> f64 {
        self
    }
}

/// Sum of `term` over `samples`: blocks short enough for `T`, added up in double precision.
///
/// Lanes of at most eight terms each keep the error of an `f32` block below 2^-20 of its sum of magnitudes, whatever
/// the length of the record, and let the compiler use SIMD.
pub(crate) fn sum_of<T: Real>(samples: &[T], term: impl Fn(T) -> T) -> f64 {
    Sum { samples, term }.wide()
}

struct Sum<'a, T, F> {
    samples: &'a [T],
    term: F,
}

/// Lanes of a sum.
const LANES: usize = 32;
/// Rows of a block: the number of terms per lane.
const ROWS: usize = 8;
/// Blocks whose lanes are stored before they are added up.
const GROUP: usize = 8;

impl<T: Real, F: Fn(T) -> T> Kernel for Sum<'_, T, F> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        let Self { samples, term } = self;
        let (rows, rest) = samples.as_chunks::<LANES>();
        let mut totals = [0.0; LANES];
        let mut stored = [[T::zero(); LANES]; GROUP];
        for group in rows.chunks(GROUP * ROWS) {
            // Several blocks are added up together, because the compiler makes vectors where lanes are stored.
            let blocks = group.chunks(ROWS);
            let block_count = blocks.len();
            for (lanes, block) in stored.iter_mut().zip(blocks) {
                let mut sums = [T::zero(); LANES];
                for row in block {
                    sums.iter_mut().zip(row).for_each(|(lane, &x)| *lane += term(x));
                }
                *lanes = sums;
            }
            for lanes in &stored[..block_count] {
                totals.iter_mut().zip(lanes).for_each(|(total, lane)| *total += lane.widened());
            }
        }
        rest.iter().fold(totals.iter().sum(), |sum, &x| sum + term(x).widened())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::wide::in_all_vectors;

    /// Catches a lost remainder or block: every length around the block size, against the plain sum.
    #[test]
    fn sum_of_every_length() {
        for count in 0..200_u32 {
            let samples: Vec<f64> = (0..count).map(f64::from).collect();
            let expected = f64::from(count) * (f64::from(count) - 1.0) / 2.0;
            assert!((sum_of(&samples, |x| x) - expected).abs() < 1e-9, "{count} samples");
        }
    }

    /// Catches accumulation of the whole record in `f32`, which stalls at 2^24.
    #[test]
    fn sum_of_many_f32() {
        let samples = vec![1.0_f32; (1 << 24) + 1000];
        assert!((sum_of(&samples, |x| x) - f64::from((1 << 24) + 1000)).abs() < 0.5);
    }

    /// Catches lanes, or an order of summation, that depend on the machine's vectors or differ from the definition: the
    /// twin goes sample by sample, and all bits are compared.
    #[test]
    fn sums_have_the_same_bits_on_every_machine() {
        fn twin<T: Real>(samples: &[T], term: impl Fn(T) -> T) -> f64 {
            let whole = samples.len() / LANES * LANES;
            let mut totals = [0.0; LANES];
            for block in samples[..whole].chunks(ROWS * LANES) {
                let mut lanes = [T::zero(); LANES];
                for (i, &x) in block.iter().enumerate() {
                    lanes[i % LANES] += term(x);
                }
                totals.iter_mut().zip(lanes).for_each(|(total, lane)| *total += lane.widened());
            }
            samples[whole..].iter().fold(totals.iter().sum(), |sum, &x| sum + term(x).widened())
        }
        fn check<T: Real>(count: usize) {
            let samples: Vec<T> = (0..count).map(|i| T::rounded((i as f64 * 0.7).sin() * 1.9)).collect();
            for term in [(|x| x) as fn(T) -> T, |x| x * x, |x| x.abs()] {
                let expected = twin(&samples, term).to_bits();
                let sums = in_all_vectors(|| Sum { samples: &samples, term });
                assert_eq!(sums.map(f64::to_bits), [expected; 3], "{count}");
                assert_eq!(sum_of(&samples, term).to_bits(), expected, "{count}");
            }
        }
        for count in (0..200).chain([16_384, 16_401]) {
            check::<f32>(count);
            check::<f64>(count);
        }
    }
}
