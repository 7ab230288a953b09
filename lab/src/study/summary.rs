//! The few tables that answer what is asked of the study, out of the long ones.

use tapline_fuse::{Combine, IndexKind};

use super::candidates::{Candidate, SingleDiscriminator, best_alone};
use super::left_out::{LEARNED, LeftOut, mean};
use super::table::{Cell, Table, cell, ends};

/// The candidate that is `index` with `combine` by `reference` on `set`.
pub(super) fn find<'a>(
    candidates: &'a [Candidate],
    set: &str,
    reference: &str,
    index: IndexKind,
    combine: Combine,
) -> Option<&'a Candidate> {
    candidates.iter().find(|r| r.set == set && r.reference == reference && r.index == index && r.combine == combine)
}

/// The default index on `set`, by `reference`.
pub(super) fn default_of<'a>(candidates: &'a [Candidate], set: &str, reference: &str) -> Option<&'a Candidate> {
    find(candidates, set, reference, IndexKind::default(), Combine::default())
}

/// The best of the candidates on `set` by `reference`.
pub(super) fn best<'a>(candidates: &'a [Candidate], set: &str, reference: &str) -> Option<&'a Candidate> {
    let area = |r: &Candidate| r.areas.auc().unwrap_or(0.0);
    candidates.iter().filter(|r| r.set == set && r.reference == reference).max_by(|a, b| area(a).total_cmp(&area(b)))
}

/// The default index on every set beside the best discriminator alone, the dissertation's index and the best candidate.
pub(super) fn default_table(
    candidates: &[Candidate],
    alone: &[SingleDiscriminator],
    sets: &[&'static str],
    seed: u64,
) -> Table {
    let mut table = Table::new(
        "default",
        "AUC of the default index (weights by repeatability, largest over runs of offsets, mean of three along the ring) by a healthy reference, on held-out tyres. The gains over the best discriminator alone and over the dissertation's index have intervals by tyres",
        &[
            "set",
            "default",
            "low",
            "high",
            "best_alone",
            "alone",
            "gain",
            "gain_low",
            "gain_high",
            "dissertation",
            "over_dissertation",
            "over_low",
            "over_high",
            "self",
            "best_index",
            "best_combine",
            "best",
        ],
    );
    for &set in sets {
        let (Some(default), Some(single), Some(best)) =
            (default_of(candidates, set, "healthy"), best_alone(alone, set), best(candidates, set, "healthy"))
        else {
            continue;
        };
        let gain = default.areas.auc().zip(single.areas.auc()).map(|(a, b)| a - b);
        let dissertation = find(candidates, set, "healthy", IndexKind::Dissertation, Combine::default());
        let own = default_of(candidates, set, "self");
        let mut row = vec![set.into(), cell(default.areas.auc())];
        row.extend(ends(default.areas.by_tyres(seed)));
        row.extend([single.which.name().into(), cell(single.areas.auc()), cell(gain)]);
        row.extend(ends(default.areas.above_by_tyres(&single.areas, seed)));
        let of_dissertation = dissertation.and_then(|d| d.areas.auc());
        row.extend([cell(of_dissertation), cell(default.areas.auc().zip(of_dissertation).map(|(a, b)| a - b))]);
        row.extend(ends(dissertation.and_then(|d| default.areas.above_by_tyres(&d.areas, seed))));
        row.push(cell(own.and_then(|r| r.areas.auc())));
        row.extend([best.index.name().into(), best.combine.name().into(), cell(best.areas.auc())]);
        table.push(row);
    }
    table
}

/// The mean of conditions beside the largest of them, index and reference being those of the default table.
pub(super) fn largest_table(candidates: &[Candidate], sets: &[&'static str], seed: u64) -> Table {
    let title = "AUC of the default index by a healthy reference, on held-out tyres, with the mean of the conditions and with the largest";
    let mut table = Table::new("largest", title, &["set", "mean", "largest", "gain", "gain_low", "gain_high"]);
    for &set in sets {
        let with = |combine| find(candidates, set, "healthy", IndexKind::default(), combine);
        let (Some(mean), Some(largest)) = (with(Combine::Mean), with(Combine::Largest)) else { continue };
        let areas = [mean, largest].map(|candidate| candidate.areas.auc());
        let gain = areas[1].zip(areas[0]).map(|(a, b)| a - b);
        let mut row = vec![set.into()];
        row.extend(areas.into_iter().chain([gain]).map(cell));
        row.extend(ends(largest.areas.above_by_tyres(&mean.areas, seed)));
        table.push(row);
    }
    table
}

/// A way of judging, as a row of a table by sets.
struct Way {
    reference: &'static str,
    index: IndexKind,
    combine: Combine,
    by_set: Vec<f64>,
}

/// Every way of judging with its AUC on every set, the best on average first.
pub(super) fn ways_table(candidates: &[Candidate], sets: &[&'static str]) -> Table {
    let columns = [&["reference", "index", "combine", "mean", "least"][..], sets].concat();
    let title = "AUC of every reference, index and combination on held-out tyres of every set, the best mean first";
    let mut table = Table::new("ways", title, &columns);
    let mut ways: Vec<Way> = Vec::new();
    for r in candidates {
        let is_it = |w: &&mut Way| w.reference == r.reference && w.index == r.index && w.combine == r.combine;
        let auc = r.areas.auc().unwrap_or(f64::NAN);
        match ways.iter_mut().find(is_it) {
            Some(way) => way.by_set.push(auc),
            None => ways.push(Way { reference: r.reference, index: r.index, combine: r.combine, by_set: vec![auc] }),
        }
    }
    ways.sort_by(|a, b| mean(&b.by_set).unwrap_or(0.0).total_cmp(&mean(&a.by_set).unwrap_or(0.0)));
    for way in ways {
        let least = way.by_set.iter().copied().min_by(f64::total_cmp);
        let head = [way.reference, way.index.name(), way.combine.name()].map(Cell::from);
        let numbers = [cell(mean(&way.by_set)), cell(least)].into_iter().chain(way.by_set.iter().map(|&auc| cell(auc)));
        table.push(head.into_iter().chain(numbers));
    }
    table
}

/// Each index that is learned from labelled tyres, left-out tyre by left-out tyre.
pub(super) fn left_out_table(left_out: &[LeftOut], sets: &[&'static str]) -> Table {
    let columns = [&["index", "mean"][..], sets].concat();
    let title = "Each cracked tyre judged by what all others teach, labelled: mean AUC of the tyres";
    let mut table = Table::new("left_out_by_set", title, &columns);
    let mut rows: Vec<(IndexKind, Vec<f64>)> = Vec::new();
    for index in LEARNED {
        let of_set =
            |set: &&str| left_out.iter().find(|l| l.index == index && l.set == *set).and_then(|l| mean(&l.by_tyre));
        rows.push((index, sets.iter().map(|set| of_set(set).unwrap_or(f64::NAN)).collect()));
    }
    rows.sort_by(|a, b| mean(&b.1).unwrap_or(0.0).total_cmp(&mean(&a.1).unwrap_or(0.0)));
    for (index, by_set) in rows {
        table.push([index.name().into(), cell(mean(&by_set))].into_iter().chain(by_set.iter().map(|&x| cell(x))));
    }
    table
}
