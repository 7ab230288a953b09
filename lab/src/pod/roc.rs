//! ROC curves of shoulders, by their strongest arc, and of locations, by their damage index.

use tapline_draw::stats::extent;

use crate::evaluation::{Areas, FALSE_ALARMS, FoundAt, Table, cell, ends};
use crate::shoulder_result::ShoulderResult;

use super::inspected::InspectedShoulder;

/// Shoulders whose limits differ by more than this fraction have different references.
const SAME_LIMIT: f64 = 0.01;

/// Least and greatest of the limits of `results`, where they differ.
pub(super) fn different<'a>(results: impl Iterator<Item = &'a ShoulderResult>) -> Option<(f64, f64)> {
    extent(results.map(|result| result.limit)).filter(|(low, high)| high > &((1.0 + SAME_LIMIT) * low))
}

#[derive(Debug)]
pub(super) struct Roc {
    /// What is called.
    pub things: &'static str,
    pub areas: Areas,
    pub auc: Option<f64>,
    pub interval: Option<(f64, f64)>,
    pub found: Option<FoundAt>,
    remark: String,
}

pub(super) fn rocs(inspected: &[InspectedShoulder], seed: u64) -> [Roc; 2] {
    let shoulders = inspected.iter().map(|shoulder| {
        let result = &shoulder.scan.result;
        (result.tyre.clone(), result.strongest_arc, !shoulder.is_sound())
    });
    let results = || inspected.iter().map(|shoulder| &shoulder.scan.result);
    let pooled = different(results()).map_or_else(String::new, |(low, high)| {
        format!("limits lie between {} and {}: scores of different references are pooled", cell(low), cell(high))
    });
    let blind = results().flat_map(|result| &result.index).filter(|index| index.is_nan()).count();
    let blind = if blind > 0 { format!("{blind} locations without an index are left out") } else { String::new() };
    [
        Roc::new("shoulders by strongest arc", Areas::of(shoulders), seed, vec![pooled.clone()]),
        Roc::new("locations by damage index", Areas::new(results()), seed, vec![pooled, blind]),
    ]
}

impl Roc {
    fn new(things: &'static str, areas: Areas, seed: u64, mut remarks: Vec<String>) -> Self {
        let auc = areas.auc();
        let (interval, found) = (areas.by_tyres(seed), areas.found_at(FALSE_ALARMS, seed));
        let [cracked, sound] = [true, false].map(|class| areas.count(class));
        let [cracked_tyres, sound_tyres] = [true, false].map(|class| areas.tyre_count(class));
        if auc.is_none() {
            remarks.push(format!("no AUC: there are {cracked} cracked and {sound} sound, and 1 of each is needed"));
        } else {
            if interval.is_none() {
                remarks.push(format!(
                    "no interval: {cracked_tyres} tyres have cracked ones, {sound_tyres} have sound ones; 2 of each are needed"
                ));
            }
            if found.is_none() {
                remarks
                    .push(format!("no TPR at 5 % false alarms: there are {sound} sound, and 20 are needed to call 1"));
            }
        }
        remarks.retain(|remark| !remark.is_empty());
        Self { things, areas, auc, interval, found, remark: remarks.join("; ") }
    }
}

pub(super) fn table(rocs: &[Roc]) -> Table {
    let mut table = Table::new(
        "roc",
        "Area under the ROC curve, and the true positive rate (TPR) at 5 % false alarms. Intervals draw whole tyres; of a perfect \
         area or rate they are the exact ones of as many independent tyres",
        ["called", "cracked", "sound", "auc", "auc_low", "auc_high", "tpr_at_5", "tpr_low", "tpr_high", "remark"],
    );
    for roc in rocs {
        let mut row =
            vec![roc.things.into(), roc.areas.count(true).into(), roc.areas.count(false).into(), cell(roc.auc)];
        row.extend(ends(roc.interval));
        row.push(cell(roc.found.map(|found| found.rate)));
        row.extend(ends(roc.found.and_then(|found| found.interval)));
        row.push(roc.remark.clone().into());
        table.push(row);
    }
    table
}
