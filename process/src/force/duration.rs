//! The contact time tau of a pulse.

use std::f64::consts::PI;

use crate::DurationEstimator;
use crate::signal::area::area;

/// Where `value`, joined by straight lines, first crosses `level` on either side of `peak_at`, going outwards. `None`
/// if the record ends before that, or if the peak is not above the level.
pub(super) fn crossings(value: impl Fn(usize) -> f64, count: usize, peak_at: usize, level: f64) -> Option<(f64, f64)> {
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

/// The base of the half-sine that is `width` wide at the fraction `level` of its peak.
pub(super) fn half_sine_base(width: f64, level: f64) -> f64 {
    // A half-sine of base tau is above the fraction q of its peak for tau (1 - 2 asin(q)/pi).
    width / (1.0 - 2.0 * level.asin() / PI)
}

/// Contact time in samples, for the estimators other than the width at 10 %, which is given as `(rise, fall)`.
///
/// `None` when the record ends before the level is crossed.
pub(super) fn other(
    estimator: DurationEstimator,
    value: impl Fn(usize) -> f64 + Copy,
    count: usize,
    peak_at: usize,
    f_max: f64,
    (rise, fall): (f64, f64),
) -> Option<f64> {
    let of_width = |level: f64| {
        let (rise, fall) = crossings(value, count, peak_at, level * f_max)?;
        Some(half_sine_base(fall - rise, level))
    };
    match estimator {
        DurationEstimator::HalfSine => None,
        DurationEstimator::Width02 => of_width(0.02),
        DurationEstimator::Width50 => of_width(0.5),
        DurationEstimator::Impulse => {
            // Half a width beyond the crossings holds the foot of a skewed pulse, and little noise.
            let margin = (fall - rise) / 2.0;
            let last = (count - 1) as f64;
            let from = (rise - margin).clamp(0.0, last);
            let to = (fall + margin).clamp(0.0, last);
            let impulse = (from < to).then(|| area(value, from, to))?;
            // A half-sine has the impulse 2 F_max tau/pi.
            Some(PI * impulse / (2.0 * f_max)).filter(|tau| tau.is_finite() && *tau > 0.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn half_sine(i: usize, start: f64, tau: f64) -> f64 {
        let phase = (i as f64 - start) / tau;
        if (0.0..1.0).contains(&phase) { (PI * phase).sin() } else { 0.0 }
    }

    /// Catches a wrong factor or level: a finely sampled half-sine returns its own base from every estimator.
    #[test]
    fn half_sine_returns_its_base() {
        for (start, tau) in [(100.0, 400.0), (157.3, 1000.0), (131.9, 200.5)] {
            let value = |i: usize| half_sine(i, start, tau);
            let peak_at = (start + tau / 2.0).round() as usize;
            let ten = crossings(value, 2000, peak_at, 0.1).unwrap();
            assert!((half_sine_base(ten.1 - ten.0, 0.1) - tau).abs() < 0.01);
            for estimator in [DurationEstimator::Width02, DurationEstimator::Width50, DurationEstimator::Impulse] {
                let found = other(estimator, value, 2000, peak_at, 1.0, ten).unwrap();
                assert!((found - tau).abs() < 0.02, "{estimator:?}: {found} for {tau}");
            }
        }
    }

    /// Catches a search from the record's ends inwards, which a bounce after the pulse would lengthen.
    #[test]
    fn walks_outwards_from_the_peak() {
        let samples = [0.0_f32, 5.0, 0.0, 0.0, 10.0, 20.0, 10.0, 0.0, 0.0, 5.0, 0.0];
        let (rise, fall) = crossings(|i| f64::from(samples[i]), samples.len(), 5, 2.0).unwrap();
        assert!((rise - 3.2).abs() < 1e-12 && (fall - 6.8).abs() < 1e-12);
    }

    /// Catches an impulse read past the record's end, a negative tau, and a width invented where the record ends.
    #[test]
    fn what_the_record_does_not_hold() {
        let value = |i: usize| 0.05 + half_sine(i, 2.0, 20.0);
        let ten = crossings(value, 24, 12, 0.1).unwrap();
        assert_eq!(other(DurationEstimator::Width02, value, 24, 12, 1.0, ten), None);
        let tau = other(DurationEstimator::Impulse, value, 24, 12, 1.0, ten).unwrap();
        assert!((tau - (20.0 + 0.05 * 23.0 * PI / 2.0)).abs() < 0.1, "{tau}");
        assert_eq!(
            other(DurationEstimator::Impulse, |i| half_sine(i, 2.0, 20.0) - 0.9, 24, 12, 0.1, (8.0, 16.0)),
            None
        );
    }
}
