//! The spectrum: processor time of a tap's discriminators against the error of its three powers.

use anyhow::{Context as _, Result};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use tapline_acquire::{ScanConfig, SimulatedLine, TyreConfig};
use tapline_draw::record::{channel, periodogram};
use tapline_model::{Crack, SimulationConfig};
use tapline_process::{Precision, ProcessConfig, ProcessExtractor, QualityConfig, Subtraction};
use tapline_wire::{Channel, Discriminator};

use crate::chart::Bench;
use crate::chart::cost::{Workload, by_turns};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Cost, Error, Point};
use crate::chart::stability;
use crate::in_memory::Record;

/// Samples of the longest records.
const SAMPLES: u32 = 16_384;
const RATE_HZ: f64 = 40_960.0;

/// PR, P_f and E_f.
type Powers = [f64; 3];

#[derive(Debug, Clone, Copy)]
struct Reading {
    precision: Precision,
    subtract: Subtraction,
    samples: u32,
}

fn readings() -> Vec<Reading> {
    use Precision::{F32, F64};
    let mut readings = Vec::new();
    for samples in [SAMPLES, 8192, 4096, 2048] {
        readings.extend([F32, F64].map(|precision| Reading { precision, subtract: Subtraction::None, samples }));
    }
    readings.extend([SAMPLES, 2048].map(|samples| Reading { precision: F32, subtract: Subtraction::Noise, samples }));
    readings
}

impl Reading {
    fn config(self) -> ProcessConfig {
        ProcessConfig {
            record_s: if self.samples < SAMPLES { f64::from(self.samples) / RATE_HZ } else { 0.0 },
            precision: self.precision,
            subtract: self.subtract,
            quality: QualityConfig::keeping(),
            ..ProcessConfig::default()
        }
    }

    fn label(self) -> String {
        let precision = if self.precision == Precision::F32 { "f32" } else { "f64" };
        let noise = if self.subtract == Subtraction::None { "" } else { ", less noise" };
        format!("{} {precision}{noise}", self.samples)
    }

    fn name(self) -> String {
        let precision = if self.precision == Precision::F32 { "single" } else { "double" };
        let noise = if self.subtract == Subtraction::None { "" } else { ", less the noise before the trigger" };
        format!("the first {} samples, {precision} precision{noise}", self.samples)
    }

    fn is_default(self) -> bool {
        let default = ProcessConfig::default();
        self.precision == default.precision
            && self.subtract == default.subtract
            && self.samples == SimulationConfig::default().sample_count
    }

    /// The powers of a record, scaled to one of [`SAMPLES`]: densities refer to the whole record.
    fn powers(self, extractor: &mut ProcessExtractor, tap: &Record) -> Powers {
        let found = extractor.extract(&tap.header, tap.samples()).values;
        let scale = f64::from(self.samples) / f64::from(SAMPLES);
        let of = |which| found.get(which).unwrap_or(f64::NAN);
        [of(Discriminator::Pr), scale * of(Discriminator::Pf), scale * of(Discriminator::Ef)]
    }
}

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let readings = readings();
    let mut by_seed = [vec![Vec::new(); readings.len()], vec![Vec::new(); readings.len()]];
    for seed in bench.seeds() {
        let clean = taps(bench, seed, false)?;
        let noisy = taps(bench, seed, true)?;
        let truths: Vec<Powers> = clean.iter().map(truth).collect::<Result<_>>()?;
        for (taps, by_seed) in [&clean, &noisy].into_iter().zip(&mut by_seed) {
            let errors: Vec<f64> =
                readings.par_iter().map(|reading| error(*reading, taps, &truths)).collect::<Result<_>>()?;
            by_seed.iter_mut().zip(errors).for_each(|(by_seed, error)| by_seed.push(error));
        }
    }
    let costs = costs(bench, &readings)?;
    let [clean, noisy] = by_seed;
    let facets = vec![
        facet(bench, "arithmetic", "Taps without noise: arithmetic and definition", &readings, &costs, clean),
        facet(bench, "noise", "Taps with the simulated rig's noise", &readings, &costs, noisy),
    ];
    Ok(Panel::new(
        "How must the spectrum be computed?",
        "Single or double precision, all of a record or its beginning: what do they cost, and what do they change?",
        [
            "The cost is that of all discriminators of a tap with their flags, force and sound of 16 bits. The error is the root mean \
             square of the relative errors of PR, P_f and E_f over taps on sound and cracked places.",
            "The truth is the periodogram of the whole record without noise, in double precision by another library. A shorter record \
             leaves out the end of the ringing, which is its error without noise; with noise, it also leaves out noise.",
        ],
        facets,
    ))
}

