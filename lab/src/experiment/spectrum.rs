//! The sound of one record: its peak, and its power density in steps of frequency.

use anyhow::{Result, ensure};
use realfft::RealFftPlanner;
use tapline_draw::record::periodogram;

/// Band that the B-scan shows (Fig. 76).
pub(super) const BAND_HZ: (f64, f64) = (500.0, 2000.0);
/// Width of its steps, each the mean of its bins.
pub(super) const STEP_HZ: f64 = 25.0;

pub(super) fn peak_v(sound_v: &[f64]) -> f64 {
    sound_v.iter().map(|x| x.abs()).max_by(f64::total_cmp).unwrap_or(0.0)
}

/// Power density in V^2/Hz of `sound_v`, step by step of [`BAND_HZ`].
pub(super) fn steps(planner: &mut RealFftPlanner<f64>, sound_v: Vec<f64>, sample_rate_hz: f64) -> Result<Vec<f64>> {
    ensure!(sample_rate_hz * 0.5 > BAND_HZ.1, "{sample_rate_hz} Hz is too slow for {} Hz", BAND_HZ.1);
    let bin_hz = sample_rate_hz / sound_v.len() as f64;
    let density = periodogram(planner, sound_v, sample_rate_hz)?;
    let step_count = ((BAND_HZ.1 - BAND_HZ.0) / STEP_HZ).round() as usize;
    let mut steps = vec![(0.0, 0_u32); step_count];
    for (density, hz) in density.iter().enumerate().map(|(k, density)| (density, k as f64 * bin_hz)) {
        let is_within = (BAND_HZ.0..BAND_HZ.1).contains(&hz);
        if let Some((sum, count)) = steps.get_mut(((hz - BAND_HZ.0) / STEP_HZ) as usize).filter(|_| is_within) {
            *sum += density;
            *count += 1;
        }
    }
    Ok(steps.into_iter().map(|(sum, count)| if count > 0 { sum / f64::from(count) } else { 0.0 }).collect())
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
        let density = steps(&mut RealFftPlanner::new(), (0..count).map(tone).collect(), rate_hz).unwrap();
        assert_eq!(density.len(), 60);
        let power: f64 = density.iter().map(|d| d * STEP_HZ).sum();
        assert!((power / 0.045 - 1.0).abs() < 1e-9, "{power}");
        assert!(density[20] > 1e6 * density[19] && density[20] > 1e6 * density[21], "{density:?}");
    }
}
