//! Recorded taps with a known truth: how index, spectrum and length of the record affect detection on them.

use anyhow::{Context as _, Result};
use serde::Deserialize;
use tapline_acquire::{Source as _, TapSet};
use tapline_fuse::{FuseConfig, IndexKind};
use tapline_process::{Precision, ProcessConfig, ProcessExtractor};
use tapline_wire::Plan;

use crate::chart::Bench;
use crate::chart::cost::{Workload, by_turns};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Error, Point};
use crate::evaluation::Areas;
use crate::in_memory::Record;
use crate::simulated::Dataset;

/// A recorded set with the configuration that ships for it.
struct Slab {
    folder: &'static str,
    name: &'static str,
    title: &'static str,
    config: &'static str,
    truth: &'static str,
}

const SLABS: [Slab; 3] = [
    Slab {
        folder: "fhwa-slab-bj",
        name: "fhwa",
        title: "FHWA laboratory slab, 5 lines",
        config: include_str!("../../../../examples/fhwa-slab-bj.toml"),
        truth: "inferred from the peak-frequency map that was published with the recordings",
    },
    Slab {
        folder: "ntu-slab-06cm",
        name: "ntu-06",
        title: "NTU slab, crack 6 cm deep, 19 lines",
        config: include_str!("../../../../examples/ntu-slab-06cm.toml"),
        truth: "the design of the specimen",
    },
    Slab {
        folder: "ntu-slab-10cm",
        name: "ntu-10",
        title: "NTU slab, crack 10 cm deep, 19 lines",
        config: include_str!("../../../../examples/ntu-slab-10cm.toml"),
        truth: "the design of the specimen",
    },
];

/// The tables of a configuration that are used here.
#[derive(Debug, Clone, Deserialize)]
struct Config {
    process: ProcessConfig,
    fuse: FuseConfig,
}

struct Variant {
    label: &'static str,
    name: &'static str,
    family: usize,
    change: fn(&mut Config, record_s: f64),
}

const VARIANTS: [Variant; 6] = [
    Variant { label: "as shipped", name: "the configuration that ships", family: 0, change: |_, _| () },
    Variant {
        label: "f64",
        name: "double precision",
        family: 0,
        change: |config, _| config.process.precision = Precision::F64,
    },
    Variant {
        label: "3/4 of the record",
        name: "the first three quarters of each record",
        family: 1,
        change: |config, record_s| config.process.record_s = 0.75 * record_s,
    },
    Variant {
        label: "1/2",
        name: "the first half of each record",
        family: 1,
        change: |config, record_s| config.process.record_s = 0.5 * record_s,
    },
    Variant {
        label: "3/8",
        name: "the first three eighths of each record",
        family: 1,
        change: |config, record_s| config.process.record_s = 0.375 * record_s,
    },
    Variant {
        label: "Eqs. 55-56",
        name: "the dissertation's index",
        family: 2,
        change: |config, _| config.fuse.index = IndexKind::Dissertation,
    },
];

struct Taps {
    plan: Plan,
    all: Vec<Record>,
}

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let mut facets = Vec::new();
    for slab in &SLABS {
        if let Some(set) = bench.recorded("slabs", slab.folder)? {
            facets.push(facet(bench, slab, &taps(set)?)?);
        }
    }
    Ok(Panel::new(
        "What do recorded taps say?",
        "Concrete slabs, hit by hand, with only the power ratio usable: do results on simulated tyres also hold on \
         recordings with a known truth?",
        [
            "Each line is compared with all lines of its slab, as the shipped configurations do. The cost is that of reading a tap, all \
             discriminators, and judging it. Intervals draw whole lines; there is one recording of each, and no seed.",
            "These records are 5 and 10 ms long, and ring until they end. Within the wide intervals of so few lines no part of them is \
             better than all. For tyres most of a record of 0.4 s is useless, because their ringing is over after 25 ms or so.",
        ],
        facets,
    ))
}

fn taps(mut set: TapSet) -> Result<Taps> {
    let plan = set.plan().clone();
    Ok(Taps { all: Record::render_all(&mut set, 0..plan.taps().len())?, plan })
}

impl Slab {
    /// The configuration of `variant`, for records of `record_s`.
    fn configured(&self, variant: &Variant, record_s: f64) -> Result<Config> {
        let mut config: Config =
            toml::from_str(self.config).with_context(|| format!("the configuration of {}", self.folder))?;
        (variant.change)(&mut config, record_s);
        Ok(config)
    }
}

fn facet(bench: &Bench, slab: &Slab, taps: &Taps) -> Result<Facet> {
    let recording = &taps.plan.recording;
    let record_s = f64::from(recording.sample_count_max) / recording.sample_rate_hz;
    let configs: Vec<Config> =
        VARIANTS.iter().map(|variant| slab.configured(variant, record_s)).collect::<Result<_>>()?;
    let mut workloads = Vec::new();
    for config in &configs {
        let mut extractor = ProcessExtractor::new(&config.process)?;
        workloads.push(Workload::batch(taps.all.len(), move || {
            judged(&config.fuse, &read(&mut extractor, taps)).map_or(f64::NAN, |areas| areas.auc().unwrap_or(f64::NAN))
        }));
    }
    let costs = by_turns(workloads, bench.size.rounds.div_ceil(3));
    let points = VARIANTS.iter().zip(&configs).zip(costs).map(|((variant, config), cost)| {
        let areas = judged(&config.fuse, &read(&mut ProcessExtractor::new(&config.process)?, taps))?;
        let loss = 1.0 - areas.auc().context("a slab has cracked and sound places")?;
        let error = Error::mean_of(vec![loss]);
        let interval = areas.by_tyres(bench.seed).map(|(low, high)| (1.0 - high, 1.0 - low));
        Ok(Point::new(variant.name, variant.label, cost, error.with_interval(interval), taps.all.len())
            .family(variant.family)
            .default_if(variant.label == VARIANTS[0].label))
    });
    Ok(Facet {
        cost: Quantity::log("Processor time of a tap, read and judged", "\u{b5}s"),
        error: Quantity::log("Loss of detection, 1 \u{2212} AUC", ""),
        tolerance: Tolerance { cost: 0.15, error: 0.003 },
        truth: slab.truth.to_owned(),
        seeds: Vec::new(),
        families: vec!["precision", "part of the record", "the dissertation's index"],
        points: points.collect::<Result<_>>()?,
        ..bench.facet(slab.name, slab.title)
    })
}

fn read(extractor: &mut ProcessExtractor, taps: &Taps) -> Dataset {
    let of_tap = |tap: &Record| extractor.extract(&tap.header, tap.samples());
    Dataset { plan: taps.plan.clone(), records: taps.all.iter().map(of_tap).collect() }
}

/// The places of all lines by their damage index; those of one line are resampled together.
fn judged(config: &FuseConfig, found: &Dataset) -> Result<Areas> {
    let mut fusion = found.fusion(config, None)?;
    let (mut places, plan) = (Vec::new(), &found.plan);
    for (number, scan) in plan.scans().iter().enumerate() {
        let (_, cells) = fusion.judge(number)?;
        for cell in cells {
            let truth = plan.truth().get(&(scan.tyre, scan.shoulder, cell.location)).copied();
            let Some(is_cracked) = truth else { continue };
            places.push((scan.to_string(), cell.damage_index, is_cracked));
        }
    }
    Ok(Areas::of(places.into_iter()))
}
