//! The dialogue between a station and its rig, and its effect on the casing on the rig.
//!
//! This file has the state, its connection and its timeouts; `station` has what the station asks for, and `receive` what a
//! line from the rig changes.

mod last_end;
mod receive;
pub(super) mod station;

use std::io::Write as _;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use tapline_wire::{OVER, RecordKind};

use self::last_end::LastEnd;
use self::receive::Counter;
use crate::rig::RigConfig;
use crate::rig::stream::Stream;

/// A rig that has been silent for this long is pinged.
const SILENCE_MAX: Duration = Duration::from_secs(10);

/// How often a rig at a serial port is asked for its name: a board that is starting does not hear it.
const ASK_AGAIN: Duration = Duration::from_secs(1);

/// An answer that should come at once is late after this time.
const LATE_AFTER: Duration = Duration::from_secs(1);

/// How often in a row a rig may lose its connection during one command before an alarm.
const UNANSWERED_MAX: u32 = 3;

/// Most messages that are kept for the station.
const MESSAGES_MAX: usize = 32;

/// The state of the dialogue; it outlasts a connection.
#[derive(Debug, Default)]
pub(crate) struct Dialogue {
    config: RigConfig,
    /// Taps per casing.
    tap_count: u64,
    /// The connection; it exists before the rig says hello.
    stream: Option<Stream>,
    /// Name of the rig, once it has said hello on this connection.
    rig_name: Option<String>,
    /// Why the rig is stopped, by its emergency stop for example, and since when.
    stopped: Option<(String, Instant)>,
    /// Whether the rig knows its position, as far as it can; if not, it must home before it moves.
    is_homed: bool,
    /// Why there is no connection.
    fault: Option<String>,
    /// The command that the rig has not answered yet.
    pending: Option<PendingCommand>,
    /// The command during which the connection was lost, and how often in a row.
    unanswered: Option<(String, u32)>,
    /// Serial of a casing on the rig that the station has not taken over.
    loaded: Option<String>,
    /// The casing that the station has taken over.
    current: Option<Current>,
    /// How the last casing ended.
    last_end: LastEnd,
    /// When the rig disconnected with the current casing on it.
    away_since: Option<Instant>,
    /// The alarm that said so, until the rig makes a tap again, or is back without a casing.
    away_alarm: Option<String>,
    /// The alarm that hits are not heard, until one is. It outlasts a casing: so does a dead sensor.
    unheard_alarm: Option<String>,
    last_received: Option<Instant>,
    /// When a rig at a port was last asked who it is.
    asked: Option<Instant>,
    /// Unexpected lines within a second.
    unexpected: Counter,
    /// Casings and stops within a minute; a new connection does not reset it.
    changes: Counter,
    last_id: u64,
    last_unknown_name: String,
    /// Alarms, and casings that were skipped.
    messages: Vec<(RecordKind, String)>,
}

#[derive(Debug)]
struct PendingCommand {
    command: Command,
    text: String,
    deadline: Instant,
    /// Whether the late answer was reported.
    is_late: bool,
    /// The casing it is for.
    casing: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Command {
    Home,
    Move,
    Hit,
    Ping,
}

impl Command {
    /// What a rig does when it obeys; `None` if that is not visible.
    fn deed(self) -> Option<&'static str> {
        match self {
            Self::Home => Some("home"),
            Self::Move => Some("move"),
            Self::Hit => Some("hit"),
            Self::Ping => None,
        }
    }
}

#[derive(Debug)]
struct Current {
    id: u64,
    /// The serial as the rig spells it.
    serial: String,
    removal: Removal,
    step: Step,
    /// The hit command, which is sent once the impactor is in position.
    hit: String,
    /// When it was sent.
    hit_sent: Option<Instant>,
    /// Whether an alarm said that the rig is away, and no tap was made since.
    is_away_told: bool,
}

/// Why no more taps of a casing will come; empty while they may.
pub(crate) type Removal = Arc<OnceLock<String>>;

/// How far the requested tap is.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    Idle,
    Begun(Tap),
    Hit(Tap, Hit),
    Failed(Tap, String),
}

/// The row of the plan, and the attempt.
pub(crate) type Tap = (u32, u16);

