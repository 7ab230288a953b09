//! A casing whose taps are heard: each is copied once, from the recording into its loan.

use std::sync::Arc;

use tapline_wire::{
    CHANNELS_MAX, CacheLine, Channel, ChannelHeader, Geometry, Plan, Serial, SourceKind, TapHeader, Truth, now_ns,
};

use crate::capture::ear::{Ear, HeardTap};
use crate::config::scan_taps::taps_of;
use crate::source::channel_headers;
use crate::{About, Error, Readiness, Refusal, ScanConfig, Source};

/// A casing whose taps are heard, in the order in which they are asked for.
#[derive(Debug)]
pub(crate) struct HeardCasing {
    pub(crate) ear: Arc<Ear>,
    pub(crate) about: About,
    channels: [ChannelHeader; CHANNELS_MAX],
    /// The tap that was taken last: row, attempt, and where it was heard.
    taken: Option<((u32, u16), HeardTap)>,
}

impl HeardCasing {
    /// The casing `serial` on `station`, scanned by `scan`; its cracks are unknown.
    pub(crate) fn new(ear: Arc<Ear>, scan: &ScanConfig, serial: Serial, station: u16) -> Result<Self, Error> {
        let config = &ear.config;
        let taps = taps_of(scan, std::iter::once((serial, station)))?;
        let mut recording = config.recording();
        recording.calibration = config.calibration.calibration(Some(now_ns()));
        let plan = Plan::new(Geometry::Ring, recording, taps, Truth::new())?;
        let counts = if config.bits == 16 { 32_768.0 } else { 1.0 };
        let per_count = Channel::BOTH.map(|channel| config.calibration.full_scale(channel) / counts);
        let channels = channel_headers(&plan.recording, &per_count);
        let about = About { plan, kind: SourceKind::Captured, can_retake: true, room: scan.room() };
        Ok(Self { ear, about, channels, taken: None })
    }

    /// Whether the last tap taken is that of plan row `row`, and still available.
    pub(crate) fn has_taken(&self, row: u32) -> bool {
        self.taken.is_some_and(|((of, _), tap)| of == row && self.ear.has(tap))
    }

    pub(super) fn refusal(&self, reason: &str) -> Refusal {
        Refusal { file: self.ear.device.to_owned(), line: 0, reason: reason.to_owned() }
    }
}

impl Source for HeardCasing {
    fn about(&self) -> &About {
        &self.about
    }

    fn grow(&mut self, plan: Plan) {
        self.about.plan = plan;
    }

    /// Takes the next tap that was heard for this one.
    fn poll(&mut self, row: u32, attempt: u16) -> Readiness {
        if self.taken.is_some_and(|(of, tap)| of == (row, attempt) && self.ear.has(tap)) {
            return Readiness::Ready;
        }
        match self.ear.take_tap() {
            Some(tap) => {
                self.taken = Some(((row, attempt), tap));
                Readiness::Ready
            }
            None => Readiness::NotYet,
        }
    }

    fn fill(&mut self, header: &mut TapHeader, buffer: &mut [CacheLine]) -> Result<(), Refusal> {
        let asked = (header.plan_index, header.id.attempt);
        let tap = self.taken.filter(|(of, _)| *of == asked).map(|(_, tap)| tap);
        let Some(tap) = tap else { return Err(self.refusal("the tap was not heard")) };
        if !self.ear.copy(tap, buffer) {
            return Err(self.refusal("samples of the tap were lost"));
        }
        header.tap_time_ns = tap.time_ns;
        header.microphone_distance_m = self.ear.config.microphone_distance_m.unwrap_or(0.0);
        header.sample_count = self.ear.config.sample_count;
        header.channels = self.channels;
        Ok(())
    }
}
