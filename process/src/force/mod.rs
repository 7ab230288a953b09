//! The force pulse: its peak, its duration and its onset.
//!
//! The defaults are the estimators of the method's section 2: `parabola` for F_max and `half_sine` for tau. Times are
//! in samples from the record's first one.
//!
//! Beyond the method, a pulse must rise above [`NOISE_SIGMAS`] sigma of the noise before it; otherwise a channel of
//! pure noise would have a peak and a duration too. The onset always comes from the width at 10 %, whichever estimator
//! gives tau.

mod droop;
mod duration;
mod peak;

use duration::{crossings, half_sine_base};
use peak::vertex;

use crate::signal::extent::Extent;
use crate::signal::record::{Count, Track};
use crate::{DurationEstimator, PeakEstimator};

/// Standard deviations of the noise that a pulse must exceed.
pub(crate) const NOISE_SIGMAS: f64 = 6.0;

/// Fraction of F_max at which the pulse's width is measured.
const WIDTH_LEVEL: f64 = 0.1;

/// Where a force of this `extent` is greatest: the first of equal samples.
pub(crate) fn peak_at<C: Count>(track: Track<'_, C>, extent: Extent<C>) -> Option<usize> {
    extent.position(track.samples, if track.unit_per_count < 0.0 { extent.least } else { extent.largest }, 0)
}

/// What the force shows of an impact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pulse {
    /// Peak force F_max, N.
    pub f_max_n: f64,
    /// Contact time tau, samples.
    pub tau_samples: f64,
    /// Beginning of contact, samples.
    pub onset_samples: f64,
}

/// Measures pulses, after correcting the sensor's droop.
#[derive(Debug, Clone, Default)]
pub(crate) struct PulseFinder {
    f_max: PeakEstimator,
    tau: DurationEstimator,
    /// Time constant of the sensor's coupling, samples; 0 if it has none.
    droop_samples: f64,
    corrected_n: Vec<f64>,
}

impl PulseFinder {
    /// A finder with these estimators and no droop; see [`PulseFinder::set_droop`].
    pub(crate) fn new(f_max: PeakEstimator, tau: DurationEstimator) -> Self {
        Self { f_max, tau, ..Self::default() }
    }

    /// Sets the time constant of the sensor's coupling; 0 if the sensor has none.
    pub(crate) fn set_droop(&mut self, time_constant_samples: f64) {
        self.droop_samples = time_constant_samples;
    }

    /// The pulse of `track`, which is greatest at sample `peak_at`; `base` and `noise` are in counts. `None` if none stands
    /// out of the noise, or if the record does not hold it from 10 % to 10 %.
    pub(crate) fn find<C: Count>(
        &mut self,
        track: Track<'_, C>,
        peak_at: usize,
        base: f64,
        noise: f64,
    ) -> Option<Pulse> {
        let Track { samples, unit_per_count } = track;
        let count = samples.len();
        let force_n = |i: usize| (samples[i].into() - base) * unit_per_count;
        let height_n = vertex(force_n, count, peak_at);
        let stands_out = height_n > NOISE_SIGMAS * noise * unit_per_count.abs();
        if !stands_out {
            return None;
        }
        let has_droop = self.droop_samples > 0.0;
        if !has_droop {
            return self.measure(force_n, count, peak_at);
        }
        let (rise, fall) = crossings(force_n, count, peak_at, WIDTH_LEVEL * height_n)?;
        let width = fall - rise;
        // Casts saturate at 0 and turn NaN into 0.
        let first = (rise - width) as usize;
        let last = ((fall + 2.0 * width) as usize).min(count - 1);
        let mut corrected_n = std::mem::take(&mut self.corrected_n);
        droop::correct(force_n, first..last + 1, self.droop_samples, &mut corrected_n);
        let of_correction = |i: usize| corrected_n.get(i.checked_sub(first)?).copied();
        let without_droop = |i: usize| of_correction(i).unwrap_or_else(|| force_n(i));
        let above = rise.ceil() as usize..=(fall as usize).min(last);
        let peak_at = above.max_by(|&i, &j| without_droop(i).total_cmp(&without_droop(j)));
        let pulse = peak_at.and_then(|peak_at| self.measure(without_droop, count, peak_at));
        self.corrected_n = corrected_n;
        pulse
    }

    fn measure(&self, force_n: impl Fn(usize) -> f64 + Copy, count: usize, peak_at: usize) -> Option<Pulse> {
        let f_max_n = self.peak(force_n, count, peak_at);
        let (rise, fall) = crossings(force_n, count, peak_at, WIDTH_LEVEL * f_max_n)?;
        let width = fall - rise;
        let base = half_sine_base(width, WIDTH_LEVEL);
        let other = duration::other(self.tau, force_n, count, peak_at, f_max_n, (rise, fall));
        Some(Pulse { f_max_n, tau_samples: other.unwrap_or(base), onset_samples: rise - (base - width) / 2.0 })
    }

    fn peak(&self, force_n: impl Fn(usize) -> f64 + Copy, count: usize, peak_at: usize) -> f64 {
        let parabola = || vertex(force_n, count, peak_at);
        match self.f_max {
            PeakEstimator::Raw => force_n(peak_at),
            PeakEstimator::Parabola => parabola(),
            PeakEstimator::Polynomial => peak::polynomial(force_n, count, peak_at).unwrap_or_else(parabola),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn pulse_of(samples: &[f32]) -> Option<Pulse> {
        found(Track { samples, unit_per_count: 1.0 }, 0.0)
    }

    fn found(track: Track<'_, f32>, noise: f64) -> Option<Pulse> {
        PulseFinder::default().find(track, peak_at(track, Extent::find(track.samples)?)?, 0.0, noise)
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

    /// Catches a width invented for a pulse that the record cuts off, and a division by zero.
    #[test]
    fn no_pulse() {
        assert_eq!(pulse_of(&[0.0, 1.0, 5.0, 9.0]), None);
        assert_eq!(pulse_of(&[9.0, 5.0, 1.0, 0.0]), None);
        assert_eq!(pulse_of(&[0.0; 8]), None);
        assert_eq!(pulse_of(&[-5.0, -1.0, -5.0]), None);
        assert_eq!(pulse_of(&[3.0]), None);
    }

    /// Catches noise taken for an impact: the same bump, with and without noise of a sixth of its height.
    #[test]
    fn must_stand_out_of_the_noise() {
        let samples = [0.0_f32, 0.0, 5.0, 10.0, 5.0, 0.0, 0.0];
        let track = Track { samples: &samples, unit_per_count: 3.0 };
        assert!(found(track, 1.6).is_some());
        assert_eq!(found(track, 1.7), None);
    }

    /// Catches a sensor wired the other way round: the scale's sign decides which extreme is the peak.
    #[test]
    fn negative_scale_turns_the_pulse() {
        let samples = [0.0_f32, 0.0, -5.0, -10.0, -6.0, 0.0, 0.0, 1.0];
        let turned: Vec<f32> = samples.iter().map(|x| -x).collect();
        let pulse = found(Track { samples: &samples, unit_per_count: -1.0 }, 0.0);
        assert!(pulse.is_some());
        assert_eq!(pulse, pulse_of(&turned));
    }
}
