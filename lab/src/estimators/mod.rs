//! Bias and spread of the estimators of `process`, on pulses of every rung and on sounds of the simulated rig.

mod force;

pub(crate) use self::force::{estimators_of, extract_force, pulse_records};

mod page;
mod sound;

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use serde::{Deserialize, Serialize};
use tapline_host::progress::{Progress, Unit};
use tapline_process::{ProcessConfig, ProcessExtractor, QualityConfig};
use tapline_wire::{Channel, Discriminator, Samples, TapHeader, digest_of_parts};

use page::markdown;

use crate::written::WrittenArgs;

/// Sample rates of the study: the rig's, and one at which a pulse has ten samples.
const RATES_HZ: [u32; 2] = [40_960, 10_240];

/// A cell of the tables: taps that differ only in noise and trigger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SignalCase {
    /// Which table it belongs to.
    pub table: &'static str,
    /// The pulse or the sound.
    pub signal: &'static str,
    pub rate_hz: u32,
    /// Peak over the standard deviation of white noise, dB; empty without noise.
    pub snr_db: Option<u32>,
    /// What else is wrong with the record.
    pub fault: &'static str,
}

/// The defaults, with every value kept: what is studied is the estimator, not the flag that would hide it.
fn plain() -> ProcessConfig {
    ProcessConfig { quality: QualityConfig::keeping(), ..ProcessConfig::default() }
}

impl SignalCase {
    /// Random numbers of this cell only, so that it can be measured again without the others; different for each seed.
    fn generator(&self, seed: u64) -> ChaCha8Rng {
        let Self { table, signal, rate_hz, snr_db, fault } = *self;
        let snr_db = snr_db.map(|db| db.to_string()).unwrap_or_default();
        let rate_hz = rate_hz.to_string();
        let parts = [table, signal, &rate_hz, &snr_db, fault].map(str::as_bytes);
        let mut generator = ChaCha8Rng::seed_from_u64(digest_of_parts(parts));
        generator.set_stream(seed);
        generator
    }
}

/// How a cell is measured.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Seed of noise and triggers; 0 on the page.
    pub seed: u64,
    pub taps: u32,
}

/// The result of an estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub table: String,
    pub signal: String,
    pub rate_hz: u32,
    pub snr_db: Option<u32>,
    pub fault: String,
    pub estimator: String,
    pub quantity: String,
    /// Mean error of the values, % of the truth.
    pub bias_percent: f64,
    /// Standard deviation of the values, % of the truth.
    pub spread_percent: f64,
    /// Taps without a value, %.
    pub absent_percent: f64,
}

/// Measures every cell, and writes table and page into the folder `out`.
///
/// # Errors
/// A computation that fails, or an error of the file system.
pub fn write(out: &Path, written: WrittenArgs) -> Result<()> {
    written.check(&out.join("estimators.md"))?;
    let rows = measure(|_| true)?;
    written.write(&[(out.join("estimators.csv"), csv(&rows)?), (out.join("estimators.md"), markdown(&rows))])
}

/// Measures the cells that `is_wanted` selects.
pub(crate) fn measure(is_wanted: impl Fn(&SignalCase) -> bool) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    let wanted = |cells: Vec<SignalCase>| cells.into_iter().filter(&is_wanted).collect::<Vec<_>>();
    let (of_force, of_sound) = (wanted(force::cells()), wanted(sound::cells()));
    let mut progress = Progress::new(Some((of_force.len() + of_sound.len()) as u64), Unit::Things("cells"));
    for (number, cell) in (0..).zip(&of_force) {
        progress.update(number);
        rows.extend(force::measure(cell, force::EFFORT)?);
    }
    for (number, cell) in (of_force.len() as u64..).zip(&of_sound) {
        progress.update(number);
        rows.extend(sound::measure(cell)?);
    }
    Ok(rows)
}

/// Measures one cell of a pulse.
pub(crate) fn measure_one(cell: &SignalCase, effort: Effort) -> Result<Vec<Row>> {
    force::measure(cell, effort)
}

pub(crate) fn csv(rows: &[Row]) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    rows.iter().try_for_each(|row| writer.serialize(row))?;
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// An estimator with its name in the table, and its quantities.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Estimator {
    pub name: &'static str,
    pub config: ProcessConfig,
    pub quantities: &'static [Discriminator],
}

