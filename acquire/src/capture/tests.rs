//! Simulated scans through ALSA into the code that listens: its plugin `file` plays what a thread here writes into a pipe.
//!
//! Each test runs its ear in a process of its own, because ALSA reads its configuration from the environment.

use std::collections::VecDeque;
use std::fs::File;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::thread::Builder;
use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_model::SimulationConfig;
use tapline_wire::{CacheLine, TapHeader, cache_lines_for, f32_of_mut, i16_of_mut};

use super::ear::Ear;
use super::{CaptureConfig, DeviceName, TriggerConfig};
use crate::{ScanConfig, SimulatedLine, Source as _};

/// Frames that are written at once; ALSA reads as many, and a pipe passes them on whole, as they have no more than 4096 bytes. Of a
/// larger write it may pass on a part, and ALSA would play old samples for the rest.
const PIECE: usize = 512;

/// Taps that may be written before those before them were taken.
const AHEAD: usize = 16;

/// The part of a record that is compared, before and after the trigger.
const PRE: usize = 100;

fn config(bits: u16, sample_count: u32) -> CaptureConfig {
    CaptureConfig {
        sample_rate_hz: 40_960,
        bits,
        pre_trigger_samples: PRE as u32,
        sample_count,
        trigger: TriggerConfig { level: 0.02, hold_off_s: 0.03, ..TriggerConfig::default() },
        ..CaptureConfig::default()
    }
}

/// The process that listens: prints the place and the hash of each tap, until it has heard enough.
#[test]
#[ignore = "started by the other tests"]
fn ear_process() {
    let Ok(text) = std::env::var("TAPLINE_TEST_CAPTURE") else { return };
    let (count, text) = text.split_once('\n').unwrap();
    let config: CaptureConfig = toml::from_str(text).unwrap();
    let (sender, woken) = sync_channel(AHEAD);
    let device = DeviceName::Alsa("scan".to_owned());
    let ear = Ear::listen(&device, &config, 1, Arc::new(move || sender.try_send(()).unwrap_or_default())).unwrap();
    let mut buffer = vec![CacheLine::default(); cache_lines_for(config.recording().payload_bytes_max())];
    let samples = 2 * config.sample_count as usize;
    let mut out = std::io::stdout().lock();
    let mut taken = 0;
    while taken < count.parse().unwrap() {
        let Some(tap) = ear.take_tap() else {
            woken.recv_timeout(Duration::from_secs(60)).expect("no tap for a minute");
            continue;
        };
        assert!(ear.copy(tap, &mut buffer));
        let hash = match config.bits {
            16 => hash_of(i16_of_mut(&mut buffer)[..samples].iter().map(|&x| i32::from(x))),
            _ => hash_of(f32_of_mut(&mut buffer)[..samples].iter().map(|&x| (x * 8_388_608.0) as i32)),
        };
        // The ear counts from 1 on.
        let crossing = tap.crossing;
        writeln!(out, "\ntap {} {} {hash}", crossing.sample - 1, crossing.time_samples - 1.0).unwrap();
        taken += 1;
    }
    assert_eq!(ear.take_alarms(), [""; 0]);
}

fn hash_of(samples: impl Iterator<Item = i32>) -> u64 {
    let mut hasher = DefaultHasher::new();
    samples.for_each(|sample| sample.hash(&mut hasher));
    hasher.finish()
}

/// Starts a process that hears `count` taps of what is written into the pipe.
fn ear(dir: &Path, config: &CaptureConfig, count: usize) -> (Child, File) {
    let (pipe, conf) = (dir.join("scan.pcm"), dir.join("asound.conf"));
    let status = Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(status.success());
    let text = format!(
        "pcm.null {{ type null }}\npcm.scan {{ type file slave.pcm null file /dev/null infile {pipe:?} format raw }}\n"
    );
    std::fs::write(&conf, text).unwrap();
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["capture::tests::ear_process", "--exact", "--ignored", "--nocapture"])
        .env("ALSA_CONFIG_PATH", conf)
        .env("TAPLINE_TEST_CAPTURE", format!("{count}\n{}", toml::to_string(config).unwrap()))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    (child, File::create(pipe).unwrap())
}

/// What is planted into a tap.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Planted {
    Nothing,
    /// The impactor does not hit.
    Missed,
    /// It hits again.
    Double,
    /// A click on the cable before the tap.
    Click,
    /// A step of the offset before the tap.
    Step,
    /// The force is cut at a third of its peak.
    Clipped,
}

const EACH: [Planted; 6] =
    [Planted::Nothing, Planted::Missed, Planted::Double, Planted::Click, Planted::Step, Planted::Clipped];

