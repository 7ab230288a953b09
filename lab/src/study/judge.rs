//! Shoulders judged by the fusion, with the truth about them.

use std::sync::Arc;

use anyhow::Result;
use tapline_fuse::{FuseConfig, ReferenceSet};
use tapline_wire::Discriminator;

use crate::evaluation::Areas;
use crate::shoulder_result::ShoulderResult;
use crate::simulated::Dataset;

/// The shoulders of `dataset`, in the order of its plan, compared with those of `by` or each tyre with itself.
pub(super) fn judge(
    config: &FuseConfig,
    dataset: &Dataset,
    by: Option<&Arc<ReferenceSet>>,
) -> Result<Vec<ShoulderResult>> {
    let mut fusion = dataset.fusion(config, by)?;
    let scans = dataset.plan.scans().iter().enumerate();
    scans.map(|(number, scan)| ShoulderResult::new(scan, &fusion.judge(number)?, dataset.is_cracked(scan))).collect()
}

/// The areas of the score of each discriminator on the shoulders of `dataset`, in place of the index.
pub(super) fn alone(dataset: &Dataset, by: Option<&Arc<ReferenceSet>>) -> Result<Vec<(Discriminator, Areas)>> {
    let config = FuseConfig { discriminators: Discriminator::ALL.to_vec(), ..FuseConfig::default() };
    let mut fusion = dataset.fusion(&config, by)?;
    let mut places = Discriminator::ALL.map(|_| Vec::new());
    for (number, scan) in dataset.plan.scans().iter().enumerate() {
        let is_cracked = dataset.is_cracked(scan);
        for (which, places) in Discriminator::ALL.into_iter().zip(&mut places) {
            let scores = fusion.alone(number, which)?.into_iter().zip(&is_cracked);
            places.extend(scores.map(|(score, &is_cracked)| (scan.tyre.to_string(), score, is_cracked)));
        }
    }
    Ok(Discriminator::ALL.into_iter().zip(places.map(|places| Areas::of(places.into_iter()))).collect())
}
