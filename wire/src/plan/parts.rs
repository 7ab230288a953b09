//! What a plan is made of: taps, the shape of their records, and the scans of shoulders.

use std::collections::BTreeMap;

use crate::record::id::{Serial, TapId};
use crate::record::tap::{Channel, SampleFormat};

/// One tap that must exist.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedTap {
    /// Its name; `attempt` is 0.
    pub id: TapId,
    /// Angle on the ring in degrees, `None` when unknown or on a line.
    pub angle_deg: Option<f64>,
    /// Whether it repeats the first location to close the ring: it shows drift and enters no index.
    pub is_closing: bool,
}

/// Shape of every record of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Samples per second and channel.
    pub sample_rate_hz: f64,
    /// Samples before the trigger.
    pub pre_trigger_samples: u32,
    /// Most samples a channel can have.
    pub sample_count_max: u32,
    /// How the converter gives its samples.
    pub sample_format: SampleFormat,
    /// Channels, in the order of the samples.
    pub channels: Vec<Channel>,
}

impl Recording {
    /// Bytes of the largest record's samples.
    pub fn payload_bytes_max(&self) -> usize {
        self.channels.len() * self.sample_count_max as usize * self.sample_format.bytes()
    }
}

/// One shoulder's scan: the taps that together get one damage map and one verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// Rig that makes the taps.
    pub station: u16,
    /// Serial number of the casing.
    pub tyre: Serial,
    /// Side of the casing.
    pub shoulder: u16,
    /// Plan rows of its taps, ascending.
    pub taps: Vec<u32>,
    /// Locations the damage map covers, ascending, each with its angle in degrees where known.
    pub locations: Vec<(u32, Option<f64>)>,
}

/// Whether a location is cracked: what the truth of a tap set or of a simulated tyre says.
pub type Truth = BTreeMap<(Serial, u16, u32), bool>;