/// An impact as the rig reports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hit {
    pub velocity_m_per_s: f64,
    /// When the rig reported it, ns since the Unix epoch.
    pub time_ns: i64,
    /// When the rig got the command to hit, and when it reported the hit.
    pub sent: Instant,
    pub at: Instant,
}

/// How far a requested tap is.
#[derive(Debug, PartialEq)]
pub(crate) enum Progress {
    Hit,
    UnderWay,
    Failed(String),
}

/// A casing that the station has taken over.
#[derive(Debug)]
pub(crate) struct LoadedCasing {
    pub id: u64,
    pub name: String,
    pub removal: Removal,
}

/// The alarm of a rig that is stopped.
fn stopped(why: &str) -> String {
    format!("the rig is stopped: {why}")
}

impl Dialogue {
    pub(super) fn new(config: RigConfig, tap_count: u64) -> Self {
        let last_end = LastEnd::read(config.last_end.as_deref());
        Self { config, tap_count, last_end, ..Self::default() }
    }

    pub(crate) fn config(&self) -> &RigConfig {
        &self.config
    }

    /// Records a new connection, whose `stream` can be written to.
    pub(super) fn connected(&mut self, stream: Stream) {
        let is_to_be_asked = stream.has_no_connection();
        self.stream = Some(stream);
        if is_to_be_asked {
            self.ask();
        }
        self.last_received = Some(Instant::now());
    }

    /// Records that the connection has ended.
    pub(super) fn disconnected(&mut self) {
        self.stream = None;
        self.forget_rig();
    }

    /// Forgets what the rig said and the commands that it got: it starts again.
    pub(super) fn forget_rig(&mut self) {
        self.rig_name = None;
        let since = self.end_stop();
        self.is_homed = false;
        self.count_unanswered();
        self.loaded = None;
        self.unexpected = Counter::default();
        self.last_end.begin_connection();
        if let Some(current) = &mut self.current {
            // Before its first tap nobody can have turned it.
            let since = since.filter(|_| current.hit_sent.is_some());
            self.away_since.get_or_insert_with(|| since.unwrap_or_else(Instant::now));
            if !matches!(current.step, Step::Hit(..)) {
                current.step = Step::Idle;
            }
        }
    }

    /// Notes that the rig is no longer stopped; since when it was.
    fn end_stop(&mut self) -> Option<Instant> {
        let (why, since) = self.stopped.take()?;
        self.alarm(format!("{OVER}{}", stopped(&why)));
        Some(since)
    }

    /// Notes that a rig that was away makes taps again.
    fn end_away(&mut self) {
        if let Some(text) = self.away_alarm.take() {
            self.alarm(format!("{OVER}{text}"));
        }
    }

    /// Gives up the unanswered command; raises an alarm if the rig never answers it, however often it connects.
    fn count_unanswered(&mut self) {
        let Some(PendingCommand { command, text, .. }) = self.pending.take() else { return };
        let Some(what) = command.deed() else { return };
        let before = self.unanswered.take().filter(|(of, _)| *of == text).map_or(0, |(_, count)| count);
        let count = before.saturating_add(1);
        if count == UNANSWERED_MAX {
            let message =
                format!("the rig does not {what}: it was sent {text:?} {count} times in a row and has not answered");
            tracing::error!("station {}: {message}", self.config.station);
            self.alarm(message);
        }
        self.unanswered = Some((text, count));
    }

    /// Whether this is a serial port, not a connection.
    pub(super) fn is_serial(&self) -> bool {
        self.stream.as_ref().is_some_and(Stream::has_no_connection)
    }

    /// Asks which rig is at the other end of a port.
    fn ask(&mut self) {
        self.asked = Some(Instant::now());
        self.send("hello");
    }

    pub(super) fn is_connected(&self) -> bool {
        self.stream.is_some()
    }

