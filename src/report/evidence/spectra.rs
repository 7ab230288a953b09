//! Power spectra of the sound, location by location, in the band of the discriminators.

use std::collections::BTreeMap;

use anyhow::Result;
use realfft::RealFftPlanner;
use tapline_draw::record::periodogram;
use tapline_draw::stats::mean;
use tapline_process::ProcessConfig;
use tapline_store::Reader;
use tapline_wire::Channel;

use crate::report::evidence::Shoulder;
use crate::report::evidence::condition::Condition;
use crate::report::evidence::samples::signal;

/// Number of frequencies of a picture.
pub(crate) const ROWS: usize = 100;
/// The edges of the band are extended to a multiple of this.
const ROUND_HZ: f64 = 500.0;

/// Density of the sound over location and frequency.
pub(crate) struct Spectra {
    /// Lower and upper edge, Hz.
    pub band_hz: (f64, f64),
    /// For each cell of the shoulder: `ROWS` densities in dB re 1 V²/Hz (or Pa²/Hz, or parts of full scale) from the
    /// lower edge up; `None` if there is no tap.
    pub columns: Vec<Option<Vec<f64>>>,
}

/// The band in which `config` looks for damage, extended to round numbers.
pub(crate) fn band_hz(config: &ProcessConfig) -> (f64, f64) {
    ((config.f_c_hz / ROUND_HZ).floor() * ROUND_HZ, (config.f_hi_hz / ROUND_HZ).ceil() * ROUND_HZ)
}

/// The spectra of the first repetition of `shoulder` under `condition`: one-sided boxcar periodograms of whole records.
pub(crate) fn spectra(
    reader: &Reader,
    shoulder: &Shoulder,
    condition: Condition,
    band_hz: (f64, f64),
) -> Result<Spectra> {
    let mut rows: BTreeMap<u32, (u16, u32)> = BTreeMap::new();
    for tap in shoulder.taps.iter().filter(|tap| tap.condition == condition && !tap.is_closing) {
        if tap.found.is_some() {
            let first = rows.entry(tap.location).or_insert((tap.repetition, tap.row));
            *first = (*first).min((tap.repetition, tap.row));
        }
    }
    let mut planner = RealFftPlanner::<f64>::new();
    let mut column = |row: u32| -> Result<Option<Vec<f64>>> {
        let Some(signal) = signal(reader, row, Channel::Sound)? else { return Ok(None) };
        let mut values = signal.values;
        let count = values.len();
        let center = mean(&values).unwrap_or(0.0);
        values.iter_mut().for_each(|value| *value -= center);
        let powers = periodogram(&mut planner, values, signal.sample_rate_hz)?;
        Ok(Some(folded(&powers, signal.sample_rate_hz / count as f64, band_hz)))
    };
    let columns = shoulder.cells.iter().map(|cell| match rows.get(&cell.location) {
        Some(&(_, row)) => column(row),
        None => Ok(None),
    });
    Ok(Spectra { band_hz, columns: columns.collect::<Result<_>>()? })
}

/// The mean of the densities in each of [`ROWS`] parts of the band, in dB; if a part has no bin, the nearest one.
fn folded(powers: &[f64], bin_hz: f64, (low_hz, high_hz): (f64, f64)) -> Vec<f64> {
    let step_hz = (high_hz - low_hz) / ROWS as f64;
    let part = |row: usize| {
        let (from_hz, to_hz) = (low_hz + row as f64 * step_hz, low_hz + (row + 1) as f64 * step_hz);
        let first = (from_hz / bin_hz).ceil() as usize;
        let inside = (first..powers.len()).take_while(|&k| (k as f64) * bin_hz < to_hz).map(|k| powers[k]);
        let inside: Vec<f64> = inside.collect();
        let nearest = (0.5 * (from_hz + to_hz) / bin_hz).round() as usize;
        let density = mean(&inside).or(powers.get(nearest).copied()).unwrap_or(0.0);
        10.0 * (density + f64::MIN_POSITIVE).log10()
    };
    (0..ROWS).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a line drawn at a wrong frequency, and a part without a bin that becomes silent.
    #[test]
    fn a_line_stays_where_it_is() {
        let mut powers = vec![1e-9; 4000];
        powers[400] = 1e-3; // 1000 Hz, with 2.5 Hz per bin
        let fine = folded(&powers, 2.5, (500.0, 2000.0));
        let loudest = (0..ROWS).max_by(|&a, &b| fine[a].total_cmp(&fine[b])).unwrap();
        assert_eq!(loudest, 33);
        let coarse = folded(&powers[..200], 50.0, (500.0, 2000.0));
        assert!(coarse.iter().all(|density| (*density + 90.0).abs() < 1e-6), "{coarse:?}");
    }

    /// Catches a band that cuts off frequencies of the discriminators.
    #[test]
    fn the_band_is_that_of_the_discriminators() {
        assert_eq!(band_hz(&ProcessConfig::default()), (500.0, 2000.0));
    }
}
