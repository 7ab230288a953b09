//! The connection to a rig: one thread that listens, and what both sides know of the casing on it.

use std::fmt;
use std::io::Write as _;
use std::net::{Shutdown, TcpStream, ToSocketAddrs as _};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use tapline_wire::{Serial, now_ns};

use super::protocol::{Line, Lines, RigSays, UNKNOWN, VERSION, one_line, unknown_name};
use crate::Wake;

/// How long the thread listens before it looks at its clocks.
const TICK: Duration = Duration::from_millis(500);

/// How long a connection may take to come about.
const CONNECT: Duration = Duration::from_secs(2);

/// First and longest wait before the next attempt to connect.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(5));

/// A rig that says nothing for so long is asked whether it is there.
const SILENCE: Duration = Duration::from_secs(10);

/// Most lines in a second that nobody asked for.
const UNASKED_MAX: u32 = 20;

/// Most alarms that wait to be handed out.
const ALARMS_MAX: usize = 16;

/// What a connection to a rig is made of.
#[derive(Debug, Clone)]
pub(crate) struct LinkConfig {
    pub(crate) address: String,
    pub(crate) station: u16,
    /// Taps of a casing.
    pub(crate) tap_count: u64,
    /// How long a rig with a casing on it may be away.
    pub(crate) patience: Duration,
    /// How long an answer may take.
    pub(crate) timeout: Duration,
}

/// What the thread and the station have in common.
pub(crate) struct Link {
    pub(crate) config: LinkConfig,
    state: Mutex<State>,
    stopped: Condvar,
    wake: Wake,
}

impl fmt::Debug for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link").field("config", &self.config).field("state", &self.state).finish_non_exhaustive()
    }
}

#[derive(Debug, Default)]
struct State {
    is_stopped: bool,
    /// The connection; it is there before the rig has said hello.
    wire: Option<TcpStream>,
    /// Name of the rig, once it has said hello on this connection.
    name: Option<String>,
    /// Why there is no connection.
    fault: Option<String>,
    /// What was told and not answered.
    awaited: Option<Awaited>,
    /// A casing that is on the rig and was not handed over.
    loaded: Option<String>,
    /// The casing that was handed over and is on the rig, as far as is known.
    current: Option<Current>,
    /// A casing that ended, with what the rig is to be told, until it is known to have heard.
    untold: Option<(String, String)>,
    /// Whether that was told on this connection, which may have broken under it.
    is_told: bool,
    /// Since when the casing that was handed over is not known to be on the rig.
    away_since: Option<Instant>,
    heard: Option<Instant>,
    /// Lines of this second that nobody asked for.
    unasked: (u32, Option<Instant>),
    last_id: u64,
    last_unknown: String,
    /// What people should know and was not handed out yet.
    alarms: Vec<String>,
}

#[derive(Debug)]
struct Awaited {
    command: Command,
    text: String,
    until: Instant,
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
    fate: Fate,
    step: Step,
    /// How to hit when the impactor stands.
    hit: String,
}

/// Why no tap of a casing will come any more, once that is so.
pub(crate) type Fate = Arc<OnceLock<String>>;

/// How far the tap is that is asked for.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    Idle,
    Begun(Tap),
    Hit(Tap, Hit),
    Failed(Tap, String),
}

/// A row of the plan and the attempt.
pub(crate) type Tap = (u32, u16);

/// An impact as the rig tells it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hit {
    pub(crate) velocity_m_per_s: f64,
    pub(crate) time_ns: i64,
}

/// How far a tap is that was asked for.
#[derive(Debug, PartialEq)]
pub(crate) enum Progress {
    Hit,
    UnderWay,
    Failed(String),
}

/// A casing as it is handed over.
#[derive(Debug)]
pub(crate) struct Handed {
    pub(crate) id: u64,
    pub(crate) name: String,
    pub(crate) fate: Fate,
}

