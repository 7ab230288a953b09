//! The force pulse: its peak, its duration and its onset.
//!
//! Default estimators of the method's section 2: `parabola` for F_max and `half_sine` for tau.
//! Times are in samples of the record, from its first one, until a rate makes seconds of them.
//!
//! Beyond the method: a pulse must rise above [`NOISE_SIGMAS`] sigma of the noise before it, or a
//! channel with nothing but noise would give a peak and a duration like any other.

use crate::record::{Count, Extent, Track};

/// Standard deviations of the noise that a pulse must exceed.
const NOISE_SIGMAS: f64 = 5.0;

/// Part q of F_max at which the pulse's width is taken.
const WIDTH_LEVEL: f64 = 0.1;

/// What the force shows of an impact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pulse {
    /// Peak force F_max, N.
    pub(crate) f_max_n: f64,
    /// Contact time tau, samples.
    pub(crate) tau_samples: f64,
    /// Beginning of contact, samples.
    pub(crate) onset_samples: f64,
}

impl Pulse {
    /// The pulse of `track`, whose `extent`, `base` and `noise` are in counts; `None` when none stands out of the
    /// noise or it is not in the record from 10 % to 10 %.
    pub(crate) fn find<C: Count>(track: Track<'_, C>, extent: Extent<C>, base: f64, noise: f64) -> Option<Self> {
        let Track { samples, unit_per_count } = track;
        let force_n = |i: usize| (samples[i].into() - base) * unit_per_count;
        let peak = if unit_per_count < 0.0 { extent.least } else { extent.largest };
        let peak_at = samples.iter().position(|&x| x == peak)?;
        let f_max_n = vertex(force_n, samples.len(), peak_at);
        let stands_out = f_max_n > NOISE_SIGMAS * noise * unit_per_count.abs();
        if !stands_out {
            return None;
        }
        let (rise, fall) = crossings(force_n, samples.len(), peak_at, WIDTH_LEVEL * f_max_n)?;
        let width = fall - rise;
        // A half-sine of base tau is above q of its peak for tau (1 - 2 asin(q)/pi).
        let tau_samples = width / (1.0 - 2.0 * WIDTH_LEVEL.asin() / std::f64::consts::PI);
        Some(Self { f_max_n, tau_samples, onset_samples: rise - (tau_samples - width) / 2.0 })
    }
}

/// Height of the parabola through the samples at and beside `peak_at`; the sample itself at the record's edge and
/// where the three lie on a line.
fn vertex(value: impl Fn(usize) -> f64, count: usize, peak_at: usize) -> f64 {
    let b = value(peak_at);
    if peak_at == 0 || peak_at + 1 >= count {
        return b;
    }
    let (a, c) = (value(peak_at - 1), value(peak_at + 1));
    let curvature = a - 2.0 * b + c;
    if curvature < 0.0 { b - (a - c).powi(2) / (8.0 * curvature) } else { b }
}

