//! Corrects the droop of a force sensor that is coupled through a time constant TC.
//!
//! Such a sensor gives y = x - (1/TC) integral of y; so x = y + (1/TC) integral of y. The integral accumulates any
//! offset, so the baseline is removed first, and the integral begins just before the pulse.

use std::ops::Range;

/// Fills `corrected` with the values of `range` without droop; `time_constant_samples` is TC.
pub(super) fn correct(
    value: impl Fn(usize) -> f64,
    range: Range<usize>,
    time_constant_samples: f64,
    corrected: &mut Vec<f64>,
) {
    let mut integral = 0.0;
    let mut before = 0.0;
    corrected.clear();
    corrected.extend(range.map(|i| {
        let y = value(i);
        integral += f64::midpoint(before, y);
        before = y;
        y + integral / time_constant_samples
    }));
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Catches a wrong sign or rule of the integral: a half-sine behind an ideal coupling, known in closed form, comes
    /// back within the error of the trapezoids.
    #[test]
    fn a_coupled_half_sine_comes_back() {
        let (tau, tc) = (200.0, 2000.0);
        let omega = PI / tau;
        // y' = x' - y/TC with x = sin(omega t): the sum of the forced and the decaying part.
        let gain = 1.0 / (1.0 + (omega * tc).powi(2));
        let forced = |t: f64| gain * omega * tc * (omega * tc * (omega * t).sin() + (omega * t).cos());
        let inside = |t: f64| forced(t) - forced(0.0) * (-t / tc).exp();
        let coupled = |i: usize| {
            let t = i as f64 - 50.0;
            match t {
                ..0.0 => 0.0,
                t if t < tau => inside(t),
                t => inside(tau) * (-(t - tau) / tc).exp(),
            }
        };
        assert!((coupled(150) - 1.0).abs() > 0.02 && coupled(260) < -0.05);
        let mut corrected = Vec::new();
        correct(coupled, 20..600, tc, &mut corrected);
        for (i, x) in (20..600).zip(&corrected) {
            let t = f64::from(i) - 50.0;
            let expected = if (0.0..tau).contains(&t) { (omega * t).sin() } else { 0.0 };
            assert!((x - expected).abs() < 2e-5, "{i}: {x} for {expected}");
        }
    }
}
