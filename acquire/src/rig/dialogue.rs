//! What a station and its rig have said to each other, and what that means for the casing on the rig.

use std::io::Write as _;
use std::net::{Shutdown, TcpStream};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use tapline_wire::{Serial, now_ns};

use super::protocol::{RigMessage, UNKNOWN, VERSION, one_line, unknown_name};

/// A rig that has been silent for so long is asked whether it is there.
const SILENCE_MAX: Duration = Duration::from_secs(10);

/// Most unexpected lines within a second.
const UNEXPECTED_MAX: u32 = 20;

/// Most alarms that wait for the station.
const ALARMS_MAX: usize = 16;

/// How a station is connected to its rig.
#[derive(Debug, Clone)]
pub(crate) struct LinkConfig {
    pub address: String,
    pub station: u16,
    /// Taps of a casing.
    pub tap_count: u64,
    /// How long a rig with a casing on it may be away.
    pub patience: Duration,
    /// How long the rig may take to answer.
    pub timeout: Duration,
}

/// The state of the dialogue, across connections.
#[derive(Debug)]
pub(crate) struct Dialogue {
    config: LinkConfig,
    /// The connection; it exists before the rig has said hello.
    stream: Option<TcpStream>,
    /// Name of the rig, once it has said hello on this connection.
    rig_name: Option<String>,
    /// Why there is no connection.
    fault: Option<String>,
    /// The command that the rig has not answered yet.
    pending: Option<PendingCommand>,
    /// Serial of a casing on the rig that the station has not taken over.
    loaded: Option<String>,
    /// The casing that the station has taken over.
    current: Option<Current>,
    /// The end of a casing that the rig is not known to have received.
    end_report: Option<EndReport>,
    /// Since when the rig is away with the current casing.
    away_since: Option<Instant>,
    last_received: Option<Instant>,
    /// Unexpected lines of this second, and when it began.
    unexpected: (u32, Option<Instant>),
    last_id: u64,
    last_unknown_name: String,
    alarms: Vec<String>,
}

#[derive(Debug)]
struct PendingCommand {
    command: Command,
    text: String,
    deadline: Instant,
    /// The casing it is for.
    casing: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Command {
    Move,
    Hit,
    Ping,
}

#[derive(Debug)]
struct Current {
    id: u64,
    /// As the rig calls it.
    serial: String,
    removal: Removal,
    step: Step,
    /// The command to hit, sent once the impactor is in position.
    hit: String,
}

#[derive(Debug)]
struct EndReport {
    serial: String,
    line: String,
    /// Whether it was sent on this connection, which may have broken since.
    is_sent: bool,
}

/// Why no more taps of a casing will come; empty as long as they may.
pub(crate) type Removal = Arc<OnceLock<String>>;

/// How far the requested tap is.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    Idle,
    Begun(Tap),
    Hit(Tap, Hit),
    Failed(Tap, String),
}

/// A row of the plan and the attempt.
pub(crate) type Tap = (u32, u16);

/// An impact as the rig reports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hit {
    pub velocity_m_per_s: f64,
    pub time_ns: i64,
}

/// How far a requested tap is.
#[derive(Debug, PartialEq)]
pub(crate) enum Progress {
    Hit,
    UnderWay,
    Failed(String),
}

/// A casing that the station takes over.
#[derive(Debug)]
pub(crate) struct LoadedCasing {
    pub id: u64,
    pub name: String,
    pub removal: Removal,
}

/// What the station asks for.
impl Dialogue {
    pub(super) fn new(config: LinkConfig) -> Self {
        Self {
            config,
            stream: None,
            rig_name: None,
            fault: None,
            pending: None,
            loaded: None,
            current: None,
            end_report: None,
            away_since: None,
            last_received: None,
            unexpected: (0, None),
            last_id: 0,
            last_unknown_name: String::new(),
            alarms: Vec::new(),
        }
    }

    pub(crate) fn config(&self) -> &LinkConfig {
        &self.config
    }

    /// Takes over the casing on the rig, if there is a new one.
    pub(crate) fn take_casing(&mut self) -> Option<LoadedCasing> {
        let serial = self.loaded.take()?;
        self.last_id += 1;
        let name = if serial == UNKNOWN {
            self.last_unknown_name = unknown_name(self.config.station, now_ns(), &self.last_unknown_name);
            self.last_unknown_name.clone()
        } else {
            serial.clone()
        };
        let (id, removal) = (self.last_id, Removal::default());
        let step = Step::Idle;
        self.current = Some(Current { id, serial, removal: Arc::clone(&removal), step, hit: String::new() });
        Some(LoadedCasing { id, name, removal })
    }

