//! What a plan is made of: taps, the shape of their records, and the scans of shoulders.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::record::calibration::Calibration;
use crate::record::id::{Serial, TapId};
use crate::record::tap::{Channel, SampleFormat};

/// One tap that must exist.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedTap {
    /// Its name; `attempt` is 0.
    pub id: TapId,
    /// Angle on the ring in degrees, `None` when unknown or on a line.
    pub angle_deg: Option<f64>,
    /// What it is for.
    pub purpose: Purpose,
}

impl PlannedTap {
    /// Whether it repeats the first location to close the ring: it shows drift and enters no index.
    pub fn is_closing(&self) -> bool {
        self.purpose == Purpose::Closing
    }

    /// Whether it was requested because of other taps: a second reading.
    pub fn is_second_reading(&self) -> bool {
        matches!(self.purpose, Purpose::Suspect | Purpose::Control)
    }
}

/// What a tap is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Purpose {
    /// The scan of the whole shoulder.
    #[default]
    Scan,
    /// It repeats the first location at the end of a turn.
    Closing,
    /// Second reading of a place that stood out.
    Suspect,
    /// Second reading of a place that did not: it gives the level that suspects are compared with.
    Control,
}

coded!(Purpose: u16, Scan = 0, Closing = 1, Suspect = 2, Control = 3);
named!(Purpose, Scan = "scan", Closing = "closing", Suspect = "suspect", Control = "control");

impl Purpose {
    /// [`Purpose::Closing`] if `is_closing`, else [`Purpose::Scan`].
    pub fn closing_if(is_closing: bool) -> Self {
        if is_closing { Self::Closing } else { Self::Scan }
    }
}

/// Shape of every record of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Samples per second and channel.
    pub sample_rate_hz: f64,
    /// Samples before the trigger.
    pub pre_trigger_samples: u32,
    /// Most samples per channel.
    pub sample_count_max: u32,
    /// How the converter gives its samples.
    pub sample_format: SampleFormat,
    /// Channels, in the order of the samples.
    pub channels: Vec<Channel>,
    /// Units and scales of the samples.
    pub calibration: Calibration,
}

impl Recording {
    /// Bytes of the largest record's samples.
    pub fn payload_bytes_max(&self) -> usize {
        self.channels.len() * self.sample_count_max as usize * self.sample_format.bytes()
    }
}

/// What taps of tests are recorded as.
#[cfg(test)]
pub(crate) fn recording() -> Recording {
    Recording {
        sample_rate_hz: 41e3,
        pre_trigger_samples: 400,
        sample_count_max: 4096,
        sample_format: SampleFormat::I16,
        channels: Channel::BOTH.to_vec(),
        calibration: Calibration::stated(),
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

impl fmt::Display for Scan {
    /// `TYRE/SHOULDER`, as command lines name it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.tyre, self.shoulder)
    }
}

/// Whether a location is cracked, according to a tap set or a simulated tyre.
pub type Truth = BTreeMap<(Serial, u16, u32), bool>;
