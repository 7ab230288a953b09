//! A station whose casings lie on a rig: another process or a machine that speaks `docs/rig-protocol.md`, over TCP
//! or a serial port.
//!
//! The station connects, and reconnects whenever the connection is lost. The rig reports which casing is on it, and
//! moves and hits on command. The samples of a tap are those that the station's device has recorded since the hit command;
//! without a device they are computed as on a simulated line.

mod dialogue;
mod link;
mod played;
mod protocol;
mod script;
mod simulated;
pub(crate) mod stream;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use tapline_model::SimulationConfig;
use tapline_wire::{CacheLine, Plan, RecordKind, TapHeader};

use self::dialogue::{Progress, Removal, Tap};
use self::link::Link;
use self::protocol::one_line;
pub use self::script::RigScript;
pub use self::simulated::{RigReport, serve_rig};
use crate::capture::ear::Ear;
use crate::capture::heard::HeardCasing;
use crate::capture::{CaptureConfig, DeviceName};
use crate::simulated::{Tyre, rig_of};
use crate::source::{no_such_row, serial_of};
use crate::{
    About, Arrival, Arrivals, Casing, CasingEnd, Error, Readiness, Refusal, ScanConfig, SimulatedLine, Source, Wake,
};

/// How often to poll without being woken; the rig wakes the station whenever something has changed.
const LOOK_EVERY: Duration = Duration::from_secs(5);

/// The same if taps must be taken in time from a device.
const LISTEN_EVERY: Duration = Duration::from_millis(100);

/// Why an unheard hit is made again.
const UNHEARD: &str = "the rig has hit, but nothing was heard";

/// How long a station whose hits are not heard waits before the next hit.
const UNHEARD_PAUSE: Duration = Duration::from_secs(5);

/// How long after a hit its tap must be heard, plus the length of its record.
const HEARD_WITHIN: Duration = Duration::from_millis(500);

/// How a station deals with its rig.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RigConfig {
    /// The station, from 1.
    pub station: u16,
    /// Host and port of the rig, or `serial:PATH`.
    pub address: String,
    /// How long a rig may be away during a casing before the casing is given up.
    pub patience: Duration,
    /// How long a rig may take to answer before the station reconnects.
    pub timeout: Duration,
    /// The same for finding its home.
    pub home_timeout: Duration,
    /// The file that has the serial of the casing that an earlier line finished last; `None` if there is none.
    pub last_end: Option<PathBuf>,
    /// How often a failed move or hit is tried again before its tap is refused.
    pub retakes: u16,
    /// The device that hears its taps; if left out, they are simulated.
    pub device: Option<(DeviceName, CaptureConfig)>,
}

/// The file in the folder `out` of a line that has the serial of the casing that was finished last at `station`, and that may still be
/// on its rig.
pub fn last_on_rig(out: &Path, station: u16) -> PathBuf {
    out.join("open").join(format!(".rig-{station}"))
}

/// The casings of a station's rig.
#[derive(Debug)]
pub struct RigArrivals {
    link: Arc<Link>,
    /// What hears the taps; `None` where they are simulated.
    ear: Option<Arc<Ear>>,
    station: u16,
    retakes: u16,
    scan: Arc<ScanConfig>,
    simulation: SimulationConfig,
    /// Casings that the station has taken over and that have not ended, by number and name.
    open: VecDeque<(u64, String)>,
}

impl RigArrivals {
    /// Connects to `rig`, now and whenever the connection is lost; `wake` is called when it has answered.
    ///
    /// The plan of a casing is that of `scan`, which also lists the cracks of the tyres it names; others are sound.
    ///
    /// # Errors
    /// [`Error`] for a value out of its bounds, or if no thread can be started. A rig that is off is not an error.
    pub fn open(rig: RigConfig, scan: &ScanConfig, simulation: &SimulationConfig, wake: Wake) -> Result<Self, Error> {
        scan.validate()?;
        let tyres: Result<Vec<Tyre>, Error> =
            (0..scan.tyre.len()).map(|number| crate::simulated::tyre_of(scan, number)).collect();
        rig_of(scan, simulation, &tyres?)?;
        let station = rig.station;
        let no_thread = |what: &str, source| Error::Thread { what: format!("the {what} of station {station}"), source };
        let ear = match &rig.device {
            Some((device, config)) => {
                Some(Ear::listen(device, config, station, wake.clone()).map_err(|source| no_thread("device", source))?)
            }
            None => None,
        };
        let retakes = rig.retakes;
        let link = Link::start(rig, scan.taps_per_tyre(), wake).map_err(|source| no_thread("rig", source))?;
        Ok(Self {
            link,
            ear,
            station,
            retakes,
            scan: Arc::new(scan.clone()),
            simulation: simulation.clone(),
            open: VecDeque::new(),
        })
    }
}

impl Drop for RigArrivals {
    fn drop(&mut self) {
        self.link.stop();
        self.ear.iter().for_each(|ear| ear.stop());
    }
}

