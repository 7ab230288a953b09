//! The last stage of the simulated rig: noise, hum, and a converter of 16 bits.

use std::f64::consts::TAU;

use crate::SimulationConfig;
use crate::tyre::identity::Generator;
use crate::tyre::pulse::to_f32;

/// Random bytes per number of noise.
const BYTES: usize = 4;
/// Mean of the sum of four random bytes.
const SUM_MEAN: f32 = 510.0;
/// Standard deviation of that sum: sqrt(4 (256^2 - 1)/12).
const SUM_SD: f64 = 147.800_767_25;

/// Turns physical signals into counts.
///
/// Noise is the sum of four random bytes: bell-shaped up to 3.4 standard deviations. Better noise would cost more than
/// all the physics of a record.
#[derive(Debug)]
pub(crate) struct Converter {
    counts_per_n: f32,
    counts_per_v: f32,
    /// Standard deviations of the noise per unit of the sum of bytes, in counts.
    force_noise: f32,
    sound_noise: f32,
    hum_v: f64,
    /// Sine and cosine of the hum, planned once.
    hum_sine: Vec<f32>,
    hum_cosine: Vec<f32>,
    bytes: Vec<u8>,
}

impl Converter {
    pub(crate) fn new(config: &SimulationConfig) -> Self {
        const COUNTS: f64 = 32_768.0;
        let (counts_per_n, counts_per_v) = (COUNTS / config.force_full_scale_n, COUNTS / config.sound_full_scale_v);
        let angle = |n: u32| TAU * (f64::from(n) * config.hum_hz / config.sample_rate_hz).fract();
        Self {
            counts_per_n: to_f32(counts_per_n),
            counts_per_v: to_f32(counts_per_v),
            force_noise: to_f32(config.force_noise_n * counts_per_n / SUM_SD),
            sound_noise: to_f32(config.sound_noise_v * counts_per_v / SUM_SD),
            hum_v: config.hum_v,
            hum_sine: (0..config.sample_count).map(|n| to_f32(angle(n).sin())).collect(),
            hum_cosine: (0..config.sample_count).map(|n| to_f32(angle(n).cos())).collect(),
            bytes: vec![0; BYTES * config.sample_count as usize],
        }
    }

    /// Converts the force in `signal`.
    pub(crate) fn force(&mut self, signal: &mut [f32], generator: &mut Generator, counts: &mut [i16]) {
        generator.bytes(&mut self.bytes);
        convert(signal, self.counts_per_n, &self.bytes, self.force_noise, counts);
    }

    /// Adds the hum to the sound in `signal` and converts it.
    pub(crate) fn sound(&mut self, signal: &mut [f32], hum_phase: f64, generator: &mut Generator, counts: &mut [i16]) {
        let (sine, cosine) = (to_f32(self.hum_v * hum_phase.cos()), to_f32(self.hum_v * hum_phase.sin()));
        for ((value, s), c) in signal.iter_mut().zip(&self.hum_sine).zip(&self.hum_cosine) {
            *value += sine * s + cosine * c;
        }
        generator.bytes(&mut self.bytes);
        convert(signal, self.counts_per_v, &self.bytes, self.sound_noise, counts);
    }
}

fn convert(signal: &[f32], counts_per_unit: f32, bytes: &[u8], noise: f32, counts: &mut [i16]) {
    let (noises, _) = bytes.as_chunks::<BYTES>();
    for ((count, value), &[a, b, c, d]) in counts.iter_mut().zip(signal).zip(noises) {
        let sum = u16::from(a) + u16::from(b) + u16::from(c) + u16::from(d);
        let exact = value * counts_per_unit + (f32::from(sum) - SUM_MEAN) * noise;
        // Rounds to nearest without calling `round`, which a plain x86-64 has no instruction for: above 0, truncation
        // is flooring.
        let shifted = (exact + 32_768.5).clamp(0.0, 65_535.0);
        *count = cut(shifted);
    }
}

#[expect(clippy::cast_possible_truncation, reason = "0 to 65535 less 32768 is an i16")]
fn cut(shifted: f32) -> i16 {
    (shifted as i32 - 32_768) as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tyre::identity::Identity;

    fn counts_of(value: f32, noise: f32) -> Vec<i16> {
        let mut bytes = vec![0; 4 * 10_000];
        Identity::new(1, "test").generator().bytes(&mut bytes);
        let mut counts = vec![0; 10_000];
        convert(&vec![value; 10_000], 1.0, &bytes, noise, &mut counts);
        counts
    }

    /// Catches rounding to the wrong side and overflow at the rails.
    #[test]
    fn counts_are_rounded_and_clipped() {
        for (value, count) in
            [(0.4, 0), (0.6, 1), (-0.4, 0), (-0.6, -1), (32_766.6, 32_767), (1e9, 32_767), (-1e9, -32_768)]
        {
            assert_eq!(counts_of(value, 0.0)[0], count, "{value}");
        }
    }

    /// Catches noise with a mean or of the wrong size.
    #[test]
    fn noise_has_its_size() {
        let counts = counts_of(0.0, to_f32(100.0 / SUM_SD));
        let mean = counts.iter().map(|&c| f64::from(c)).sum::<f64>() / 1e4;
        let sd = (counts.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>() / 1e4).sqrt();
        assert!(mean.abs() < 4.0 && (sd - 100.0).abs() < 3.0, "{mean} {sd}");
    }
}
