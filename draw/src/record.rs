//! One channel of one record, in its unit and without its baseline, and its power spectral density.

use anyhow::{Context as _, Result};
use realfft::RealFftPlanner;
use tapline_wire::{Channel, Samples, TapHeader};

use crate::stats::median;

/// The channel `kind` of a record in its unit; `None` if it is absent, has no samples, or has a sample that is not a
/// number.
///
/// The baseline is the median of the first three quarters before the trigger, as in the discriminators; of all samples
/// if there is no time before the trigger.
pub fn channel(header: &TapHeader, samples: Samples<'_>, kind: Channel) -> Option<Vec<f64>> {
    let (order, (_, unit_per_count)) = header.channels().enumerate().find(|(_, (channel, _))| *channel == kind)?;
    let count = header.sample_count as usize;
    let range = order * count..(order + 1) * count;
    let mut values: Vec<f64> = match samples {
        Samples::I16(all) => all.get(range)?.iter().map(|&x| f64::from(x)).collect(),
        Samples::F32(all) => all.get(range)?.iter().map(|&x| f64::from(x)).collect(),
    };
    let quiet = (3 * header.pre_trigger_samples as usize / 4).min(count);
    let baseline = median(&values[..if quiet == 0 { count } else { quiet }])?;
    for value in &mut values {
        *value = (*value - baseline) * unit_per_count;
    }
    values.iter().all(|value| value.is_finite()).then_some(values)
}

/// Power density of `signal` in its unit squared per Hz, in bins of `sample_rate_hz` over its length: the one-sided
/// boxcar periodogram of the whole record (the PSD of Eqs. 52 and 53).
///
/// # Errors
/// Those of the transform.
pub fn periodogram(planner: &mut RealFftPlanner<f64>, mut signal: Vec<f64>, sample_rate_hz: f64) -> Result<Vec<f64>> {
    let count = signal.len();
    let transform = planner.plan_fft_forward(count);
    let mut bins = transform.make_output_vec();
    transform.process(&mut signal, &mut bins).context("cannot transform a record")?;
    let density = 2.0 / (sample_rate_hz * count as f64);
    // The first bin, and the last of an even number of samples, have no negative frequency.
    let last = if count.is_multiple_of(2) { count / 2 } else { count };
    let one_sided =
        |(k, power): (usize, f64)| if k == 0 || k == last { 0.5 * density * power } else { density * power };
    Ok(bins.iter().map(|bin| bin.norm_sqr()).enumerate().map(one_sided).collect())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use tapline_wire::{ChannelHeader, SampleFormat};

    use super::*;

    /// Catches the wrong channel, a unit or a baseline left out, and numbers computed from a NaN.
    #[test]
    fn a_channel_is_in_its_unit_without_its_baseline() {
        let mut header = TapHeader {
            sample_rate_hz: 1e3,
            pre_trigger_samples: 4,
            sample_count: 5,
            sample_format: SampleFormat::F32.code(),
            channel_count: 2,
            ..TapHeader::default()
        };
        for (place, kind) in Channel::BOTH.into_iter().enumerate() {
            header.channels[place] = ChannelHeader { code: kind.code(), unit_per_count: 0.5, ..Default::default() };
        }
        let mut samples = vec![0.0_f32; 5];
        samples.extend([3.0, 5.0, 4.0, 90.0, 8.0]);
        let found = |samples: &[f32], kind| channel(&header, Samples::F32(samples), kind);
        assert_eq!(found(&samples, Channel::Sound), Some(vec![-0.5, 0.5, 0.0, 43.0, 2.0]));
        assert_eq!(found(&samples[..9], Channel::Sound), None);
        samples[9] = f32::NAN;
        assert_eq!((found(&samples, Channel::Sound), found(&samples, Channel::Force)), (None, Some(vec![0.0; 5])));
    }

    /// Catches a wrong scale or side: the density times the bin width adds up to the mean square (Parseval).
    #[test]
    fn powers_add_up() {
        for count in [4096_usize, 4095] {
            let rate_hz = 40_960.0;
            let signal: Vec<f64> = (0..count).map(|k| 0.1 + 0.3 * (TAU * 1003.0 * k as f64 / rate_hz).sin()).collect();
            let mean_square = signal.iter().map(|x| x * x).sum::<f64>() / count as f64;
            let density = periodogram(&mut RealFftPlanner::new(), signal, rate_hz).unwrap();
            let power = density.iter().sum::<f64>() * rate_hz / count as f64;
            assert!((power / mean_square - 1.0).abs() < 1e-12, "{count}: {power} {mean_square}");
        }
    }
}
