//! What a device records now, for people who set it up.

use std::sync::Arc;

use tapline_wire::{CacheLine, TapHeader, cache_lines_for};

use crate::capture::ear::Ear;
use crate::capture::heard::HeardCasing;
use crate::capture::{CaptureConfig, DeviceName, NotTaps, TriggerConfig};
use crate::source::serial_of;
use crate::{Error, Readiness, ScanConfig, Source as _, Wake};

/// Listens to a device as a station would.
#[derive(Debug)]
pub struct Monitor {
    ear: Arc<Ear>,
    taps: HeardCasing,
    count: u16,
}

/// A tap that was heard, with all that a stage gets of it.
#[derive(Debug, Clone)]
pub struct MonitoredTap {
    /// Its header.
    pub header: TapHeader,
    /// Its samples.
    pub samples: Vec<CacheLine>,
}

impl Monitor {
    /// Listens to `device` of `station`; `wake` is called when a tap was heard.
    ///
    /// # Errors
    /// [`Error`] for a value out of its bounds, or if no thread can be started. A missing device is not an
    /// error: see [`Monitor::fault`].
    pub fn listen(device: &DeviceName, config: &CaptureConfig, station: u16, wake: Wake) -> Result<Self, Error> {
        config.validate_for(device)?;
        let ear = Ear::listen(device, config, station, wake)
            .map_err(|source| Error::Thread { what: format!("the device {device}"), source })?;
        // The places of the taps are unknown.
        let nowhere = ScanConfig { locations: 1, shoulders: 1, ..ScanConfig::default() };
        let taps = HeardCasing::new(Arc::clone(&ear), &nowhere, serial_of("the name of the monitor", "monitor")?, 0)?;
        Ok(Self { ear, taps, count: 0 })
    }

    /// The last `count` samples of the force and of the sound, parts of full scale, the oldest first; fewer where fewer have come.
    pub fn latest(&self, count: usize) -> [Vec<f32>; 2] {
        self.ear.latest(count)
    }

    /// What was no tap.
    pub fn not_taps(&self) -> NotTaps {
        self.ear.not_taps()
    }

    /// Has taps found at another trigger `level`, a part of full scale.
    ///
    /// # Errors
    /// [`Error::Setting`] for a level out of its bounds: it stays what it was.
    pub fn set_level(&self, level: f64) -> Result<(), Error> {
        TriggerConfig { level, ..TriggerConfig::default() }.validate("capture.trigger")?;
        self.ear.set_level(level);
        Ok(())
    }

    /// Why the device is not heard, if it is not.
    pub fn fault(&self) -> Option<String> {
        self.ear.fault()
    }

    /// The next tap that was heard.
    pub fn take(&mut self) -> Option<MonitoredTap> {
        if self.taps.poll(0, self.count) != Readiness::Ready {
            return None;
        }
        let bytes = self.taps.plan().recording.payload_bytes_max();
        let mut tap =
            MonitoredTap { header: TapHeader::default(), samples: vec![CacheLine::default(); cache_lines_for(bytes)] };
        let rendered = self.taps.render(0, self.count, &mut tap.header, &mut tap.samples);
        self.count = self.count.wrapping_add(1);
        rendered.is_ok().then_some(tap)
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.ear.stop();
    }
}
