//! Mains hum in a channel, estimated before the trigger.

use std::f64::consts::TAU;

use crate::Real;

/// Fraction of the mains' period that the quiet samples must span for its phase to be found.
const PERIODS_MIN: f64 = 0.25;

/// Frequency above which a sine does not count as hum.
const CYCLES_PER_SAMPLE_MAX: f64 = 0.25;

/// c + a cos(omega n) + b sin(omega n), with n counted from the record's first sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hum {
    omega: f64,
    constant: f64,
    cosine: f64,
    sine: f64,
}

/// The vector (`x`, `y`), turned by `omega` from sample to sample: the error is 1e-11 after a record of 1e5.
fn turns(omega: f64, x: f64, y: f64) -> impl Iterator<Item = (f64, f64)> {
    let (sin, cos) = omega.sin_cos();
    std::iter::successors(Some((x, y)), move |(x, y)| Some((x * cos - y * sin, y * cos + x * sin)))
}

impl Hum {
    /// The level and the hum of frequency `cycles_per_sample` that fit the first `count` values best.
    ///
    /// `None` if these span less than a quarter of a period, or if a period has fewer than four samples.
    pub(crate) fn fit(value: impl Fn(usize) -> f64, count: usize, cycles_per_sample: f64) -> Option<Self> {
        let is_seen = count as f64 * cycles_per_sample >= PERIODS_MIN;
        let is_sampled = cycles_per_sample <= CYCLES_PER_SAMPLE_MAX;
        if !(is_seen && is_sampled) {
            return None;
        }
        let omega = TAU * cycles_per_sample;
        let turns: Vec<(f64, f64)> = turns(omega, 1.0, 0.0).take(count).collect();
        // The columns 1, cos, sin are made orthogonal one after the other. A span of half a period would make their
        // normal equations nearly singular.
        let column = |k: usize, n: usize| match k {
            0 => 1.0,
            1 => turns[n].0,
            _ => turns[n].1,
        };
        let dot = |f: &dyn Fn(usize) -> f64, g: &dyn Fn(usize) -> f64| (0..count).map(|n| f(n) * g(n)).sum::<f64>();
        let one = |_: usize| 1.0;
        let by_one = |k: usize| dot(&|n| column(k, n), &one) / count as f64;
        let (cos_1, sin_1) = (by_one(1), by_one(2));
        let p = |n: usize| column(1, n) - cos_1;
        let sin_p = dot(&|n| column(2, n), &p) / dot(&p, &p);
        let q = |n: usize| column(2, n) - sin_1 - sin_p * p(n);
        let weight = |f: &dyn Fn(usize) -> f64| dot(&value, f) / dot(f, f);
        let (level, on_p, on_q) = (weight(&one), weight(&p), weight(&q));
        let cosine = on_p - sin_p * on_q;
        let constant = level - cosine * cos_1 - on_q * sin_1;
        let hum = Self { omega, constant, cosine, sine: on_q };
        [constant, cosine, on_q].iter().all(|x| x.is_finite()).then_some(hum)
    }

    /// Subtracts level and hum from every sample of `signal`.
    pub(crate) fn subtract_from<T: Real>(&self, signal: &mut [T]) {
        // a cos + b sin is the first part of (a, -b) that turns.
        for (sample, (x, _)) in signal.iter_mut().zip(turns(self.omega, self.cosine, -self.sine)) {
            *sample -= T::rounded(self.constant + x);
        }
    }

    /// Amplitude of the sine.
    pub(crate) fn amplitude(&self) -> f64 {
        self.cosine.hypot(self.sine)
    }

    /// Level and hum at sample `n`.
    pub(crate) fn at(&self, n: usize) -> f64 {
        let (sin, cos) = (self.omega * n as f64).sin_cos();
        self.constant + self.cosine * cos + self.sine * sin
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Catches a wrong projection: hum on a level returns itself, over half a period or many.
        #[test]
        fn hum_returns_itself(a in -1.0..1.0_f64, phase in 0.0..6.3_f64, level in -9.0..9.0_f64, periods in 0.3..5.0_f64) {
            let omega = TAU * periods / 400.0;
            let value = |n: usize| level + a * (omega * n as f64 + phase).cos();
            let hum = Hum::fit(value, 400, periods / 400.0).unwrap();
            let mut zeros: Vec<f64> = (0..20_000).map(value).collect();
            hum.subtract_from(&mut zeros);
            prop_assert!(zeros.iter().all(|x| x.abs() < 1e-7));
            for n in [0, 100, 399, 1000, 16_000] {
                prop_assert!((hum.at(n) - value(n)).abs() < 1e-8, "{n}: {} {}", hum.at(n), value(n));
            }
        }
    }

    /// Catches a phase invented from too few samples, and a division by zero.
    #[test]
    fn too_short_a_look_finds_no_hum() {
        assert_eq!(Hum::fit(|_| 1.0, 99, 1.0 / 400.0), None);
        assert_eq!(Hum::fit(|_| 1.0, 0, 0.5), None);
        assert_eq!(Hum::fit(|_| f64::NAN, 400, 1.0 / 400.0), None);
        assert_eq!(Hum::fit(|_| 1.0, 400, 0.5), None); // sines of half the rate vanish
        assert_eq!(Hum::fit(|_| 1.0, 400, f64::NAN), None);
    }
}
