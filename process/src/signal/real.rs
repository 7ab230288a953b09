//! The two arithmetics as one trait, which is sealed.

use std::ops::{AddAssign, SubAssign};

use bytemuck::Pod;
use rustfft::FftNum;

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

/// Sum of the squares of `signal`, as eight sums side by side, which vectors can take.
pub(crate) fn sum_of_squares<T: Real>(signal: &[T]) -> f64 {
    let (rows, rest) = signal.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for row in rows {
        sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += x.widened().powi(2));
    }
    sums.iter().sum::<f64>() + rest.iter().map(|x| x.widened().powi(2)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a sample that is left out, or counted twice, where the length is no multiple of eight.
    #[test]
    fn squares_of_every_length() {
        for count in 0..40 {
            let signal: Vec<f32> = (0..count).map(|i| i as f32 - 7.0).collect();
            let expected: f64 = (0..count).map(|i| f64::from(i - 7).powi(2)).sum();
            assert!((sum_of_squares(&signal) - expected).abs() < 1e-9, "{count}");
        }
    }
}
