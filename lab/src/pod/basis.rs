//! What the numbers rest on, and what was left out.

use super::PodArgs;
use super::archives::Scans;
use super::inspected::InspectedShoulder;
use super::truth::{KnownTruth, Shoulder};
use crate::evaluation::{Cell, Table};

pub(super) fn table(scans: &Scans, truth: &KnownTruth, inspected: &[InspectedShoulder], args: &PodArgs) -> Table {
    let mut table = Table::new("basis", "What the numbers rest on", ["what", "count", "remark"]);
    let mut push = |what: &str, count: usize, remark: String| table.push([what.into(), count.into(), remark.into()]);
    let scan_count: usize = scans.of_shoulder.values().map(Vec::len).sum();
    let sound_count = inspected.iter().filter(|shoulder| shoulder.is_sound()).count();
    let cracks = || inspected.iter().flat_map(|shoulder| &shoulder.cracks);
    let unsized_count = cracks().filter(|crack| crack.size_mm.is_none()).count();
    let not_inspected: Vec<Shoulder> =
        (scans.of_shoulder.keys()).filter(|&key| !truth.shoulders.contains_key(key)).cloned().collect();
    let which = if args.results { "the newest results of each" } else { "" };
    push("archives", scans.archive_count, which.to_owned());
    push("judged scans of shoulders", scan_count, String::new());
    push("shoulders", scans.of_shoulder.len(), String::new());
    push("cracked shoulders", inspected.len() - sound_count, String::new());
    push("sound shoulders", sound_count, "inspected, and stated to be sound".to_owned());
    push("cracks", cracks().count(), String::new());
    if unsized_count > 0 {
        push("cracks without a size", unsized_count, "they do not count in the probability of detection".to_owned());
    }
    if !not_inspected.is_empty() {
        let file =
            if args.truth.is_some() { "the truth file has no row for them" } else { "their archives have no truth" };
        let text = format!("not inspected: {file}; only in the tables of repeated scans: {}", names(&not_inspected));
        push("shoulders left out", not_inspected.len(), text);
    }
    if !truth.not_scanned.is_empty() {
        let text = format!("inspected, but in none of the archives that were read: {}", names(&truth.not_scanned));
        push("shoulders of the truth file left out", truth.not_scanned.len(), text);
    }
    if !truth.ignored.is_empty() {
        push("columns of the truth file left out", truth.ignored.len(), truth.ignored.join(", "));
    }
    let repeat_count = scan_count - scans.of_shoulder.len();
    if repeat_count > 0 {
        push(
            "repeated scans",
            repeat_count,
            "of shoulders scanned before; only in the tables of repeated scans".to_owned(),
        );
    }
    for (what, count, remark) in [
        ("copies", scans.copy_count, "scans with the same recording as another; left out"),
        ("scans without a verdict", scans.unjudged_count, "left out"),
    ] {
        if count > 0 {
            push(what, count, remark.to_owned());
        }
    }
    for remark in &scans.remarks {
        table.push(["results".into(), Cell::Empty, remark.clone().into()]);
    }
    for why in &scans.unreadable {
        table.push(["archive left out".into(), Cell::Count(1), why.clone().into()]);
    }
    table
}

/// The first few of many shoulders.
pub(super) fn names(shoulders: &[Shoulder]) -> String {
    const SHOWN: usize = 8;
    let rest = shoulders.len().saturating_sub(SHOWN);
    let shown = shoulders.iter().take(SHOWN).map(|(tyre, shoulder, day)| {
        let from = day.map_or_else(String::new, |day| format!(" from {day}"));
        format!("{tyre}/{shoulder}{from}")
    });
    let shown = shown.collect::<Vec<_>>().join(" ");
    if rest > 0 { format!("{shown} and {rest} more") } else { shown }
}
