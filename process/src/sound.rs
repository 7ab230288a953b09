//! The sound's onset, with and without a force, and its two areas.
//!
//! Conventions of the method's section 2, made exact: between samples the sound is a straight line, and its magnitude
//! at an end between two samples is the magnitude of that line there. Magnitudes, including those at the ends, are
//! joined by straight lines too.

use crate::Real;
use crate::force::Pulse;
use crate::signal::area::interpolated;
use crate::signal::blocks::Blocks;
use crate::signal::real::sum_of_squares;
use crate::signal::record::Count;

/// Speed of sound c in air, m/s.
const SOUND_M_PER_S: f64 = 343.0;

/// Standard deviations of the sound before the trigger that an onset must exceed.
const ONSET_SIGMAS: f64 = 5.0;

/// Where the sound of `pulse` begins at a microphone at this distance D, in samples: onset + D/c.
pub(crate) fn sound_onset(pulse: Pulse, microphone_distance_m: f64, sample_rate_hz: f64) -> f64 {
    pulse.onset_samples + microphone_distance_m / SOUND_M_PER_S * sample_rate_hz
}

/// First sample of `samples` that is further than 5 sigma from `base`, where sigma is the standard deviation of the
/// first `pre_trigger_samples` (all p of them, around their own mean: `numpy.std`).
pub(crate) fn onset_without_force<C: Count>(samples: &[C], pre_trigger_samples: usize, base: f64) -> Option<usize> {
    let before = samples.get(..pre_trigger_samples)?;
    let count = before.len() as f64;
    let mean = before.iter().map(|&x| x.into()).sum::<f64>() / count;
    let variance = before.iter().map(|&x| (x.into() - mean).powi(2)).sum::<f64>() / count;
    let limit = ONSET_SIGMAS * variance.sqrt();
    samples.iter().position(|&x| (x.into() - base).abs() > limit)
}

/// Integral of the magnitude of `signal`, from `from` samples to its end, by trapezoids, in the signal's unit times
/// samples. `blocks` are those of the signal. 0 if nothing is left there.
pub(crate) fn magnitude_area<T: Real>(signal: &[T], blocks: &Blocks, from: f64) -> f64 {
    let first = from.floor() as usize + 1;
    let Some([next, .., last] | [next @ last]) = signal.get(first..) else { return 0.0 };
    let at_from = interpolated(|i| signal[i].widened(), from).abs();
    let (next, last) = (next.widened().abs(), last.widened().abs());
    let head = (first as f64 - from) * (at_from + next) / 2.0;
    // The sum of trapezoids weighs each sample by one, the two outermost by a half.
    head + blocks.magnitude(signal, first) - (next + last) / 2.0
}