    /// How far `tap` of the casing `id` is; the rig is commanded to make it as soon as it is free.
    pub(crate) fn tap(
        &mut self,
        id: u64,
        tap: Tap,
        to_move: impl FnOnce() -> String,
        to_hit: impl FnOnce() -> String,
    ) -> Progress {
        self.end_patience();
        let is_free = self.rig_name.is_some() && self.away_since.is_none() && self.pending.is_none();
        let Some(current) = self.current.as_mut().filter(|current| current.id == id) else {
            return Progress::UnderWay;
        };
        match &current.step {
            Step::Hit(of, _) if *of == tap => return Progress::Hit,
            Step::Failed(of, why) if *of == tap => {
                let why = why.clone();
                current.step = Step::Idle;
                return Progress::Failed(why);
            }
            Step::Begun(of) if *of == tap => return Progress::UnderWay,
            _ if !is_free => return Progress::UnderWay,
            _ => {}
        }
        current.step = Step::Begun(tap);
        current.hit = to_hit();
        self.command(Command::Move, to_move(), id);
        Progress::UnderWay
    }

    /// The impact of `tap` of the casing `id`, once the rig has hit.
    pub(crate) fn hit(&self, id: u64, tap: Tap) -> Option<Hit> {
        match &self.current {
            Some(Current { id: of, step: Step::Hit(at, hit), .. }) if *of == id && *at == tap => Some(*hit),
            _ => None,
        }
    }

    /// Reports to the rig how the casing `id` ended, now or when it is back: `word`, its serial, and `why`.
    pub(crate) fn report_end(&mut self, id: u64, word: &str, why: &str) {
        let Some(current) = self.current.take_if(|current| current.id == id) else { return };
        let line = format!("{word} {}{why}", current.serial);
        let is_sent = self.rig_name.is_some() && self.away_since.is_none();
        if is_sent {
            self.send(&line);
        }
        self.end_report = Some(EndReport { serial: current.serial, line, is_sent });
        self.away_since = None;
    }

    /// The alarms since the last call.
    pub(crate) fn take_alarms(&mut self) -> Vec<String> {
        std::mem::take(&mut self.alarms)
    }

    /// What the station waits for, for people.
    pub(crate) fn waits_for(&self) -> String {
        let address = &self.config.address;
        match (&self.rig_name, &self.current, &self.pending) {
            (None, Some(current), _) => format!("the rig at {address}, which went away with casing {}", current.serial),
            (None, None, _) => {
                let fault = self.fault.as_ref().map_or_else(String::new, |fault| format!(": {fault}"));
                format!("the rig at {address}{fault}")
            }
            (Some(name), Some(_), Some(pending)) => format!("the rig {name:?} at {address} to {}", pending.text),
            (Some(name), ..) => format!("a casing on the rig {name:?} at {address}"),
        }
    }
}

/// What the connection's thread reports.
impl Dialogue {
    /// Notes a new connection, whose `stream` can be written to.
    pub(super) fn connected(&mut self, stream: TcpStream) {
        self.stream = Some(stream);
        self.last_received = Some(Instant::now());
    }

    /// Notes that the connection has ended.
    pub(super) fn disconnected(&mut self) {
        self.stream = None;
        self.rig_name = None;
        self.pending = None;
        self.loaded = None;
        self.unexpected = (0, None);
        if let Some(report) = &mut self.end_report {
            report.is_sent = false;
        }
        if let Some(current) = &mut self.current {
            self.away_since.get_or_insert_with(Instant::now);
            if !matches!(current.step, Step::Hit(..)) {
                current.step = Step::Idle;
            }
        }
    }

    /// Ends the connection; the thread that reads from it notices.
    pub(super) fn disconnect(&self) {
        if let Some(stream) = &self.stream
            && let Err(error) = stream.shutdown(Shutdown::Both)
        {
            tracing::debug!("the connection to a rig was not closed: {error}");
        }
    }

    /// Whether the rig has said hello on this connection.
    pub(super) fn has_hello(&self) -> bool {
        self.rig_name.is_some()
    }

