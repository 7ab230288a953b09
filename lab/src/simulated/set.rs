//! Sets of simulated casings: the values of every tap; a scan uses some of them.

use std::ops::Range;

use anyhow::{Context as _, Result, ensure};
use tapline_acquire::ScanConfig;
use tapline_model::SimulationConfig;
use tapline_plate::ScanShape;
use tapline_process::ProcessConfig;
use tapline_wire::{Discriminator, Discriminators, Plan, PlannedTap, Samples, TapId, Values};

use super::reading::{Reader, Reading};
use super::scan_taps::ScanTaps;
use super::scene::{Scene, Simulator, Tyre};
use crate::in_memory::scanned;

/// What a tap gave: its discriminators, and the velocity as measured.
type Found = (Values, f64);

/// How often an unusable tap is taken again, as by default.
const RETAKES: u16 = 2;

/// Casings and the values of their taps.
#[derive(Debug, Clone)]
pub struct Set {
    /// The casings.
    pub tyres: Vec<Tyre>,
    /// The taps of each.
    pub shape: ScanShape,
    /// `[casing][shoulder][offset][velocity][repetition][location]`.
    found: Vec<Found>,
}

/// What each of `readings` finds in every tap of `tyres` in `scene`, planned by `shape`: one set per reading, in order.
///
/// # Errors
/// A setting out of its bounds.
pub(crate) fn simulate(
    simulator: Simulator,
    scene: Scene,
    shape: &ScanShape,
    tyres: &[Tyre],
    seed: u64,
    readings: &[Reading],
) -> Result<Vec<Set>> {
    let plated: Vec<_> = tyres.iter().map(Tyre::of_plate).collect();
    let plan = shape.plan(&plated)?;
    let taps: Vec<Vec<Discriminators>> = match simulator {
        Simulator::Plate => {
            let reader =
                || Reader::new(readings).map_err(|e| tapline_plate::Error::Recording { what: format!("{e:#}") });
            tapline_plate::taps(
                &scene.population(),
                seed,
                &plated,
                &plan,
                RETAKES,
                reader,
                |reader, header, samples| reader.read(header, Samples::F32(samples)),
            )?
        }
        Simulator::Model => modelled(&scene.model(shape), shape, tyres, seed, readings)?,
    };
    ensure!(plan.taps().len() == taps.len(), "a tap was not taken");
    let set = |number: usize| {
        let absent = (Values::default(), f64::NAN);
        let found = vec![absent; tyres.len() * shape.tap_count()];
        let mut set = Set { tyres: tyres.to_vec(), shape: shape.clone(), found };
        for tap in taps.iter().map(|of_tap| &of_tap[number]) {
            let place = set.place(&tap.id)?;
            set.found[place] = (tap.values, tap.velocity_measured_m_per_s);
        }
        Ok(set)
    };
    (0..readings.len()).map(set).collect()
}

impl Scene {
    /// The rig of `model` for the scene, with records as `shape` has them.
    pub fn model(self, shape: &ScanShape) -> SimulationConfig {
        SimulationConfig {
            sample_rate_hz: shape.sample_rate_hz,
            sample_count: (shape.record_s * shape.sample_rate_hz).round() as u32,
            pre_trigger_samples: shape.pre_trigger_samples,
            ..self.simulation()
        }
    }
}

/// The values of the taps of `tyres` in `model`.
fn modelled(
    simulation: &SimulationConfig,
    shape: &ScanShape,
    tyres: &[Tyre],
    seed: u64,
    readings: &[Reading],
) -> Result<Vec<Vec<Discriminators>>> {
    let scan = ScanConfig {
        seed,
        offsets_mm: shape.offsets_mm.clone(),
        velocities_m_per_s: shape.velocities_m_per_s.clone(),
        repetitions: shape.repetitions,
        locations: shape.location_count,
        closing_tap: false,
        tyre: tyres.iter().map(Tyre::of_model).collect(),
        ..ScanConfig::default()
    };
    Ok(scanned(&scan, simulation, || Reader::new(readings), Reader::read)?.1)
}

/// Every tap of `tyres` in `scene`, planned by `shape` and read by `process`.
///
/// # Errors
/// A setting out of its bounds.
pub fn simulated(
    simulator: Simulator,
    scene: Scene,
    shape: &ScanShape,
    tyres: &[Tyre],
    seed: u64,
    process: ProcessConfig,
) -> Result<Set> {
    let sets = simulate(simulator, scene, shape, tyres, seed, &[Reading { process, ..Reading::default() }])?;
    sets.into_iter().next().context("there is one reading")
}

/// `values`, each changed by `change`.
fn changed(values: Values, change: impl Fn(Discriminator, f64) -> f64) -> Values {
    let mut changed = Values::default();
    for which in Discriminator::ALL {
        changed.set(which, values.get(which).map(|value| change(which, value)));
    }
    changed
}

