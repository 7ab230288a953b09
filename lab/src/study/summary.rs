//! The default index compared with what it must beat, set by set.

use crate::evaluation::{Areas, Cell, FALSE_ALARMS, FoundAt, Table, cell, ends};
use tapline_fuse::IndexKind;
use tapline_wire::Discriminator;

use super::candidates::{Candidate, SingleDiscriminator, best_alone, find};

/// An area, and by how much that of the default index exceeds it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rival {
    pub auc: f64,
    pub gain: f64,
    /// 95 % interval of the gain by tyres.
    pub interval: Option<(f64, f64)>,
}

/// The default index by the healthy reference on one set.
#[derive(Debug, Clone)]
pub(super) struct OfSet {
    pub set: &'static str,
    pub auc: f64,
    /// 95 % interval by tyres.
    pub interval: Option<(f64, f64)>,
    pub best_alone: Discriminator,
    /// That discriminator, and the dissertation's index by the same reference.
    pub alone: Rival,
    pub dissertation: Rival,
    /// AUC of the default index, each tyre by itself.
    pub by_itself: Option<f64>,
    /// What is found at 5 % false calls.
    pub found: Option<FoundAt>,
}

/// The default index on each of `sets`.
pub(super) fn of_sets(
    candidates: &[Candidate],
    alone: &[SingleDiscriminator],
    sets: &[&'static str],
    seed: u64,
) -> Vec<OfSet> {
    let of_set = |&set: &&'static str| {
        let default = &find(candidates, set, "healthy", IndexKind::default())?.areas;
        let auc = default.auc()?;
        let rival = |areas: &Areas| {
            let theirs = areas.auc()?;
            Some(Rival { auc: theirs, gain: auc - theirs, interval: default.above_by_tyres(areas, seed) })
        };
        let single = best_alone(alone, set)?;
        Some(OfSet {
            set,
            auc,
            interval: default.by_tyres(seed),
            best_alone: single.which,
            alone: rival(&single.areas)?,
            dissertation: rival(&find(candidates, set, "healthy", IndexKind::Dissertation)?.areas)?,
            by_itself: find(candidates, set, "self", IndexKind::default()).and_then(|own| own.areas.auc()),
            found: default.found_at(FALSE_ALARMS, seed),
        })
    };
    sets.iter().filter_map(of_set).collect()
}

pub(super) fn table(of_sets: &[OfSet]) -> Table {
    let title = "AUC of the default index by a healthy reference, beside the best discriminator alone and the dissertation's index by \
                 the same reference, and beside the default index of each tyre by itself. Intervals are by tyres";
    let columns = "set default low high best_alone alone gain gain_low gain_high dissertation over_dissertation over_low \
                   over_high self";
    let mut table = Table::new("default", title, columns.split(' '));
    for of in of_sets {
        let rival = |rival: &Rival| -> Vec<Cell> {
            [cell(rival.auc), cell(rival.gain)].into_iter().chain(ends(rival.interval)).collect()
        };
        let mut row = vec![of.set.into(), cell(of.auc)];
        row.extend(ends(of.interval));
        row.push(of.best_alone.name().into());
        row.extend(rival(&of.alone));
        row.extend(rival(&of.dissertation));
        row.push(cell(of.by_itself));
        table.push(row);
    }
    table
}
