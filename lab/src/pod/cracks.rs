//! Which cracks are found. A find is a crack with at least one location in a region. Its response is the greatest damage index
//! along it over the limit of its shoulder, so that shoulders with different references can be pooled.

use crate::evaluation::{Cell, DETECTION_COLUMNS, Detection, Table, Target, cell, yes_or_no};
use tapline_wire::Verdict;

use super::archives::Scanned;
use super::inspected::InspectedShoulder;
use super::truth::Crack;

/// The two limits that a region may reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Limit {
    ReInspect,
    Reject,
}

impl Limit {
    const ALL: [Self; 2] = [Self::ReInspect, Self::Reject];

    fn class(self) -> &'static str {
        ["re-inspect limit", "reject limit"][self as usize]
    }

    fn value(self, scan: &Scanned) -> f64 {
        match self {
            Self::ReInspect => scan.judgement.limit_re_inspect,
            Self::Reject => scan.judgement.limit_reject,
        }
    }

    /// Whether the region of `place` reaches it.
    fn is_reached(self, scan: &Scanned, place: usize) -> bool {
        let is_called = scan.result.is_called[place];
        match self {
            Self::ReInspect => is_called,
            Self::Reject => {
                is_called
                    && scan.region_index[place] >= scan.judgement.limit_reject
                    && scan.result.verdict == Verdict::Reject
            }
        }
    }

    fn is_found(self, scan: &Scanned, crack: &Crack) -> bool {
        scan.places_of(crack).any(|place| self.is_reached(scan, place))
    }

    fn response(self, scan: &Scanned, crack: &Crack) -> f64 {
        highest(scan, crack) / self.value(scan)
    }
}

/// Greatest index along `crack`; NaN where there is none.
fn highest(scan: &Scanned, crack: &Crack) -> f64 {
    let index = scan.places_of(crack).map(|place| scan.result.index[place]).filter(|x| !x.is_nan());
    index.max_by(f64::total_cmp).unwrap_or(f64::NAN)
}

/// The cracks whose size is known, at each limit; none if there is no such crack.
pub(super) fn detections(inspected: &[InspectedShoulder]) -> Vec<Detection> {
    let of_limit = |limit: Limit| {
        let targets = inspected.iter().flat_map(|InspectedShoulder { scan, cracks }| {
            cracks.iter().filter_map(move |crack| {
                Some(Target {
                    size_mm: crack.size_mm?,
                    depth_mm: None,
                    location_count: crack.location_count,
                    is_found: limit.is_found(scan, crack),
                    response: limit.response(scan, crack),
                    limit: 1.0,
                })
            })
        });
        let targets: Vec<Target> = targets.collect();
        (!targets.is_empty()).then(|| Detection::new(limit.class().to_owned(), targets))
    };
    Limit::ALL.into_iter().filter_map(of_limit).collect()
}

pub(super) fn table(detections: &[Detection]) -> Table {
    let title = "Finds against the size of the crack, in mm: by hit/miss, and by the response; a region that reaches the \
                 limit is a find";
    let mut table = Table::new("detection", title, DETECTION_COLUMNS);
    detections.iter().for_each(|detection| detection.push(&mut table));
    if detections.is_empty() {
        let empty = (2..DETECTION_COLUMNS.len()).map(|_| Cell::Empty);
        let why = "no crack of an inspected shoulder has a size_mm, which a probability of detection needs";
        table.push(["".into()].into_iter().chain(empty).chain([why.into()]));
    }
    table
}

/// Every crack, with a size or without.
pub(super) fn all(inspected: &[InspectedShoulder]) -> Table {
    let columns = "tyre shoulder first_location location_count size_mm damage_index limit_re_inspect found_re_inspect \
                   found_reject";
    let mut table = Table::long("cracks", "Every crack of the shoulders that were inspected", columns.split(' '));
    for InspectedShoulder { scan, cracks } in inspected {
        for crack in cracks {
            table.push([
                scan.result.tyre.clone().into(),
                usize::from(scan.result.shoulder).into(),
                (crack.first_location as usize).into(),
                (crack.location_count as usize).into(),
                cell(crack.size_mm),
                cell(highest(scan, crack)),
                cell(scan.judgement.limit_re_inspect),
                yes_or_no(Limit::ReInspect.is_found(scan, crack)),
                yes_or_no(Limit::Reject.is_found(scan, crack)),
            ]);
        }
    }
    table
}
