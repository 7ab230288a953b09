//! A data acquisition module of Measurement Computing or Data Translation, through libuldaq: one that powers IEPE sensors.

use std::thread;
use std::time::{Duration, Instant};

use tapline_wire::Channel;
use uldaqrs::{
    CouplingMode, DaqDevice, DaqDeviceDescriptor, DaqDeviceInterface, DaqInChanDescriptor, DaqInScanFlag, IepeMode,
    Range, ScanOption, ScanStatus, get_device_inventory,
};

use super::{Chunk, Device};
use crate::capture::CaptureConfig;

/// How long a read waits for samples before it returns without any: a transfer of the module.
const WAIT: Duration = Duration::from_millis(10);

/// Approximately how long the driver keeps samples while nobody reads.
const BUFFER_S: f64 = 1.0;

/// The module counts as stopped when it has given nothing for this long.
const SILENT_MAX: Duration = Duration::from_secs(5);

/// Largest relative difference between the module's rate and the requested one. Its clock has steps, and
/// a ten-thousandth changes no result of a tap.
const RATE_ERROR_MAX: f64 = 1e-4;

/// A module that scans.
pub(super) struct DaqModule {
    device: DaqDevice,
    /// The driver writes into it until the scan is stopped.
    buffer: Vec<f64>,
    circle: Circle,
    /// When frames came last.
    heard: Instant,
}

impl DaqModule {
    pub(super) fn open(name: &str, config: &CaptureConfig) -> Result<Self, String> {
        let fault = |what: &str| {
            let what = what.to_owned();
            move |error: uldaqrs::Error| format!("{what}: {error}")
        };
        let found = get_device_inventory(DaqDeviceInterface::USB).map_err(fault("cannot search for modules"))?;
        let device = DaqDevice::create(pick(name, &found)?).map_err(fault("it cannot be opened"))?;
        device.connect().map_err(fault("cannot connect to it"))?;
        let (range_v, range) = match config.uldaq.range_v {
            range_v if range_v > 1.0 => (10.0, Range::Bip10Volts),
            _ => (1.0, Range::Bip1Volts),
        };
        let mut channels = Vec::new();
        let [force, sound] = config.picked();
        for number in 0..config.channels {
            let is_supplied = config.uldaq.iepe.iter().any(|of| match of {
                Channel::Force => usize::from(number) == force,
                Channel::Sound => usize::from(number) == sound,
            });
            // The supply adds a constant voltage to the signal, which exceeds the range.
            let (iepe, coupling) = match is_supplied {
                true => (IepeMode::Enabled, CouplingMode::Ac),
                false => (IepeMode::Disabled, CouplingMode::Dc),
            };
            // Volts: another program may have left newtons.
            device
                .set_ai_sensor_sensitivity(number.into(), 1.0)
                .and_then(|()| device.set_ai_coupling_mode(number.into(), coupling))
                .and_then(|()| device.set_ai_iepe_mode(number.into(), iepe))
                .map_err(fault(&format!("it has no channel {} with a supply for IEPE sensors", number + 1)))?;
            channels.push(DaqInChanDescriptor::analog_se(number.into(), range));
        }
        let wanted_hz = f64::from(config.sample_rate_hz);
        let frames = ((BUFFER_S * wanted_hz) as usize).next_power_of_two();
        let mut module = Self {
            device,
            buffer: vec![0.0; frames * channels.len()],
            circle: Circle::new(frames, channels.len(), range_v),
            heard: Instant::now(),
        };
        let (continuous, scaled) = (ScanOption::CONTINUOUS, DaqInScanFlag::DEFAULT);
        let scan = module.device.daq_in_scan(&channels, frames, wanted_hz, continuous, scaled, &mut module.buffer);
        check_rate(wanted_hz, scan.map_err(fault(&format!("it does not scan {} channels", config.channels)))?)?;
        Ok(module)
    }

    /// How many frames the driver has written.
    fn written(device: &DaqDevice) -> Result<u64, String> {
        match device.daq_in_scan_status() {
            Ok((ScanStatus::Running, transfer)) => Ok(transfer.current_scan_count),
            Ok((ScanStatus::Idle, _)) => Err("its scan has ended".to_owned()),
            Err(error) => Err(format!("its scan has ended: {error}")),
        }
    }
}

