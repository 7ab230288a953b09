//! How a station hears taps: the table `[capture]`.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use tapline_wire::{Channel, Recording, SampleFormat};

use crate::capture::{DeviceName, TriggerConfig};
use crate::config::calibration::CalibrationFile;
use crate::config::{refuse, within};
use crate::{Error, ScanConfig};

/// Further settings of a data acquisition module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UldaqConfig {
    /// Volts at the greatest sample: 10 or 1.
    pub range_v: f64,
    /// The channels whose sensors the module powers: force, sound. These are AC-coupled, the others DC-coupled.
    pub iepe: Vec<Channel>,
}

impl Default for UldaqConfig {
    fn default() -> Self {
        Self { range_v: 10.0, iepe: Vec::new() }
    }
}

/// What a device records, and what counts as a tap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CaptureConfig {
    /// Rate at which the device samples; it is not resampled.
    pub sample_rate_hz: u32,
    /// Bits of a sample: 16, 24 or 32. Of 32 the upper 24 are kept.
    pub bits: u16,
    /// Channels of the device.
    pub channels: u16,
    /// The channel with the force, from 1.
    pub force_channel: u16,
    /// The channel with the sound, from 1.
    pub sound_channel: u16,
    /// Samples of a record before the pulse begins.
    pub pre_trigger_samples: u32,
    /// Samples of a record, including those before the pulse.
    pub sample_count: u32,
    /// Distance from the impact to the microphone; unknown if left out.
    pub microphone_distance_m: Option<f64>,
    /// How long the latest samples are kept while the station is busy.
    pub buffer_s: f64,
    /// What counts as a tap.
    pub trigger: TriggerConfig,
    /// Units and scales of this device's samples: from the calibration file of its station.
    #[serde(skip)]
    pub calibration: CalibrationFile,
    /// Additional settings of a data acquisition module.
    pub uldaq: UldaqConfig,
}

impl Default for CaptureConfig {
    fn default() -> Self {
        Self {
            sample_rate_hz: 48_000,
            bits: 16,
            channels: 2,
            force_channel: 1,
            sound_channel: 2,
            pre_trigger_samples: 512,
            sample_count: 2400,
            microphone_distance_m: None,
            buffer_s: 10.0,
            trigger: TriggerConfig::default(),
            calibration: CalibrationFile::default(),
            uldaq: UldaqConfig::default(),
        }
    }
}

impl CaptureConfig {
    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds.
    pub fn validate(&self) -> Result<(), Error> {
        within("capture.sample_rate_hz", self.sample_rate_hz, 4000..=1_000_000)?;
        if ![16, 24, 32].contains(&self.bits) {
            return refuse("capture.bits", self.bits, "16, 24 or 32");
        }
        within("capture.channels", self.channels, 2..=64)?;
        within("capture.force_channel", self.force_channel, 1..=self.channels)?;
        within("capture.sound_channel", self.sound_channel, 1..=self.channels)?;
        if self.force_channel == self.sound_channel {
            return refuse("capture.sound_channel", self.sound_channel, "different from capture.force_channel");
        }
        within("capture.sample_count", self.sample_count, 64..=4_000_000)?;
        within("capture.pre_trigger_samples", self.pre_trigger_samples, 16..=self.sample_count - 16)?;
        if let Some(distance_m) = self.microphone_distance_m.filter(|m| !(*m > 0.0 && *m <= 10.0)) {
            return refuse("capture.microphone_distance_m", distance_m, "above 0 and at most 10, or left out");
        }
        within("capture.buffer_s", self.buffer_s, 0.1..=600.0)?;
        if ![1.0, 10.0].contains(&self.uldaq.range_v) {
            return refuse("capture.uldaq.range_v", self.uldaq.range_v, "1 or 10");
        }
        self.trigger.validate("capture.trigger")
    }

    /// The same, and checks what `device` supports.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value that it does not allow.
    pub(crate) fn validate_for(&self, device: &DeviceName) -> Result<(), Error> {
        self.validate()?;
        if matches!(device, DeviceName::Uldaq(_)) && self.bits == 16 {
            return refuse("capture.bits", self.bits, "24 or 32, as source is \"uldaq\"");
        }
        Ok(())
    }

    /// What a tap of it is.
    pub fn recording(&self) -> Recording {
        Recording {
            sample_rate_hz: self.sample_rate_hz.into(),
            pre_trigger_samples: self.pre_trigger_samples,
            sample_count_max: self.sample_count,
            sample_format: if self.bits == 16 { SampleFormat::I16 } else { SampleFormat::F32 },
            channels: Channel::BOTH.to_vec(),
            calibration: self.calibration.calibration(None),
        }
    }

    /// What a casing needs if it is scanned by `scan` and recorded with this configuration.
    pub fn limits(&self, scan: &ScanConfig) -> tapline_wire::CasingLimits {
        scan.limits_of(self.recording().payload_bytes_max())
    }

    /// The channels of the device that are kept, in the order of the record's.
    pub(super) fn picked(&self) -> [usize; 2] {
        [usize::from(self.force_channel) - 1, usize::from(self.sound_channel) - 1]
    }

    /// How long a record is.
    pub(crate) fn record_time(&self) -> Duration {
        Duration::from_secs(self.sample_count.into()) / self.sample_rate_hz.max(1)
    }

    /// Frames that the ring keeps: a few records at least.
    pub(super) fn buffer_frames(&self) -> usize {
        let of_time = (self.buffer_s * f64::from(self.sample_rate_hz)) as usize;
        // A tap waits for the end of its hold-off before it can be taken.
        let of_hold_off = (self.trigger.hold_off_s * f64::from(self.sample_rate_hz)) as usize;
        of_time.max(4 * self.sample_count as usize) + of_hold_off
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a value that is let through, or refused without its key, value and bound.
    #[test]
    fn what_is_out_of_bounds_is_refused() {
        let refusal = |text: &str| {
            let config: CaptureConfig = toml::from_str(text).unwrap();
            config.validate().unwrap_err().to_string()
        };
        for (text, want) in [
            ("sample_rate_hz = 0", "capture.sample_rate_hz is 0; it must be from 4000 to 1000000"),
            ("bits = 20", "capture.bits is 20; it must be 16, 24 or 32"),
            ("channels = 1", "capture.channels is 1"),
            ("sound_channel = 3", "capture.sound_channel is 3; it must be from 1 to 2"),
            ("force_channel = 2", "capture.sound_channel is 2; it must be different from capture.force_channel"),
            ("pre_trigger_samples = 2385", "capture.pre_trigger_samples is 2385; it must be from 16 to 2384"),
            ("microphone_distance_m = 0.0", "capture.microphone_distance_m is 0"),
            ("buffer_s = nan", "capture.buffer_s is NaN"),
            ("trigger.level = 2.0", "capture.trigger.level is 2"),
            ("uldaq.range_v = 5.0", "capture.uldaq.range_v is 5; it must be 1 or 10"),
        ] {
            let error = refusal(text);
            assert!(error.contains(want), "{error:?} lacks {want:?}");
        }
        CaptureConfig::default().validate().unwrap();
    }
}
