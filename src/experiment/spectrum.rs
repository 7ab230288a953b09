//! The sound of one record: its peak, and its power density in steps of frequency.

use std::sync::Arc;

use anyhow::{Context as _, Result, ensure};
use realfft::{RealFftPlanner, RealToComplex};
use tapline_wire::{Channel, Samples, TapHeader};

/// Band that the B-scan shows (Fig. 76).
pub(super) const BAND_HZ: (f64, f64) = (500.0, 2000.0);
/// Width of its steps, each the mean of its bins.
pub(super) const STEP_HZ: f64 = 25.0;

/// The sound of `samples` in V, less the median of the first three quarters before the trigger.
pub(super) fn sound_v(header: &TapHeader, samples: Samples<'_>) -> Result<Vec<f64>> {
    let of_sound = header.channels().enumerate().find(|(_, (channel, _))| *channel == Channel::Sound);
    let (place, (_, v_per_count)) = of_sound.context("a simulated record has no sound")?;
    let count = header.sample_count as usize;
    let range = place * count..(place + 1) * count;
    let mut sound_v: Vec<f64> = match samples {
        Samples::I16(all) => all[range].iter().map(|&x| f64::from(x) * v_per_count).collect(),
        Samples::F32(all) => all[range].iter().map(|&x| f64::from(x) * v_per_count).collect(),
    };
    let mut before = sound_v[..header.pre_trigger_samples as usize * 3 / 4].to_vec();
    before.sort_by(f64::total_cmp);
    let median = before.get(before.len() / 2).copied().unwrap_or(0.0);
    sound_v.iter_mut().for_each(|x| *x -= median);
    Ok(sound_v)
}

/// The largest magnitude of `sound_v`.
pub(super) fn peak_v(sound_v: &[f64]) -> f64 {
    sound_v.iter().map(|x| x.abs()).max_by(f64::total_cmp).unwrap_or(0.0)
}

/// Takes spectra of records of one length and rate.
pub(super) struct Spectra {
    fft: Arc<dyn RealToComplex<f64>>,
    sample_rate_hz: f64,
    sample_count: usize,
}

impl Spectra {
    /// For records of `sample_count` samples, `sample_rate_hz` a second.
    pub(super) fn new(sample_rate_hz: f64, sample_count: usize) -> Result<Self> {
        ensure!(sample_rate_hz * 0.5 > BAND_HZ.1, "{sample_rate_hz} Hz is too slow for {} Hz", BAND_HZ.1);
        Ok(Self { fft: RealFftPlanner::new().plan_fft_forward(sample_count), sample_rate_hz, sample_count })
    }

    /// Power density in V^2/Hz of `sound_v` (one-sided boxcar periodogram, Eq. 50), step by step of [`BAND_HZ`].
    pub(super) fn of(&self, mut sound_v: Vec<f64>) -> Result<Vec<f64>> {
        let mut bins = self.fft.make_output_vec();
        self.fft.process(&mut sound_v, &mut bins)?;
        let count = self.sample_count as f64;
        let (bin_hz, density) = (self.sample_rate_hz / count, 2.0 / (self.sample_rate_hz * count));
        let step_count = ((BAND_HZ.1 - BAND_HZ.0) / STEP_HZ).round() as usize;
        let mut steps = vec![(0.0, 0_u32); step_count];
        for (bin, hz) in bins.iter().enumerate().map(|(k, bin)| (bin, k as f64 * bin_hz)) {
            let is_within = (BAND_HZ.0..BAND_HZ.1).contains(&hz);
            if let Some((sum, count)) = steps.get_mut(((hz - BAND_HZ.0) / STEP_HZ) as usize).filter(|_| is_within) {
                *sum += bin.norm_sqr() * density;
                *count += 1;
            }
        }
        Ok(steps.into_iter().map(|(sum, count)| if count > 0 { sum / f64::from(count) } else { 0.0 }).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// Catches a wrong scale, step or side: the density of a tone, summed over its band, is its power.
    #[test]
    fn a_tones_power_lies_in_its_step() {
        let (rate_hz, count) = (40_960.0, 16_384);
        let tone = |k: usize| 0.3 * (TAU * 1000.0 * k as f64 / rate_hz).sin();
        let density = Spectra::new(rate_hz, count).unwrap().of((0..count).map(tone).collect()).unwrap();
        assert_eq!(density.len(), 60);
        let power: f64 = density.iter().map(|d| d * STEP_HZ).sum();
        assert!((power / 0.045 - 1.0).abs() < 1e-9, "{power}");
        assert!(density[20] > 1e6 * density[19] && density[20] > 1e6 * density[21], "{density:?}");
    }
}
