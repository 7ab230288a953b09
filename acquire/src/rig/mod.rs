//! A station whose casings lie on a rig: another process, or a machine, that speaks `docs/rig-protocol.md` over TCP.
//!
//! The station connects, and connects again whenever the connection is lost. The rig reports which casing is on it, and
//! moves and hits on command. When it reports a hit, the samples of the tap are computed as those of a simulated line are.

mod dialogue;
mod link;
mod protocol;
mod script;

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use tapline_model::SimulationConfig;
use tapline_wire::{CacheLine, Plan, Serial, SourceKind, TapHeader};

use self::dialogue::{LinkConfig, Progress, Removal, Tap};
use self::link::Link;
use self::protocol::one_line;
pub use self::script::{RigReport, RigScript, serve_rig};
use crate::simulated::{Tyre, rig_of};
use crate::{Arrival, Arrivals, Casing, CasingEnd, Error, Readiness, Refusal, ScanConfig, SimulatedLine, Source, Wake};

/// How often to look without being woken; the rig wakes the station whenever something has changed.
const LOOK_EVERY: Duration = Duration::from_secs(5);

/// How a station deals with its rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigConfig {
    /// Host and port of the rig.
    pub address: String,
    /// How long a rig may be away with a casing under way before that is given up, in s.
    pub patience_s: f64,
    /// How long a rig may take to answer before the connection is made anew, in s.
    pub timeout_s: f64,
    /// How often a failed move or hit is tried again before its tap is refused.
    pub retakes: u16,
}

/// The casings of a station's rig.
#[derive(Debug)]
pub struct RigArrivals {
    link: Arc<Link>,
    station: u16,
    retakes: u16,
    scan: Arc<ScanConfig>,
    simulation: SimulationConfig,
    /// Casings that the station has taken over and that have not ended, by number and name.
    open: VecDeque<(u64, String)>,
}

impl RigArrivals {
    /// Connects to the rig of `station`, now and whenever the connection is lost; `wake` is called when it has answered.
    ///
    /// The plan of a casing is that of `scan`, which also lists the cracks of the tyres it names; others are sound.
    ///
    /// # Errors
    /// [`Error`] for a value out of its bounds, and when there is no thread to be had. A rig that is off is no error.
    pub fn open(
        rig: &RigConfig,
        station: u16,
        scan: &ScanConfig,
        simulation: &SimulationConfig,
        wake: Wake,
    ) -> Result<Self, Error> {
        scan.validate()?;
        let tyres: Result<Vec<Tyre>, Error> =
            (0..scan.tyre.len()).map(|number| crate::simulated::tyre_of(scan, number)).collect();
        rig_of(scan, simulation, &tyres?)?;
        let seconds = |key: &str, value: f64| {
            let time =
                Duration::try_from_secs_f64(value).ok().filter(|time| (0.001..=86_400.0).contains(&time.as_secs_f64()));
            time.ok_or_else(|| Error::Setting {
                key: format!("station.{key}"),
                value: value.to_string(),
                bound: "from 0.001 to 86400".to_owned(),
            })
        };
        let config = LinkConfig {
            address: rig.address.clone(),
            station,
            tap_count: scan.taps_per_tyre(),
            patience: seconds("rig_patience_s", rig.patience_s)?,
            timeout: seconds("rig_timeout_s", rig.timeout_s)?,
        };
        let link = Link::start(config, wake)
            .map_err(|source| Error::Thread { what: format!("the rig of station {station}"), source })?;
        Ok(Self {
            link,
            station,
            retakes: rig.retakes,
            scan: Arc::new(scan.clone()),
            simulation: simulation.clone(),
            open: VecDeque::new(),
        })
    }
}

impl Drop for RigArrivals {
    fn drop(&mut self) {
        self.link.stop();
    }
}

impl Arrivals for RigArrivals {
    fn station(&self) -> u16 {
        self.station
    }