impl Device for DaqModule {
    fn read(&mut self, take: &mut dyn FnMut(Chunk<'_>, u64)) -> Result<(), String> {
        let Self { device, buffer, circle, heard } = self;
        if circle.pass(buffer, &mut || Self::written(device), take)? {
            *heard = Instant::now();
        } else if heard.elapsed() > SILENT_MAX {
            return Err(format!("it has given no samples for {} s", SILENT_MAX.as_secs()));
        } else {
            thread::sleep(WAIT);
        }
        Ok(())
    }
}

impl Drop for DaqModule {
    fn drop(&mut self) {
        // Before the buffer is gone.
        if let Err(error) = self.device.daq_in_scan_stop() {
            tracing::warn!("a scan was not stopped: {error}");
        }
    }
}

/// The module called `name` among those `found`: by its number, or by its product if that is unambiguous.
fn pick<'a>(name: &str, found: &'a [DaqDeviceDescriptor]) -> Result<&'a DaqDeviceDescriptor, String> {
    let listed = |of: &[&DaqDeviceDescriptor]| {
        let names: Vec<String> = of.iter().map(|one| format!("{} ({})", one.product_name, one.unique_id)).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    };
    if let Some(one) = found.iter().find(|one| one.unique_id == name) {
        return Ok(one);
    }
    let alike: Vec<&DaqDeviceDescriptor> = found.iter().filter(|one| one.product_name == name).collect();
    match alike.as_slice() {
        [one] => Ok(one),
        [] => Err(format!("no module {name} is connected; found: {}", listed(&found.iter().collect::<Vec<_>>()))),
        _ => Err(format!("several modules are called {name}: give the number of one: {}", listed(&alike))),
    }
}

/// Refuses a rate that is not the requested one.
fn check_rate(wanted_hz: f64, got_hz: f64) -> Result<(), String> {
    // NaN is refused too.
    if ((got_hz - wanted_hz) / wanted_hz).abs() <= RATE_ERROR_MAX {
        return Ok(());
    }
    Err(format!("it samples at {got_hz} Hz, not at {wanted_hz}"))
}

/// The position in a scan's buffer from which frames have not been passed on.
#[derive(Debug)]
struct Circle {
    frames: u64,
    channels: usize,
    range_v: f64,
    /// Frames since the scan began that were passed on, or lost.
    taken: u64,
    scaled: Vec<f32>,
}

impl Circle {
    fn new(frames: usize, channels: usize, range_v: f64) -> Self {
        Self { frames: frames as u64, channels, range_v, taken: 0, scaled: Vec::new() }
    }