    /// Logs why there is no connection, once for each reason.
    pub(super) fn log_fault(&mut self, reason: &str) {
        if self.fault.as_deref() != Some(reason) {
            let LinkConfig { station, address, .. } = &self.config;
            tracing::warn!("station {station}: no connection to the rig at {address}: {reason}; trying again");
            self.fault = Some(reason.to_owned());
        }
    }

    /// Ends a connection whose rig does not answer, and pings a silent rig.
    ///
    /// # Errors
    /// Why the connection is to end.
    pub(super) fn check_timeouts(&mut self) -> Result<(), String> {
        let now = Instant::now();
        let timeout = self.config.timeout;
        if let Some(pending) = self.pending.as_ref().filter(|pending| now >= pending.deadline) {
            return Err(format!("the rig has not answered {:?} within {timeout:?}", pending.text));
        }
        let silence = self.last_received.map_or(Duration::ZERO, |at| now.duration_since(at));
        if self.rig_name.is_none() && silence >= timeout {
            return Err(format!("the rig has not said hello within {timeout:?}"));
        }
        if self.rig_name.is_some() && silence >= SILENCE_MAX && self.pending.is_none() {
            self.command(Command::Ping, "ping".to_owned(), 0);
        }
        Ok(())
    }

    /// Gives up the current casing if its rig has been away for too long; whether it did.
    pub(super) fn end_patience(&mut self) -> bool {
        let patience = self.config.patience;
        let is_over = self.away_since.is_some_and(|since| since.elapsed() >= patience);
        if is_over {
            self.remove_current(&format!("the rig was away for more than {} s", patience.as_secs_f64()));
        }
        is_over
    }

    /// Takes a line from the rig; whether something has changed for the station.
    ///
    /// # Errors
    /// Why the connection is to end.
    pub(super) fn receive(&mut self, line: &str) -> Result<bool, String> {
        let now = Instant::now();
        self.last_received = Some(now);
        let Some(message) = RigMessage::parse(line) else {
            return Err(format!("the rig has said {:?}, which means nothing here", one_line(line)));
        };
        if self.rig_name.is_none() {
            return self.receive_hello(message, line);
        }
        // A line from the rig shows that it has received what was sent before on this connection.
        self.end_report.take_if(|report| report.is_sent);
        let may_answer =
            matches!(message, RigMessage::Ready | RigMessage::Hit(_) | RigMessage::Error(_) | RigMessage::Pong);
        if !may_answer || self.pending.is_none() {
            self.count_unexpected(now)?;
        }
        match message {
            RigMessage::Hello { .. } => Err("the rig has said hello twice".to_owned()),
            RigMessage::Casing(serial) => Ok(self.load(&serial)),
            RigMessage::Removed => {
                self.discard_loaded();
                self.end_report = None;
                self.remove_current("it was taken away from the rig before its last tap");
                Ok(true)
            }
            RigMessage::Ready => {
                let casing = self.answered(Command::Move, line)?;
                let hit = self.begun(casing).map(|current| current.hit.clone());
                if let Some(hit) = hit {
                    self.command(Command::Hit, hit, casing);
                }
                Ok(false)
            }
            RigMessage::Hit(velocity_m_per_s) => {
                let casing = self.answered(Command::Hit, line)?;
                let hit = Hit { velocity_m_per_s, time_ns: now_ns() };
                self.advance(casing, |tap| Step::Hit(tap, hit));
                Ok(true)
            }
            RigMessage::Pong => self.answered(Command::Ping, line).map(|_| true),
            RigMessage::Error(why) => {
                let LinkConfig { station, address, .. } = &self.config;
                tracing::warn!("station {station}: the rig at {address} reports {why:?}");
                if let Some(pending) = self.pending.take() {
                    self.advance(pending.casing, |tap| Step::Failed(tap, why));
                }
                Ok(true)
            }
        }
    }
}

/// How lines from the rig are handled.
impl Dialogue {
    fn receive_hello(&mut self, message: RigMessage, line: &str) -> Result<bool, String> {
        let LinkConfig { station, address, .. } = &self.config;
        match message {
            RigMessage::Hello { name, version: VERSION } => {
                tracing::info!("station {station}: connected to the rig {name:?} at {address}");
                self.rig_name = Some(name);
                self.fault = None;
                Ok(true)
            }
            RigMessage::Hello { version, .. } => {
                self.send(&format!("error version {version} is not spoken here, but {VERSION}"));
                Err(format!("the rig speaks version {version} of the protocol; this station speaks {VERSION}"))
            }
            _ => Err(format!("the rig has said {:?} before hello", one_line(line))),
        }
    }