impl Arrivals for RigArrivals {
    fn station(&self) -> u16 {
        self.station
    }

    fn next(&mut self) -> Result<Arrival, Error> {
        let Some(loaded) = self.link.dialogue().take_casing() else { return Ok(Arrival::NotYet) };
        let serial = serial_of("the serial of a casing on the rig", &loaded.name)?;
        let struck: Box<dyn Source> = match &self.ear {
            Some(ear) => Box::new(HeardCasing::new(Arc::clone(ear), &self.scan, serial, self.station)?),
            None => {
                let listed = self.scan.tyre.iter().find(|tyre| tyre.serial == loaded.name);
                let cracks = listed.map_or_else(Vec::new, |tyre| tyre.crack.clone());
                let tyre = Tyre { serial, station: self.station, cracks };
                Box::new(SimulatedLine::for_tyre(&self.scan, &self.simulation, &tyre, 0, 0)?)
            }
        };
        self.open.push_back((loaded.id, loaded.name.clone()));
        let taps = RigCasing {
            link: Arc::clone(&self.link),
            id: loaded.id,
            removal: loaded.removal,
            ear: self.ear.clone(),
            struck,
            retakes: self.retakes,
            failed: None,
            heard: None,
            unheard: None,
            has_refused: false,
        };
        Ok(Arrival::Casing(Casing { name: loaded.name, taps: Box::new(taps) }))
    }

    fn ended(&mut self, name: &str, end: &CasingEnd) {
        let Some(at) = self.open.iter().position(|(_, open)| open == name) else { return };
        let Some((id, _)) = self.open.remove(at) else { return };
        match end {
            CasingEnd::Closed { .. } => self.link.dialogue().report_end(id, "closed", ""),
            CasingEnd::Refused { reason } => {
                self.link.dialogue().report_end(id, "refused", &format!(" {}", one_line(reason)))
            }
        }
    }

    fn waits_for(&self) -> String {
        let fault = self.ear.as_ref().and_then(|ear| ear.fault());
        fault.unwrap_or_else(|| self.link.dialogue().waits_for())
    }

    fn fault(&self) -> Option<String> {
        self.ear.as_ref().and_then(|ear| ear.fault()).or_else(|| self.link.dialogue().fault())
    }

    fn stopped(&self) -> Option<String> {
        self.link.dialogue().stopped()
    }

    fn patience(&self) -> Option<Duration> {
        Some(self.link.dialogue().config().patience)
    }

    fn take_messages(&mut self) -> Vec<(RecordKind, String)> {
        let mut messages = self.link.dialogue().take_messages();
        messages.extend(self.ear.iter().flat_map(|ear| ear.take_alarms()).map(|text| (RecordKind::Alarm, text)));
        messages
    }

    fn look_every(&self) -> Duration {
        if self.ear.is_some() { LISTEN_EVERY } else { LOOK_EVERY }
    }
}

/// The casing on the rig.
#[derive(Debug)]
struct RigCasing {
    link: Arc<Link>,
    id: u64,
    removal: Removal,
    ear: Option<Arc<Ear>>,
    /// Its taps, once the rig has hit.
    struck: Box<dyn Source>,
    retakes: u16,
    /// The tap that failed last, and how often; hits that were not heard do not count.
    failed: Option<(Tap, u16)>,
    /// The tap that was heard last.
    heard: Option<Tap>,
    /// Unheard hits in a row, and since when.
    unheard: Option<(u16, Instant)>,
    /// Whether a tap was refused.
    has_refused: bool,
}

/// Says that no tap was heard in `time`, but what was: it shows a level that is too high, or a missing sensor.
fn unheard(ear: &Ear, time: Duration) -> String {
    let frames = time.as_secs_f64() * f64::from(ear.config.sample_rate_hz);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a time of a second or so, in samples")]
    let heights = ear.latest(frames as usize).map(|samples| height(&samples));
    let level = 100.0 * ear.config.trigger.level;
    match heights {
        [Some(force), Some(sound)] => format!(
            "{UNHEARD}: the force rose to {force:.1} % of full scale, the sound to {sound:.1} %; the trigger level is {level:.1} %"
        ),
        _ => format!("{UNHEARD}: no samples came"),
    }
}

/// How far `samples` rise or fall from their usual value, in % of full scale; `None` without samples.
fn height(samples: &[f32]) -> Option<f32> {
    let mut sorted = samples.to_vec();
    sorted.sort_by(f32::total_cmp);
    let (least, median, greatest) = (sorted.first()?, sorted[sorted.len() / 2], sorted.last()?);
    Some(100.0 * (median - least).max(greatest - median))
}

impl RigCasing {
    fn refusal(&self, reason: String) -> Refusal {
        Refusal { file: format!("rig at {}", self.link.dialogue().config().address), line: 0, reason }
    }

