//! The ways of recording and reading that are tried, and what each costs.

use anyhow::Result;
use tapline_acquire::{ScanConfig, SimulatedLine};
use tapline_codec::{Codec, pack};
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor};

use crate::chart::Bench;
use crate::chart::cost::{Workload, by_turns};
use crate::chart::point::{Cost, Failure};
use crate::chart::size::Size;
use crate::chart::stability;
use crate::in_memory::Record;
use crate::simulated::{Reading, quantise};

pub(in crate::chart::panels) const RATE_HZ: f64 = 40_960.0;
/// Length of the longest record; the shorter ones are its beginnings.
pub(in crate::chart::panels) const RECORD_S: f64 = 0.4;
pub(in crate::chart::panels) const PRE_TRIGGER_S: f64 = 0.0125;

/// Lengths that are tried, the longest first.
pub(in crate::chart::panels) const LENGTHS_S: [f64; 8] = [RECORD_S, 0.2, 0.1, 0.06, 0.05, 0.04, 0.03, 0.025];
/// The length at which rates and bits are tried.
const CONVERTER_S: f64 = 0.1;
const BITS: [u32; 4] = [14, 12, 10, 8];
const RATES_HZ: [f64; 3] = [20_480.0, 81_920.0, 10_240.0];

pub(in crate::chart::panels) const LENGTH_FAMILIES: [&str; 1] = ["length of the record"];
pub(in crate::chart::panels) const CONVERTER_FAMILIES: [&str; 2] = ["sample rate, 16 bits", "bits, 41 kHz"];

/// Length of the rig's records.
fn default_record_s() -> f64 {
    let rig = SimulationConfig::default();
    f64::from(rig.sample_count) / rig.sample_rate_hz
}

/// A way to record and to read.
#[derive(Debug, Clone)]
pub(in crate::chart::panels) struct Heard {
    pub name: String,
    pub label: String,
    pub family: usize,
    pub is_default: bool,
    pub rate_hz: f64,
    /// Length of the rig's record.
    pub record_s: f64,
    pub reading: Reading,
}

impl Heard {
    fn plain(record_s: f64) -> Self {
        Self {
            name: String::new(),
            label: String::new(),
            family: 0,
            is_default: false,
            rate_hz: RATE_HZ,
            record_s,
            reading: Reading::default(),
        }
    }

    /// The rig's default records, read by `process`.
    pub(in crate::chart::panels) fn changed(
        (name, label, family): (&str, &str, usize),
        process: ProcessConfig,
    ) -> Self {
        Self {
            name: name.to_owned(),
            label: label.to_owned(),
            family,
            is_default: process == ProcessConfig::default(),
            reading: Reading { process, ..Reading::default() },
            ..Self::plain(default_record_s())
        }
    }

    pub(in crate::chart::panels) fn lengths() -> Vec<Self> {
        let default_s = default_record_s();
        let length = |record_s: f64| {
            // The longest record is read whole.
            let record_used_s = if record_s < RECORD_S { record_s } else { 0.0 };
            Self {
                name: format!("records of {record_s} s"),
                label: format!("{record_s} s"),
                is_default: (record_s - default_s).abs() < 1e-9,
                reading: Reading {
                    process: ProcessConfig { record_s: record_used_s, ..ProcessConfig::default() },
                    ..Reading::default()
                },
                ..Self::plain(RECORD_S)
            }
        };
        LENGTHS_S.into_iter().map(length).collect()
    }

    /// Rates and bits of the converter; a short chart tries one other rate.
    pub(in crate::chart::panels) fn converters(size: &Size) -> Vec<Self> {
        let plain = Self::plain(CONVERTER_S);
        let bits = |bits: u32| Self {
            name: format!("{bits} bits at 40.96 kHz"),
            label: format!("{bits} bits"),
            family: 1,
            reading: Reading { bits: Some(bits), ..Reading::default() },
            ..plain.clone()
        };
        let rate = |rate_hz: f64| Self {
            name: format!("16 bits at {} kHz", rate_hz / 1e3),
            label: if (rate_hz - RATE_HZ).abs() < 1.0 {
                "16 bits, 41 kHz: the rig".to_owned()
            } else {
                format!("{:.0} kHz", rate_hz / 1e3)
            },
            rate_hz,
            // The simulator `plate` gives floats: they are rounded as by a converter of 16 bits.
            reading: Reading { bits: Some(16), ..Reading::default() },
            ..plain.clone()
        };
        let rates = if size.is_full { &RATES_HZ[..] } else { &RATES_HZ[..1] };
        [RATE_HZ].into_iter().chain(rates.iter().copied()).map(rate).chain(BITS.map(bits)).collect()
    }

    /// The stability limits that it fails.
    pub(in crate::chart::panels) fn failures(&self) -> Vec<Failure> {
        if self.record_s < RECORD_S { Vec::new() } else { stability::of_spectrum(&self.reading.process) }
    }

    /// Samples of a channel.
    fn sample_count(&self) -> usize {
        let used_s = self.reading.process.record_s;
        ((if used_s > 0.0 { used_s } else { self.record_s }) * self.rate_hz).round() as usize
    }
}

/// Cost of a way, per tap.
#[derive(Debug, Clone, Copy)]
pub(in crate::chart::panels) struct HeardCost {
    pub bytes_kib: Cost,
    pub cpu_us: Cost,
}

/// What each of `heard` costs, on taps of one casing of `model`.
pub(in crate::chart::panels) fn costs(bench: &Bench, heard: &[Heard]) -> Result<Vec<HeardCost>> {
    let taps: Vec<Vec<Record>> = heard.iter().map(|heard| taps(bench, heard)).collect::<Result<_>>()?;
    let bytes = taps.iter().map(|taps| packed_kib(taps));
    let mut workloads = Vec::new();
    for (heard, taps) in heard.iter().zip(&taps) {
        let mut extractor = ProcessExtractor::new(&heard.reading.process)?;
        workloads.push(Workload::each(taps, move |tap| {
            let found = extractor.extract(&tap.header, tap.samples());
            f64::from(found.values.get(tapline_wire::Discriminator::Pr).is_some())
        }));
    }
    let cpu = by_turns(workloads, bench.size.rounds);
    Ok(bytes.zip(cpu).map(|(bytes_kib, cpu_us)| HeardCost { bytes_kib, cpu_us }).collect())
}

/// Records of a rig that records no more than `heard` reads.
fn taps(bench: &Bench, heard: &Heard) -> Result<Vec<Record>> {
    let scan = ScanConfig { seed: bench.seed, ..ScanConfig::default() };
    let simulation = SimulationConfig {
        sample_rate_hz: heard.rate_hz,
        sample_count: u32::try_from(heard.sample_count())?,
        pre_trigger_samples: (PRE_TRIGGER_S * heard.rate_hz).round() as u32,
        ..SimulationConfig::default()
    };
    let mut line = SimulatedLine::new(&scan, &simulation)?;
    let mut taps = Record::render_all(&mut line, 0..bench.size.taps)?;
    if let Some(bits) = heard.reading.bits {
        taps.iter_mut().for_each(|tap| quantise(bits, tap.counts_mut()));
    }
    Ok(taps)
}

/// Both channels of each tap, packed.
fn packed_kib(taps: &[Record]) -> Cost {
    let (mut planes, mut packed) = (Vec::new(), Vec::new());
    let of_tap = |tap: &Record| {
        pack(Codec::default(), 2, tap.bytes(), &mut planes, &mut packed);
        packed.len() as f64 / 1024.0
    };
    let kib: Vec<f64> = taps.iter().map(of_tap).collect();
    Cost::of(&kib)
}