    fn next(&mut self) -> Result<Arrival, Error> {
        let Some(loaded) = self.link.dialogue().take_casing() else { return Ok(Arrival::NotYet) };
        let serial = Serial::new(&loaded.name).map_err(|error| Error::Setting {
            key: "the serial of a casing on the rig".to_owned(),
            value: loaded.name.clone(),
            bound: error.bound(),
        })?;
        let listed = self.scan.tyre.iter().find(|tyre| tyre.serial == loaded.name);
        let cracks = listed.map_or_else(Vec::new, |tyre| tyre.crack.clone());
        let tyre = Tyre { serial, station: self.station, cracks };
        let line = SimulatedLine::for_tyre(&self.scan, &self.simulation, &tyre, 0)?;
        self.open.push_back((loaded.id, loaded.name.clone()));
        let taps = RigCasing {
            link: Arc::clone(&self.link),
            id: loaded.id,
            removal: loaded.removal,
            line,
            retakes: self.retakes,
            failed: None,
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
        self.link.dialogue().waits_for()
    }

    fn patience(&self) -> Option<Duration> {
        Some(self.link.dialogue().config().patience)
    }

    fn take_alarms(&mut self) -> Vec<String> {
        self.link.dialogue().take_alarms()
    }

    fn look_every(&self) -> Duration {
        LOOK_EVERY
    }
}

/// The casing on the rig.
#[derive(Debug)]
struct RigCasing {
    link: Arc<Link>,
    id: u64,
    removal: Removal,
    line: SimulatedLine,
    retakes: u16,
    /// The tap that failed last, and how often.
    failed: Option<(Tap, u16)>,
}

impl RigCasing {
    fn refusal(&self, reason: String) -> Refusal {
        Refusal { file: format!("rig at {}", self.link.dialogue().config().address), line: 0, reason }
    }
}

impl Source for RigCasing {
    fn plan(&self) -> &Plan {
        self.line.plan()
    }

    fn kind(&self) -> SourceKind {
        self.line.kind()
    }

    fn can_retake(&self) -> bool {
        true
    }

    fn room(&self) -> u32 {
        self.line.room()
    }

    fn grow(&mut self, plan: Plan) {
        self.line.grow(plan);
    }

    fn poll(&mut self, row: u32, attempt: u16) -> Readiness {
        if let Some(why) = self.removal.get() {
            return Readiness::Gone(why.clone());
        }
        let Some(&tap) = self.line.plan().taps().get(row as usize) else {
            return Readiness::Refused(crate::source::no_such_row(self.line.plan(), row));
        };
        let to_move = || {
            let (angle_deg, offset_mm) = (tap.angle_deg.unwrap_or(0.0), tap.id.offset_mm().unwrap_or(0.0));
            format!("move {} {} {angle_deg} {offset_mm}", tap.id.shoulder, tap.id.location)
        };
        let to_hit = || format!("hit {}", tap.id.velocity_m_per_s().unwrap_or(0.0));
        // Bound first: the arms lock the dialogue again.
        let progress = self.link.dialogue().tap(self.id, (row, attempt), to_move, to_hit);
        match progress {
            Progress::Hit => Readiness::Ready,
            Progress::UnderWay => match self.removal.get() {
                Some(why) => Readiness::Gone(why.clone()),
                None => Readiness::NotYet,
            },
            Progress::Failed(why) => {
                let failed = self.failed.take().filter(|(of, _)| *of == (row, attempt)).map_or(0, |(_, count)| count);
                if failed >= self.retakes {
                    return Readiness::Refused(self.refusal(format!("the rig cannot make this tap: {why}")));
                }
                self.failed = Some(((row, attempt), failed + 1));
                self.poll(row, attempt)
            }
        }
    }

    fn render(
        &mut self,
        row: u32,
        attempt: u16,
        header: &mut TapHeader,
        buffer: &mut [CacheLine],
    ) -> Result<(), Refusal> {
        self.line.render(row, attempt, header, buffer)?;
        let Some(hit) = self.link.dialogue().hit(self.id, (row, attempt)) else {
            return Err(self.refusal("the rig has not made this tap".to_owned()));
        };
        header.velocity_measured_m_per_s = hit.velocity_m_per_s;
        header.tap_time_ns = hit.time_ns;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
