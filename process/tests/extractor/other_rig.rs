//! Taps of another rig than the simulated one: closed-form pulses and ringing, of any rate, length, scale and format.
//!
//! Nothing here uses a contact model, so rules that depend on details of `tapline_model` fail on these taps.

use std::f64::consts::{PI, TAU};

use tapline_wire::{Channel, SampleFormat, TapHeader, TapId};

use crate::plant::{Tap, noise, peak};

/// Uniform numbers in [0, 1), determined by `seed`.
fn dice(seed: usize) -> impl FnMut() -> f64 {
    let mut state = (seed as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A decaying sine.
struct Mode {
    f_hz: f64,
    decay_per_s: f64,
    amplitude: f64,
}

/// Clean tap number `k`.
pub(crate) fn tap(k: usize) -> Tap {
    let mut dice = dice(k + 1);
    let mut between = |low: f64, high: f64| low + (high - low) * dice();
    let rate_hz = [40_960.0, 41_000.0, 44_100.0, 48_000.0][k % 4];
    let count = [16_384_u32, 16_384, 8192][k / 4 % 3];
    let format = if (k / 12).is_multiple_of(2) { SampleFormat::I16 } else { SampleFormat::F32 };
    let pre_trigger_samples = between(100.0, 2000.0) as u32;
    let (tau_s, restitution, is_haversine) = (between(0.5e-3, 3e-3), between(0.2, 0.9), between(0.0, 1.0) < 0.5);
    // The impactor of 4.5 g leaves with its restitution.
    let velocity_m_per_s = [1.2, 1.5, 1.85][k % 3];
    let mean = if is_haversine { 0.5 } else { 2.0 / PI };
    let f_max_n = (1.0 + restitution) * 4.5e-3 * velocity_m_per_s / (mean * tau_s);
    let onset = f64::from(pre_trigger_samples) - between(0.0, 1.0);
    let distance_m = between(0.0, 0.5);
    let modes: Vec<Mode> = (0..2 + k % 4)
        .map(|_| Mode { f_hz: between(200.0, 3000.0), decay_per_s: between(40.0, 400.0), amplitude: between(0.2, 1.0) })
        .collect();
    let noise_part = 1e-3 * between(0.0, 10.0_f64.ln()).exp();
    let at = |n: usize| (n as f64 - onset) / rate_hz;
    let pulse = |t: f64| {
        let s = if (0.0..tau_s).contains(&t) { (PI * t / tau_s).sin() } else { 0.0 };
        if is_haversine { s * s } else { s }
    };
    let ringing = |t: f64| {
        let value = |mode: &Mode| mode.amplitude * (-mode.decay_per_s * t).exp() * (TAU * mode.f_hz * t).sin();
        if t > 0.0 { modes.iter().map(value).sum() } else { 0.0 }
    };
    let n = count as usize;
    let force: Vec<f64> = (0..n).map(|i| f_max_n * pulse(at(i))).collect();
    let sound: Vec<f64> = (0..n).map(|i| ringing(at(i) - distance_m / 343.0)).collect();
    // The converter: 16-bit counts, newtons and volts as floats, or fractions of an unknown full scale.
    let (force_peak, sound_peak) = (peak(&force), peak(&sound));
    let full_scale = [Some(222.0), None][k / 24 % 2];
    let (force_gain, force_unit) = match (format, full_scale) {
        (SampleFormat::I16, Some(full)) => (32_768.0 / full, full / 32_768.0),
        (SampleFormat::I16, None) => (between(0.3, 0.9) * 32_768.0 / force_peak, 1.0 / 32_768.0),
        (SampleFormat::F32, Some(_)) => (1.0, 1.0),
        (SampleFormat::F32, None) => (between(0.3, 0.9) / force_peak, 1.0),
    };
    let full = if format == SampleFormat::I16 { 32_768.0 } else { 1.0 };
    let sound_gain = between(0.3, 0.9) * full / sound_peak;
    let with_noise = |channel: &[f64], gain: f64, sigma: f64, seed: usize| -> Vec<f64> {
        channel.iter().zip(noise(seed)).map(|(x, e)| gain * (x + sigma * e)).collect()
    };
    let mut header = TapHeader {
        id: TapId::default().with_velocity_m_per_s(Some(velocity_m_per_s)).unwrap(),
        velocity_measured_m_per_s: velocity_m_per_s * between(0.98, 1.02),
        velocity_nominal_m_per_s: velocity_m_per_s,
        microphone_distance_m: distance_m,
        sample_format: format.code(),
        ..TapHeader::in_units(rate_hz, pre_trigger_samples, count, &Channel::BOTH)
    };
    header.channels[0].unit_per_count = force_unit;
    header.channels[1].unit_per_count = 1.0 / full;
    Tap {
        header,
        force: with_noise(&force, force_gain, noise_part * force_peak, 2 * k + 11),
        sound: with_noise(&sound, sound_gain, noise_part * sound_peak, 2 * k + 12),
    }
}
