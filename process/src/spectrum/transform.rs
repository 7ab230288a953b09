//! Transforms of complex numbers: the trait, and `rustfft`.

use std::sync::Arc;

use num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use crate::Real;

/// Transforms as many numbers as it was planned for.
pub(crate) trait Transform<T>: Send + Sync {
    /// Sets the first `bin_count` and the last `bin_count` of `transformed`, which is as long as `given`. The others,
    /// and `given`, are overwritten.
    fn forward(&mut self, given: &mut [Complex<T>], transformed: &mut [Complex<T>], bin_count: usize);
}

/// The transform by `rustfft`, of any length.
pub(super) struct Rustfft<T> {
    fft: Arc<dyn Fft<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> Rustfft<T> {
    pub(super) fn new(length: usize) -> Self {
        // A planner keeps every plan it ever made, so each plan has its own planner.
        let fft = FftPlanner::new().plan_fft_forward(length);
        Self { scratch: vec![Complex::new(T::zero(), T::zero()); fft.get_outofplace_scratch_len()], fft }
    }
}

impl<T: Real> Transform<T> for Rustfft<T> {
    fn forward(&mut self, given: &mut [Complex<T>], transformed: &mut [Complex<T>], _bin_count: usize) {
        self.fft.process_outofplace_with_scratch(given, transformed, &mut self.scratch);
    }
}
