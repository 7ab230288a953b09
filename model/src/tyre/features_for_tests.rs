//! The simplest feature extractor that shows whether a simulated crack has an effect; the real one is another crate.

use std::f64::consts::{PI, TAU};

/// F_max, tau, A_1, PR, P_f, E_f, as section 2 of the method defines them, but with a coarse naive spectrum.
pub(crate) type Features = [f64; 6];

pub(crate) const NAMES: [&str; 6] = ["f_max", "tau", "a_1", "pr", "p_f", "e_f"];
/// Whether each rises over a crack (section 3).
pub(crate) const RISES: [bool; 6] = [false, true, true, true, true, true];
/// Samples that sound takes to the microphone.
pub(crate) const SOUND_DELAY: f64 = 0.05 / 343.0 * FS;

const FS: f64 = 40_960.0;
const P: usize = 512;
/// Samples of the gated spectrum: bins of 20 Hz.
const GATE: usize = 2048;

/// One channel in physical units, without its baseline.
pub(crate) fn volts(samples: &[i16], full_scale: f64) -> Vec<f64> {
    let mut quiet: Vec<i16> = samples[..P * 3 / 4].to_vec();
    quiet.sort_unstable();
    let median = f64::from(quiet[quiet.len() / 2]);
    samples.iter().map(|&s| (f64::from(s) - median) * full_scale / 32_768.0).collect()
}

pub(crate) fn features(samples: &[i16]) -> Features {
    let (force, sound) = samples.split_at(samples.len() / 2);
    let (force, sound) = (volts(force, 222.0), volts(sound, 5.0));
    let peak = (0..force.len()).max_by(|&a, &b| force[a].total_cmp(&force[b])).unwrap();
    let f_max = force[peak];
    let level = 0.1 * f_max;
    let rise = (0..peak).rev().find(|&n| force[n] < level).unwrap();
    let fall = (peak..force.len()).find(|&n| force[n] < level).unwrap();
    let at_rise = rise as f64 + (level - force[rise]) / (force[rise + 1] - force[rise]);
    let at_fall = fall as f64 - (level - force[fall]) / (force[fall - 1] - force[fall]);
    let width = at_fall - at_rise;
    let tau = width / (1.0 - 2.0 * 0.1_f64.asin() / PI);
    let onset = at_rise - 0.5 * (tau - width) + SOUND_DELAY;
    let a_1 = (sound[onset.ceil() as usize..=(onset + tau) as usize].iter().sum::<f64>() / FS).abs();
    let gate = &sound[..GATE];
    let density: Vec<f64> = (0..=150).map(|k| power(gate, k)).collect();
    let sum = |low: usize, high: usize| density[low..=high].iter().sum::<f64>();
    // 560 to 2000 Hz over 80 to 3000 Hz.
    let p_f = density[28..=100].iter().copied().fold(0.0, |a, b| if b > a { b } else { a });
    [f_max, tau / FS, a_1, sum(28, 100) / sum(4, 150), p_f, sum(28, 100)]
}

/// Squared magnitude of bin `k` of the discrete Fourier transform.
fn power(x: &[f64], k: usize) -> f64 {
    let (s, c) = (TAU * k as f64 / x.len() as f64).sin_cos();
    let (mut re, mut im, mut w_re, mut w_im) = (0.0, 0.0, 1.0, 0.0);
    for v in x {
        (re, im) = (re + v * w_re, im + v * w_im);
        (w_re, w_im) = (w_re * c - w_im * s, w_im * c + w_re * s);
    }
    re * re + im * im
}
