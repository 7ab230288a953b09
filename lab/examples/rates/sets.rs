//! Sets of casings: simulated once, and kept in the cache.

use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use clap::ValueEnum;
use rayon::prelude::*;
use serde_json::json;
use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_model::SimulationConfig;
use tapline_plate::{Population, ScanShape, discriminators};
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::{
    CacheLine, Discriminator, Discriminators, Plan, PlannedTap, Quality, Samples, Scan, Serial, TapHeader, Values,
    cache_lines_for, digest_of_parts,
};

use crate::scenes::{Crack, Scene, Simulator, Tyre};

/// Columns of a tap: its discriminators and the velocity as measured.
const COLUMNS: usize = Discriminator::COUNT + 1;
/// How often a tap of no use is taken again, as by default.
const RETAKES: u16 = 2;

/// Where sets come from.
#[derive(Debug)]
pub(crate) struct Cache {
    folder: PathBuf,
    simulator: Simulator,
    shape: ScanShape,
    /// Sound casings of a group that are kept for references.
    reference_casings: usize,
    simulated: Cell<(usize, f64)>,
}

/// Casings and what came of their taps.
#[derive(Debug)]
pub(crate) struct Set {
    pub(crate) tyres: Vec<Tyre>,
    pub(crate) shape: ScanShape,
    /// `[casing][shoulder][offset][velocity][repetition][location][column]`.
    values: Vec<f64>,
}

