//! The status of a line: what it is doing, and what people should know about it.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tapline_wire::{STATUS_BYTES_MAX, Verdict};

use crate::shown::casing::CasingStatus;
use crate::shown::latency::Latency;
use crate::shown::rig::Sign;
use crate::shown::verdict::CasingVerdict;
use crate::shown::whole::Whole;

/// The state of a line.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Status {
    pub out: PathBuf,
    pub pid: u32,
    /// When it was taken, in ns since the Unix epoch.
    pub at_ns: i64,
    pub is_ending: bool,
    /// Why the archive cannot be written, so that the line waits.
    pub held_by: Option<String>,
    /// What keeps the line from working as it should at this moment; empty while nothing does.
    pub troubles: Vec<String>,
    pub taps_per_s: f64,
    pub settled_count: u64,
    pub closed_count: u64,
    /// Casings that were refused.
    pub refused_count: u64,
    pub lost_count: u64,
    pub latency: Latency,
    /// Where verdicts go.
    pub receivers: Vec<ReceiverStatus>,
    pub stations: Vec<StationStatus>,
    pub stages: Vec<StageStatus>,
    /// The last verdicts, and the last of each station, the newest first.
    pub verdicts: Vec<CasingVerdict>,
    /// What someone should look at, the newest first.
    pub alarms: Vec<Alarm>,
}

/// Something that a person should look at, or, if it begins with [`tapline_wire::OVER`], should have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Alarm {
    /// When it was raised, in ns since the Unix epoch.
    pub at_ns: i64,
    pub text: String,
}

/// The state of a station.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct StationStatus {
    pub number: u16,
    /// The casing that it taps.
    pub casing: Option<CasingStatus>,
    /// The previous casing, as it was when its verdict was reported; `None` once another one was refused.
    pub last: Option<CasingStatus>,
    /// The name of the casing that was done and taken off the rig last, until another one comes.
    pub removed: Option<String>,
    /// The casing that was refused last, until another one comes.
    pub refused: Option<Alarm>,
    /// What it waits for; empty while it taps.
    pub waits_for: String,
    /// What keeps it from seeing or tapping a casing that comes: its rig, device or folder is away, or its rig is stopped.
    pub fault: Option<String>,
    pub tally: Tally,
    /// Properties of its last casing as a whole: the median over its shoulders.
    pub whole: Whole,
    /// Signs that its rig has changed.
    pub signs: Vec<Sign>,
    /// Day of the oldest calibration that its last casing was judged by, as `2026-11-24`.
    pub calibrated_on: Option<String>,
    /// Last day of the calibration that ends first, likewise; `None` if none ends.
    pub calibration_ends: Option<String>,
    /// Whether a calibration is not known to be valid on the day of its taps.
    pub is_calibration_out_of_date: bool,
}

/// The state of one receiver of verdicts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ReceiverStatus {
    pub name: String,
    /// Verdicts that it has not acknowledged.
    pub waiting: u64,
    /// What is wrong with it at this moment.
    pub trouble: Option<String>,
}

/// What a station has done since the line was started, in closed casings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tally {
    pub verdicts: VerdictCounts,
    pub archived: u64,
    pub refused: u64,
    pub missing: u64,
    /// How often a tap was taken again.
    pub retaken: u64,
}

/// Casings by verdict.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct VerdictCounts {
    pub pass: u64,
    pub re_inspect: u64,
    pub reject: u64,
}

impl Tally {
    /// Adds a casing that is closed.
    pub(crate) fn add(&mut self, verdict: &CasingVerdict, retaken: u64) {
        *match verdict.verdict {
            Verdict::Pass => &mut self.verdicts.pass,
            Verdict::ReInspect => &mut self.verdicts.re_inspect,
            Verdict::Reject => &mut self.verdicts.reject,
        } += 1;
        self.archived += verdict.archived as u64;
        self.refused += verdict.refused as u64;
        self.missing += verdict.missing as u64;
        self.retaken += retaken;
    }
}

