//! Shoulders judged by the fusion, with the truth about them.

use std::sync::Arc;

use anyhow::Result;
use tapline_fuse::{FuseConfig, Fusion, Reference, ReferenceSet};
use tapline_wire::{Reasons, Verdict};

use super::dataset::Dataset;

/// One shoulder.
#[derive(Debug, Clone)]
pub(super) struct ShoulderResult {
    pub tyre: String,
    pub shoulder: u16,
    pub is_passed: bool,
    /// Whether an index that was asked for could not be learned, so that the mean was used.
    pub has_fallen_back: bool,
    /// Damage index of each location; NaN where there is none.
    pub index: Vec<f64>,
    /// Index from which a location is suspect.
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
}

/// What shoulders are compared with.
#[derive(Debug, Clone)]
pub(super) enum ComparedWith {
    /// Each tyre with itself.
    Itself,
    /// The shoulders of a file.
    File(Arc<ReferenceSet>),
}

/// The shoulders of `taken`, in the order of its plan.
pub(super) fn judge(config: &FuseConfig, dataset: &Dataset, by: &ComparedWith) -> Result<Vec<ShoulderResult>> {
    let with = |reference| FuseConfig { reference: Some(reference), ..config.clone() };
    let mut fusion = match by {
        ComparedWith::Itself => Fusion::new(&with(Reference::Own), &dataset.plan)?,
        ComparedWith::File(set) => {
            Fusion::with_reference(&with(Reference::File("study.json".into())), &dataset.plan, set.clone())?
        }
    };
    dataset.records.iter().try_for_each(|record| fusion.push(record))?;
    for number in 0..dataset.plan.scans().len() {
        fusion.end(number)?;
    }
    let judged = |(number, scan): (usize, &tapline_wire::Scan)| {
        let (judgement, cells) = fusion.judge(number)?;
        let truth = |location| dataset.plan.truth().get(&(scan.tyre, scan.shoulder, location)).copied();
        Ok(ShoulderResult {
            tyre: scan.tyre.to_string(),
            shoulder: scan.shoulder,
            is_passed: judgement.verdict == Verdict::Pass.code(),
            has_fallen_back: judgement.reasons.contains(Reasons::FELL_BACK),
            index: cells.iter().map(|cell| cell.damage_index).collect(),
            limit: judgement.limit_re_inspect,
            is_called: cells.iter().map(|cell| cell.region > 0).collect(),
            is_cracked: cells.iter().map(|cell| truth(cell.location).unwrap_or(false)).collect(),
        })
    };
    dataset.plan.scans().iter().enumerate().map(judged).collect()
}

/// Intersection of called and cracked locations over their union, all shoulders together; `None` where both are empty.
pub(super) fn overlap(judged: &[ShoulderResult]) -> Option<f64> {
    let places = || judged.iter().flat_map(|j| j.is_called.iter().zip(&j.is_cracked));
    let both = places().filter(|&(&called, &cracked)| called && cracked).count();
    let either = places().filter(|&(&called, &cracked)| called || cracked).count();
    (either > 0).then(|| both as f64 / either as f64)
}