impl Cache {
    pub(crate) fn new(
        folder: &Path,
        simulator: Simulator,
        shape: ScanShape,
        reference_casings: Option<usize>,
    ) -> Result<Self> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let reference_casings = reference_casings.unwrap_or(0);
        Ok(Self { folder: folder.to_owned(), simulator, shape, reference_casings, simulated: Cell::default() })
    }

    pub(crate) fn shape(&self) -> &ScanShape {
        &self.shape
    }

    /// Taps simulated so far, and the seconds that took.
    pub(crate) fn simulated(&self) -> (usize, f64) {
        self.simulated.get()
    }

    /// The sound casings that references of a group are made of.
    pub(crate) fn reference(&self, scene: Scene, seed: u64) -> Result<Set> {
        let scene = scene.reference_scene();
        let tyres = (0..self.reference_casings).map(|k| Tyre::sound(format!("reference-{k:03}"))).collect();
        self.set(scene, &format!("{}-reference", scene.set_name()), tyres, seed)
    }

    /// `count` casings of a group that are judged.
    pub(crate) fn judged(&self, scene: Scene, count: usize, seed: u64) -> Result<Set> {
        self.set(scene, scene.set_name(), scene.tyres(self.shape.location_count, count, seed)?, seed)
    }

    fn set(&self, scene: Scene, name: &str, tyres: Vec<Tyre>, seed: u64) -> Result<Set> {
        let shape = ScanShape { record_s: scene.record_s(self.shape.record_s), ..self.shape.clone() };
        let counts = [2, shape.offsets_mm.len(), shape.velocities_m_per_s.len()];
        let mut lengths = vec![tyres.len()];
        lengths.extend(counts);
        lengths.extend([usize::from(shape.repetitions), shape.location_count as usize, COLUMNS]);
        let truth = |tyre: &Tyre| -> Vec<Vec<bool>> {
            let ring = |shoulder| (0..shape.location_count).map(|l| tyre.is_cracked(shoulder, l)).collect();
            vec![ring(1), ring(2)]
        };
        let names = Discriminator::ALL.iter().map(|d| d.column()).chain(["velocity_measured_m_per_s"]);
        let settings = match self.simulator {
            Simulator::Plate => json!(scene.population()),
            Simulator::Model => json!(simulation(scene, &shape)),
        };
        let head = json!({
            "simulator": self.simulator,
            "settings": settings,
            "seed": seed,
            "order": ["casing", "shoulder", "offset", "velocity", "repetition", "location", "column"],
            "shape": lengths,
            "offsets_mm": shape.offsets_mm,
            "velocities_m_per_s": shape.velocities_m_per_s,
            "record_s": shape.record_s,
            "columns": names.collect::<Vec<_>>(),
            "tyres": tyres,
            "is_cracked": tyres.iter().map(truth).collect::<Vec<_>>(),
            "fingerprint": self.fingerprint(scene, seed)?,
        });
        let text = serde_json::to_string_pretty(&head)?;
        let simulator = if self.simulator == Simulator::Plate { "plate" } else { "model" };
        let digest = digest_of_parts([text.as_bytes()]);
        let path = self.folder.join(format!("{simulator}-{name}-{seed}-{digest:016x}.f64"));
        let length: usize = lengths.iter().product();
        if let Some(values) = fs::read(&path).ok().and_then(|bytes| read(&bytes, length)) {
            return Ok(Set { tyres, shape, values });
        }
        let begun = Instant::now();
        let (plan, found) = self.simulate(scene, &shape, &tyres, seed)?;
        let values = Set::values(&tyres, &shape, &plan, &found)?;
        let (taps, seconds) = self.simulated.get();
        self.simulated.set((taps + found.len(), seconds + begun.elapsed().as_secs_f64()));
        fs::write(path.with_extension("json"), text)?;
        let draft = path.with_extension("draft");
        fs::write(&draft, values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
        fs::rename(&draft, &path)?;
        Ok(Set { tyres, shape, values })
    }

    /// Two taps' discriminators, in bits: sets of a simulator or an extractor that has changed are not those of the cache.
    fn fingerprint(&self, scene: Scene, seed: u64) -> Result<Vec<u64>> {
        let shape = ScanShape {
            offsets_mm: vec![0.0],
            velocities_m_per_s: vec![1.85],
            repetitions: 1,
            location_count: 2,
            ..self.shape.clone()
        };
        let crack = Crack { first: 0, count: 1, location_count: 2, depth_mm: 8.0, length_mm: 20.0, severity: 1.0 };
        let tyre = Tyre { serial: "fingerprint".to_owned(), cracks: vec![crack] };
        let (_, found) = self.simulate(scene, &shape, &[tyre], seed)?;
        let bits =
            |d: &Discriminators| Discriminator::ALL.map(|which| d.values.get(which).unwrap_or(f64::NAN).to_bits());
        Ok(found.iter().flat_map(bits).collect())
    }

    fn simulate(
        &self,
        scene: Scene,
        shape: &ScanShape,
        tyres: &[Tyre],
        seed: u64,
    ) -> Result<(Plan, Vec<Discriminators>)> {
        let plated: Vec<_> = tyres.iter().map(Tyre::of_plate).collect();
        let plan = shape.plan(&plated)?;
        let found = match self.simulator {
            Simulator::Plate => {
                let population: Population = scene.population();
                discriminators(&population, seed, &plated, &plan, &ProcessConfig::default(), RETAKES)?
            }
            Simulator::Model => {
                let of_tyre = |tyre: &Tyre| modelled(&simulation(scene, shape), shape, tyre, seed);
                let found: Vec<Vec<Discriminators>> = tyres.par_iter().map(of_tyre).collect::<Result<_>>()?;
                found.concat()
            }
        };
        Ok((plan, found))
    }
}

/// The model's rig for `scene`, with records of the shape's length.
fn simulation(scene: Scene, shape: &ScanShape) -> SimulationConfig {
    SimulationConfig {
        sample_rate_hz: shape.sample_rate_hz,
        sample_count: (shape.record_s * shape.sample_rate_hz).round() as u32,
        pre_trigger_samples: shape.pre_trigger_samples,
        ..scene.simulation()
    }
}

/// What comes of the taps of `tyre` by the model.
fn modelled(simulation: &SimulationConfig, shape: &ScanShape, tyre: &Tyre, seed: u64) -> Result<Vec<Discriminators>> {
    let scan = ScanConfig {
        seed,
        offsets_mm: shape.offsets_mm.clone(),
        velocities_m_per_s: shape.velocities_m_per_s.clone(),
        repetitions: shape.repetitions,
        locations: shape.location_count,
        closing_tap: false,
        tyre: vec![tyre.of_model()],
        ..ScanConfig::default()
    };
    let mut line = SimulatedLine::new(&scan, simulation)?;
    let mut buffer = vec![CacheLine::default(); cache_lines_for(line.plan().recording.payload_bytes_max())];
    let mut extractor = ProcessExtractor::new(&ProcessConfig::default())?;
    let rows = 0..u32::try_from(line.plan().taps().len())?;
    rows.map(|row| {
        let mut header = TapHeader::default();
        for attempt in 0..=RETAKES {
            line.render(row, attempt, &mut header, &mut buffer)?;
            header.retakes_left = (RETAKES - attempt).into();
            let samples = Samples::view(&header, &buffer).context("a record does not fit its header")?;
            let found = extractor.extract(&header, samples);
            if !found.quality.contains(Quality::RETAKE) {
                return Ok(found);
            }
        }
        anyhow::bail!("a tap was asked for once more than allowed")
    })
    .collect()
}