/// Errors of one quantity over many taps.
#[derive(Debug, Default)]
struct Errors {
    percent: Vec<f64>,
    absent: u32,
}

impl Errors {
    fn push(&mut self, value: Option<f64>, truth: f64) {
        match value {
            Some(value) => self.percent.push(100.0 * (value / truth - 1.0)),
            None => self.absent += 1,
        }
    }

    /// Rounded to three decimals: noise in the last digits of a transform does not reach the second one.
    fn row(&self, cell: &SignalCase, estimator: &str, quantity: Discriminator) -> Row {
        let count = f64::from(u32::try_from(self.percent.len()).unwrap_or(u32::MAX));
        let mean = self.percent.iter().sum::<f64>() / count;
        let variance = self.percent.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
        let rounded = |x: f64| (x * 1e3).round() / 1e3 + 0.0; // + 0.0: no minus before a zero
        Row {
            table: cell.table.to_owned(),
            signal: cell.signal.to_owned(),
            rate_hz: cell.rate_hz,
            snr_db: cell.snr_db,
            fault: cell.fault.to_owned(),
            estimator: estimator.to_owned(),
            quantity: quantity.column().to_owned(),
            bias_percent: rounded(mean),
            spread_percent: rounded(variance.sqrt()),
            absent_percent: rounded(100.0 * f64::from(self.absent) / (count + f64::from(self.absent))),
        }
    }
}

/// A row for each quantity of each of `estimators`, from `taps` of the channel `kind` in its unit. `truth` is the value that an
/// estimator should find.
fn rows(
    cell: &SignalCase,
    kind: Channel,
    pre_trigger_samples: u32,
    estimators: &[Estimator],
    taps: &[Vec<f32>],
    truth: impl Fn(&Estimator, Discriminator) -> Option<f64>,
) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for estimator in estimators {
        let mut extractor = ProcessExtractor::new(&estimator.config)?;
        let found = taps.iter().map(|tap| extract(&mut extractor, kind, tap, cell.rate_hz, pre_trigger_samples));
        let found = found.collect::<Result<Vec<_>>>()?;
        for &quantity in estimator.quantities {
            let truth = truth(estimator, quantity).context("a clean tap has its values")?;
            let mut errors = Errors::default();
            found.iter().for_each(|found| errors.push(found.get(quantity), truth));
            rows.push(errors.row(cell, estimator.name, quantity));
        }
    }
    Ok(rows)
}

/// What `extractor` finds in a record of one channel, whose samples are in its unit.
fn extract(
    extractor: &mut ProcessExtractor,
    kind: Channel,
    samples: &[f32],
    rate_hz: u32,
    pre_trigger_samples: u32,
) -> Result<tapline_wire::Values> {
    let sample_count = u32::try_from(samples.len())?;
    let header = TapHeader::in_units(f64::from(rate_hz), pre_trigger_samples, sample_count, &[kind]);
    Ok(extractor.extract(&header, Samples::F32(samples)).values)
}

/// Adds white noise, `snr_db` below `peak`.
#[expect(clippy::cast_possible_truncation, reason = "samples are in single precision")]
fn add_noise(samples: &mut [f32], peak: f64, snr_db: Option<u32>, generator: &mut ChaCha8Rng) {
    let Some(snr_db) = snr_db else { return };
    let sigma = peak / 10.0_f64.powf(f64::from(snr_db) / 20.0);
    for x in samples {
        let normal: f64 = StandardNormal.sample(generator);
        *x += (sigma * normal) as f32;
    }
}

/// Uniform in 0 to 1.
fn uniform(generator: &mut ChaCha8Rng) -> Result<f64> {
    Ok(Uniform::new(0.0, 1.0)?.sample(generator))
}

/// The number after `name` in a fault such as "clipped 80 %".
fn amount(fault: &str, name: &str) -> Result<Option<f64>> {
    let Some(rest) = fault.strip_prefix(name) else { return Ok(None) };
    let Some(number) = rest.split_whitespace().next() else { bail!("{fault}: no number") };
    Ok(Some(number.parse()?))
}

#[cfg(test)]
mod tests;