/// The state of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct StageStatus {
    pub name: String,
    pub pid: Option<u32>,
    pub restarts: u32,
}

impl Status {
    /// The status as text for shared memory. If it is too long, it is shortened as [`CUTS`] says.
    pub(crate) fn encode(&self) -> String {
        let mut status = self.clone();
        loop {
            let text = serde_json::to_string(&status).unwrap_or_default(); // it has no key that is no text
            if text.len() <= STATUS_BYTES_MAX {
                return text;
            }
            if !CUTS.iter().any(|cut| cut(&mut status)) {
                return String::new();
            }
        }
    }
}

/// What is left out of a status that is too long, in this order; each returns whether there was anything to leave out.
const CUTS: [fn(&mut Status) -> bool; 4] = [
    // The places of taps.
    |status| {
        let casings = status.stations.iter_mut().flat_map(|station| [&mut station.casing, &mut station.last]);
        let shoulders = casings.flatten().map(|casing| std::mem::take(&mut casing.shoulders));
        shoulders.fold(false, |was_there, shoulders| was_there | !shoulders.is_empty())
    },
    // Levels and scatter.
    |status| {
        let wholes = status.stations.iter_mut().map(|station| std::mem::take(&mut station.whole));
        wholes.fold(false, |was_there, whole| was_there | (whole != Whole::default()))
    },
    |status| halve(&mut status.verdicts),
    |status| halve(&mut status.alarms),
];

/// Leaves the newer half.
fn halve<T>(newest_first: &mut Vec<T>) -> bool {
    let before = newest_first.len();
    newest_first.truncate(before / 2);
    before > 0
}

#[cfg(test)]
mod tests {
    use crate::shown::casing::ShoulderStatus;

    use super::*;

    /// Catches a status that is not shown at all because of its rings, and one that loses verdicts for them.
    #[test]
    fn a_status_that_is_too_long_is_shown_without_rings() {
        let ring = |locations: usize| ShoulderStatus {
            tyre: "A".to_owned(),
            shoulder: 1,
            angles_deg: vec![359.9; locations],
            locations: "9".repeat(locations),
            planned: locations,
            settled: locations,
        };
        let status = |locations| {
            let casing = Some(CasingStatus { shoulders: vec![ring(locations)], ..CasingStatus::default() });
            let station = StationStatus { casing, ..StationStatus::default() };
            let alarm = Alarm { at_ns: 1, text: "text".to_owned() };
            Status { stations: vec![station], alarms: vec![alarm], ..Status::default() }
        };
        let read = |status: &Status| serde_json::from_str::<Status>(&status.encode()).unwrap();
        assert_eq!(read(&status(100)), status(100));
        let short = read(&status(120_000));
        assert_eq!((short.alarms.len(), short.stations[0].casing.as_ref().unwrap().shoulders.len()), (1, 0));
    }

    /// Catches a line of many stations that shows nothing at all when all of their rigs have changed.
    #[test]
    fn three_hundred_stations_fit() {
        let times =
            || ["f_max", "tau", "a_1", "a_2", "pr", "p_f", "e_f", "centroid"].map(|w| (w.to_owned(), 1.2345)).into();
        let sign = Sign {
            name: "features_absent".to_owned(),
            count: 1000,
            first: "S300-10000".to_owned(),
            last: "S300-20000".to_owned(),
            detail: Some("f_max 0.81, tau 1.10, pr 1.02 times the reference's".to_owned()),
        };
        let casing = CasingStatus { name: "S300-20000".to_owned(), planned: 1000, ..CasingStatus::default() };
        let station = StationStatus {
            number: 300,
            waits_for: "the archive, which cannot be written: its disk is full".to_owned(),
            casing: Some(casing.clone()),
            last: Some(casing),
            whole: Whole { level: times(), scatter: times(), ..Whole::default() },
            signs: vec![sign; 4],
            ..StationStatus::default()
        };
        let status = Status { stations: vec![station; 300], ..Status::default() };
        assert_eq!(serde_json::from_str::<Status>(&status.encode()).unwrap(), status);
    }
}
