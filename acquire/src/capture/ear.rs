//! What one station hears: the latest samples of its device, and the taps found in them.

use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use tapline_wire::{CacheLine, OVER, f32_of_mut, i16_of_mut, now_ns};

use crate::Wake;
use crate::capture::device::{self, Chunk, Device};
use crate::capture::ring::Ring;
use crate::capture::{CaptureConfig, Crossing, DeviceName, NotTaps, Trigger};

/// Most taps that wait to be taken.
const TAPS_MAX: usize = 64;

/// Most alarms that wait to be sent.
const ALARMS_MAX: usize = 16;

/// First and longest wait before a device is opened again.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(5));

/// Real-time priority of the thread that listens.
const PRIORITY: u8 = 50;

/// Counts of a full-scale 16-bit sample.
const COUNTS_FULL_SCALE: f32 = 32_768.0;

/// A tap that was heard, with its whole record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HeardTap {
    /// Where the trigger found it.
    pub(crate) crossing: Crossing,
    /// When the force was half of its peak, ns since the Unix epoch.
    pub(crate) time_ns: i64,
    /// The same on a monotonic clock.
    at: Instant,
    /// Whether another pulse came after its record and within its hold-off.
    is_struck_again: bool,
}

/// What a station hears.
pub(crate) struct Ear {
    pub(crate) device: String,
    pub(crate) config: CaptureConfig,
    state: Mutex<State>,
    is_stopped: AtomicBool,
    wake: Wake,
}

#[derive(Debug)]
struct State {
    samples: Ring,
    /// The trigger level, a part of full scale.
    level: f64,
    /// Found, but their records are not complete yet.
    begun: VecDeque<HeardTap>,
    /// Complete, and not taken yet.
    taps: VecDeque<HeardTap>,
    /// Whether an alarm has said that they are too many, since one was last taken.
    are_too_many: bool,
    alarms: Vec<String>,
    /// Why the device is not heard.
    fault: Option<String>,
    /// How often taps were lost, or may have been.
    loss_count: u64,
    not_taps: NotTaps,
}

impl fmt::Debug for Ear {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Ear").field("device", &self.device).finish_non_exhaustive()
    }
}

impl Ear {
    /// Listens to `device` for station number `station` until [`Ear::stop`]; `wake` is called when a tap was heard.
    ///
    /// # Errors
    /// If no thread can be started. A missing device is not an error: it is tried again.
    pub(crate) fn listen(
        device: &DeviceName,
        config: &CaptureConfig,
        station: u16,
        wake: Wake,
    ) -> std::io::Result<Arc<Self>> {
        let opened = (device.clone(), config.clone());
        Self::listen_to(&device.to_string(), config, station, wake, move || device::open(&opened.0, &opened.1))
    }

    /// The same for the device that `open` opens.
    pub(super) fn listen_to(
        device: &str,
        config: &CaptureConfig,
        station: u16,
        wake: Wake,
        open: impl FnMut() -> Result<Box<dyn Device>, String> + Send + 'static,
    ) -> std::io::Result<Arc<Self>> {
        let state = State {
            samples: Ring::new(2, config.buffer_frames()),
            level: config.trigger.level,
            begun: VecDeque::new(),
            taps: VecDeque::new(),
            are_too_many: false,
            alarms: Vec::new(),
            fault: None,
            loss_count: 0,
            not_taps: NotTaps::default(),
        };
        let ear = Arc::new(Self {
            device: device.to_owned(),
            config: config.clone(),
            state: Mutex::new(state),
            is_stopped: AtomicBool::new(false),
            wake,
        });
        let of_thread = Arc::clone(&ear);
        thread::Builder::new().name(format!("capture {station}")).spawn(move || of_thread.run(station, open))?;
        Ok(ear)
    }

    /// Ends the thread; it may take a moment to notice.
    pub(crate) fn stop(&self) {
        self.is_stopped.store(true, Ordering::Relaxed);
    }

    /// Sets the trigger `level`.
    pub(crate) fn set_level(&self, level: f64) {
        self.state().level = level;
    }

    /// Whether a tap waits to be taken.
    pub(crate) fn has_tap(&self) -> bool {
        let state = self.state();
        state.taps.iter().any(|tap| self.is_whole(&state.samples, *tap))
    }

    /// How often taps were lost, or may have been.
    pub(crate) fn loss_count(&self) -> u64 {
        self.state().loss_count
    }

    /// The next tap whose samples are all available; taps taken too late for that are skipped.
    pub(crate) fn take_tap(&self) -> Option<HeardTap> {
        let mut state = self.state();
        while let Some(tap) = state.taps.pop_front() {
            state.are_too_many = false;
            if self.is_whole(&state.samples, tap) {
                return Some(tap);
            }
            state.loss_count += 1;
            state.alarm("a tap was heard but not taken in time: capture.buffer_s is too short, or samples were lost");
        }
        None
    }

