//! Spikes: single samples that stand out of a pulse.

use std::ops::Range;

use crate::signal::record::Count;
use crate::signal::wide::Kernel;

/// Standard deviations of the noise that a spike must exceed; the deviation of a sample has 1.4 of one.
const SPIKE_SIGMAS: f64 = 7.0;
/// A half-sine of n samples begins with a kink, which deviates by pi/(3 n) of its height; and a seventh more for noise.
const KINK: f64 = 1.2;
/// Where a pulse of n samples bends, it deviates by a part of its height that falls with n squared: at most 15/n^2 within clean
/// pulses of both simulators, sound and cracked casings at 10 to 20 kHz, and 37/n^2 at their ends; and a fifth more.
const BEND_INSIDE: f64 = 18.0;
const BEND_OUTSIDE: f64 = 44.0;
/// Samples to either side by which a sample is judged.
const REACH: usize = 2;

/// Whether a sample in `pulse` or beside it deviates from the cubic through its four neighbours by more than `ratio_max` of
/// the `peak` and by more than `noise`, in counts.
pub(super) fn has_spike<C: Count>(
    samples: &[C],
    pulse: Range<usize>,
    (peak, noise): (f64, f64),
    ratio_max: f64,
) -> bool {
    let beside = pulse.len() / 4 + REACH + 1;
    let first = pulse.start.saturating_sub(beside);
    let last = samples.len().min(pulse.end + beside);
    let Some(beside) = samples.get(first..last) else { return false };
    Deviations { beside, first, pulse, peak, of_noise: SPIKE_SIGMAS * noise, ratio_max }.wide()
}

/// Whether any of the samples `beside` the pulse, which begin with number `first`, deviates too much.
struct Deviations<'a, C> {
    beside: &'a [C],
    first: usize,
    pulse: Range<usize>,
    peak: f64,
    of_noise: f64,
    ratio_max: f64,
}

impl<C: Count> Kernel for Deviations<'_, C> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { beside, first, pulse, peak, of_noise, ratio_max } = self;
        let n = pulse.len() as f64;
        let (bend_inside, bend_outside) = (BEND_INSIDE / (n * n), BEND_OUTSIDE / (n * n));
        // Numbers of windows, counted from the first, that lie within the pulse.
        let inside = pulse.start.saturating_sub(first)..(pulse.end.saturating_sub(2 * REACH)).saturating_sub(first);
        // Six times all of it, which spares divisions.
        let limit = |ratios: &[f64]| {
            6.0 * ratios.iter().fold(of_noise, |most, ratio| if ratio * peak > most { ratio * peak } else { most })
        };
        let limit_inside = limit(&[ratio_max, bend_inside]);
        let limit_outside = limit(&[ratio_max, bend_outside, KINK / n]);
        let mut is_any = false;
        for (number, &window) in beside.array_windows().enumerate() {
            let [a, b, x, c, d] = window.map(Into::<f64>::into);
            let deviation = (6.0 * x - (4.0 * (b + c) - (a + d))).abs();
            let is_inside = (number >= inside.start) & (number < inside.end);
            is_any |= deviation > if is_inside { limit_inside } else { limit_outside };
        }
        is_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pulse(n: usize, shift: f64) -> (Vec<f32>, Range<usize>) {
        let height = |i: usize| {
            let phase = (i as f64 - 20.0 - shift) / n as f64;
            if (0.0..1.0).contains(&phase) { (100.0 * (std::f64::consts::PI * phase).sin()) as f32 } else { 0.0 }
        };
        let samples: Vec<f32> = (0..n + 40).map(height).collect();
        let first = samples.iter().position(|&x| x > 10.0).unwrap();
        let end = samples.iter().rposition(|&x| x > 10.0).unwrap() + 1;
        (samples, first..end)
    }

    /// Catches a smooth pulse, with its kinks, that has a spike.
    #[test]
    fn a_pulse_has_none() {
        for n in [9, 12, 20, 37, 100, 1000] {
            for shift in 0..20 {
                let (samples, place) = pulse(n, f64::from(shift) / 20.0);
                assert!(!has_spike(&samples, place, (100.0, 0.0), 0.03), "{n} {shift}");
            }
        }
    }

    /// Catches a spike that is missed because of its place or sign, and one that noise explains.
    #[test]
    fn a_spike_is_found_anywhere() {
        for at in 20..57 {
            for height in [-60.0_f64, -10.0, 10.0, 300.0] {
                let (mut samples, place) = pulse(37, 0.4);
                samples[at] += height as f32;
                assert!(has_spike(&samples, place.clone(), (100.0, 1.0), 0.03), "{at} {height}");
                assert!(!has_spike(&samples, place, (100.0, 0.2 * height.abs()), 0.03), "{at} {height}");
            }
        }
    }
}
