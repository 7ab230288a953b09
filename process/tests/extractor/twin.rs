//! A slow twin, written from the definitions instead of the code: whole lists instead of walks, and the discrete
//! Fourier transform as a double loop.

use std::f64::consts::PI;

use proptest::prelude::*;
use tapline_wire::{Discriminator, Discriminators, Quality};

use crate::reference::CASES;
use crate::signal::{Case, assert_close};

fn median(samples: &[f64]) -> f64 {
    let mut sorted = samples.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2]) / 2.0
}

/// Every crossing of `level`, in samples.
fn crossings(x: &[f64], level: f64) -> Vec<f64> {
    let is_crossing = |i: &usize| (x[*i] > level) != (x[*i + 1] > level);
    (0..x.len() - 1).filter(is_crossing).map(|i| i as f64 + (level - x[i]) / (x[i + 1] - x[i])).collect()
}

/// Integral of `fold(x)` over [from, to], as a sum of trapezoids over all segments.
fn integral(x: &[f64], from: f64, to: f64, fold: fn(f64) -> f64) -> f64 {
    let line = |t: f64| {
        let i = (t as usize).min(x.len() - 2);
        x[i] * (i as f64 + 1.0 - t) + x[i + 1] * (t - i as f64)
    };
    let mut knots: Vec<f64> = (0..x.len()).map(|i| i as f64).filter(|&t| t > from && t < to).collect();
    knots.insert(0, from);
    knots.push(to);
    knots.windows(2).map(|w| (w[1] - w[0]) * (fold(line(w[0])) + fold(line(w[1]))) / 2.0).sum()
}

/// Powers of the bins of `x` from 0 to the Nyquist frequency, one-sided, V^2/Hz.
fn density(x: &[f64], rate: f64) -> Vec<(f64, f64)> {
    let n = x.len();
    let mean = x.iter().sum::<f64>() / n as f64;
    let bin = |k: usize| {
        let angle = |i: usize| -2.0 * PI * ((i * k) % n) as f64 / n as f64;
        let re: f64 = x.iter().enumerate().map(|(i, x)| (x - mean) * angle(i).cos()).sum();
        let im: f64 = x.iter().enumerate().map(|(i, x)| (x - mean) * angle(i).sin()).sum();
        let sides = if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
        (k as f64 * (1.0 / (n as f64 * (1.0 / rate))), sides * (re * re + im * im) / (rate * n as f64))
    };
    (0..=n / 2).map(bin).collect()
}

/// The definitions, applied to a tap with force and sound, whose pulse and areas are in the record.
fn discriminators(case: &Case) -> [Option<f64>; Discriminator::COUNT] {
    let counts = case.recorded().counts();
    let n = case.count as usize;
    let m = (0.75 * f64::from(case.p)).floor() as usize;
    let channel = |at: usize, unit: f64| -> Vec<f64> {
        let x: Vec<f64> = counts[at * n..(at + 1) * n].iter().map(|x| x * unit).collect();
        let base = median(&x[..m]);
        x.iter().map(|x| x - base).collect()
    };
    let (force, sound) = (channel(0, case.force_unit), channel(1, case.sound_unit));

    let top = (0..n).fold(0, |best, i| if force[i] > force[best] { i } else { best });
    let (a, b, c) = (force[top - 1], force[top], force[top + 1]);
    // The parabola through (-1, a), (0, b), (1, c), at the zero of its derivative.
    let (square, slope) = ((a + c) / 2.0 - b, (c - a) / 2.0);
    let at = -slope / (2.0 * square);
    let f_max = square * at * at + slope * at + b;
    let all = crossings(&force, 0.1 * f_max);
    let rise =
        all.iter().copied().filter(|&t| t < top as f64).fold(f64::NEG_INFINITY, |a, b| if b > a { b } else { a });
    let fall = all.iter().copied().filter(|&t| t > top as f64).fold(f64::INFINITY, |a, b| if b < a { b } else { a });
    let tau = (fall - rise) / (1.0 - 2.0 * 0.1_f64.asin() / PI);
    let onset = (rise + fall - tau) / 2.0 + case.distance / 343.0 * case.rate;

    let psd = density(&sound, case.rate);
    let f_c = if case.follow { case.rate / (2.0 * tau) } else { 550.0 };
    let band = |low: f64, high: f64| -> Vec<f64> {
        psd.iter().filter(|(f, _)| low <= *f && *f <= high).map(|(_, power)| *power).collect()
    };
    let (flexural, reference) = (band(f_c, 2000.0), band(case.f_lo, 3000.0));
    let moment: f64 = psd.iter().filter(|(f, _)| case.f_lo <= *f && *f <= 3000.0).map(|(f, power)| f * power).sum();
    let energy: f64 = flexural.iter().sum();
    [
        f_max,
        tau / case.rate,
        integral(&sound, onset, onset + tau, |x| x).abs() / case.rate,
        integral(&sound, onset + tau, n as f64 - 1.0, f64::abs) / case.rate,
        energy / reference.iter().sum::<f64>(),
        flexural.iter().copied().fold(0.0, |a, b| if b > a { b } else { a }),
        energy * case.rate / n as f64,
        moment / reference.iter().sum::<f64>(),
    ]
    .map(Some)
}

/// Any tap: catches a difference that the few cases of scipy do not show, for any length, scale and offset.
fn any_case() -> impl Strategy<Value = Case> {
    let place = (any::<u32>(), 300..600_u32, 20..120_u32, 0.0..12.0_f64);
    let shape = (any::<bool>(), 0.8e-3..2.5e-3_f64, 0.0..0.4_f64, 0.0..0.02_f64, -0.5..0.5_f64, any::<bool>());
    (place, shape).prop_map(|((seed, count, p, lag), (is_i16, tau, distance, noise, offset, follow))| Case {
        seed,
        count,
        p,
        is_i16,
        tau,
        distance,
        noise,
        offset,
        follow,
        rate: 20_480.0,
        onset: f64::from(p) + lag,
        force_unit: if is_i16 { 0.004 } else { 2.0 },
        sound_unit: if is_i16 { 1e-4 } else { 0.5 },
        ..CASES[0].0
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, max_global_rejects: 2, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn like_the_twin(case in any_case()) {
        let found: Discriminators = case.extract::<f64>();
        // In this noise 2 of 100 000 pulses look as if they were cut off: so rarely that three in one test are a fault.
        prop_assert!(Quality::CLIPPED.contains(found.quality), "{found:?}");
        prop_assume!(found.quality.is_empty());
        assert_close(&found, discriminators(&case), 1e-9, "twin");
    }
}