    /// Forgets the taps before `time`; returns how many they were.
    pub(crate) fn forget_before(&self, time: Instant) -> usize {
        let mut state = self.state();
        let before = state.taps.len() + state.begun.len();
        state.taps.retain(|tap| tap.at >= time);
        state.begun.retain(|tap| tap.at >= time);
        before - state.taps.len() - state.begun.len()
    }

    /// Drops waiting taps of which some samples have been lost since.
    pub(crate) fn forget_lost(&self) {
        let State { taps, samples, .. } = &mut *self.state();
        taps.retain(|tap| self.is_whole(samples, *tap));
    }

    /// How many strikes were heard whose taps were not taken, including those with incomplete records.
    pub(crate) fn strike_count(&self) -> usize {
        let state = self.state();
        state.taps.iter().chain(&state.begun).map(|tap| 1 + usize::from(tap.is_struck_again)).sum()
    }

    /// Copies the record of `tap` into `buffer`, channel by channel; `false` if it is no longer available.
    pub(crate) fn copy(&self, tap: HeardTap, buffer: &mut [CacheLine]) -> bool {
        let (state, count) = (self.state(), self.config.sample_count as usize);
        if !self.is_whole(&state.samples, tap) {
            return false;
        }
        let (first, ring) = (self.first_frame(tap), &state.samples);
        match self.config.bits {
            // The original counts of the device: fractions of full scale hold them exactly.
            16 => ring.copy_to(first, &mut i16_of_mut(buffer)[..2 * count], |x| (x * COUNTS_FULL_SCALE) as i16),
            _ => ring.copy_to(first, &mut f32_of_mut(buffer)[..2 * count], |x| x),
        }
        true
    }

    /// Number of the first frame of the record of `tap`.
    fn first_frame(&self, tap: HeardTap) -> u64 {
        tap.crossing.sample.saturating_sub(self.config.pre_trigger_samples.into())
    }

    /// Number of the frame after the record of `tap`.
    fn end_frame(&self, tap: HeardTap) -> u64 {
        self.first_frame(tap) + u64::from(self.config.sample_count)
    }

    /// Whether all of the record of `tap` is among `samples`.
    fn is_whole(&self, samples: &Ring, tap: HeardTap) -> bool {
        samples.has(self.first_frame(tap), self.config.sample_count as usize)
    }

    /// Whether the record of `tap` is still there.
    pub(crate) fn has(&self, tap: HeardTap) -> bool {
        self.is_whole(&self.state().samples, tap)
    }

    /// What was no tap.
    pub(crate) fn not_taps(&self) -> NotTaps {
        self.state().not_taps
    }

    /// The last `count` samples of the force and of the sound, parts of full scale; fewer where fewer have come.
    pub(crate) fn latest(&self, count: usize) -> [Vec<f32>; 2] {
        self.state().samples.latest(count).map(Iterator::collect)
    }

    /// The alarms since the last call.
    pub(crate) fn take_alarms(&self) -> Vec<String> {
        std::mem::take(&mut self.state().alarms)
    }