/// Standard deviation of `quiet` around its own mean (`numpy.std`), in the signal's unit.
pub(crate) fn deviation<T: Real>(quiet: &[T]) -> f64 {
    let count = quiet.len() as f64;
    let mean = quiet.iter().map(|x| x.widened()).sum::<f64>() / count;
    (quiet.iter().map(|x| (x.widened() - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// What noise of `sigma` adds to the magnitude area of `signal` from `from` samples to its end, in the signal's unit
/// times samples.
///
/// Normal noise alone has a mean magnitude of sqrt(2/pi) sigma; the louder a signal is, the less noise adds to it. Here
/// noise adds that times its fraction of the power, for each block of [`NOISE_BLOCK`] samples. This is exact where
/// either is alone, and at most a quarter of sigma too much where they are equal.
pub(crate) fn magnitude_of_noise<T: Real>(signal: &[T], from: f64, sigma: f64) -> f64 {
    let first = from.floor() as usize + 1;
    let blocks = signal.get(first..).unwrap_or_default().chunks(NOISE_BLOCK);
    let of_block = |block: &[T]| {
        let power = sum_of_squares(block) / block.len() as f64;
        let share = if power > sigma * sigma { sigma * sigma / power } else { 1.0 };
        share * block.len() as f64
    };
    std::f64::consts::FRAC_2_PI.sqrt() * sigma * blocks.map(of_block).sum::<f64>()
}

/// Samples over which the power is averaged: some 6 ms, in which a ringing hardly falls.
const NOISE_BLOCK: usize = 256;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tapline_testing::noise::Noise;

    use super::*;

    /// [`magnitude_area`] of a signal in blocks of eight samples.
    fn magnitude_area_of(signal: &[f64], from: f64) -> f64 {
        let mut blocks = Blocks::default();
        blocks.fill(&mut signal.to_vec(), 8000.0, |_, _| ());
        magnitude_area(signal, &blocks, from)
    }

    proptest! {
        /// Catches a wrong half weight at either end: the twin adds one trapezoid after the other.
        #[test]
        fn magnitude_area_like_a_loop(samples in prop::collection::vec(-1e3..1e3_f64, 2..300), part in 0.0..1.0_f64) {
            let from = part * (samples.len() - 1) as f64;
            let left = from as usize;
            let mut points = vec![(from, (samples[left] + (samples[left + 1] - samples[left]) * (from - left as f64)).abs())];
            points.extend((left + 1..samples.len()).map(|i| (i as f64, samples[i].abs())));
            let expected: f64 = points.windows(2).map(|w| (w[1].0 - w[0].0) * (w[0].1 + w[1].1) / 2.0).sum();
            prop_assert!((magnitude_area_of(&samples, from) - expected).abs() < 1e-9 * (1.0 + expected));
        }
    }

    /// Catches noise subtracted where the signal drowns it, and not subtracted where there is nothing else.
    #[test]
    fn noise_counts_where_it_is_alone() {
        let mut noise = Noise(5);
        for (amplitude, tolerance) in [(0.0, 0.03), (100.0, 1e-3), (1.0, 0.25)] {
            let clean: Vec<f64> = (0..16_384).map(|i| amplitude * (0.1 * f64::from(i)).sin()).collect();
            let noisy: Vec<f64> = clean.iter().map(|x| x + noise.normal()).collect();
            let found = magnitude_area_of(&noisy, 0.5) - magnitude_of_noise(&noisy, 0.5, 1.0);
            let off = (found - magnitude_area_of(&clean, 0.5)) / 16_384.0;
            let unit = if amplitude > 1.0 { amplitude } else { 1.0 };
            assert!(off.abs() < tolerance * unit, "{amplitude}: {off}");
        }
        assert!(magnitude_of_noise(&[1.0_f64; 3], 9.0, 1.0).abs() < 1e-15);
    }

    /// Catches a read past the end.
    #[test]
    fn nothing_is_left_at_the_end() {
        assert!(magnitude_area_of(&[1.0_f64, 2.0], 1.0).abs() < 1e-15);
        assert!(magnitude_area_of(&[1.0_f64, 2.0], 7.0).abs() < 1e-15);
        assert!((magnitude_area_of(&[1.0_f64, 2.0], 0.0) - 1.5).abs() < 1e-15);
    }

    /// Catches sigma around the baseline instead of the mean, sigma of 0.75 p, and a signed comparison.
    #[test]
    fn onset_exceeds_five_sigma() {
        let mut samples = vec![0.0_f32; 20];
        samples[0] = 4.0; // std of four: sqrt(3), so the limit is 8.66; about the median 0 it would be 10
        samples[9] = -9.0;
        samples[12] = 50.0;
        assert_eq!(onset_without_force(&samples, 4, 0.0), Some(9));
        assert_eq!(onset_without_force(&samples, 3, 0.0), Some(12)); // of three: limit 9.43
        assert_eq!(onset_without_force(&samples, 21, 0.0), None);
        assert_eq!(onset_without_force(&[0_i16; 9], 4, 0.0), None);
    }
}
