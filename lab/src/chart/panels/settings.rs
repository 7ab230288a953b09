//! How each estimator of `[process]`, changed alone, affects detection in records of the default length.

use anyhow::Result;
use tapline_process::{BandEdges, DurationEstimator, PeakEstimator, Precision, ProcessConfig, Subtraction};
use tapline_wire::Discriminator;

use super::force;
use super::recording::readings::{Heard, costs};
use super::recording::scenes::{self, found};
use super::recording::{TOLERANCE, point};
use crate::chart::Bench;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::Failure;
use crate::chart::stability;
use crate::simulated::Simulator;

const FAMILIES: [&str; 3] = ["tau", "F_max", "sound"];

/// The default, and each setting changed alone.
fn settings() -> Vec<Heard> {
    let default = ProcessConfig::default();
    let tau = |tau| ProcessConfig { tau, ..default };
    let f_max = |f_max| ProcessConfig { f_max, ..default };
    let subtract = |subtract| ProcessConfig { subtract, ..default };
    let all = [
        ("the default", "as shipped", 0, default),
        ("tau = \"width_02\"", "width_02", 0, tau(DurationEstimator::Width02)),
        ("tau = \"width_50\"", "width_50", 0, tau(DurationEstimator::Width50)),
        ("tau = \"impulse\"", "impulse", 0, tau(DurationEstimator::Impulse)),
        ("f_max = \"raw\"", "raw", 1, f_max(PeakEstimator::Raw)),
        ("f_max = \"polynomial\"", "polynomial", 1, f_max(PeakEstimator::Polynomial)),
        ("subtract = \"noise\"", "less noise", 2, subtract(Subtraction::Noise)),
        ("subtract = \"hum\"", "less hum", 2, subtract(Subtraction::Hum)),
        ("precision = \"f64\"", "f64", 2, ProcessConfig { precision: Precision::F64, ..default }),
        (
            "band_edges = \"fractional\"",
            "fractional",
            2,
            ProcessConfig { band_edges: BandEdges::Fractional, ..default },
        ),
        ("f_c_follows_tau = true", "f_c follows tau", 2, ProcessConfig { f_c_follows_tau: true, ..default }),
    ];
    all.map(|(name, label, family, process)| Heard::changed((name, label, family), process)).into()
}

/// The limits that a setting fails: for the force's estimators those of their own panel, for the others those of a
/// spectrum.
fn failures(bench: &Bench, heard: &Heard) -> Result<Vec<Failure>> {
    let process = heard.reading.process;
    let default = ProcessConfig::default();
    match () {
        () if process.tau != default.tau => force::of_estimator(bench, Discriminator::Tau, &process),
        () if process.f_max != default.f_max => force::of_estimator(bench, Discriminator::FMax, &process),
        () => Ok(stability::of_spectrum(&process)),
    }
}

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let settings = settings();
    let costs = costs(bench, &settings)?;
    let found = found(bench, &settings, &scenes::ALL)?;
    let failures = settings.iter().map(|heard| failures(bench, heard)).collect::<Result<Vec<_>>>()?;
    let facet = |simulator: Simulator| {
        let points = settings.iter().enumerate();
        let points = points.map(|(place, heard)| {
            let point = point(bench, heard, costs[place].cpu_us, &found, (simulator, place))?;
            Ok(point.failing(failures[place].clone()))
        });
        Ok(Facet {
            cost: Quantity::log("Processor time of a tap, all discriminators", "\u{b5}s"),
            error: Quantity::log("Loss of detection, 1 \u{2212} AUC", ""),
            tolerance: TOLERANCE,
            families: FAMILIES.to_vec(),
            points: points.collect::<Result<_>>()?,
            ..bench.facet(simulator.name(), format!("Cracks of the simulator {}", simulator.name()))
        })
    };
    Ok(Panel::new(
        "Which estimators find more cracks?",
        "Each estimator, and the precision, is changed alone, in records of the default length: what does it cost, and does the \
         index find more with it?",
        [
            "Scenes and reference are those of the panel `recording`: faint and strong cracks of smooth and of rough casings, and faint ones \
             in eight times the noise. The rig's hum is 3 mV.",
            "The simulators do not agree on tau. With the impulse the index finds more cracks of `plate` in each of the seeds, by about the \
             tolerance, and no more of `model`. Neither values nearer to the contact (`width_02`) nor values with less bias from \
             noise find more, because the index compares with places that have the same bias.",
        ],
        Simulator::ALL.into_iter().map(facet).collect::<Result<_>>()?,
    ))
}