    /// Whether the tap that the rig reports was heard: once, and since the rig got the command to hit.
    fn heard(&mut self, tap: Tap) -> Readiness {
        let Some(ear) = &self.ear else { return Readiness::Ready };
        let Some(hit) = self.link.dialogue().hit(self.id, tap) else { return Readiness::NotYet };
        // Requested again, as after a stage has died: it is still there.
        if self.heard == Some(tap) && self.struck.poll(tap.0, tap.1) == Readiness::Ready {
            return Readiness::Ready;
        }
        // No tolerance: a delay of samples makes a tap seem later than it was, never earlier.
        let stray = ear.forget_before(hit.sent);
        if stray > 0 {
            tracing::warn!(
                "{}: {stray} taps were heard that were not asked for",
                self.link.dialogue().config().address
            );
        }
        let record = ear.config.record_time();
        let waited = hit.at.elapsed();
        let fault = match ear.strike_count() {
            0 if waited > HEARD_WITHIN + record => {
                let before = self.unheard.map_or(0, |(count, _)| count);
                self.unheard = Some((before.saturating_add(1), Instant::now()));
                let why = unheard(ear, hit.sent.elapsed());
                self.link.dialogue().begin_unheard(&why);
                why
            }
            0 => return Readiness::NotYet,
            1 => {
                let readiness = self.struck.poll(tap.0, tap.1);
                if readiness == Readiness::Ready {
                    (self.heard, self.unheard) = (Some(tap), None);
                    self.link.dialogue().end_unheard();
                }
                return readiness;
            }
            _ => {
                let why = "the rig was told to hit once, but was heard more than once";
                self.link.dialogue().end_unheard();
                self.link.dialogue().alarm_of(self.id, why);
                why.to_owned()
            }
        };
        self.heard = None;
        self.link.dialogue().fail(self.id, tap, &fault);
        self.poll(tap.0, tap.1)
    }

    /// Whether the rig must wait, because its hits would not be heard.
    fn is_deaf(&self) -> bool {
        let is_unheard = |(count, since): (u16, Instant)| count > self.retakes && since.elapsed() < UNHEARD_PAUSE;
        self.unheard.is_some_and(is_unheard) || self.ear.as_ref().is_some_and(|ear| ear.fault().is_some())
    }
}

impl Source for RigCasing {
    fn about(&self) -> &About {
        self.struck.about()
    }

    fn grow(&mut self, plan: Plan) {
        self.struck.grow(plan);
    }

    fn poll(&mut self, row: u32, attempt: u16) -> Readiness {
        if let Some(why) = self.removal.get() {
            return Readiness::Gone(why.clone());
        }
        if self.is_deaf() {
            return Readiness::NotYet;
        }
        let Some(&tap) = self.plan().taps().get(row as usize) else {
            return Readiness::Refused(no_such_row(self.plan(), row));
        };
        let to_move = || {
            let (angle_deg, offset_mm) = (tap.angle_deg.unwrap_or(0.0), tap.id.offset_mm().unwrap_or(0.0));
            format!("move {} {} {angle_deg} {offset_mm}", tap.id.shoulder, tap.id.location)
        };
        let to_hit = || format!("hit {}", tap.id.velocity_m_per_s().unwrap_or(0.0));
        // Bound first: the arms lock the dialogue again.
        let progress = self.link.dialogue().tap(self.id, (row, attempt), to_move, to_hit);
        match progress {
            Progress::Hit => self.heard((row, attempt)),
            Progress::UnderWay => match self.removal.get() {
                Some(why) => Readiness::Gone(why.clone()),
                None => Readiness::NotYet,
            },
            Progress::Failed(why) => {
                let failed = self.failed.take().filter(|(of, _)| *of == (row, attempt)).map_or(0, |(_, count)| count);
                // An unheard hit is no fault of this tap: it waits until it is heard, or the casing is taken away.
                let is_unheard = why.starts_with(UNHEARD);
                if !is_unheard {
                    self.unheard = None;
                }
                if failed >= self.retakes && !is_unheard {
                    let reason = format!("the rig cannot make this tap: {why}");
                    // The next taps may fail for the same reason: one alarm per casing.
                    if !std::mem::replace(&mut self.has_refused, true) {
                        self.link.dialogue().alarm_of(self.id, &reason);
                    }
                    return Readiness::Refused(self.refusal(reason));
                }
                self.failed = Some(((row, attempt), failed.saturating_add(u16::from(!is_unheard))));
                self.poll(row, attempt)
            }
        }
    }

    fn fill(&mut self, header: &mut TapHeader, buffer: &mut [CacheLine]) -> Result<(), Refusal> {
        self.struck.fill(header, buffer)?;
        let Some(hit) = self.link.dialogue().hit(self.id, (header.plan_index, header.id.attempt)) else {
            return Err(self.refusal("the rig has not made this tap".to_owned()));
        };
        header.velocity_measured_m_per_s = hit.velocity_m_per_s;
        if self.ear.is_none() {
            header.tap_time_ns = hit.time_ns;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