fn read(bytes: &[u8], length: usize) -> Option<Vec<f64>> {
    let (values, rest) = bytes.as_chunks::<8>();
    (values.len() == length && rest.is_empty()).then(|| values.iter().map(|&x| f64::from_le_bytes(x)).collect())
}

impl Set {
    /// The values of `found`, in the order of a set.
    fn values(tyres: &[Tyre], shape: &ScanShape, plan: &Plan, found: &[Discriminators]) -> Result<Vec<f64>> {
        let mut values = vec![f64::NAN; tyres.len() * shape.tap_count() * COLUMNS];
        let number: std::collections::BTreeMap<&str, usize> =
            tyres.iter().enumerate().map(|(number, tyre)| (tyre.serial.as_str(), number)).collect();
        anyhow::ensure!(plan.taps().len() == found.len(), "a tap was not taken");
        for tap in found {
            let casing = number.get(tap.id.tyre.as_str()).context("a tap of another casing")?;
            let at = place(shape, *casing, tap)? * COLUMNS;
            for (out, which) in values[at..].iter_mut().zip(Discriminator::ALL) {
                *out = tap.values.get(which).unwrap_or(f64::NAN);
            }
            values[at + Discriminator::COUNT] = tap.velocity_measured_m_per_s;
        }
        Ok(values)
    }

    /// Casings of the set from `first` on, with their first `repetitions`: the plan and what came of its taps, after
    /// `scene` has changed them.
    pub(crate) fn part(
        &self,
        casings: std::ops::Range<usize>,
        repetitions: u16,
        policy: Policy,
        scene: Scene,
    ) -> Result<(Plan, Vec<Discriminators>)> {
        let tyres: Vec<_> = self.tyres[casings.clone()].iter().map(Tyre::of_plate).collect();
        let plan = ScanShape { repetitions, ..self.shape.clone() }.plan(&tyres)?;
        let whole = self.whole(&plan, casings.start, repetitions, scene)?;
        if policy != Policy::Adaptive {
            return Ok((plan, whole));
        }
        // Every second location at the belt edge and every third at 10 mm.
        let is_coarse = |tap: &PlannedTap| {
            let offset_mm = tap.id.offset_mm().unwrap_or(f64::NAN);
            let is_of = |mm: f64, every: u32| (offset_mm - mm).abs() < 1e-6 && tap.id.location.is_multiple_of(every);
            tap.id.repetition == 0 && (is_of(0.0, 2) || is_of(10.0, 3))
        };
        let taps: Vec<PlannedTap> = plan.taps().iter().copied().filter(is_coarse).collect();
        let coarse = Plan::new(plan.geometry, plan.recording.clone(), taps, plan.truth().clone())?;
        let records = whole.into_iter().zip(plan.taps()).filter(|(_, tap)| is_coarse(tap)).map(|(record, _)| record);
        let records = (0..).zip(records).map(|(plan_index, record)| Discriminators { plan_index, ..record });
        let records = records.collect();
        Ok((coarse, records))
    }