    /// Ends the connection; the thread that reads from it will notice.
    pub(super) fn disconnect(&mut self) {
        if let Some(stream) = self.stream.take()
            && let Err(error) = stream.close()
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
            let RigConfig { station, address, .. } = &self.config;
            tracing::warn!("station {station}: there is no connection to the rig at {address}: {reason}; trying again");
            self.fault = Some(reason.to_owned());
            // Without a casing a rig may be off. One that comes and goes is reported once until it has made a tap.
            if let Some(current) = &mut self.current
                && !std::mem::replace(&mut current.is_away_told, true)
            {
                let text = format!("casing {}: the connection to the rig is lost: {reason}", current.serial);
                self.away_alarm = Some(text.clone());
                self.alarm(text);
            }
        }
    }

    /// Pings a silent rig.
    ///
    /// # Errors
    /// The reason to end the connection: the rig has not answered in time.
    pub(super) fn check_timeouts(&mut self) -> Result<(), String> {
        let now = Instant::now();
        let timeout = self.config.timeout;
        // A hit and a ping are answered at once; moving takes time.
        let is_prompt = |of: &&mut PendingCommand| matches!(of.command, Command::Hit | Command::Ping) && !of.is_late;
        if let Some(pending) = self.pending.as_mut().filter(is_prompt)
            && pending.deadline.saturating_duration_since(now) + LATE_AFTER <= timeout
        {
            pending.is_late = true;
            let text = format!("the rig has not answered {:?} for {LATE_AFTER:?}", pending.text);
            tracing::warn!("station {}: {text}", self.config.station);
            self.alarm(text);
        }
        if let Some(pending) = self.pending.as_ref().filter(|pending| now >= pending.deadline) {
            let timeout = self.timeout_of(pending.command);
            return Err(format!("the rig has not answered {:?} within {timeout:?}", pending.text));
        }
        let silence = self.last_received.map_or(Duration::ZERO, |at| now.duration_since(at));
        let is_unasked = self.asked.is_some_and(|at| now.duration_since(at) >= ASK_AGAIN);
        if self.rig_name.is_none() && is_unasked && self.is_serial() {
            self.ask();
        }
        if self.rig_name.is_none() && silence >= timeout {
            if self.is_serial() {
                self.log_fault(&format!("the rig has not said hello within {timeout:?}"));
                return Ok(());
            }
            return Err(format!("the rig has not said hello within {timeout:?}"));
        }
        if self.rig_name.is_some() && silence >= SILENCE_MAX && self.pending.is_none() {
            self.command(Command::Ping, "ping".to_owned(), 0);
        }
        Ok(())
    }

    /// Gives up the current casing if its rig was disconnected for too long; returns whether it did.
    pub(super) fn end_patience(&mut self) -> bool {
        let patience = self.config.patience;
        let is_over = self.away_since.is_some_and(|since| since.elapsed() >= patience);
        if is_over {
            self.remove_current(&format!("the rig was stopped or away for more than {} s", patience.as_secs_f64()));
        }
        is_over
    }

    /// Reports a casing that was taken away before the station took it over.
    fn discard_loaded(&mut self) {
        if let Some(serial) = self.loaded.take() {
            let text = format!("casing {serial} was taken away before its scan began; it has no verdict");
            tracing::error!("station {}: {text}", self.config.station);
            self.report(RecordKind::Refusal, text);
        }
    }

    /// Ends the scan of the current casing, which stays on the rig, if a tap of it was made before: it may have been turned since.
    fn give_up_if_turned(&mut self, why: &str) {
        let Some(current) = self.current.as_ref().filter(|current| current.hit_sent.is_some()) else { return };
        let (serial, removal) = (current.serial.clone(), Arc::clone(&current.removal));
        let why = format!("{why}: the casing may have been turned");
        tracing::warn!("station {}: casing {serial}: {why}", self.config.station);
        self.alarm(format!("casing {serial}: {why}"));
        removal.get_or_init(|| why);
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
        self.report(RecordKind::Alarm, text);
    }

    fn report(&mut self, kind: RecordKind, text: String) {
        if self.messages.len() < MESSAGES_MAX {
            self.messages.push((kind, text));
        }
    }

    /// Sends `line`; ends the connection if that fails.
    fn send(&mut self, line: &str) {
        let Some(stream) = &mut self.stream else { return };
        if stream.write_all(format!("{line}\n").as_bytes()).is_err() {
            self.disconnect();
        }
    }

    fn timeout_of(&self, command: Command) -> Duration {
        if command == Command::Home { self.config.home_timeout } else { self.config.timeout }
    }

    fn command(&mut self, command: Command, text: String, casing: u64) {
        self.send(&text);
        let deadline = Instant::now() + self.timeout_of(command);
        self.pending = Some(PendingCommand { command, text, deadline, is_late: false, casing });
    }
}
