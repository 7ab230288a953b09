//! The value of full-scale samples, from recordings of known signals: blows of a known peak, or a tone of a known level.

use std::f64::consts::{SQRT_2, TAU};

/// Step of the frequencies at which a tone is sought, and how far from the stated one it may lie.
const STEP_HZ: f64 = 0.25;
const SEARCH: f64 = 0.02;

/// Longest part of a recording in which a tone is sought. The window passes frequencies within 2 / T of the tone: in a longer
/// part all of them may lie between two steps.
const SEARCH_S: f64 = 8.0;

/// Parts of a recording whose levels are compared.
const PARTS: usize = 8;

/// A scale from blows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blows {
    /// Newtons of a full-scale sample: the mean over the blows.
    pub full_scale_n: f64,
    /// Standard deviation over the blows, as a fraction of the mean.
    pub spread: f64,
}

/// The scale at which blows with these `peaks`, as fractions of full scale, had the peaks `known_n`; `None` for fewer than two, for
/// lists of unequal length, or for a peak that is not above 0.
pub fn of_blows(peaks: &[f64], known_n: &[f64]) -> Option<Blows> {
    let scales: Vec<f64> = peaks.iter().zip(known_n).map(|(peak, known_n)| known_n / peak).collect();
    if scales.len() < 2
        || peaks.len() != known_n.len()
        || scales.iter().any(|scale| !(scale.is_finite() && *scale > 0.0))
    {
        return None;
    }
    let count = scales.len() as f64;
    let mean = scales.iter().sum::<f64>() / count;
    let variance = scales.iter().map(|scale| (scale - mean).powi(2)).sum::<f64>() / (count - 1.0);
    Some(Blows { full_scale_n: mean, spread: variance.sqrt() / mean })
}

/// A tone, as it was recorded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone {
    /// Root of the mean square of the tone alone, in the unit of the samples.
    pub rms: f64,
    /// Its frequency.
    pub frequency_hz: f64,
    /// The rest besides the tone, as a fraction of the whole: ratio of RMS values.
    pub rest: f64,
    /// Largest difference between parts of the recording and the whole, as part of the level.
    pub drift: f64,
}

/// The tone near `frequency_hz` in `samples`; `None` if they hold fewer than 100 of its periods, or if it is above half of the rate.
pub fn of_tone(samples: &[f32], sample_rate_hz: f64, frequency_hz: f64) -> Option<Tone> {
    let periods = samples.len() as f64 / sample_rate_hz * frequency_hz;
    let is_below_half = (1.0 + SEARCH) * frequency_hz < 0.5 * sample_rate_hz;
    if !(is_below_half && periods >= 100.0) {
        return None;
    }
    let middle = middle(samples, (SEARCH_S * sample_rate_hz) as usize);
    let steps = (SEARCH * frequency_hz / STEP_HZ).ceil();
    let tried = (0..=2 * steps as usize).map(|step| frequency_hz + (step as f64 - steps) * STEP_HZ);
    let rated = tried.map(|hz| (hz, rms_at(middle, sample_rate_hz, hz)));
    let (nearest_hz, _) = rated.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let of_middle_hz = loudest_hz(middle, sample_rate_hz, nearest_hz, STEP_HZ);
    // The whole passes fewer frequencies than its middle, and needs the tone's more exactly.
    let frequency_hz = loudest_hz(samples, sample_rate_hz, of_middle_hz, sample_rate_hz / samples.len() as f64);
    let rms = rms_at(samples, sample_rate_hz, frequency_hz);
    let whole = windowed(samples, |x, _| x * x).sqrt();
    // Rounding may leave less than nothing beside a clean tone.
    let rest = (1.0 - (rms / whole).powi(2)).clamp(0.0, 1.0).sqrt();
    let parts = samples.chunks_exact(samples.len() / PARTS).map(|part| rms_at(part, sample_rate_hz, frequency_hz));
    let drift = parts.map(|part| (part / rms - 1.0).abs()).max_by(f64::total_cmp)?;
    (rms > 0.0 && whole > 0.0).then_some(Tone { rms, frequency_hz, rest, drift })
}

/// The middle of `samples`, of at most `count`.
fn middle(samples: &[f32], count: usize) -> &[f32] {
    let cut = samples.len().saturating_sub(count) / 2;
    &samples[cut..samples.len() - cut]
}

/// The frequency of the highest level within `reach_hz` of `near_hz`, where the level has one maximum.
fn loudest_hz(samples: &[f32], sample_rate_hz: f64, near_hz: f64, reach_hz: f64) -> f64 {
    let (mut low, mut high) = (near_hz - reach_hz, near_hz + reach_hz);
    for _ in 0..20 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if rms_at(samples, sample_rate_hz, a) < rms_at(samples, sample_rate_hz, b) { low = a } else { high = b }
    }
    0.5 * (low + high)
}

