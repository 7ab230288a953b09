//! The casings of a list, before anything is scanned.

use std::collections::BTreeSet;

use anyhow::{Result, ensure};

use crate::config::job::Job;
use crate::config::reference::remark_on_bands;
use crate::line::setup::{Arriving, Setup};

/// The casings of a list, checked.
#[derive(Debug)]
pub(super) struct Listed {
    pub names: Vec<String>,
    pub tap_count: usize,
    /// Digests of the plans of recorded taps; simulated ones follow from the configuration.
    pub plans: Vec<String>,
}

impl Listed {
    pub(super) fn check(job: &Job, setup: &Setup) -> Result<Self> {
        let fusions = job.fusions();
        let is_simulated = setup.arriving == Arriving::Simulated;
        let mut known = BTreeSet::new();
        let mut listed = Self { names: Vec::new(), tap_count: 0, plans: Vec::new() };
        let list = setup.arriving.list(job)?;
        for casing in list.iter().flat_map(|list| list.listed()) {
            let (name, _station, plan) = casing?;
            // Simulated tyres differ only in their names; each recorded one has taps of its own.
            match !is_simulated || listed.names.is_empty() {
                true => drop(fusions.check(&plan)?),
                false => fusions.check_shoulder(&plan)?,
            }
            ensure!(known.insert(name.clone()), "two casings are called {name}: each needs a name of its own");
            if listed.names.is_empty() {
                let bands = remark_on_bands(&job.config.process, &plan.recording);
                let conditions = fusions.remark_on_conditions(&plan);
                bands.iter().chain(&conditions).for_each(|text| tracing::warn!("{text}"));
            }
            listed.tap_count += plan.taps().len();
            if !is_simulated {
                listed.plans.push(format!("{name} {:016x}", plan.digest()));
            }
            listed.names.push(name);
        }
        Ok(listed)
    }
}