    /// Passes on what is new in `buffer`, up to its end, as fractions of full scale; whether there was any. `written` gives
    /// the number of frames written into it since the scan began.
    fn pass(
        &mut self,
        buffer: &[f64],
        written: &mut dyn FnMut() -> Result<u64, String>,
        take: &mut dyn FnMut(Chunk<'_>, u64),
    ) -> Result<bool, String> {
        let first = self.taken % self.frames;
        let count = written()?.saturating_sub(self.taken).min(self.frames - first);
        if count == 0 {
            return Ok(false);
        }
        // The driver writes into the buffer unseen by the compiler.
        let all = std::hint::black_box(buffer);
        let place = |frame: u64| frame as usize * self.channels;
        self.scaled.clear();
        self.scaled.extend(all[place(first)..place(first + count)].iter().map(|volts| (volts / self.range_v) as f32));
        let behind = written()?.saturating_sub(self.taken);
        if behind > self.frames {
            // The data may be from two laps of the buffer.
            self.taken += behind;
            take(Chunk::Lost(behind), 0);
        } else {
            self.taken += count;
            take(Chunk::F32(&self.scaled), behind.saturating_sub(count));
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn module(product_name: &str, unique_id: &str) -> DaqDeviceDescriptor {
        DaqDeviceDescriptor {
            product_name: product_name.to_owned(),
            product_id: 1,
            interface: DaqDeviceInterface::USB,
            dev_string: product_name.to_owned(),
            unique_id: unique_id.to_owned(),
        }
    }

    #[test]
    fn a_module_is_found_by_its_name_or_number() {
        // Catches another module that is taken, and an error that does not say what there is.
        let found = [module("DT9837A", "11"), module("DT9837B", "12"), module("DT9837B", "13")];
        assert_eq!(pick("13", &found), Ok(&found[2]));
        assert_eq!(pick("DT9837A", &found), Ok(&found[0]));
        let want = "no module DT9837C is connected; found: DT9837A (11), DT9837B (12), DT9837B (13)";
        assert_eq!(pick("DT9837C", &found), Err(want.to_owned()));
        let want = "several modules are called DT9837B: give the number of one: DT9837B (12), DT9837B (13)";
        assert_eq!(pick("DT9837B", &found), Err(want.to_owned()));
    }

    #[test]
    fn a_module_that_is_not_connected_is_reported() {
        // Catches a start without the module that was asked for, and a library that ends the program where there is no USB.
        let Err(error) = DaqModule::open("no such module", &CaptureConfig::default()) else { panic!("it was opened") };
        assert!(error.starts_with("no module no such module is connected; found: "), "{error}");
    }

    #[test]
    fn a_rate_that_the_module_does_not_have_is_refused() {
        // Catches times that are wrong by the ratio of two rates, and a clock's last digits that are refused.
        assert_eq!(check_rate(48_000.0, 48_000.0), Ok(()));
        assert_eq!(check_rate(48_000.0, 47_999.2), Ok(()));
        let want = |got: &str| Err(format!("it samples at {got} Hz, not at 48000"));
        assert_eq!(check_rate(48_000.0, 47_990.0), want("47990"));
        assert_eq!(check_rate(48_000.0, 52_734.0), want("52734"));
        assert_eq!(check_rate(48_000.0, f64::NAN), want("NaN"));
    }

    /// What a buffer of 8 frames of 3 channels holds when `written` frames came: frame n has n + 0.25 channel volts.
    fn buffer(written: u64) -> Vec<f64> {
        let mut buffer = vec![0.0; 24];
        for frame in 0..written {
            for channel in 0..3 {
                buffer[frame as usize % 8 * 3 + channel] = frame as f64 + 0.25 * channel as f64;
            }
        }
        buffer
    }

    /// What comes of reads before and within each of which so many frames were written.
    fn passed(circle: &mut Circle, reads: &[(u64, u64)]) -> Vec<Result<Vec<f32>, u64>> {
        let mut passed = Vec::new();
        for &(before, within) in reads {
            let mut counts = [before, within].into_iter();
            let mut written = || counts.next().ok_or_else(|| "asked too often".to_owned());
            let mut take = |chunk: Chunk<'_>, _behind: u64| {
                passed.push(match chunk {
                    Chunk::F32(samples) => Ok(samples.to_vec()),
                    Chunk::Lost(frames) => Err(frames),
                });
            };
            circle.pass(&buffer(within), &mut written, &mut take).unwrap();
        }
        passed
    }

    /// Frames of 3 channels in the range of 10 V.
    fn scaled(frames: std::ops::Range<u32>) -> Result<Vec<f32>, u64> {
        Ok(frames.flat_map(|n| [0.0, 0.25, 0.5].map(|of| ((f64::from(n) + of) / 10.0) as f32)).collect())
    }

    #[test]
    fn volts_become_parts_of_full_scale_in_their_order() {
        // Catches another scale, a frame that is left out or passed on twice, and channels that are mixed at the buffer's end.
        let mut circle = Circle::new(8, 3, 10.0);
        let reads = [(0, 0), (3, 3), (3, 3), (7, 7), (11, 12), (11, 12), (13, 16), (16, 16)];
        let want = [scaled(0..3), scaled(3..7), scaled(7..8), scaled(8..11), scaled(11..13), scaled(13..16)];
        assert_eq!(passed(&mut circle, &reads), want);
        let mut circle = Circle::new(8, 3, 1.0);
        assert_eq!(passed(&mut circle, &[(1, 1)]), [Ok(vec![0.0, 0.25, 0.5])]);
    }

    #[test]
    fn a_lap_of_the_driver_is_reported_as_lost() {
        // Catches samples of another lap: those that were written over before they were read, and while they were.
        let mut circle = Circle::new(8, 3, 10.0);
        let reads = [(3, 3), (12, 12), (15, 15), (16, 16), (20, 20), (24, 25), (27, 27)];
        let want =
            [scaled(0..3), Err(9), scaled(12..15), scaled(15..16), scaled(16..20), scaled(20..24), scaled(24..27)];
        assert_eq!(passed(&mut circle, &reads), want);
        assert_eq!(passed(&mut circle, &[(30, 36), (37, 37)]), [Err(9), scaled(36..37)]);
    }
}