/// Where `value`, joined by straight lines, crosses `level` on either side of `peak_at`, first met walking outwards;
/// `None` when the record ends before, or the peak itself is not above the level.
fn crossings(value: impl Fn(usize) -> f64, count: usize, peak_at: usize, level: f64) -> Option<(f64, f64)> {
    let is_above = value(peak_at) > level;
    if !is_above {
        return None;
    }
    let before = (0..peak_at).rev().find(|&i| value(i) <= level)?;
    let after = (peak_at + 1..count).find(|&i| value(i) <= level)?;
    let rise = before as f64 + (level - value(before)) / (value(before + 1) - value(before));
    let fall = after as f64 - (level - value(after)) / (value(after - 1) - value(after));
    Some((rise, fall))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn pulse_of(samples: &[f32]) -> Option<Pulse> {
        let track = Track { samples, unit_per_count: 1.0 };
        Pulse::find(track, Extent::of(samples)?, 0.0, 0.0)
    }

    /// Catches a wrong factor in tau or onset: a finely sampled half-sine returns its own base and beginning.
    #[test]
    fn half_sine_returns_itself() {
        for (start, tau) in [(100.0, 400.0), (57.3, 1000.0), (31.9, 200.5)] {
            let samples: Vec<f32> = (0..1600)
                .map(|i| (f64::from(i) - start) / tau)
                .map(|phase| if (0.0..1.0).contains(&phase) { (80.0 * (PI * phase).sin()) as f32 } else { 0.0 })
                .collect();
            let pulse = pulse_of(&samples).unwrap();
            assert!((pulse.f_max_n - 80.0).abs() < 1e-4, "{pulse:?}");
            assert!((pulse.tau_samples - tau).abs() < 0.01, "{pulse:?}");
            assert!((pulse.onset_samples - start).abs() < 0.01, "{pulse:?}");
        }
    }

    /// Catches a parabola through the wrong samples or with a wrong sign: any parabola returns its own vertex.
    #[test]
    fn parabola_returns_its_vertex() {
        for shift in [-0.49, -0.2, 0.0, 0.3, 0.5] {
            let value = |i: usize| 9.0 - 2.0 * (i as f64 - 3.0 - shift).powi(2);
            assert!((vertex(value, 7, 3) - 9.0).abs() < 1e-12, "{shift}");
        }
        assert!((vertex(|_| 4.0, 7, 3) - 4.0).abs() < 1e-15);
        assert!((vertex(|i| i as f64, 7, 6) - 6.0).abs() < 1e-15);
        assert!((vertex(|i| -(i as f64), 7, 0)).abs() < 1e-15);
    }

    /// Catches a walk inwards from the record's ends, which a bounce after the pulse would lengthen.
    #[test]
    fn walks_outwards_from_the_peak() {
        let samples = [0.0_f32, 5.0, 0.0, 0.0, 10.0, 20.0, 10.0, 0.0, 0.0, 5.0, 0.0];
        let (rise, fall) = crossings(|i| f64::from(samples[i]), samples.len(), 5, 2.0).unwrap();
        assert!((rise - 3.2).abs() < 1e-12 && (fall - 6.8).abs() < 1e-12);
    }

    /// Catches a width made up for a pulse that the record cuts off, and a division by zero.
    #[test]
    fn no_pulse() {
        assert_eq!(pulse_of(&[0.0, 1.0, 5.0, 9.0]), None);
        assert_eq!(pulse_of(&[9.0, 5.0, 1.0, 0.0]), None);
        assert_eq!(pulse_of(&[0.0; 8]), None);
        assert_eq!(pulse_of(&[-5.0, -1.0, -5.0]), None);
        assert_eq!(pulse_of(&[3.0]), None);
    }

    /// Catches noise taken for an impact: the same bump, with and without noise of a fifth of its height.
    #[test]
    fn must_stand_out_of_the_noise() {
        let samples = [0.0_f32, 0.0, 5.0, 10.0, 5.0, 0.0, 0.0];
        let track = Track { samples: &samples, unit_per_count: 3.0 };
        let extent = Extent::of(&samples).unwrap();
        assert!(Pulse::find(track, extent, 0.0, 1.9).is_some());
        assert_eq!(Pulse::find(track, extent, 0.0, 2.1), None);
    }

    /// Catches a sensor wired the other way round: the scale's sign decides which extreme is the peak.
    #[test]
    fn negative_scale_turns_the_pulse() {
        let samples = [0.0_f32, 0.0, -5.0, -10.0, -6.0, 0.0, 0.0, 1.0];
        let turned: Vec<f32> = samples.iter().map(|x| -x).collect();
        let extent = Extent::of(&samples).unwrap();
        let pulse = Pulse::find(Track { samples: &samples, unit_per_count: -1.0 }, extent, 0.0, 0.0);
        assert!(pulse.is_some());
        assert_eq!(pulse, pulse_of(&turned));
    }
}
