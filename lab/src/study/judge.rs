//! Shoulders judged by the fusion, with the truth about them.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use tapline_fuse::{FuseConfig, Fusion, Reference, ReferenceSet};
use tapline_wire::{Discriminator, Verdict};

use super::dataset::Dataset;

/// One shoulder.
#[derive(Debug, Clone)]
pub(super) struct ShoulderResult {
    pub tyre: String,
    pub shoulder: u16,
    pub verdict: Verdict,
    /// Damage index of each location; NaN where there is none.
    pub index: Vec<f64>,
    /// What the strongest arc must reach for the shoulder to be inspected again.
    pub limit: f64,
    /// Whether each location lies in a region.
    pub is_called: Vec<bool>,
    /// Whether each location is cracked.
    pub is_cracked: Vec<bool>,
}

impl ShoulderResult {
    /// Whether it has no crack.
    pub(super) fn is_sound(&self) -> bool {
        !self.is_cracked.contains(&true)
    }

    /// A passed shoulder that has nothing but an index.
    #[cfg(test)]
    pub(super) fn with_index(tyre: &str, index: &[f64], is_cracked: &[bool]) -> Self {
        Self {
            tyre: tyre.to_owned(),
            shoulder: 1,
            verdict: Verdict::Pass,
            index: index.to_vec(),
            limit: 1.0,
            is_called: vec![false; index.len()],
            is_cracked: is_cracked.to_vec(),
        }
    }
}

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
        limit: f64::NAN,
        is_called: Vec::new(),
        is_cracked: scan.locations.iter().map(|&(location, _)| truth(location).unwrap_or(false)).collect(),
    }
}

/// Intersection of called and cracked locations over their union, all shoulders together; `None` where both are empty.
pub(super) fn overlap(judged: &[ShoulderResult]) -> Option<f64> {
    let places = || judged.iter().flat_map(|j| j.is_called.iter().zip(&j.is_cracked));
    let both = places().filter(|&(&called, &cracked)| called && cracked).count();
    let either = places().filter(|&(&called, &cracked)| called || cracked).count();
    (either > 0).then(|| both as f64 / either as f64)
}