impl Set {
    /// The same with every value changed by `change`, which gets the number of the tap in the set.
    pub fn changed(&self, change: impl Fn(usize, Discriminator, f64) -> f64) -> Self {
        let of = |(tap, &(values, velocity)): (usize, &Found)| {
            (changed(values, |which, value| change(tap, which, value)), velocity)
        };
        Self { found: self.found.iter().enumerate().map(of).collect(), ..self.clone() }
    }

    /// The number in the set of the first casing's tap that a scan of `taps` makes first; its neighbours follow.
    ///
    /// # Errors
    /// If the set has no such tap.
    pub fn first_tap_of(&self, taps: &ScanTaps) -> Result<usize> {
        let tyre = self.tyres.first().context("the set has no casings")?;
        let plan = self.shape.plan(&[tyre.of_plate()])?;
        let first = plan.taps().iter().find(|tap| taps.has(tap)).context("the set has no such tap")?;
        self.place(&first.id)
    }

    /// The planned `taps` of some casings of the set: their plan and values, after the change by `scene`.
    ///
    /// # Errors
    /// If the set has not all of these taps.
    pub fn part(&self, casings: Range<usize>, taps: &ScanTaps, scene: Scene) -> Result<(Plan, Vec<Discriminators>)> {
        let tyres: Vec<_> = self.tyres[casings.clone()].iter().map(Tyre::of_plate).collect();
        let all = self.shape.plan(&tyres)?;
        let planned: Vec<PlannedTap> = all.taps().iter().copied().filter(|tap| taps.has(tap)).collect();
        let plan = Plan::new(all.geometry, all.recording.clone(), planned, all.truth().clone())?;
        let found = (0..).zip(plan.taps()).map(|(plan_index, tap)| {
            let mut record = self.record(plan_index, tap)?;
            if scene.changes_a_turn() && self.is_turn_changed(taps, tap)? {
                let gone = f64::from(tap.id.location) / f64::from(self.shape.location_count);
                record.values = changed(record.values, |which, value| scene.changed(which, value, gone));
            }
            Ok(record)
        });
        let found = found.collect::<Result<_>>()?;
        Ok((plan, found))
    }

    /// The values of `taps`, requested in addition to those of `plan`, a part of the set.
    ///
    /// # Errors
    /// If the set has not all of these taps.
    pub fn again(&self, taps: &[PlannedTap], plan: &Plan) -> Result<Vec<Discriminators>> {
        let row = u32::try_from(plan.taps().len())?;
        (row..).zip(taps).map(|(plan_index, tap)| self.record(plan_index, tap)).collect()
    }

    /// Whether `tap` belongs to the turn that a scene changes: of shoulder 1, a different one in each casing.
    fn is_turn_changed(&self, taps: &ScanTaps, tap: &PlannedTap) -> Result<bool> {
        let repetitions = taps.turns.iter().map(|turn| usize::from(turn.repetition) + 1).max().unwrap_or(1);
        let turn_count = self.shape.offsets_mm.len() * self.shape.velocities_m_per_s.len() * repetitions;
        let offset = nearest(&self.shape.offsets_mm, tap.id.offset_mm())?;
        let velocity = nearest(&self.shape.velocities_m_per_s, tap.id.velocity_m_per_s())?;
        let condition = offset * self.shape.velocities_m_per_s.len() + velocity;
        let turn = condition * repetitions + usize::from(tap.id.repetition);
        Ok(tap.id.shoulder == 1 && turn == self.casing(&tap.id)? % turn_count)
    }

    fn record(&self, plan_index: u32, tap: &PlannedTap) -> Result<Discriminators> {
        let found = self.found.get(self.place(&tap.id)?);
        let &(values, velocity_measured_m_per_s) = found.context("a tap that is not in the set")?;
        Ok(Discriminators { id: tap.id, plan_index, velocity_measured_m_per_s, values, ..Discriminators::default() })
    }

    /// The number of the casing of `id`.
    fn casing(&self, id: &TapId) -> Result<usize> {
        self.tyres.iter().position(|tyre| tyre.serial == id.tyre.as_str()).context("a tap of another casing")
    }

    /// The number of the tap `id`.
    fn place(&self, id: &TapId) -> Result<usize> {
        let shape = &self.shape;
        ensure!(id.repetition < shape.repetitions, "repetition {} of {}", id.repetition, shape.repetitions);
        let mut place = self.casing(id)? * 2 + usize::from(id.shoulder == 2);
        place = place * shape.offsets_mm.len() + nearest(&shape.offsets_mm, id.offset_mm())?;
        place = place * shape.velocities_m_per_s.len() + nearest(&shape.velocities_m_per_s, id.velocity_m_per_s())?;
        place = place * usize::from(shape.repetitions) + usize::from(id.repetition);
        Ok(place * shape.location_count as usize + id.location as usize)
    }
}

fn nearest(values: &[f64], value: Option<f64>) -> Result<usize> {
    value.and_then(|value| values.iter().position(|v| (v - value).abs() < 1e-6)).context("a tap of another plan")
}
