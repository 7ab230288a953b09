//! What goes over the wires as JSON; `docs/verdict.schema.json` describes it.

use serde::Serialize;

use crate::shown::verdict::CasingVerdict;
use crate::wires::now::Standing;

/// What stands at a station.
#[derive(Debug, Serialize)]
struct Standings<'a> {
    /// The kind of this line of JSON: `station`.
    kind: &'static str,
    station: u16,
    /// `ready`, `busy`, `judged`, or `no_signal`.
    state: &'static str,
    /// Absent in every state but `judged`.
    verdict: Option<&'a CasingVerdict>,
}

/// A verdict.
pub(super) fn verdict(verdict: &CasingVerdict) -> String {
    serde_json::to_string(verdict).unwrap_or_default() // it has no key that is no text
}

/// What stands at `station`.
pub(super) fn standing(station: u16, standing: &Standing) -> String {
    let (state, verdict) = match standing {
        Standing::NoSignal => ("no_signal", None),
        Standing::Ready => ("ready", None),
        Standing::Busy => ("busy", None),
        Standing::Judged(verdict) => ("judged", Some(&**verdict)),
    };
    serde_json::to_string(&Standings { kind: "station", station, state, verdict }).unwrap_or_default()
}