impl Link {
    /// Starts the thread that connects, listens, and connects again until [`Link::stop`].
    pub(crate) fn start(config: LinkConfig, wake: Wake) -> std::io::Result<Arc<Self>> {
        let name = format!("rig {}", config.station);
        let link = Arc::new(Self { config, state: Mutex::default(), stopped: Condvar::new(), wake });
        let of_thread = Arc::clone(&link);
        thread::Builder::new().name(name).spawn(move || of_thread.listen_for_ever())?;
        Ok(link)
    }

    /// Ends the thread; it may take a moment to notice.
    pub(crate) fn stop(&self) {
        let mut state = self.lock();
        state.is_stopped = true;
        state.hang_up();
        self.stopped.notify_all();
    }

    /// The casing that is on the rig, if it was not handed over.
    pub(crate) fn hand_over(&self) -> Option<Handed> {
        let mut state = self.lock();
        let serial = state.loaded.take()?;
        state.last_id += 1;
        let name = if serial == UNKNOWN {
            state.last_unknown = unknown_name(self.config.station, now_ns(), &state.last_unknown);
            state.last_unknown.clone()
        } else {
            serial.clone()
        };
        let (id, fate) = (state.last_id, Fate::default());
        state.current = Some(Current { id, serial, fate: Arc::clone(&fate), step: Step::Idle, hit: String::new() });
        Some(Handed { id, name, fate })
    }

