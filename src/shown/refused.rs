//! Why taps of a shoulder were refused, for people: a casing that was taken away early has a row of reasons, of which this is the cause.

use std::collections::BTreeMap;

use anyhow::Result;
use serde::{Deserialize, Serialize};
use tapline_host::messages::counted;
use tapline_store::Reader;
use tapline_wire::{Reasons, Scan, TapState};

/// The refused taps of a shoulder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct RefusedTaps {
    /// How many there are, and why.
    pub text: String,
    /// Names of the reasons of the verdict that say no more than this, with `|` between them.
    pub covers: String,
}

impl RefusedTaps {
    /// Those of `scan`, whose other taps lack `absent_count` discriminators; `None` if there are none.
    pub(crate) fn of(reader: &Reader, scan: &Scan, absent_count: u32) -> Result<Option<Self>> {
        let (states, planned) = (reader.ledger().taps(), reader.plan().taps());
        let tap_count = scan.taps.len();
        let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
        let mut places: BTreeMap<(u32, Option<u64>), [usize; 2]> = BTreeMap::new();
        for &row in &scan.taps {
            let tap = &planned[row as usize];
            let is_refused = states[row as usize] == TapState::Refused;
            if is_refused {
                *reasons.entry(without_file(&reader.reason(row)?).to_owned()).or_default() += 1;
            }
            if !tap.is_closing() {
                let place = places.entry((tap.id.location, tap.id.offset_mm().map(f64::to_bits))).or_default();
                *place = [place[0] + usize::from(is_refused), place[1] + 1];
            }
        }
        let count: usize = reasons.values().sum();
        let Some((reason, of_reason)) = reasons.iter().max_by_key(|&(_, count)| count) else { return Ok(None) };
        let planned = counted(tap_count, "planned tap was", "planned taps were");
        let mut text = format!("{count} of {planned} refused: {reason}");
        if *of_reason < count {
            text.push_str(&format!(" ({of_reason} of them)"));
        }
        // What other causes may have as well is still said: a sensor that is dead in taps that came, and a reference without limits.
        let is_gap = places.values().any(|[refused, planned]| 2 * refused > *planned);
        let is_heard = 4 * (absent_count as usize) < tap_count - count;
        let is_most = 2 * count > tap_count;
        let follows = [
            (true, Reasons::TAPS_REFUSED),
            (is_gap, Reasons::LOCATION_BLIND),
            (is_most || is_gap && is_heard, Reasons::DISCRIMINATORS_ABSENT),
            (is_most, Reasons::NO_INDEX),
        ];
        let covers = follows.into_iter().filter(|(is_so, _)| *is_so).fold(Reasons::default(), |all, (_, of)| all | of);
        Ok(Some(Self { text, covers: covers.to_string() }))
    }

    /// Whether a reason with this name says no more.
    pub(crate) fn covers(&self, name: &str) -> bool {
        self.covers.split('|').any(|covered| covered == name)
    }
}

/// The `reason` of a refusal without the file and the line of the table that it names, which differ from tap to tap.
pub(crate) fn without_file(reason: &str) -> &str {
    let of_table = reason.split_once(" (taps.csv line ").and_then(|(_, rest)| rest.split_once("): "));
    of_table.map_or(reason, |(_, why)| why)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a reason that keeps its file, so that each tap has one of its own, and one that loses what it says.
    #[test]
    fn a_reason_is_grouped_without_its_file() {
        for (reason, grouped) in [
            ("F-3-2/000101-000.wav (taps.csv line 103): the file does not exist", "the file does not exist"),
            ("rig at 127.0.0.1:7: impactor jammed", "rig at 127.0.0.1:7: impactor jammed"),
            ("a (taps.csv line 3", "a (taps.csv line 3"),
        ] {
            assert_eq!(without_file(reason), grouped);
        }
    }
}
