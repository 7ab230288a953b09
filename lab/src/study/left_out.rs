//! Indices that learn from labels, each tyre judged by what all others teach.

use std::collections::BTreeMap;

use crate::statistics::auc_left_out;
use anyhow::{Context as _, Result};
use tapline_fuse::{FuseConfig, IndexKind};

use super::candidates::TrainTest;
use super::judge::ComparedWith;
use super::judge::judge;
use super::parallel::each;
use super::table::{Table, cell};

/// The default index, and those that learn more from labels than which locations are sound.
pub(super) const LEARNED: [IndexKind; 5] =
    [IndexKind::Repeatability, IndexKind::Robust, IndexKind::Auc, IndexKind::Lda, IndexKind::LogOdds];

/// One index on one set.
#[derive(Debug, Clone)]
pub(super) struct LeftOut {
    pub set: &'static str,
    pub index: IndexKind,
    /// AUC of each cracked tyre, in the order of their serials.
    pub by_tyre: Vec<f64>,
}

/// Each cracked tyre of `split` left out once, by every index.
pub(super) fn left_out(split: &TrainTest, threads: usize) -> Result<Vec<LeftOut>> {
    let cracked = split.cracked();
    each(&LEARNED, threads, |&index| {
        let config = FuseConfig { index, ..FuseConfig::default() };
        // Places are locations of cracked tyres; sound tyres teach always.
        let mut groups = Vec::new();
        let mut places = Vec::new();
        let mut labels = Vec::new();
        for (&(serial, shoulder, location), &label) in split.dataset.plan.truth() {
            if cracked.iter().any(|tyre| tyre == serial.as_str()) {
                groups.push(serial.to_string());
                places.push((shoulder, location));
                labels.push(label);
            }
        }
        let mut failed = None;
        let fit = |train: &[usize]| {
            let teaches = |tyre: &str| !cracked.iter().any(|t| t == tyre) || train.iter().any(|&p| groups[p] == tyre);
            let judged = split.dataset.reference(true, teaches).and_then(|set| {
                judge(&config, &split.dataset.of_tyres(|tyre| !teaches(tyre))?, &ComparedWith::File(set))
            });
            let map = judged.map(|judged| -> BTreeMap<(u16, u32), f64> {
                judged.iter().flat_map(|j| (0..).zip(&j.index).map(|(l, &x)| ((j.shoulder, l), x))).collect()
            });
            map.unwrap_or_else(|error| {
                failed = Some(error);
                BTreeMap::new()
            })
        };
        let score =
            |map: &BTreeMap<(u16, u32), f64>, place: usize| map.get(&places[place]).copied().unwrap_or(f64::NAN);
        let by_tyre = auc_left_out(&groups, &labels, fit, score).context("fewer than two cracked tyres")?;
        if let Some(error) = failed {
            return Err(error);
        }
        Ok(LeftOut { set: split.name, index, by_tyre: by_tyre.into_iter().filter_map(|(_, auc)| auc).collect() })
    })
}

/// The table of them.
pub(super) fn table(all: &[LeftOut]) -> Table {
    let mut table = Table::long(
        "left_out",
        "Each cracked tyre judged by what all others teach, labelled: mean, least and greatest AUC of a tyre",
        &["set", "index", "tyres", "mean_auc", "least_auc", "greatest_auc"],
    );
    for l in all {
        let ends = [l.by_tyre.iter().copied().min_by(f64::total_cmp), l.by_tyre.iter().copied().max_by(f64::total_cmp)];
        let row = [l.set.into(), l.index.name().into(), l.by_tyre.len().into(), cell(mean(&l.by_tyre))];
        table.push(row.into_iter().chain(ends.map(cell)));
    }
    table
}

/// The mean; `None` of nothing.
pub(super) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
