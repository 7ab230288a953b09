//! Which offsets, velocities and repetitions are worth their time: parts of the full plan, from the same taps.

use crate::evaluation::{Areas, Table, cell, ends, yes_or_no};
use anyhow::{Context as _, Result};
use tapline_fuse::FuseConfig;

use super::candidates::Split;
use super::dataset::Turns;
use super::judge::judge;
use super::parallel::each;

/// Of a tap on the dissertation's rig: 170 s for a turn of 100 locations.
const TAP_S: f64 = 1.7;
/// Taps of a turn there, whatever is simulated.
const TURN_TAPS: f64 = 100.0;
/// Of a casing on the competing machine.
pub(super) const COMPETITOR_CASING_S: f64 = 60.0;
/// By how much a plan may fall short of the full one.
const SHORTFALL: f64 = 0.01;

/// One plan.
#[derive(Debug, Clone)]
pub(super) struct PlanResult {
    pub turns: Turns,
    pub areas: Areas,
    pub auc: f64,
    pub shoulder_s: f64,
    /// Whether no plan that takes no more time is better.
    pub is_on_front: bool,
}

/// Every part of the `full` plan, by the default index and the healthy reference; the full plan last.
pub(super) fn plans(split: &Split, full: &Turns, threads: usize) -> Result<Vec<PlanResult>> {
    let mut turns = Vec::new();
    for offsets_mm in subsets(&full.offsets_mm) {
        for velocities_m_per_s in subsets(&full.velocities_m_per_s) {
            for repetitions in 1..=full.repetitions {
                let offsets_mm = offsets_mm.clone();
                turns.push(Turns { offsets_mm, velocities_m_per_s: velocities_m_per_s.clone(), repetitions });
            }
        }
    }
    let mut tried = each(&turns, threads, |turns| {
        let part = split.with(turns)?;
        let areas = Areas::new(&judge(&FuseConfig::default(), &part.judged()?, &part.healthy()?)?);
        let auc = areas.auc().context("a plan has no area: no crack was planted, or nothing is sound")?;
        let shoulder_s = turns.count() as f64 * TURN_TAPS * TAP_S;
        Ok(PlanResult { turns: turns.clone(), areas, auc, shoulder_s, is_on_front: false })
    })?;
    for k in 0..tried.len() {
        let beats = |other: &PlanResult| {
            other.shoulder_s <= tried[k].shoulder_s && other.auc > tried[k].auc
                || other.shoulder_s < tried[k].shoulder_s && other.auc >= tried[k].auc
        };
        tried[k].is_on_front = !tried.iter().any(beats);
    }
    Ok(tried)
}

/// The subsets of `values` but the empty one, all of them last.
fn subsets(values: &[f64]) -> Vec<Vec<f64>> {
    let chosen = |mask: u32| (0..).zip(values).filter(|&(bit, _)| mask >> bit & 1 == 1).map(|(_, &v)| v).collect();
    (1..1_u32 << values.len()).map(chosen).collect()
}

/// The cheapest plan that falls short of the full one by no more than allowed; of equally cheap ones the best.
pub(super) fn cheapest(tried: &[PlanResult]) -> Option<&PlanResult> {
    let full = tried.last()?;
    let is_enough = |t: &&PlanResult| t.auc >= full.auc - SHORTFALL;
    tried.iter().filter(is_enough).min_by(|a, b| a.shoulder_s.total_cmp(&b.shoulder_s).then(b.auc.total_cmp(&a.auc)))
}

fn list(values: &[f64]) -> String {
    values.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

/// The table of `tried`, which are all of them or those of note.
pub(super) fn table(
    name: &'static str,
    title: &'static str,
    all: &[PlanResult],
    is_shown: impl Fn(&PlanResult) -> bool,
    seed: u64,
) -> Table {
    let columns = [
        "offsets_mm",
        "velocities_m_per_s",
        "repetitions",
        "shoulder_s",
        "casing_s",
        "auc",
        "short_of_full",
        "short_low",
        "short_high",
        "front",
    ];
    let mut table = Table::new(name, title, &columns);
    let Some(full) = all.last() else { return table };
    for t in all.iter().filter(|t| is_shown(t)) {
        let turns = &t.turns;
        let mut row = vec![
            list(&turns.offsets_mm).into(),
            list(&turns.velocities_m_per_s).into(),
            usize::from(turns.repetitions).into(),
        ];
        row.extend([t.shoulder_s, 2.0 * t.shoulder_s, t.auc, full.auc - t.auc].map(cell));
        row.extend(ends(full.areas.above_by_tyres(&t.areas, seed)));
        row.push(yes_or_no(t.is_on_front));
        table.push(row);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a part that is forgotten, the empty one among them, and a full one that is not the last.
    #[test]
    fn parts_are_all_and_the_whole_is_last() {
        let parts = subsets(&[1.0, 2.0, 3.0]);
        assert_eq!(parts.len(), 7);
        assert!(parts.iter().all(|part| !part.is_empty()));
        assert_eq!(parts.last().unwrap(), &[1.0, 2.0, 3.0]);
    }
}
