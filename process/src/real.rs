//! The two arithmetics, as one trait that nobody else can implement.

use std::ops::{AddAssign, SubAssign};

use realfft::FftNum;

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// `f32` or `f64`: the arithmetic of the transform and of sums over a whole record.
pub trait Real: FftNum + PartialOrd + AddAssign + SubAssign + sealed::Sealed {
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

/// Sum over `samples` of `term`, in double precision across blocks that are short enough for `T`.
///
/// Eight lanes of at most eight terms each keep the error of an `f32` block below 2^-20 of its sum
/// of magnitudes, whatever the length of the record, and leave the compiler free to use SIMD.
pub(crate) fn sum_of<T: Real>(samples: &[T], term: impl Fn(T) -> T) -> f64 {
    const LANES: usize = 8;
    const BLOCK: usize = 64;
    let mut blocks = samples.chunks_exact(BLOCK);
    let mut total = 0.0;
    for block in blocks.by_ref() {
        let mut lanes = [T::zero(); LANES];
        for row in block.chunks_exact(LANES) {
            for (lane, &x) in lanes.iter_mut().zip(row) {
                *lane += term(x);
            }
        }
        total += lanes.iter().map(|lane| lane.widened()).sum::<f64>();
    }
    total + blocks.remainder().iter().map(|&x| term(x).widened()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
