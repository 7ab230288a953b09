//! The study's numbers beside published ones of other structures, for which nothing else of the kind is in print.

use super::summary::OfSet;
use crate::evaluation::{Cell, Detection, Table, cell, ends};

/// a90/95 in mm of honeycomb panels tapped by machine: NRC Canada, ICAF 2023, paper 55.
pub(super) const HONEYCOMB_A90_95_MM: f64 = 28.0;
/// TPR of concrete slabs, at a TNR of 0.95: Dorafshan & Azari, TRID 1748127.
pub(super) const SLABS_TPR: f64 = 0.7;

/// The a90/95 by hit/miss of the cracks of all depths.
pub(super) fn a90_95_mm(detection: &[Detection]) -> Option<f64> {
    detection.first()?.a90_95_mm()
}

pub(super) fn table(detection: &[Detection], of_sets: &[OfSet]) -> Table {
    let mut table = Table::new(
        "published",
        "This study beside published numbers of other structures: they show the usual size of such numbers, not which method is better. \
         TPR is the part of the cracked locations that is called at a limit that calls 5 % of the sound ones",
        ["number", "set", "here", "low", "high", "published", "published_of", "source"],
    );
    table.push([
        "a90/95 in mm, all depths, hit/miss".into(),
        "plain".into(),
        cell(a90_95_mm(detection)),
        Cell::Empty,
        Cell::Empty,
        cell(HONEYCOMB_A90_95_MM),
        "honeycomb panel tapped by machine: another structure".into(),
        "NRC Canada, ICAF 2023, paper 55".into(),
    ]);
    for (set, found) in of_sets.iter().filter_map(|of| Some((of.set, of.found?))) {
        let mut row = vec!["TPR at 5 % false calls".into(), set.into(), cell(found.rate)];
        row.extend(ends(found.interval));
        row.extend([
            cell(SLABS_TPR),
            "concrete slabs, TNR 0.95: another structure".into(),
            "Dorafshan & Azari, TRID 1748127".into(),
        ]);
        table.push(row);
    }
    table
}