/// Taps of a casing with a crack of medium depth under a tenth of them, with the rig's noise and hum or without.
fn taps(bench: &Bench, seed: u64, has_noise: bool) -> Result<Vec<Record>> {
    let count = u32::try_from(bench.size.taps)?;
    let crack = Crack { shoulder: 1, first_location: 0, location_count: count.div_ceil(10), ..Crack::default() };
    let scan = ScanConfig {
        seed,
        offsets_mm: vec![0.0],
        velocities_m_per_s: vec![1.85],
        locations: count,
        closing_tap: false,
        tyre: vec![TyreConfig { serial: "SPECTRUM".to_owned(), station: 1, crack: vec![crack] }],
        ..ScanConfig::default()
    };
    let rig = SimulationConfig { sample_count: SAMPLES, ..SimulationConfig::default() };
    let simulation =
        if has_noise { rig } else { SimulationConfig { force_noise_n: 0.0, sound_noise_v: 0.0, hum_v: 0.0, ..rig } };
    let mut line = SimulatedLine::new(&scan, &simulation)?;
    Record::render_all(&mut line, 0..bench.size.taps)
}

/// The powers from a periodogram that shares no code with `process`.
fn truth(tap: &Record) -> Result<Powers> {
    let sound = channel(&tap.header, tap.samples(), Channel::Sound).context("a tap has a sound")?;
    let bin_hz = RATE_HZ / sound.len() as f64;
    let density = periodogram(&mut RealFftPlanner::new(), sound, RATE_HZ)?;
    let config = ProcessConfig::default();
    let within = |low: f64, high: f64| {
        let of_bin = move |&(k, _): &(usize, &f64)| (low..=high).contains(&(k as f64 * bin_hz));
        density.iter().enumerate().filter(of_bin).map(|(_, density)| *density)
    };
    let flexural: f64 = within(config.f_c_hz, config.f_hi_hz).sum();
    let all: f64 = within(config.f_lo_hz, config.f_top_hz).sum();
    let peak = within(config.f_c_hz, config.f_hi_hz).max_by(f64::total_cmp).context("the band has bins")?;
    Ok([flexural / all, peak, flexural * bin_hz])
}

/// Root mean square of the relative errors of all powers of `taps`.
fn error(reading: Reading, taps: &[Record], truths: &[Powers]) -> Result<f64> {
    let mut extractor = ProcessExtractor::new(&reading.config())?;
    let (mut squares, mut count) = (0.0, 0.0);
    for (tap, truth) in taps.iter().zip(truths) {
        for (found, truth) in reading.powers(&mut extractor, tap).into_iter().zip(truth) {
            squares += (found / truth - 1.0).powi(2);
            count += 1.0;
        }
    }
    Ok((squares / count).sqrt())
}

fn costs(bench: &Bench, readings: &[Reading]) -> Result<Vec<Cost>> {
    let taps = taps(bench, bench.seed, true)?;
    let mut workloads = Vec::new();
    for &reading in readings {
        // With the default policies of the flags, as on a line.
        let config = ProcessConfig { quality: QualityConfig::default(), ..reading.config() };
        let mut extractor = ProcessExtractor::new(&config)?;
        workloads.push(Workload::each(&taps, move |tap| reading.powers(&mut extractor, tap)[0]));
    }
    Ok(by_turns(workloads, bench.size.rounds))
}

fn facet(
    bench: &Bench,
    name: &str,
    title: &str,
    readings: &[Reading],
    costs: &[Cost],
    by_seed: Vec<Vec<f64>>,
) -> Facet {
    let point = |((&reading, &cost), by_seed): ((&Reading, &Cost), Vec<f64>)| {
        Point::new(
            reading.name(),
            reading.label(),
            cost,
            Error::mean_of(by_seed),
            bench.size.taps * bench.size.seed_count as usize,
        )
        .family(usize::from(reading.precision == Precision::F64))
        .default_if(reading.is_default())
        .failing(stability::of_spectrum(&reading.config()))
    };
    Facet {
        cost: Quantity::log("Processor time of a tap, all discriminators", "\u{b5}s"),
        error: Quantity::log("Relative error of PR, P_f and E_f, rms", ""),
        tolerance: Tolerance { cost: 0.1, error: if name == "noise" { 0.005 } else { 1e-4 } },
        truth: "the periodogram of the whole record without noise, in double precision by realfft".to_owned(),
        families: vec!["single precision", "double precision"],
        points: readings.iter().zip(costs).zip(by_seed).map(point).collect(),
        ..bench.facet(name, title)
    }
}
