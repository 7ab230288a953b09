//! Shoulders that were judged, with the truth about them.

use anyhow::{Context as _, Result};
use tapline_wire::{DamageCell, Judgement, Scan, Verdict};

/// A shoulder as the fusion judged it, with the truth about it.
#[derive(Debug, Clone)]
pub struct ShoulderResult {
    /// Serial number of its casing.
    pub tyre: String,
    /// Side of the casing, 1 or 2.
    pub shoulder: u16,
    /// Its verdict.
    pub verdict: Verdict,
    /// Damage index of each location; NaN where there is none.
    pub index: Vec<f64>,
    /// How far the strongest arc stands out; NaN where there is none.
    pub strongest_arc: f64,
    /// What the strongest arc must reach for the shoulder to be inspected again.
    pub limit: f64,
    /// Whether each location lies in a region.
    pub is_called: Vec<bool>,
    /// Whether each location is cracked.
    pub is_cracked: Vec<bool>,
}

impl ShoulderResult {
    /// The result of `scan`, with the truth about its locations.
    pub(crate) fn new(
        scan: &Scan,
        (judgement, cells): &(Judgement, Vec<DamageCell>),
        is_cracked: Vec<bool>,
    ) -> Result<Self> {
        Ok(Self {
            tyre: scan.tyre.to_string(),
            shoulder: scan.shoulder,
            verdict: Verdict::from_code(judgement.verdict).context("a shoulder has no verdict")?,
            index: cells.iter().map(|cell| cell.damage_index).collect(),
            strongest_arc: judgement.strongest_arc,
            limit: judgement.limit_re_inspect,
            is_called: cells.iter().map(|cell| cell.region > 0).collect(),
            is_cracked,
        })
    }

    /// Whether it has no crack.
    pub(crate) fn is_sound(&self) -> bool {
        !self.is_cracked.contains(&true)
    }

    /// A passed shoulder that has nothing but an index.
    #[cfg(test)]
    pub(crate) fn with_index(tyre: &str, index: &[f64], is_cracked: &[bool]) -> Self {
        Self {
            tyre: tyre.to_owned(),
            shoulder: 1,
            verdict: Verdict::Pass,
            index: index.to_vec(),
            strongest_arc: f64::NAN,
            limit: 1.0,
            is_called: vec![false; index.len()],
            is_cracked: is_cracked.to_vec(),
        }
    }
}

/// Intersection of called and cracked locations over their union, all shoulders together; `None` where both are empty.
pub(crate) fn overlap(judged: &[ShoulderResult]) -> Option<f64> {
    let places = || judged.iter().flat_map(|j| j.is_called.iter().zip(&j.is_cracked));
    let both = places().filter(|&(&called, &cracked)| called && cracked).count();
    let either = places().filter(|&(&called, &cracked)| called || cracked).count();
    (either > 0).then(|| both as f64 / either as f64)
}
