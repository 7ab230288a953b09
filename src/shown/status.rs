//! The status of a line: what it is doing, and what people should know about it.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tapline_wire::Verdict;

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
    /// Whether the last casing was taken off the rig.
    pub is_removed: bool,
    /// The casing that was refused last, until another one comes.
    pub refused: Option<Alarm>,
    /// What it waits for; empty while it taps.
    pub waits_for: String,
    /// Why its rig is stopped.
    pub stopped: Option<String>,
    /// What keeps it from seeing or tapping a casing that comes.
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
    /// When the first of them was finished, in ns since the Unix epoch.
    pub since_ns: Option<i64>,
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
        self.since_ns = Some(self.since_ns.map_or(verdict.at_ns, |since_ns| since_ns.min(verdict.at_ns)));
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