    /// Why the device is not heard, if it is not.
    pub(crate) fn fault(&self) -> Option<String> {
        self.state().fault.clone()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run(&self, station: u16, mut open: impl FnMut() -> Result<Box<dyn Device>, String>) {
        prefer_this_thread(station);
        let mut wait = BACK_OFF.0;
        while !self.is_stopped.load(Ordering::Relaxed) {
            let why = match open() {
                Ok(mut device) => {
                    tracing::info!("station {station}: listens to {}", self.device);
                    let why = self.follow(device.as_mut());
                    // A fault ends with the first samples, not when the device opens.
                    if self.state().fault.is_none() {
                        wait = BACK_OFF.0;
                    }
                    why
                }
                Err(why) => why,
            };
            if self.is_stopped.load(Ordering::Relaxed) {
                return;
            }
            let text = format!("the device {} is not heard: {why}", self.device);
            if self.state().fault.as_ref() != Some(&text) {
                tracing::error!("station {station}: {text}; trying again");
                let mut state = self.state();
                state.end_fault();
                state.alarm(&text);
                state.fault = Some(text);
                drop(state);
                (self.wake)();
            }
            thread::sleep(wait);
            wait = (2 * wait).min(BACK_OFF.1);
        }
    }

    /// Listens until the device fails; returns why.
    fn follow(&self, device: &mut dyn Device) -> String {
        let mut trigger = Trigger::new(&self.config.trigger, self.config.sample_rate_hz.into());
        // The frames of a reopened device continue after those heard before.
        trigger.skip(self.state().samples.end());
        self.lost(&mut trigger, 1);
        let mut force = Vec::new();
        while !self.is_stopped.load(Ordering::Relaxed) {
            let outcome = device.read(&mut |chunk, behind| match chunk {
                Chunk::Lost(frames) => {
                    let text = format!("{} has lost about {frames} samples; any tap in them is lost", self.device);
                    tracing::error!("{text}");
                    self.state().alarm(&text);
                    self.lost(&mut trigger, frames);
                }
                Chunk::F32(frames) => self.hear(&mut trigger, frames, behind, &mut force),
            });
            if let Err(why) = outcome {
                return why;
            }
        }
        "the station ends".to_owned()
    }

    /// Notes that `frames` were lost, and with them the taps that lie in them.
    fn lost(&self, trigger: &mut Trigger, frames: u64) {
        let mut state = self.state();
        state.samples.skip(frames);
        state.begun.clear();
        state.loss_count += 1;
        trigger.skip(frames);
    }

    /// Takes a piece of the stream; `behind` frames have already come after it.
    fn hear(&self, trigger: &mut Trigger, frames: &[f32], behind: u64, force: &mut Vec<f32>) {
        let (width, picked) = (usize::from(self.config.channels), self.config.picked());
        let mut state = self.state();
        force.clear();
        state.samples.push(frames, width, &picked);
        force.extend(frames.chunks_exact(width).map(|frame| frame[picked[0]]));
        state.end_fault();
        let end = state.samples.end();
        let (end_ns, end_at) = (now_ns(), Instant::now());
        trigger.set_level(state.level);
        trigger.push(force, |crossing| {
            let ago_s = ((end + behind) as f64 - crossing.time_samples) / f64::from(self.config.sample_rate_hz);
            let time_ns = end_ns - (ago_s * 1e9) as i64;
            let ago = Duration::try_from_secs_f64(ago_s).unwrap_or_default();
            let at = end_at.checked_sub(ago).unwrap_or(end_at);
            state.begun.push_back(HeardTap { crossing, time_ns, at, is_struck_again: false });
        });
        for &second in trigger.seconds() {
            // Within the record it belongs to the tap: processing detects a double hit.
            let is_behind = |tap: &HeardTap| self.end_frame(*tap) <= second;
            let tap = state.begun.iter_mut().rfind(|tap| tap.crossing.sample < second).filter(|tap| is_behind(tap));
            if let Some(tap) = tap {
                tap.is_struck_again = true;
                let after_s = (second - tap.crossing.sample) as f64 / f64::from(self.config.sample_rate_hz);
                tracing::warn!(
                    "device {}: a second strike {after_s:.3} s after a tap, within its hold-off",
                    self.device
                );
            }
        }
        state.not_taps = trigger.not_taps();
        // The crossing comes at most one longest pulse after the tap begins.
        let hold_off = trigger.hold_off_samples() + trigger.delay_samples() as u64;
        let mut is_news = false;
        while let Some(&tap) = state.begun.front() {
            // Until the hold-off is over a second strike may come.
            if self.end_frame(tap).max(tap.crossing.sample + hold_off) > end {
                break;
            }
            state.begun.pop_front();
            if state.taps.len() >= TAPS_MAX {
                state.taps.pop_front();
                state.loss_count += 1;
                if !std::mem::replace(&mut state.are_too_many, true) {
                    state.alarm("more taps were heard than the station has asked for");
                }
            }
            state.taps.push_back(tap);
            is_news = true;
        }
        drop(state);
        if is_news {
            (self.wake)();
        }
    }
}

impl State {
    /// Notes that the fault has ended, if there is one.
    fn end_fault(&mut self) {
        if let Some(text) = self.fault.take() {
            self.alarm(&format!("{OVER}{text}"));
        }
    }

    fn alarm(&mut self, text: &str) {
        if self.alarms.len() < ALARMS_MAX {
            self.alarms.push(text.to_owned());
        }
    }
}

/// Gives this thread real-time priority if that is allowed, and logs whether it is.
fn prefer_this_thread(station: u16) {
    use thread_priority::{
        RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
        set_thread_priority_and_policy, thread_native_id,
    };
    let Ok(priority) = ThreadPriorityValue::try_from(PRIORITY) else { return };
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let set = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(priority), policy);
    match set {
        Ok(()) => tracing::info!("station {station}: listens with real-time priority {PRIORITY}"),
        Err(error) => tracing::warn!(
            "station {station}: listens without real-time priority, which is not allowed here ({error:?}): raise the limit rtprio"
        ),
    }
}

#[cfg(test)]
#[path = "ear_tests.rs"]
mod tests;
