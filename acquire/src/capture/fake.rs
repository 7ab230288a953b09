//! A device for tests: it gives what a test plays, and nothing else.

use std::ops::Range;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

use tapline_wire::{CacheLine, cache_lines_for, f32_of_mut, i16_of_mut};

use crate::capture::device::{Chunk, Device};
use crate::capture::ear::{Ear, HeardTap};
use crate::capture::{CaptureConfig, TriggerConfig};

/// Samples of a record before its tap.
pub(crate) const PRE: u64 = 100;

/// Samples of a record.
pub(crate) const RECORD: u64 = 400;

/// Samples of a force pulse.
const PULSE: u64 = 40;

/// Force and sound, in counts of 16 bits.
pub(crate) type Frame = [i16; 2];

/// What a device does next.
#[derive(Debug)]
pub(crate) enum Step {
    /// It gives frames.
    Frames(Vec<Frame>),
    /// The same, read when so many frames had come behind them.
    Late(Vec<Frame>, u64),
    /// It has lost so many.
    Lost(u64),
    /// It fails, or cannot be opened, for this reason.
    Fails(&'static str),
    /// It can be opened.
    Opens,
    /// It gives nothing for now.
    Nothing,
}

/// What is heard through: whatever is played into it.
#[derive(Debug)]
pub(crate) struct Cable {
    pub(crate) ear: Arc<Ear>,
    steps: SyncSender<Step>,
}

/// The configuration of what is heard through a cable.
pub(crate) fn config(bits: u16) -> CaptureConfig {
    CaptureConfig {
        sample_rate_hz: 40_960,
        bits,
        pre_trigger_samples: PRE as u32,
        sample_count: RECORD as u32,
        trigger: TriggerConfig { hold_off_s: 0.005, ..TriggerConfig::default() },
        ..CaptureConfig::default()
    }
}

/// Frames number `numbers` of a stream with the pulses of taps that begin at `taps`; each frame's sound is its own.
pub(crate) fn frames(numbers: Range<u64>, taps: &[u64]) -> Vec<Frame> {
    let pulse = |after: u64| (std::f64::consts::PI * after as f64 / PULSE as f64).sin().powi(2) * 8000.0;
    let force = |n: u64| taps.iter().filter(|&&tap| (tap..tap + PULSE).contains(&n)).map(|tap| pulse(n - tap)).sum();
    numbers.map(|n| [f64::round(force(n)) as i16, (n % 30_011) as i16]).collect()
}

/// The record of the tap that begins at `tap`: its pulse has risen to 2 % of its peak one sample later.
pub(crate) fn record(tap: u64) -> Vec<Frame> {
    let first = tap + 1 - PRE;
    frames(first..first + RECORD, &[tap])
}

impl Cable {
    /// A cable with a device that is open.
    pub(crate) fn new(config: &CaptureConfig) -> Self {
        let (steps, played) = sync_channel(0);
        let played = Arc::new(Mutex::new(played));
        let open = move || match next(&played) {
            Step::Opens => Ok(Box::new(Fake { played: Arc::clone(&played) }) as Box<dyn Device>),
            Step::Fails(why) => Err(why.to_owned()),
            other => Err(format!("{other:?} of a device that is not open")),
        };
        let cable = Self { ear: Ear::listen_to("fake", config, 1, Arc::new(|| {}), open).unwrap(), steps };
        cable.play([Step::Opens]);
        cable
    }

    /// Has the device do one thing after the other; the ear has heard all of it then, but for a failure at the end.
    pub(crate) fn play(&self, steps: impl IntoIterator<Item = Step>) {
        let mut is_open = true;
        for step in steps {
            is_open = !matches!(step, Step::Fails(_));
            self.steps.send(step).unwrap();
        }
        // Who takes this has done all before it.
        if is_open {
            self.steps.send(Step::Nothing).unwrap();
        }
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.ear.stop();
    }
}

/// What is played next; a device that nobody plays any more has failed.
fn next(played: &Mutex<Receiver<Step>>) -> Step {
    played.lock().unwrap().recv().unwrap_or(Step::Fails("the test is over"))
}

struct Fake {
    played: Arc<Mutex<Receiver<Step>>>,
}

impl Device for Fake {
    fn read(&mut self, take: &mut dyn FnMut(Chunk<'_>, u64)) -> Result<(), String> {
        let mut give = |frames: &[Frame], behind: u64| {
            let samples: Vec<f32> = frames.iter().flatten().map(|&x| f32::from(x) / 32_768.0).collect();
            take(Chunk::F32(&samples), behind);
        };
        match next(&self.played) {
            Step::Frames(frames) => give(&frames, 0),
            Step::Late(frames, behind) => give(&frames, behind),
            Step::Lost(count) => take(Chunk::Lost(count), 0),
            Step::Fails(why) => return Err(why.to_owned()),
            Step::Nothing => {}
            Step::Opens => return Err("it was open".to_owned()),
        }
        Ok(())
    }
}

/// The frames of `samples`, channel by channel, in the format of a device of so many bits.
pub(crate) fn frames_of(samples: &mut [CacheLine], bits: u16) -> Vec<Frame> {
    let count = 2 * RECORD as usize;
    let counts: Vec<i16> = match bits {
        16 => i16_of_mut(samples)[..count].to_vec(),
        _ => f32_of_mut(samples)[..count].iter().map(|&x| (x * 32_768.0) as i16).collect(),
    };
    let (force, sound) = counts.split_at(count / 2);
    force.iter().zip(sound).map(|(&force, &sound)| [force, sound]).collect()
}

/// The record of a tap as an ear has it.
pub(crate) fn heard(ear: &Ear, tap: HeardTap) -> Vec<Frame> {
    let mut samples = vec![CacheLine::default(); cache_lines_for(ear.config.recording().payload_bytes_max())];
    assert!(ear.copy(tap, &mut samples));
    frames_of(&mut samples, ear.config.bits)
}
