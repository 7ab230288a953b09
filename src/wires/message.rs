//! What goes over the wires as JSON; `docs/verdict.schema.json` describes it.

use serde::Serialize;

use crate::shown::verdict::CasingVerdict;
use crate::wires::now::StationState;

/// What stands at a station.
#[derive(Debug, Serialize)]
struct StationMessage<'a> {
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
pub(super) fn station_state(station: u16, station_state: &StationState) -> String {
    let verdict = if let StationState::Judged(verdict) = station_state { Some(&**verdict) } else { None };
    let state = station_state.name();
    serde_json::to_string(&StationMessage { kind: "station", station, state, verdict }).unwrap_or_default()
}