    /// Takes in that a casing is on the rig: the current one again, one that has ended, or a new one. Whether something has
    /// changed for the station.
    fn load(&mut self, serial: &str) -> bool {
        let station = self.config.station;
        if serial != UNKNOWN
            && let Err(error) = Serial::new(serial)
        {
            tracing::error!("station {station}: a casing is passed over: {error}");
            self.alarm(format!("a casing is passed over: {error}"));
            self.send(&format!("error {}", one_line(&error.to_string())));
            self.discard_loaded();
            self.remove_current("another casing was put on the rig before its last tap");
            return true;
        }
        let scan = format!("scan {serial} {}", self.config.tap_count);
        if let Some(current) = self.current.as_mut().filter(|current| current.serial == serial && serial != UNKNOWN) {
            if self.away_since.take().is_none() {
                self.send(&format!("error casing {serial} is on the rig already"));
                return false;
            }
            tracing::info!("station {station}: the rig is back with casing {serial}");
            if !matches!(current.step, Step::Hit(..)) {
                current.step = Step::Idle;
            }
            self.send(&scan);
            return true;
        }
        if let Some(report) = self.end_report.take().filter(|report| report.serial == serial && serial != UNKNOWN) {
            self.send(&report.line);
            return false;
        }
        self.remove_current("another casing was put on the rig before its last tap");
        self.discard_loaded();
        self.loaded = Some(serial.to_owned());
        self.send(&scan);
        true
    }

    /// Raises an alarm for a casing that was taken away before the station took it over, if there was one.
    fn discard_loaded(&mut self) {
        if let Some(serial) = self.loaded.take() {
            let text = format!("casing {serial} was taken away before its scan began; it has no verdict");
            tracing::error!("station {}: {text}", self.config.station);
            self.alarm(text);
        }
    }

    /// Ends the current casing before its last tap, if there is one.
    fn remove_current(&mut self, why: &str) {
        self.away_since = None;
        if let Some(Current { serial, removal, .. }) = self.current.take() {
            tracing::warn!("station {}: casing {serial}: {why}", self.config.station);
            self.alarm(format!("casing {serial}: {why}"));
            removal.get_or_init(|| why.to_owned());
        }
    }

    fn alarm(&mut self, text: String) {
        if self.alarms.len() < ALARMS_MAX {
            self.alarms.push(text);
        }
    }

    /// Sends `line`; a connection that does not take it is ended.
    fn send(&mut self, line: &str) {
        let Some(stream) = &mut self.stream else { return };
        if stream.write_all(format!("{line}\n").as_bytes()).is_err() {
            self.disconnect();
        }
    }

    fn command(&mut self, command: Command, text: String, casing: u64) {
        self.send(&text);
        let deadline = Instant::now() + self.config.timeout;
        self.pending = Some(PendingCommand { command, text, deadline, casing });
    }

    /// The casing that the answered `command` was for; an error if the rig answers another command, or none.
    fn answered(&mut self, command: Command, line: &str) -> Result<u64, String> {
        match self.pending.take() {
            Some(pending) if pending.command == command => Ok(pending.casing),
            Some(pending) => Err(format!("the rig has answered {:?} with {:?}", pending.text, one_line(line))),
            None => Err(format!("the rig has said {:?} unasked", one_line(line))),
        }
    }

    /// The casing numbered `casing`, if it is on the rig and a tap of it is begun.
    fn begun(&mut self, casing: u64) -> Option<&mut Current> {
        self.current.as_mut().filter(|current| current.id == casing && matches!(current.step, Step::Begun(_)))
    }

    /// Replaces the begun tap of `casing`, if there is one, by the `next` step.
    fn advance(&mut self, casing: u64, next: impl FnOnce(Tap) -> Step) {
        if let Some(current) = self.begun(casing)
            && let Step::Begun(tap) = current.step
        {
            current.step = next(tap);
        }
    }

    fn count_unexpected(&mut self, now: Instant) -> Result<(), String> {
        let (count, since) = &mut self.unexpected;
        if since.is_none_or(|since| now.duration_since(since) >= Duration::from_secs(1)) {
            (*count, *since) = (0, Some(now));
        }
        *count += 1;
        if *count > UNEXPECTED_MAX {
            return Err(format!("the rig has said more than {UNEXPECTED_MAX} lines unasked within a second"));
        }
        Ok(())
    }
}
