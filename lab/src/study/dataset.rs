//! The taps of a set, and parts of them: some tyres, or some repetitions.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use tapline_acquire::{ScanConfig, TyreConfig};
use tapline_fuse::{FuseConfig, ReferenceSet};
use tapline_model::SimulationConfig;
use tapline_wire::{Discriminators, Plan, PlannedTap, Truth};

use crate::in_memory::scanned;
use crate::simulated::{Reader, Reading, reference_of};

/// The velocity of every tap.
const VELOCITY_M_PER_S: f64 = 1.5;

/// A plan and the discriminators of each of its taps.
#[derive(Debug, Clone)]
pub(super) struct Dataset {
    pub plan: Plan,
    pub records: Vec<Discriminators>,
}

/// Which turns are made around a shoulder.
#[derive(Debug, Clone)]
pub(super) struct Turns {
    pub offsets_mm: Vec<f64>,
    pub repetitions: u16,
}

impl Dataset {
    /// Scans `tyres`; `seed` decides every random number.
    pub(super) fn scan(
        simulation: &SimulationConfig,
        tyres: Vec<TyreConfig>,
        turns: &Turns,
        numbers: (u64, u32),
    ) -> Result<Self> {
        let read = Self::scan_read(simulation, tyres, turns, numbers, &[Reading::default()])?;
        read.into_iter().next().context("one reading gives one dataset")
    }

    /// The same for each of `readings`.
    pub(super) fn scan_read(
        simulation: &SimulationConfig,
        tyres: Vec<TyreConfig>,
        turns: &Turns,
        (seed, location_count): (u64, u32),
        readings: &[Reading],
    ) -> Result<Vec<Self>> {
        let scan = ScanConfig {
            seed,
            offsets_mm: turns.offsets_mm.clone(),
            velocities_m_per_s: vec![VELOCITY_M_PER_S],
            repetitions: turns.repetitions,
            locations: location_count,
            closing_tap: false, // it enters no index
            tyre: tyres,
            ..ScanConfig::default()
        };
        let (plan, taps) = scanned(&scan, simulation, || Reader::new(readings), Reader::read)?;
        let dataset = |number: usize| {
            let records = taps.iter().map(|of_tap| of_tap[number]).collect();
            Self { plan: plan.clone(), records }
        };
        Ok((0..readings.len()).map(dataset).collect())
    }

    /// Its taps that `is_wanted` selects, as a plan.
    pub(super) fn only(&self, is_wanted: impl Fn(&PlannedTap) -> bool) -> Result<Self> {
        let rows = self.plan.taps().iter().zip(&self.records).filter(|(tap, _)| is_wanted(tap));
        let (taps, records): (Vec<PlannedTap>, Vec<Discriminators>) = rows.map(|(t, r)| (*t, *r)).unzip();
        let records = (0..).zip(records).map(|(plan_index, record)| Discriminators { plan_index, ..record }).collect();
        let truth: Truth = self.plan.truth().clone();
        let plan = Plan::new(self.plan.geometry, self.plan.recording.clone(), taps, truth)?;
        Ok(Self { plan, records })
    }

    /// Its taps of tyres that `is_wanted` selects.
    pub(super) fn of_tyres(&self, is_wanted: impl Fn(&str) -> bool) -> Result<Self> {
        self.only(|tap| is_wanted(tap.id.tyre.as_str()))
    }

    /// The reference from tyres that `is_wanted` selects, stated to be sound.
    pub(super) fn reference(&self, is_wanted: impl Fn(&str) -> bool) -> Result<Arc<ReferenceSet>> {
        let scans = self.plan.scans().iter().enumerate().filter(|(_, scan)| is_wanted(scan.tyre.as_str()));
        reference_of(&FuseConfig::default(), &self.plan, &self.records, scans.map(|(number, _)| number))
    }
}
