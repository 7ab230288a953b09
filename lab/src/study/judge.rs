//! Shoulders judged by the fusion, with the truth about them.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use tapline_fuse::{FuseConfig, Fusion, Reference, ReferenceSet};
use tapline_wire::{Discriminator, Verdict};

use super::dataset::Dataset;
use crate::evaluation::ShoulderResult;

/// What shoulders are compared with.
#[derive(Debug, Clone)]
pub(super) enum ComparedWith {
    /// Each tyre with itself.
    Itself,
    /// The shoulders of a file.
    File(Arc<ReferenceSet>),
}

impl ComparedWith {
    /// The fusion that has had all taps of `dataset`.
    fn fusion(&self, config: &FuseConfig, dataset: &Dataset) -> Result<Fusion> {
        let with = |reference| FuseConfig { reference: Some(reference), ..config.clone() };
        let mut fusion = match self {
            Self::Itself => Fusion::new(&with(Reference::Own), &dataset.plan)?,
            Self::File(set) => {
                Fusion::with_reference(&with(Reference::File("study.json".into())), &dataset.plan, set.clone())?
            }
        };
        dataset.records.iter().try_for_each(|record| fusion.push(record))?;
        for number in 0..dataset.plan.scans().len() {
            fusion.end(number)?;
        }
        Ok(fusion)
    }
}

/// The shoulders of `dataset`, in the order of its plan.
pub(super) fn judge(config: &FuseConfig, dataset: &Dataset, by: &ComparedWith) -> Result<Vec<ShoulderResult>> {
    let mut fusion = by.fusion(config, dataset)?;
    let judged = |number: usize| {
        let (judgement, cells) = fusion.judge(number)?;
        Ok(ShoulderResult {
            verdict: Verdict::from_code(judgement.verdict).context("a shoulder has no verdict")?,
            index: cells.iter().map(|cell| cell.damage_index).collect(),
            strongest_arc: judgement.strongest_arc,
            limit: judgement.limit_re_inspect,
            is_called: cells.iter().map(|cell| cell.region > 0).collect(),
            ..unjudged(dataset, number)
        })
    };
    (0..dataset.plan.scans().len()).map(judged).collect()
}

/// What each discriminator says of the shoulders of `dataset`, in place of the index; nothing is called.
pub(super) fn alone(dataset: &Dataset, by: &ComparedWith) -> Result<Vec<(Discriminator, Vec<ShoulderResult>)>> {
    let config = FuseConfig { discriminators: Discriminator::ALL.to_vec(), ..FuseConfig::default() };
    let mut fusion = by.fusion(&config, dataset)?;
    let mut found = Discriminator::ALL.map(|which| (which, Vec::new())).to_vec();
    for number in 0..dataset.plan.scans().len() {
        for (which, results) in &mut found {
            results.push(ShoulderResult { index: fusion.alone(number, *which)?, ..unjudged(dataset, number) });
        }
    }
    Ok(found)
}

/// Scan number `number` of `dataset`, with the truth and nothing else.
fn unjudged(dataset: &Dataset, number: usize) -> ShoulderResult {
    let scan = &dataset.plan.scans()[number];
    let truth = |location| dataset.plan.truth().get(&(scan.tyre, scan.shoulder, location)).copied();
    ShoulderResult {
        tyre: scan.tyre.to_string(),
        shoulder: scan.shoulder,
        verdict: Verdict::Pass,
        index: Vec::new(),
        strongest_arc: f64::NAN,
        limit: f64::NAN,
        is_called: Vec::new(),
        is_cracked: scan.locations.iter().map(|&(location, _)| truth(location).unwrap_or(false)).collect(),
    }
}
