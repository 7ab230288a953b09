//! A plan with what was found in each of its taps, and parts of it: some tyres, or some repetitions.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use tapline_acquire::{ScanConfig, SimulatedLine};
use tapline_fuse::{Built, FuseConfig, Fusion, KnownShoulder, Reference, ReferenceSet, build_reference};
use tapline_model::SimulationConfig;
use tapline_wire::{Discriminators, Plan, PlannedTap, Scan};

use super::reading::{Reader, Reading};
use crate::in_memory::scanned;

/// A plan and the discriminators of each of its taps.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// The taps.
    pub plan: Plan,
    /// What was found in each, in the order of the plan.
    pub records: Vec<Discriminators>,
}

/// The taps of `scan` on the rig of `model` that `simulation` describes: one dataset per reading, in order.
pub(crate) fn scan_model(
    scan: &ScanConfig,
    simulation: &SimulationConfig,
    readings: &[Reading],
) -> Result<Vec<Dataset>> {
    let (plan, taps) = scanned(|| Ok(SimulatedLine::new(scan, simulation)?), || Reader::new(readings), Reader::read)?;
    Ok(by_reading(&plan, &taps, readings.len()))
}

/// One dataset for each of `count` readings, from what each tap gave in all of them.
pub(super) fn by_reading(plan: &Plan, taps: &[Vec<Discriminators>], count: usize) -> Vec<Dataset> {
    let records = |number: usize| taps.iter().map(|of_tap| of_tap[number]).collect();
    (0..count).map(|number| Dataset { plan: plan.clone(), records: records(number) }).collect()
}

impl Dataset {
    /// Its taps that `is_wanted` selects, as a plan.
    pub(crate) fn only(&self, is_wanted: impl Fn(&PlannedTap) -> bool) -> Result<Self> {
        let rows = self.plan.taps().iter().zip(&self.records).filter(|(tap, _)| is_wanted(tap));
        let (taps, records): (Vec<PlannedTap>, Vec<Discriminators>) = rows.map(|(t, r)| (*t, *r)).unzip();
        let records = (0..).zip(records).map(|(plan_index, record)| Discriminators { plan_index, ..record }).collect();
        let plan = Plan::new(self.plan.geometry, self.plan.recording.clone(), taps, self.plan.truth().clone())?;
        Ok(Self { plan, records })
    }

    /// Its taps of tyres that `is_wanted` selects.
    pub(crate) fn of_tyres(&self, is_wanted: impl Fn(&str) -> bool) -> Result<Self> {
        self.only(|tap| is_wanted(tap.id.tyre.as_str()))
    }

    /// The reference from tyres that `is_wanted` selects, stated to be sound.
    pub(crate) fn reference(&self, config: &FuseConfig, is_wanted: impl Fn(&str) -> bool) -> Result<Arc<ReferenceSet>> {
        let scans = self.plan.scans().iter().enumerate().filter(|(_, scan)| is_wanted(scan.tyre.as_str()));
        let shoulders = scans.map(|(number, _)| KnownShoulder::of(&self.plan, &self.records, number, None));
        let shoulders: Option<Vec<_>> = shoulders.collect();
        let built = Built { config: config.clone(), ..Built::default() };
        Ok(Arc::new(build_reference(&built, shoulders.context("a shoulder is not planned")?)?))
    }

    /// The fusion after all of its taps, compared with `reference`, or by the reference of `config`, which is each casing by itself
    /// if it names none.
    pub(crate) fn fusion(&self, config: &FuseConfig, reference: Option<&Arc<ReferenceSet>>) -> Result<Fusion> {
        let own = config.reference.clone().or(Some(Reference::Own));
        let config = FuseConfig { reference: own, ..config.clone() };
        let mut fusion = Fusion::by(&config, &self.plan, reference.cloned())?;
        self.records.iter().try_for_each(|record| fusion.push(record))?;
        (0..self.plan.scans().len()).try_for_each(|number| fusion.end(number))?;
        Ok(fusion)
    }

    /// Whether each location of `scan` is cracked.
    pub(crate) fn is_cracked(&self, scan: &Scan) -> Vec<bool> {
        let truth = |location| self.plan.truth().get(&(scan.tyre, scan.shoulder, location)).copied();
        scan.locations.iter().map(|&(location, _)| truth(location).unwrap_or(false)).collect()
    }
}
