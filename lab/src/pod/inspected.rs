//! Shoulders that were scanned and inspected by other means: the first scan of each. Looks at the same crack are not
//! independent, so later scans are only used where repeated scans are compared.

use super::archives::{Scanned, Scans};
use super::truth::{Crack, KnownTruth};
use crate::evaluation::{Table, cell, yes_or_no};

#[derive(Debug)]
pub(super) struct InspectedShoulder {
    /// Its first scan, with the truth.
    pub scan: Scanned,
    pub cracks: Vec<Crack>,
}

/// All of them, by casing and shoulder.
pub(super) fn inspected(scans: &Scans, truth: &KnownTruth) -> Vec<InspectedShoulder> {
    let of = |(shoulder, scans): (_, &Vec<Scanned>)| {
        let cracks = truth.shoulders.get(shoulder)?.cracks.clone();
        let mut scan = scans.first()?.clone();
        for crack in &cracks {
            let places: Vec<usize> = scan.places_of(crack).collect();
            places.into_iter().for_each(|place| scan.result.is_cracked[place] = true);
        }
        Some(InspectedShoulder { scan, cracks })
    };
    scans.of_shoulder.iter().filter_map(of).collect()
}

impl InspectedShoulder {
    /// Whether it has no crack, not even where it was not tapped.
    pub(super) fn is_sound(&self) -> bool {
        self.cracks.is_empty()
    }
}

pub(super) fn table(inspected: &[InspectedShoulder]) -> Table {
    let columns = "tyre shoulder archive cracks verdict strongest_arc limit_re_inspect limit_reject sound".split(' ');
    let mut table = Table::long("shoulders", "Every shoulder that was inspected, by its first scan", columns);
    for shoulder in inspected {
        let InspectedShoulder { scan, cracks } = shoulder;
        table.push([
            scan.result.tyre.clone().into(),
            usize::from(scan.result.shoulder).into(),
            scan.archive.clone().into(),
            cracks.len().into(),
            scan.result.verdict.to_string().into(),
            cell(scan.result.strongest_arc),
            cell(scan.judgement.limit_re_inspect),
            cell(scan.judgement.limit_reject),
            yes_or_no(shoulder.is_sound()),
        ]);
    }
    table
}
