//! The sound of a simulated rig: samples of its hits, written continuously as a sound card would give them.

use std::fs::OpenOptions;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use tapline_model::{SimulatedRig, SimulatedTap, SimulationConfig};

use crate::simulated::{SERIAL, Tyre, default_tyre, rig_of};
use crate::source::serial_of;
use crate::{Error, ScanConfig};

/// Approximate time of one write: a power of two of samples, as stations read it.
const PERIOD_S: f64 = 0.01;

/// Time from a hit to its unwanted repetition.
const AGAIN_S: f64 = 0.06;

/// Most hits that are not written yet.
const HITS_MAX: usize = 8;

/// Writes the sound of a rig into a file or pipe: 16 bits, force and sound, interleaved, in real time.
#[derive(Debug)]
pub(super) struct Player {
    scan: ScanConfig,
    simulation: SimulationConfig,
    hits: SyncSender<Vec<i16>>,
    /// The casing on the rig, and its hits by place and offset in the order of their hits.
    rig: Option<(String, SimulatedRig, Vec<Place>)>,
    place: Place,
}

/// The impactor's position, as commanded by the station.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Place {
    shoulder: u16,
    location: u32,
    offset_mm: f64,
}

impl Player {
    /// Writes into `path` from now on; a pipe is waited for.
    pub(super) fn start(path: &Path, scan: &ScanConfig, simulation: &SimulationConfig) -> Result<Self, Error> {
        scan.validate()?;
        let (hits, heard) = sync_channel(HITS_MAX);
        let (path, rate_hz) = (path.to_owned(), simulation.sample_rate_hz);
        let run = move || {
            // The listener may leave and return.
            while let Err(error) = write(&path, rate_hz, &heard) {
                tracing::info!("{}: {error}; it is opened again", path.display());
                thread::sleep(Duration::from_millis(200));
            }
        };
        let thread = thread::Builder::new().name("played".to_owned()).spawn(run);
        thread.map_err(|source| Error::Thread { what: "the sound of the rig".to_owned(), source })?;
        Ok(Self { scan: scan.clone(), simulation: simulation.clone(), hits, rig: None, place: Place::default() })
    }

    /// Puts the casing `serial` on the rig: one that the scan lists, or a sound one.
    pub(super) fn load(&mut self, serial: &str) -> Result<(), Error> {
        let listed = self.scan.tyre.iter().find(|tyre| tyre.serial == serial);
        let tyre = match listed {
            Some(tyre) => Tyre { serial: serial_of(SERIAL, serial)?, station: 1, cracks: tyre.crack.clone() },
            None => default_tyre(&self.scan, serial, 1, false)?,
        };
        self.rig = Some((serial.to_owned(), rig_of(&self.scan, &self.simulation, &[tyre])?, Vec::new()));
        Ok(())
    }

    /// Moves as the station's `move` says.
    pub(super) fn go(&mut self, words: &str) {
        let mut words = words.split(' ');
        let mut next = || words.next().unwrap_or_default();
        let (shoulder, location, _angle) = (next().parse().unwrap_or(0), next().parse().unwrap_or(0), next());
        self.place = Place { shoulder, location, offset_mm: next().parse().unwrap_or(0.0) };
    }

    /// Hits `times` times in quick succession.
    pub(super) fn hit(&mut self, velocity_m_per_s: f64, times: usize) {
        let Some((serial, rig, hits)) = &mut self.rig else { return };
        let mut frames: Vec<i16> = Vec::new();
        for number in 0..times {
            let repetition = hits.iter().filter(|place| **place == self.place).count();
            hits.push(self.place);
            let tap = SimulatedTap {
                tyre_serial: serial,
                shoulder: self.place.shoulder,
                offset_mm: self.place.offset_mm,
                velocity_m_per_s,
                location: self.place.location,
                location_count: self.scan.locations,
                repetition: u16::try_from(repetition).unwrap_or(u16::MAX),
                attempt: 0,
            };
            let mut samples = vec![0; rig.sample_total()];
            rig.render(&tap, &mut samples);
            let (force, sound) = samples.split_at(samples.len() / 2);
            let first = 2 * (number as f64 * AGAIN_S * self.simulation.sample_rate_hz) as usize;
            frames.resize(frames.len().max(first + samples.len()), 0);
            let interleaved = force.iter().zip(sound).flat_map(|(&force, &sound)| [force, sound]);
            frames[first..].iter_mut().zip(interleaved).for_each(|(sum, sample)| *sum = sum.saturating_add(sample));
        }
        if times > 0 && self.hits.try_send(frames).is_err() {
            tracing::error!("nobody reads the sound of the rig: a hit is not heard");
        }
    }
}

/// Writes `hits` as they come, and silence between them.
fn write(path: &PathBuf, rate_hz: f64, hits: &Receiver<Vec<i16>>) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).open(path)?;
    let period = ((PERIOD_S * rate_hz) as usize).next_power_of_two();
    let period_time = Duration::try_from_secs_f64(period as f64 / rate_hz).map_err(io::Error::other)?;
    let (mut left, mut due): (Vec<i16>, Instant) = (Vec::new(), Instant::now());
    loop {
        if left.is_empty() {
            left = hits.try_recv().unwrap_or_default();
        }
        let count = left.len().min(2 * period);
        let mut samples: Vec<i16> = left.drain(..count).collect();
        samples.resize(2 * period, 0);
        let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
        file.write_all(&bytes)?;
        due += period_time;
        match due.checked_duration_since(Instant::now()) {
            Some(early) => thread::sleep(early),
            // A long stop is not made up for in a burst.
            None if due.elapsed() > Duration::from_secs(1) => due = Instant::now(),
            None => {}
        }
    }
}
