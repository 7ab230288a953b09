//! Shoulders judged by the fusion, with the truth about them.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use tapline_fuse::{FuseConfig, Fusion, Reference, ReferenceSet};
use tapline_wire::{Discriminator, Verdict};

use super::dataset::Dataset;
use crate::evaluation::ShoulderResult;

/// The fusion after all taps of `dataset`, compared with the shoulders of a reference, or each tyre with itself.
fn fusion(config: &FuseConfig, dataset: &Dataset, by: Option<&Arc<ReferenceSet>>) -> Result<Fusion> {
    let config = FuseConfig { reference: Some(Reference::Own), ..config.clone() };
    let mut fusion = Fusion::by(&config, &dataset.plan, by.cloned())?;
    dataset.records.iter().try_for_each(|record| fusion.push(record))?;
    (0..dataset.plan.scans().len()).try_for_each(|number| fusion.end(number))?;
    Ok(fusion)
}

/// The shoulders of `dataset`, in the order of its plan, compared with those of `by` or each tyre with itself.
pub(super) fn judge(
    config: &FuseConfig,
    dataset: &Dataset,
    by: Option<&Arc<ReferenceSet>>,
) -> Result<Vec<ShoulderResult>> {
    let mut fusion = fusion(config, dataset, by)?;
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

/// The score of each discriminator on the shoulders of `dataset`, in place of the index; nothing is called.
pub(super) fn alone(
    dataset: &Dataset,
    by: Option<&Arc<ReferenceSet>>,
) -> Result<Vec<(Discriminator, Vec<ShoulderResult>)>> {
    let config = FuseConfig { discriminators: Discriminator::ALL.to_vec(), ..FuseConfig::default() };
    let mut fusion = fusion(&config, dataset, by)?;
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