/// Root of the mean square of a sine of `frequency_hz` in `samples`, through Hann's window, which keeps others out.
fn rms_at(samples: &[f32], sample_rate_hz: f64, frequency_hz: f64) -> f64 {
    let turn = TAU * frequency_hz / sample_rate_hz;
    let re = windowed(samples, |x, k| x * (turn * k).cos());
    let im = windowed(samples, |x, k| x * (turn * k).sin());
    // A sine of amplitude a has the mean a/2 against its own phase.
    SQRT_2 * re.hypot(im)
}

/// Mean of `term` through Hann's window, given each sample without the mean of all, and its number.
fn windowed(samples: &[f32], term: impl Fn(f64, f64) -> f64) -> f64 {
    let count = samples.len() as f64;
    let window = |k: f64| 1.0 - (TAU * (k + 0.5) / count).cos();
    let mean = samples.iter().map(|&x| f64::from(x)).sum::<f64>() / count;
    let sum: f64 = (0..)
        .zip(samples)
        .map(|(k, &x)| (f64::from(k), x))
        .map(|(k, x)| window(k) * term(f64::from(x) - mean, k))
        .sum();
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a mean of forces over a mean of peaks, a variance of a population, and blows that are no calibration.
    #[test]
    fn blows_give_the_scale() {
        let found = of_blows(&[0.25, 0.5], &[50.0, 110.0]).unwrap();
        assert!((found.full_scale_n - 210.0).abs() < 1e-9);
        assert!((found.spread - 200f64.sqrt() / 210.0).abs() < 1e-9, "{found:?}");
        assert_eq!(of_blows(&[0.25], &[50.0]), None);
        assert_eq!(of_blows(&[0.25, 0.0], &[50.0, 50.0]), None);
        assert_eq!(of_blows(&[0.25, 0.3], &[50.0]), None);
        assert_eq!(of_blows(&[0.25, 0.3], &[50.0, 60.0, 70.0]), None);
    }

    /// Catches a level that depends on where between two steps the frequency lies, on an offset, or on noise, and a level or a
    /// purity that is wrong.
    #[test]
    fn a_tone_gives_the_level() {
        let rate_hz = 48_000.0;
        let tone = |hz: f64, noise: f64, fall: f64| -> Vec<f32> {
            let mut seed = 7_u64;
            let mut random = || {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (seed >> 40) as f64 / (1_u64 << 24) as f64 - 0.5
            };
            let of = |k: u32, random: f64| {
                let t = f64::from(k) / rate_hz;
                (0.1 + 0.2 * (1.0 - fall * t) * (TAU * hz * t + 0.3).sin() + noise * 12f64.sqrt() * random) as f32
            };
            (0..96_000).map(|k| of(k, random())).collect()
        };
        for hz in [1000.0, 991.37, 1013.9] {
            let found = of_tone(&tone(hz, 0.0, 0.0), rate_hz, 1000.0).unwrap();
            assert!((found.rms * SQRT_2 / 0.2 - 1.0).abs() < 1e-4, "{hz}: {found:?}");
            assert!(
                (found.frequency_hz - hz).abs() < 1e-2 && found.rest < 1e-2 && found.drift < 1e-3,
                "{hz}: {found:?}"
            );
        }
        let noisy = of_tone(&tone(1000.0, 0.0141, 0.0), rate_hz, 1000.0).unwrap();
        assert!((noisy.rms * SQRT_2 / 0.2 - 1.0).abs() < 1e-2 && (noisy.rest - 0.1).abs() < 0.01, "{noisy:?}");
        let falling = of_tone(&tone(1000.0, 0.0, 0.05), rate_hz, 1000.0).unwrap();
        assert!(falling.drift > 0.03, "{falling:?}");
        assert_eq!(of_tone(&tone(1000.0, 0.0, 0.0)[..4000], rate_hz, 1000.0), None);
        assert_eq!(of_tone(&[], rate_hz, f64::NAN), None);
        assert_eq!(of_tone(&tone(1000.0, 0.0, 0.0), rate_hz, 24_000.0), None);
    }

    /// Catches a tone that is lost between two steps, because a long recording passes few frequencies.
    #[test]
    fn a_long_recording_has_the_same_level() {
        let rate_hz = 4000.0;
        let tone = |k: u32| (0.2 * (TAU * 1000.1 * f64::from(k) / rate_hz).sin()) as f32;
        let samples: Vec<f32> = (0..240_000).map(tone).collect();
        for seconds in [20, 60] {
            let found = of_tone(&samples[..seconds * 4000], rate_hz, 1000.0).unwrap();
            assert!((found.rms * SQRT_2 / 0.2 - 1.0).abs() < 1e-4, "{seconds} s: {found:?}");
        }
    }
}