/// Frames of a simulated scan, one tap each `period` frames.
struct Scan {
    line: SimulatedLine,
    buffer: Vec<CacheLine>,
    period: usize,
    rng: ChaCha8Rng,
    offset: i32,
}

impl Scan {
    fn new(tap_count: usize, period: usize) -> Self {
        let scan = ScanConfig {
            offsets_mm: vec![0.0],
            velocities_m_per_s: vec![1.5],
            repetitions: (tap_count / 100).try_into().unwrap(),
            shoulders: 1,
            closing_tap: false,
            ..ScanConfig::default()
        };
        let simulation = SimulationConfig { sample_count: period as u32, ..SimulationConfig::default() };
        let line = SimulatedLine::new(&scan, &simulation).unwrap();
        let buffer = vec![CacheLine::default(); cache_lines_for(line.plan().recording.payload_bytes_max())];
        Self { line, buffer, period, rng: ChaCha8Rng::seed_from_u64(7), offset: 0 }
    }

    /// Force and sound of tap number `row`, 24 bits: without noise, and with noise of `noise` counts of 16 bits and what is
    /// `planted`.
    fn tap(&mut self, row: usize, noise: i32, planted: Planted) -> (Vec<[i32; 2]>, Vec<[i32; 2]>) {
        let mut header = TapHeader::default();
        self.line.render(row as u32, 0, &mut header, &mut self.buffer).unwrap();
        let count = header.sample_count as usize;
        let (force, sound) = i16_of_mut(&mut self.buffer)[..2 * count].split_at(count);
        let peak = force.iter().copied().max().map_or(0, i32::from);
        let mut frames: Vec<[i32; 2]> =
            force.iter().zip(sound).take(self.period).map(|(&force, &sound)| [force.into(), sound.into()]).collect();
        let tap = header.pre_trigger_samples as usize;
        let clean = frames.clone();
        match planted {
            Planted::Nothing | Planted::Step => {}
            Planted::Missed => frames.iter_mut().for_each(|frame| frame[0] = 0),
            Planted::Double => {
                let second: Vec<i32> = frames[tap - 20..tap + 180].iter().map(|frame| frame[0] / 2).collect();
                frames[tap + 600..].iter_mut().zip(second).for_each(|(frame, force)| frame[0] += force);
            }
            Planted::Click => frames[tap - 300][0] += 9000,
            Planted::Clipped => frames.iter_mut().for_each(|frame| frame[0] = frame[0].min(peak / 3)),
        }
        for (k, frame) in frames.iter_mut().enumerate() {
            if planted == Planted::Step && k == tap - 400 {
                self.offset = 1500 - self.offset;
            }
            frame[0] += self.offset;
            for value in frame {
                let noise = if noise > 0 { self.rng.random_range(-noise * 256..=noise * 256) } else { 0 };
                *value = (*value * 256 + noise).clamp(-8_388_608, 8_388_607);
            }
        }
        (clean, frames)
    }
}

/// Bytes of `frames` as a device of so many bits gives them.
fn bytes_of(frames: &[[i32; 2]], bits: u16) -> Vec<u8> {
    let samples = frames.iter().flatten();
    match bits {
        16 => samples.flat_map(|&x| ((x >> 8) as i16).to_le_bytes()).collect(),
        24 => samples.flat_map(|&x| x.to_le_bytes().into_iter().take(3)).collect(),
        _ => samples.flat_map(|&x| (x << 8).to_le_bytes()).collect(),
    }
}

/// The last frames that were written, by their numbers.
#[derive(Default)]
struct Window {
    frames: VecDeque<[i32; 2]>,
    first: u64,
}

impl Window {
    fn push(&mut self, frames: &[[i32; 2]], most: usize) {
        self.frames.extend(frames);
        let spare = self.frames.len().saturating_sub(most);
        self.frames.drain(..spare);
        self.first += spare as u64;
    }

    /// The hash of the record whose trigger is frame `trigger`, as a device of so many bits gives it.
    fn hash(&self, trigger: u64, config: &CaptureConfig) -> u64 {
        let first = usize::try_from(trigger - u64::from(config.pre_trigger_samples) - self.first).unwrap();
        let count = config.sample_count as usize;
        let of = |channel: usize| self.frames.range(first..first + count).map(move |frame| frame[channel]);
        hash_of(of(0).chain(of(1)).map(|sample| if config.bits == 16 { sample >> 8 } else { sample }))
    }
}

/// Where the force of a tap without noise is half of its peak, counted from its first frame.
fn half_of_peak(frames: &[[i32; 2]]) -> f64 {
    let (base, peak) = (frames[0][0], frames.iter().map(|frame| frame[0]).max().unwrap());
    let half = f64::from(base) + 0.5 * f64::from(peak - base);
    let above = frames.iter().position(|frame| f64::from(frame[0]) >= half).unwrap();
    let (low, high) = (f64::from(frames[above - 1][0]), f64::from(frames[above][0]));
    above as f64 - 1.0 + (half - low) / (high - low)
}