    /// What came of `taps`, which are asked for besides those of `plan`, a part of the set from casing `first` on.
    pub(crate) fn again(&self, taps: &[PlannedTap], first: usize, plan: &Plan) -> Result<Vec<Discriminators>> {
        let number: std::collections::BTreeMap<&str, usize> =
            self.tyres.iter().enumerate().map(|(number, tyre)| (tyre.serial.as_str(), number)).collect();
        let row = u32::try_from(plan.taps().len())?;
        let of = |(plan_index, tap): (u32, &PlannedTap)| {
            let record = Discriminators { id: tap.id, plan_index, ..Discriminators::default() };
            let casing = *number.get(tap.id.tyre.as_str()).context("a tap of another casing")?;
            anyhow::ensure!(casing >= first, "a tap of another part");
            let at = place(&self.shape, casing, &record)? * COLUMNS;
            let mut values = Values::default();
            for (&value, which) in self.values[at..].iter().zip(Discriminator::ALL) {
                values.set(which, Some(value));
            }
            let velocity_measured_m_per_s = self.values[at + Discriminator::COUNT];
            Ok(Discriminators { velocity_measured_m_per_s, values, ..record })
        };
        (row..).zip(taps).map(of).collect()
    }

    fn whole(&self, plan: &Plan, first: usize, repetitions: u16, scene: Scene) -> Result<Vec<Discriminators>> {
        let tyre_count = plan.scans().len() / 2;
        let turn_count = self.shape.offsets_mm.len() * self.shape.velocities_m_per_s.len() * usize::from(repetitions);
        let per_casing = plan.taps().len() / tyre_count;
        let per_turn = self.shape.location_count as usize;
        let found = (0..).zip(plan.taps()).map(|(plan_index, tap)| {
            let casing = first + plan_index as usize / per_casing;
            let turn = (plan_index as usize % per_casing) / per_turn;
            let record = Discriminators { id: tap.id, plan_index, ..Discriminators::default() };
            let at = place(&self.shape, casing, &record)? * COLUMNS;
            let is_changed = scene.changes_a_turn() && turn == casing % turn_count;
            let gone = f64::from(tap.id.location) / f64::from(self.shape.location_count);
            let mut values = Values::default();
            for (&value, which) in self.values[at..].iter().zip(Discriminator::ALL) {
                values.set(which, Some(if is_changed { scene.changed(which, value, gone) } else { value }));
            }
            let velocity_measured_m_per_s = self.values[at + Discriminator::COUNT];
            Ok(Discriminators { velocity_measured_m_per_s, values, ..record })
        });
        found.collect()
    }
}

/// How a casing is scanned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Policy {
    /// All taps and no others.
    Fixed,
    /// All taps, and what stands out again.
    Full,
    /// Some of the taps, and what stands out again.
    Adaptive,
}

/// What a rig needs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Times {
    /// From tap to tap.
    pub(crate) tap_s: f64,
    /// To another offset, besides.
    pub(crate) offset_s: f64,
}

impl Times {
    /// For the scan of `tyre`, both of whose shoulders are tapped at once.
    pub(crate) fn of(self, plan: &Plan, tyre: Serial) -> f64 {
        let of_scan = |scan: &Scan| {
            let taps: Vec<&PlannedTap> = scan.taps.iter().map(|&row| &plan.taps()[row as usize]).collect();
            let moves = taps.windows(2).filter(|pair| pair[0].id.offset_mm() != pair[1].id.offset_mm()).count();
            taps.len() as f64 * self.tap_s + moves as f64 * self.offset_s
        };
        let scans = plan.scans().iter().filter(|scan| scan.tyre == tyre);
        scans.map(of_scan).max_by(f64::total_cmp).unwrap_or(0.0)
    }
}

/// Which tap of a set `tap` of casing number `casing` is.
fn place(shape: &ScanShape, casing: usize, tap: &Discriminators) -> Result<usize> {
    let nearest = |values: &[f64], value: Option<f64>| {
        value.and_then(|value| values.iter().position(|v| (v - value).abs() < 1e-6)).context("a tap of another plan")
    };
    let offset = nearest(&shape.offsets_mm, tap.id.offset_mm())?;
    let velocity = nearest(&shape.velocities_m_per_s, tap.id.velocity_m_per_s())?;
    let mut place = casing * 2 + usize::from(tap.id.shoulder == 2);
    place = place * shape.offsets_mm.len() + offset;
    place = place * shape.velocities_m_per_s.len() + velocity;
    place = place * usize::from(shape.repetitions) + usize::from(tap.id.repetition);
    Ok(place * shape.location_count as usize + tap.id.location as usize)
}
