//! Plans of transforms, made once a length.

use std::fmt;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};

use crate::Real;

/// Lengths whose plans are kept: more than one line taps with, and a bound on memory.
const PLANS_MAX: usize = 8;

struct Plan<T> {
    fft: Arc<dyn RealToComplex<T>>,
    bins: Vec<Complex<T>>,
    scratch: Vec<Complex<T>>,
}

/// Transforms signals of any length, keeping the plans of the lengths used last.
pub(super) struct Plans<T> {
    /// Most recently used last.
    plans: Vec<Plan<T>>,
}

impl<T> fmt::Debug for Plans<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Plans").field("plan_count", &self.plans.len()).finish()
    }
}

impl<T: Real> Plans<T> {
    pub(super) fn new() -> Self {
        Self { plans: Vec::with_capacity(PLANS_MAX) }
    }

    /// Bins of `signal` from 0 Hz to the Nyquist frequency; destroys `signal`.
    pub(super) fn transform(&mut self, signal: &mut [T]) -> Option<&[Complex<T>]> {
        let plan = self.plan(signal.len());
        // The lengths are the plan's own.
        plan.fft.process_with_scratch(signal, &mut plan.bins, &mut plan.scratch).ok()?;
        Some(&plan.bins)
    }

    fn plan(&mut self, count: usize) -> &mut Plan<T> {
        match self.plans.iter().position(|plan| plan.fft.len() == count) {
            Some(at) => self.plans[at..].rotate_left(1),
            None => {
                if self.plans.len() >= PLANS_MAX {
                    self.plans.remove(0);
                }
                // A planner keeps every plan it ever made, so each plan gets its own.
                let fft = RealFftPlanner::new().plan_fft_forward(count);
                self.plans.push(Plan { bins: fft.make_output_vec(), scratch: fft.make_scratch_vec(), fft });
            }
        }
        let last = self.plans.len() - 1;
        &mut self.plans[last]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a cache without bound, and a plan used for another length than its own.
    #[test]
    fn plans_are_kept_and_bounded() {
        let signal = |count: usize| -> Vec<f64> { (0..count).map(|i| ((i * i) % 17) as f64).collect() };
        let mut plans = Plans::new();
        for count in (100..130).chain([129, 100, 128]) {
            let kept = plans.transform(&mut signal(count)).unwrap().to_vec();
            assert_eq!(kept, Plans::new().transform(&mut signal(count)).unwrap());
            assert!(plans.plans.len() <= PLANS_MAX);
        }
        let kept: Vec<usize> = plans.plans.iter().map(|plan| plan.fft.len()).collect();
        assert_eq!(kept, [123, 124, 125, 126, 127, 129, 100, 128]);
    }
}
