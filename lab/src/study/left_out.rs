//! Indices that learn from labels, each tyre judged by what all others teach.

use std::collections::BTreeMap;

use crate::statistics::auc_left_out;
use anyhow::{Context as _, Result};
use tapline_fuse::{FuseConfig, IndexKind};

use super::judged::By;
use super::judged::judge;
use super::rivals::Halves;
use super::table::{Table, cell};
use super::work::each;

/// The default index, and those that learn more from labels than which locations are sound.
pub(super) const LEARNED: [IndexKind; 5] =
    [IndexKind::Repeatability, IndexKind::Robust, IndexKind::Auc, IndexKind::Lda, IndexKind::LogOdds];

/// One index on one set.
#[derive(Debug, Clone)]
pub(super) struct LeftOut {
    pub(super) set: &'static str,
    pub(super) index: IndexKind,
    /// AUC of each cracked tyre, in the order of their serials.
    pub(super) by_tyre: Vec<f64>,
}

/// Each cracked tyre of `halves` left out once, by every index.
pub(super) fn left_out(halves: &Halves, threads: usize) -> Result<Vec<LeftOut>> {
    let cracked = halves.cracked();
    each(&LEARNED, threads, |&index| {
        let config = FuseConfig { index, ..FuseConfig::default() };
        // Places are locations of cracked tyres; sound tyres teach always.
        let mut groups = Vec::new();
        let mut places = Vec::new();
        let mut labels = Vec::new();
        for (&(serial, shoulder, location), &label) in halves.taken.plan.truth() {
            if cracked.iter().any(|tyre| tyre == serial.as_str()) {
                groups.push(serial.to_string());
                places.push((shoulder, location));
                labels.push(label);
            }
        }
        let mut failed = None;
        let fit = |train: &[usize]| {
            let teaches = |tyre: &str| !cracked.iter().any(|t| t == tyre) || train.iter().any(|&p| groups[p] == tyre);
            let judged = halves
                .taken
                .reference(true, teaches)
                .and_then(|set| judge(&config, &halves.taken.of_tyres(|tyre| !teaches(tyre))?, &By::File(set)));
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
        Ok(LeftOut { set: halves.name, index, by_tyre: by_tyre.into_iter().filter_map(|(_, auc)| auc).collect() })
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
        let row = [l.set.to_owned(), l.index.name().to_owned(), l.by_tyre.len().to_string(), cell(mean(&l.by_tyre))];
        table.push(row.into_iter().chain(ends.map(cell)));
    }
    table
}

/// The mean; `None` of nothing.
pub(super) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
