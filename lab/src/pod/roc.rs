//! ROC curves of shoulders, by their strongest arc, and of locations, by their damage index.

use tapline_draw::stats::extent;
use tapline_host::messages::counted;
use tapline_wire::Reasons;

use crate::evaluation::{Areas, FALSE_ALARMS, FoundAt, TYRES_MIN, Table, cell, ends};

use super::archives::Scanned;
use super::inspected::InspectedShoulder;

/// Shoulders whose limits differ by more than this fraction have different references.
const SAME_LIMIT: f64 = 0.01;

/// Reasons of a shoulder that was compared with its own casing, because it scattered more than the named reference.
const BY_OWN_CASING: Reasons = Reasons::SCATTER_OFF.union(Reasons::SELF_REFERENCE);

/// Remarks if `scans` were compared with more than one reference: the range of their limits with `what_follows`, and how many
/// were compared with their own casing.
pub(super) fn reference_remarks<'a>(
    scans: impl Iterator<Item = &'a Scanned>,
    thing: &str,
    what_follows: &str,
) -> Vec<String> {
    let (by_own, named): (Vec<&Scanned>, Vec<&Scanned>) =
        scans.partition(|scan| scan.judgement.reasons.contains(BY_OWN_CASING));
    let limits = extent(named.iter().map(|scan| scan.result.limit));
    let different = limits.filter(|(low, high)| high > &((1.0 + SAME_LIMIT) * low));
    let different =
        different.map(|(low, high)| format!("limits lie between {} and {}: {what_follows}", cell(low), cell(high)));
    let by_own = (!by_own.is_empty()).then(|| {
        let one = format!("{thing} was compared with its own casing because its scatter was off");
        let more = format!("{thing}s were compared with their own casings because their scatter was off");
        counted(by_own.len(), &one, &more)
    });
    different.into_iter().chain(by_own).collect()
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
    let scans = inspected.iter().map(|shoulder| &shoulder.scan);
    let pooled = reference_remarks(scans, "shoulder", "scores of different references are pooled").join("; ");
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
                    "no interval: {cracked_tyres} tyres have cracked ones, {sound_tyres} have sound ones; {TYRES_MIN} of each are needed"
                ));
            }
            if found.is_none() {
                remarks
                    .push(format!("no TPR at 5 % false calls: there are {sound} sound, and 20 are needed to call 1"));
            }
        }
        remarks.retain(|remark| !remark.is_empty());
        Self { things, areas, auc, interval, found, remark: remarks.join("; ") }
    }
}

pub(super) fn table(rocs: &[Roc]) -> Table {
    let mut table = Table::new(
        "roc",
        "Area under the ROC curve, and the true positive rate (TPR) at 5 % false calls. Intervals draw whole tyres; of a perfect \
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