/// Plays `tap_count` taps with one after the other of `noises`, in counts of 16 bits, and checks that each that hits is heard
/// once, at its place, with its own samples. Returns the largest error of a time, in samples, of what is cut off by nothing.
fn play(tap_count: usize, period: usize, bits: u16, noises: &[i32], planted: impl Fn(usize) -> Planted) -> f64 {
    let dir = tempfile::tempdir().unwrap();
    let config = config(bits, (period as u32 / 2).min(8192));
    let is_hit = |row: usize| row < tap_count && planted(row) != Planted::Missed;
    let expected = (0..tap_count).filter(|&row| is_hit(row)).count();
    let (mut child, mut pipe) = ear(dir.path(), &config, expected);
    let (sender, heard) = sync_channel(4 * AHEAD);
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let reader = Builder::new().name("lines".to_owned()).spawn(move || {
        let taps = lines.map(Result::unwrap).filter(|line| line.starts_with("tap "));
        taps.for_each(|line| sender.send(line).unwrap());
    });
    let (mut scan, mut window, mut worst) = (Scan::new(tap_count, period), Window::default(), 0.0_f64);
    let (mut waited_for, mut left) = (VecDeque::new(), Vec::new());
    let mut check = |line: &str, window: &Window, (row, time): (usize, f64)| {
        let words: Vec<&str> = line.split(' ').collect();
        let (trigger, at): (u64, f64) = (words[1].parse().unwrap(), words[2].parse().unwrap());
        assert_eq!(trigger / period as u64, row as u64, "{:?}", planted(row));
        assert_eq!(words[3].parse(), Ok(window.hash(trigger, &config)), "tap {row}");
        if planted(row) != Planted::Clipped {
            let error = (at - time).abs();
            worst = if error > worst { error } else { worst };
        }
    };
    for row in 0..tap_count {
        let noise = noises[row * noises.len() / tap_count];
        let (clean, frames) = scan.tap(row, noise, planted(row));
        window.push(&frames, (2 * AHEAD + 4) * period);
        left.extend_from_slice(&frames);
        if is_hit(row) {
            waited_for.push_back((row, (row * period) as f64 + half_of_peak(&clean)));
        }
        if row + 1 == tap_count {
            // Silence behind the last tap, up to a whole piece: no more, for it is played as fast as it is heard.
            left.resize((left.len() + period).next_multiple_of(PIECE), [scan.offset * 256, 0]);
        }
        let whole = left.len() / PIECE * PIECE;
        for piece in left[..whole].chunks(PIECE) {
            match pipe.write_all(&bytes_of(piece, bits)) {
                // The ear may have heard all, and be gone, before the last silence is written.
                Err(error) if row + 1 == tap_count && error.kind() == std::io::ErrorKind::BrokenPipe => {}
                written => written.unwrap(),
            }
        }
        left.drain(..whole);
        let may_wait = if row + 1 == tap_count { 0 } else { AHEAD };
        while waited_for.len() > may_wait {
            check(&heard.recv().expect("a tap that was heard"), &window, waited_for.pop_front().unwrap());
        }
    }
    // It ends by itself when it has heard them all. At the end of the pipe ALSA would play what it has once more.
    assert!(child.wait().unwrap().success());
    drop(pipe);
    reader.unwrap().join().unwrap();
    assert_eq!(heard.try_iter().count(), 0);
    worst
}

#[test]
fn every_tap_of_a_scan_is_heard_once() {
    // Catches a tap that is missed, heard twice, or has the samples of another, and channels that are apart: 20 taps a second.
    // The noise goes up to 0.2 % of the lowest peak; [`trigger`](super::trigger) has more of it.
    let worst = play(10_000, 2048, 16, &[0, 2, 5, 10, 15], |_| Planted::Nothing);
    assert!(worst < 0.1, "{worst} samples");
}

#[test]
fn every_format_is_heard_as_it_is() {
    // Catches bytes in another order, and a sample that is rounded.
    for bits in [24, 32] {
        assert!(play(300, 2048, bits, &[0, 5], |_| Planted::Nothing) < 0.1);
    }
}

#[test]
fn what_is_no_tap_is_not_heard_and_what_is_one_is() {
    // Catches a click, a step, a rebound or a missed hit that shifts all taps behind it, and a clipped pulse that is not heard:
    // 2.5 taps a second.
    let worst = play(10_000, 16_384, 16, &[0, 2, 5, 10, 15], |row| EACH[row % EACH.len()]);
    assert!(worst < 0.1, "{worst} samples");
}
