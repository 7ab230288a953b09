//! The transform of complex numbers: our own of powers of two from 1024 on in single precision, where the processor has
//! AVX-512, and `rustfft`'s everywhere else.

use std::sync::Arc;

use num_complex::Complex;
use rustfft::{Fft, FftPlanner};

#[cfg(target_arch = "x86_64")]
use super::lanes::Lanes;
use crate::Real;

/// Transforms as many numbers as it was planned for.
pub trait Transform<T>: Send + Sync {
    /// Sets of `transformed`, which is as long as `given`, the first `bin_count` bins and the last as many; nothing of use is
    /// left in the others, nor in `given`.
    fn forward(&mut self, given: &mut [Complex<T>], transformed: &mut [Complex<T>], bin_count: usize);
}

/// The fastest transform of `length` numbers in the arithmetic that the machine has.
pub(super) fn plan<T: Real>(length: usize) -> Box<dyn Transform<T>> {
    T::own_transform(length).unwrap_or_else(|| Box::new(Rustfft::new(length)))
}

/// Our own transform of `length` numbers in single precision; `None` where there is none.
#[cfg(target_arch = "x86_64")]
pub(crate) fn of_single(length: usize) -> Option<Box<dyn Transform<f32>>> {
    Some(Box::new(Lanes::try_new(length)?))
}

/// No transform of our own: it is for other processors.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) fn of_single(_length: usize) -> Option<Box<dyn Transform<f32>>> {
    None
}

/// That of `rustfft`, of any length.
pub(super) struct Rustfft<T> {
    fft: Arc<dyn Fft<T>>,
    scratch: Vec<Complex<T>>,
}

impl<T: Real> Rustfft<T> {
    pub(super) fn new(length: usize) -> Self {
        // A planner keeps every plan it ever made, so each plan gets its own.
        let fft = FftPlanner::new().plan_fft_forward(length);
        Self { scratch: vec![Complex::new(T::zero(), T::zero()); fft.get_outofplace_scratch_len()], fft }
    }
}

impl<T: Real> Transform<T> for Rustfft<T> {
    fn forward(&mut self, given: &mut [Complex<T>], transformed: &mut [Complex<T>], _bin_count: usize) {
        self.fft.process_outofplace_with_scratch(given, transformed, &mut self.scratch);
    }
}