    /// How far `tap` of the casing `id` is; told to the rig if it is not under way.
    pub(crate) fn tap(
        &self,
        id: u64,
        tap: Tap,
        to_move: impl FnOnce() -> String,
        to_hit: impl FnOnce() -> String,
    ) -> Progress {
        let mut state = self.lock();
        self.look_at_clock(&mut state);
        let is_free = state.name.is_some() && state.away_since.is_none() && state.awaited.is_none();
        let Some(current) = state.current.as_mut().filter(|current| current.id == id) else {
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
        state.command(Command::Move, to_move(), id, self.config.timeout);
        Progress::UnderWay
    }

    /// The impact of `tap` of the casing `id`, once the rig has hit.
    pub(crate) fn hit(&self, id: u64, tap: Tap) -> Option<Hit> {
        match &self.lock().current {
            Some(Current { id: of, step: Step::Hit(at, hit), .. }) if *of == id && *at == tap => Some(*hit),
            _ => None,
        }
    }

    /// Tells the rig how the casing `id` ended, now or when it is back: `words` are put before its serial.
    pub(crate) fn ended(&self, id: u64, word: &str, why: &str) {
        let mut state = self.lock();
        let Some(current) = state.current.take_if(|current| current.id == id) else { return };
        let line = format!("{word} {}{why}", current.serial);
        state.is_told = state.name.is_some() && state.away_since.is_none();
        if state.is_told {
            state.say(&line);
        }
        state.untold = Some((current.serial, line));
        state.away_since = None;
    }

    /// What people should know, once.
    pub(crate) fn take_alarms(&self) -> Vec<String> {
        std::mem::take(&mut self.lock().alarms)
    }

    /// What the station waits for, for people.
    pub(crate) fn waits_for(&self) -> String {
        let state = self.lock();
        let address = &self.config.address;
        match (&state.name, &state.current, &state.awaited) {
            (None, Some(current), _) => format!("the rig at {address}, which went away with casing {}", current.serial),
            (None, None, _) => {
                let fault = state.fault.as_ref().map_or_else(String::new, |fault| format!(": {fault}"));
                format!("the rig at {address}{fault}")
            }
            (Some(name), Some(_), Some(awaited)) => format!("the rig {name:?} at {address} to {}", awaited.text),
            (Some(name), ..) => format!("a casing on the rig {name:?} at {address}"),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn listen_for_ever(&self) {
        let mut back_off = BACK_OFF.0;
        while !self.lock().is_stopped {
            match self.connect() {
                Ok(stream) => {
                    let reason = self.listen(stream);
                    let mut state = self.lock();
                    if state.name.is_some() {
                        back_off = BACK_OFF.0;
                    }
                    if !state.is_stopped {
                        self.tell_lost(&mut state, &reason);
                    }
                    state.lost();
                }
                Err(reason) => self.tell_lost(&mut self.lock(), &reason),
            }
            (self.wake)();
            self.rest(back_off);
            back_off = (back_off * 2).min(BACK_OFF.1);
        }
    }

    /// Logs why there is no connection, once.
    fn tell_lost(&self, state: &mut State, reason: &str) {
        if state.fault.as_deref() != Some(reason) {
            let LinkConfig { station, address, .. } = &self.config;
            tracing::warn!("station {station}: no connection to the rig at {address}: {reason}; trying again");
            state.fault = Some(reason.to_owned());
        }
    }

    /// Waits before the next attempt; the clock of a casing whose rig is away runs on.
    fn rest(&self, mut time: Duration) {
        let mut state = self.lock();
        while !state.is_stopped && !time.is_zero() {
            let part = time.min(TICK);
            state = self.stopped.wait_timeout(state, part).map_or_else(|e| e.into_inner().0, |(state, _)| state);
            time -= part;
            self.look_at_clock(&mut state);
        }
    }

    fn connect(&self) -> Result<TcpStream, String> {
        let addresses = self.config.address.to_socket_addrs().map_err(|error| error.to_string())?;
        let mut reason = "the name has no address".to_owned();
        for address in addresses {
            match TcpStream::connect_timeout(&address, CONNECT) {
                Ok(stream) => return Ok(stream),
                Err(error) => reason = error.to_string(),
            }
        }
        Err(reason)
    }

    /// Listens to the rig until the connection ends; why it did.
    fn listen(&self, mut stream: TcpStream) -> String {
        let prepared = stream
            .set_nodelay(true)
            .and_then(|()| stream.set_read_timeout(Some(TICK)))
            .and_then(|()| stream.set_write_timeout(Some(CONNECT)))
            .and_then(|()| stream.try_clone());
        match prepared {
            Ok(wire) => {
                let mut state = self.lock();
                if state.is_stopped {
                    return "the station ends".to_owned();
                }
                state.wire = Some(wire);
                state.heard = Some(Instant::now());
            }
            Err(error) => return error.to_string(),
        }
        let mut lines = Lines::default();
        loop {
            let line = match lines.next(&mut stream) {
                Ok(line) => line,
                Err(error) => return error.to_string(),
            };
            let mut state = self.lock();
            let outcome = match line {
                Line::Text(line) => self.hear(&mut state, &line),
                Line::Nothing => Ok(false),
                Line::End => Err("the rig has closed the connection".to_owned()),
                Line::Garbage(what) => Err(format!("the rig has sent {what}")),
            };
            let outcome = outcome.and_then(|has_changed| self.check_answers(&mut state).map(|()| has_changed));
            self.look_at_clock(&mut state);
            if outcome.is_err() || state.is_stopped {
                state.hang_up();
                return outcome.err().unwrap_or_else(|| "the station ends".to_owned());
            }
            drop(state);
            if outcome == Ok(true) {
                (self.wake)();
            }
        }
    }

    /// Takes what the rig says; whether something changed for the station, or why the connection is to end.
    fn hear(&self, state: &mut State, line: &str) -> Result<bool, String> {
        let now = Instant::now();
        state.heard = Some(now);
        let Some(says) = RigSays::of(line) else {
            return Err(format!("the rig has said {:?}, which means nothing here", one_line(line)));
        };
        if state.name.is_none() {
            return self.greet(state, says, line);
        }
        // What was told before on this connection was heard.
        if state.is_told {
            (state.untold, state.is_told) = (None, false);
        }
        let may_be_answer = matches!(says, RigSays::Ready | RigSays::Hit(_) | RigSays::Error(_) | RigSays::Pong);
        if !may_be_answer || state.awaited.is_none() {
            state.count_unasked(now)?;
        }
        match says {
            RigSays::Hello { .. } => Err("the rig has said hello twice".to_owned()),
            RigSays::Casing(serial) => self.load(state, &serial),
            RigSays::Removed => {
                self.pass_over(state);
                state.untold = None;
                self.take_away(state, "it was taken away from the rig before its last tap");
                Ok(true)
            }
            RigSays::Ready => {
                let casing = state.answered(Command::Move, line)?;
                let hit = state.under_way(casing).map(|current| current.hit.clone());
                if let Some(hit) = hit {
                    state.command(Command::Hit, hit, casing, self.config.timeout);
                }
                Ok(false)
            }
            RigSays::Hit(velocity_m_per_s) => {
                let casing = state.answered(Command::Hit, line)?;
                let hit = Hit { velocity_m_per_s, time_ns: now_ns() };
                state.step(casing, |tap| Step::Hit(tap, hit));
                Ok(true)
            }
            RigSays::Pong => state.answered(Command::Ping, line).map(|_| true),
            RigSays::Error(why) => {
                let LinkConfig { station, address, .. } = &self.config;
                tracing::warn!("station {station}: the rig at {address} reports {why:?}");
                if let Some(awaited) = state.awaited.take() {
                    state.step(awaited.casing, |tap| Step::Failed(tap, why));
                }
                Ok(true)
            }
        }
    }

    fn greet(&self, state: &mut State, says: RigSays, line: &str) -> Result<bool, String> {
        let LinkConfig { station, address, .. } = &self.config;
        match says {
            RigSays::Hello { name, version: VERSION } => {
                tracing::info!("station {station}: connected to the rig {name:?} at {address}");
                state.name = Some(name);
                state.fault = None;
                Ok(true)
            }
            RigSays::Hello { version, .. } => {
                state.say(&format!("error version {version} is not spoken here, but {VERSION}"));
                Err(format!("the rig speaks version {version} of the protocol; this station speaks {VERSION}"))
            }
            _ => Err(format!("the rig has said {:?} before hello", one_line(line))),
        }
    }

    /// A casing is on the rig.
    fn load(&self, state: &mut State, serial: &str) -> Result<bool, String> {
        let station = self.config.station;
        if serial != UNKNOWN
            && let Err(error) = Serial::new(serial)
        {
            tracing::error!("station {station}: a casing is passed over: {error}");
            state.alarm(format!("a casing is passed over: {error}"));
            state.say(&format!("error {}", one_line(&error.to_string())));
            self.pass_over(state);
            self.take_away(state, "another casing was put on the rig before its last tap");
            return Ok(true);
        }
        let scan = format!("scan {serial} {}", self.config.tap_count);
        if let Some(current) = state.current.as_mut().filter(|current| current.serial == serial && serial != UNKNOWN) {
            if state.away_since.take().is_none() {
                state.say(&format!("error casing {serial} is on the rig already"));
                return Ok(false);
            }
            tracing::info!("station {station}: the rig is back with casing {serial}");
            if !matches!(current.step, Step::Hit(..)) {
                current.step = Step::Idle;
            }
            state.say(&scan);
            return Ok(true);
        }
        if let Some((_, told)) = state.untold.take().filter(|(of, _)| of == serial && serial != UNKNOWN) {
            state.say(&told);
            return Ok(false);
        }
        self.take_away(state, "another casing was put on the rig before its last tap");
        self.pass_over(state);
        state.loaded = Some(serial.to_owned());
        state.say(&scan);
        Ok(true)
    }

    /// Notes that the casing on the rig was taken away before its scan began, if there was one.
    fn pass_over(&self, state: &mut State) {
        if let Some(serial) = state.loaded.take() {
            let station = self.config.station;
            tracing::error!(
                "station {station}: casing {serial} was taken away before its scan began; it has no verdict"
            );
            state.alarm(format!("casing {serial} was taken away before its scan began; it has no verdict"));
        }
    }

    fn take_away(&self, state: &mut State, why: &str) {
        state.away_since = None;
        if let Some(Current { serial, fate, .. }) = state.current.take() {
            tracing::warn!("station {}: casing {serial}: {why}", self.config.station);
            state.alarm(format!("casing {serial}: {why}"));
            // The first reason is the one that counts.
            fate.get_or_init(|| why.to_owned());
        }
    }

    /// Ends a connection whose rig does not answer, and asks a silent one whether it is there.
    fn check_answers(&self, state: &mut State) -> Result<(), String> {
        let now = Instant::now();
        let timeout = self.config.timeout;
        if let Some(awaited) = state.awaited.as_ref().filter(|awaited| now >= awaited.until) {
            return Err(format!("the rig has not answered {:?} within {timeout:?}", awaited.text));
        }
        let silence = state.heard.map_or(Duration::ZERO, |heard| now.duration_since(heard));
        if state.name.is_none() && silence >= timeout {
            return Err(format!("the rig has not said hello within {timeout:?}"));
        }
        if state.name.is_some() && silence >= SILENCE && state.awaited.is_none() {
            state.command(Command::Ping, "ping".to_owned(), 0, timeout);
        }
        Ok(())
    }

    /// Gives a casing up whose rig was away for too long.
    fn look_at_clock(&self, state: &mut State) {
        let patience = self.config.patience;
        if state.away_since.is_some_and(|since| since.elapsed() >= patience) {
            self.take_away(state, &format!("the rig was away for more than {} s", patience.as_secs_f64()));
            (self.wake)();
        }
    }
}

impl State {
    fn alarm(&mut self, text: String) {
        if self.alarms.len() < ALARMS_MAX {
            self.alarms.push(text);
        }
    }

    /// The connection has ended.
    fn lost(&mut self) {
        self.wire = None;
        self.name = None;
        self.awaited = None;
        self.loaded = None;
        self.is_told = false;
        self.unasked = (0, None);
        if let Some(current) = &mut self.current {
            self.away_since.get_or_insert_with(Instant::now);
            if !matches!(current.step, Step::Hit(..)) {
                current.step = Step::Idle;
            }
        }
    }

    fn hang_up(&mut self) {
        if let Some(wire) = &self.wire
            && let Err(error) = wire.shutdown(Shutdown::Both)
        {
            tracing::debug!("the connection to a rig was not closed: {error}");
        }
    }

    /// Sends `line`; a connection that does not take it is ended.
    fn say(&mut self, line: &str) {
        let Some(wire) = &mut self.wire else { return };
        if wire.write_all(format!("{line}\n").as_bytes()).is_err() {
            self.hang_up();
        }
    }

    fn command(&mut self, command: Command, text: String, casing: u64, timeout: Duration) {
        self.say(&text);
        self.awaited = Some(Awaited { command, text, until: Instant::now() + timeout, casing });
    }

    /// The casing that the answered `command` was for; why the connection is to end where nothing of the kind was told.
    fn answered(&mut self, command: Command, line: &str) -> Result<u64, String> {
        match self.awaited.take() {
            Some(awaited) if awaited.command == command => Ok(awaited.casing),
            Some(awaited) => Err(format!("the rig has answered {:?} with {:?}", awaited.text, one_line(line))),
            None => Err(format!("the rig has said {:?} unasked", one_line(line))),
        }
    }

    fn under_way(&mut self, casing: u64) -> Option<&mut Current> {
        self.current.as_mut().filter(|current| current.id == casing && matches!(current.step, Step::Begun(_)))
    }

    /// The step after the one under way, of the casing that is on the rig still.
    fn step(&mut self, casing: u64, next: impl FnOnce(Tap) -> Step) {
        if let Some(current) = self.under_way(casing)
            && let Step::Begun(tap) = current.step
        {
            current.step = next(tap);
        }
    }

    fn count_unasked(&mut self, now: Instant) -> Result<(), String> {
        let (count, since) = &mut self.unasked;
        if since.is_none_or(|since| now.duration_since(since) >= Duration::from_secs(1)) {
            (*count, *since) = (0, Some(now));
        }
        *count += 1;
        if *count > UNASKED_MAX {
            return Err(format!("the rig has said more than {UNASKED_MAX} lines unasked within a second"));
        }
        Ok(())
    }
}
