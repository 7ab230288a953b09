//! How often verdicts are right: sets of simulated casings, judged with references of sound ones.
//!
//! `cargo run --release -p tapline-lab --example rates -- --simulator plate` prints, for every scene, reference and number
//! of repetitions, how many shoulders got which verdict with a 95 % interval, and how well the index and each discriminator
//! alone rank the locations. Casings come in groups, each with its own reference; a shoulder is judged once in a cell.

mod cells;
mod sets;

use std::io::{self, Write as _};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use clap::{Parser, ValueEnum as _};
use tapline_lab::simulated::{Reading, Scene, Simulator, Times};
use tapline_plate::ScanShape;
use tapline_process::{DurationEstimator, ProcessConfig};

use cells::{Asked, Policy, SceneCounts, casings, judge_cell, named};
use sets::Sets;

/// Judges simulated casings and counts the verdicts.
#[derive(Debug, Parser)]
struct Args {
    /// What simulates the casings.
    #[arg(long, value_enum, default_value = "plate")]
    simulator: Simulator,
    /// What shoulders are compared with: `self`, or numbers of sound casings.
    #[arg(long, value_delimiter = ',', value_parser = casings, default_value = "8,12,self")]
    reference: Vec<usize>,
    /// Repetitions that are judged, of the reference and of the scan alike.
    #[arg(long, value_delimiter = ',', default_value = "1,2")]
    repetitions: Vec<u16>,
    /// Scenes; all if left out.
    #[arg(long, value_delimiter = ',', value_enum)]
    scene: Vec<Scene>,
    /// Groups of casings, each with a seed and a reference of its own.
    #[arg(long, default_value_t = 5)]
    groups: u64,
    /// Sound casings that are judged in a group; both shoulders count.
    #[arg(long, default_value_t = 50)]
    sound: usize,
    /// Casings with a crack that are judged in a group; shoulder 1 counts, shoulder 2 is sound.
    #[arg(long, default_value_t = 20)]
    cracked: usize,
    /// Offsets, mm.
    #[arg(long, value_delimiter = ',', default_value = "0,5,10,15")]
    offsets: Vec<f64>,
    /// Velocities, m/s.
    #[arg(long, value_delimiter = ',', default_value = "1.85")]
    velocities: Vec<f64>,
    /// Locations of a ring.
    #[arg(long, default_value_t = 100)]
    locations: u32,
    /// Whether what stands out is tapped again, and whether only some of the taps are made first.
    #[arg(long, value_enum, default_value = "fixed")]
    policy: Policy,
    /// Time from tap to tap, s.
    #[arg(long, default_value_t = 0.4)]
    tap_s: f64,
    /// How tau is found, as `[process] tau` says.
    #[arg(long, value_parser = duration, default_value = "half_sine")]
    tau: DurationEstimator,
    /// Seed of the first group.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

fn duration(name: &str) -> Result<DurationEstimator, String> {
    serde_json::from_value(name.into()).map_err(|error| error.to_string())
}

fn main() -> Result<()> {
    let mut args = Args::parse();
    ensure!(args.groups > 0 && args.sound > 0 && args.cracked > 0, "there must be a casing in each group");
    if args.scene.is_empty() {
        args.scene = Scene::value_variants().to_vec();
    }
    let turns = args.repetitions.iter().copied().max().context("--repetitions is empty")?;
    // Second readings are simulated with the first ones.
    let turns = if args.policy == Policy::Fixed { turns } else { 2 * turns };
    let asked = Asked { policy: args.policy, times: Times { tap_s: args.tap_s, ..Times::default() } };
    let shape = ScanShape {
        offsets_mm: args.offsets.clone(),
        velocities_m_per_s: args.velocities.clone(),
        repetitions: turns,
        location_count: args.locations,
        ..ScanShape::default()
    };
    let process = ProcessConfig { tau: args.tau, ..ProcessConfig::default() };
    let reading = Reading { process, ..Reading::default() };
    let taps_of_casing = shape.tap_count();
    let mut sets = Sets::new(args.simulator, shape, reading, args.reference.iter().copied().max().unwrap_or(0));
    let begun = Instant::now();
    let mut out = io::stdout().lock();
    writeln!(
        out,
        "{:?}, {} groups, {} sound and {} cracked casings judged in each, {} taps a casing",
        args.simulator, args.groups, args.sound, args.cracked, taps_of_casing
    )?;
    SceneCounts::write_head(&mut out)?;
    for &scene in &args.scene {
        let judged_count = if scene.is_sound() { args.sound } else { args.cracked };
        for &by in &args.reference {
            for &repetitions in &args.repetitions {
                let cell = judge_cell(&mut sets, scene, by, repetitions, judged_count, (args.seed, args.groups), asked)
                    .with_context(|| format!("{scene:?}, reference {}, {repetitions} repetitions", named(by)))?;
                cell.write(&mut out)?;
                out.flush()?;
            }
        }
    }
    let (taps, seconds) = (sets.tap_count(), sets.seconds);
    writeln!(out, "simulated {taps} taps in {seconds:.1} s; all took {:.1} s", begun.elapsed().as_secs_f64())?;
    Ok(())
}
