//! Sets of simulated casings: the values of every tap; a scan uses some of them.

use std::collections::HashMap;
use std::ops::Range;

use anyhow::{Context as _, Result};
use tapline_acquire::ScanConfig;
use tapline_model::SimulationConfig;
use tapline_plate::ScanShape;
use tapline_wire::{Discriminator, Discriminators, Plan, PlannedTap, TapId, Values};

use super::dataset::{Dataset, by_reading, scan_model};
use super::plate_line::PlateLine;
use super::reading::{Reader, Reading};
use super::scan_taps::ScanTaps;
use super::scene::{Scene, Simulator, Tyre};
use crate::in_memory::scanned;

/// Casings and the values of their taps.
#[derive(Debug, Clone)]
pub struct Set {
    /// The casings.
    pub tyres: Vec<Tyre>,
    /// The taps of each.
    pub shape: ScanShape,
    /// All taps, by casing, shoulder, offset, velocity, repetition and location.
    taps: Dataset,
}

/// What each of `readings` finds in every tap of `tyres` in `scene`, planned by `shape`: one set per reading, in order.
///
/// # Errors
/// A setting out of its bounds.
pub fn simulate(
    simulator: Simulator,
    scene: Scene,
    shape: &ScanShape,
    tyres: &[Tyre],
    seed: u64,
    readings: &[Reading],
) -> Result<Vec<Set>> {
    let plated: Vec<_> = tyres.iter().map(Tyre::of_plate).collect();
    let plan = shape.plan(&plated)?;
    let found = match simulator {
        Simulator::Plate => {
            let source = || PlateLine::new(&scene.population(), seed, &plated, &plan);
            by_reading(&plan, &scanned(source, || Reader::new(readings), Reader::read)?.1, readings.len())
        }
        Simulator::Model => {
            let simulation = SimulationConfig {
                sample_rate_hz: shape.sample_rate_hz,
                sample_count: plan.recording.sample_count_max,
                pre_trigger_samples: shape.pre_trigger_samples,
                ..scene.simulation()
            };
            scan_model(&scan_of(shape, tyres, seed), &simulation, readings)?
        }
    };
    found.into_iter().map(|found| Set::new(tyres, shape, &plan, &found)).collect()
}

/// The scan of `tyres` by `model`, with the taps of `shape`.
fn scan_of(shape: &ScanShape, tyres: &[Tyre], seed: u64) -> ScanConfig {
    ScanConfig {
        seed,
        offsets_mm: shape.offsets_mm.clone(),
        velocities_m_per_s: shape.velocities_m_per_s.clone(),
        repetitions: shape.repetitions,
        locations: shape.location_count,
        closing_tap: false,
        tyre: tyres.iter().map(Tyre::of_model).collect(),
        ..ScanConfig::default()
    }
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
    /// From what was `found`, whose taps are those of `plan` in another order.
    fn new(tyres: &[Tyre], shape: &ScanShape, plan: &Plan, found: &Dataset) -> Result<Self> {
        let rows = rows(&found.plan);
        let record = |(plan_index, tap): (u32, &PlannedTap)| {
            let &row = rows.get(&tap.id).context("a tap was not taken")?;
            let Discriminators { velocity_measured_m_per_s, values, .. } = found.records[row];
            Ok(Discriminators {
                id: tap.id,
                plan_index,
                velocity_measured_m_per_s,
                values,
                ..Discriminators::default()
            })
        };
        let records = (0..).zip(plan.taps()).map(record).collect::<Result<_>>()?;
        Ok(Self { tyres: tyres.to_vec(), shape: shape.clone(), taps: Dataset { plan: plan.clone(), records } })
    }

    /// The same with every value changed by `change`, which gets the number of the tap in the set.
    pub fn changed(&self, change: impl Fn(usize, Discriminator, f64) -> f64) -> Self {
        let mut set = self.clone();
        for (tap, record) in set.taps.records.iter_mut().enumerate() {
            record.values = changed(record.values, |which, value| change(tap, which, value));
        }
        set
    }

    /// The number in the set of the first casing's tap that a scan of `taps` makes first; its neighbours follow.
    ///
    /// # Errors
    /// If the set has no such tap.
    pub fn first_tap_of(&self, taps: &ScanTaps) -> Result<usize> {
        self.taps.plan.taps().iter().position(|tap| taps.has(tap)).context("the set has no such tap")
    }

    /// The planned `taps` of some casings of the set: their plan and values, after the change by `scene`.
    ///
    /// # Errors
    /// If the set has none of these taps.
    pub fn part(&self, casings: Range<usize>, taps: &ScanTaps, scene: Scene) -> Result<Dataset> {
        let serials: Vec<&str> = self.tyres[casings].iter().map(|tyre| tyre.serial.as_str()).collect();
        let mut part = self.taps.only(|tap| serials.contains(&tap.id.tyre.as_str()) && taps.has(tap))?;
        for record in part.records.iter_mut().filter(|_| scene.changes_a_turn()) {
            if self.is_turn_changed(taps, &record.id)? {
                let gone = f64::from(record.id.location) / f64::from(self.shape.location_count);
                record.values = changed(record.values, |which, value| scene.changed(which, value, gone));
            }
        }
        Ok(part)
    }

    /// `part` of the set with the values of `taps`, which are requested in addition.
    ///
    /// # Errors
    /// If the set has not all of these taps.
    pub fn again(&self, taps: &[PlannedTap], mut part: Dataset) -> Result<Dataset> {
        let rows = rows(&self.taps.plan);
        for (plan_index, tap) in (u32::try_from(part.records.len())?..).zip(taps) {
            let &row = rows.get(&tap.id).context("a tap that is not in the set")?;
            part.records.push(Discriminators { plan_index, ..self.taps.records[row] });
        }
        Ok(Dataset { plan: part.plan.grown(taps)?, ..part })
    }

    /// Whether the tap `id` belongs to the turn that a scene changes: of shoulder 1, a different one in each casing.
    fn is_turn_changed(&self, taps: &ScanTaps, id: &TapId) -> Result<bool> {
        let repetitions = taps.turns.iter().map(|turn| usize::from(turn.repetition) + 1).max().unwrap_or(1);
        let turn_count = self.shape.offsets_mm.len() * self.shape.velocities_m_per_s.len() * repetitions;
        let offset = nearest(&self.shape.offsets_mm, id.offset_mm())?;
        let velocity = nearest(&self.shape.velocities_m_per_s, id.velocity_m_per_s())?;
        let condition = offset * self.shape.velocities_m_per_s.len() + velocity;
        let turn = condition * repetitions + usize::from(id.repetition);
        let casing = self.tyres.iter().position(|tyre| tyre.serial == id.tyre.as_str());
        Ok(id.shoulder == 1 && turn == casing.context("a tap of another casing")? % turn_count)
    }
}

/// The row of each tap of `plan`.
fn rows(plan: &Plan) -> HashMap<TapId, usize> {
    plan.taps().iter().map(|tap| tap.id).zip(0..).collect()
}

fn nearest(values: &[f64], value: Option<f64>) -> Result<usize> {
    value.and_then(|value| values.iter().position(|v| (v - value).abs() < 1e-6)).context("a tap of another plan")
}
