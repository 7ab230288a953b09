//! The simulated rig: the other side of the protocol, with everything that can go wrong at a real rig.

use std::io::{self, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tapline_model::SimulationConfig;
use tapline_wire::Serial;

use super::played::Player;
use super::protocol::{LineReader, ReadLine, UNKNOWN, VERSION};
use crate::{Error, ScanConfig};

/// How often a waiting rig checks whether it is to stop.
const TICK: Duration = Duration::from_millis(20);

/// Longest time that a script may state, in s: a day.
const TIME_MAX_S: f64 = 86_400.0;

/// What a simulated rig does. Fractions are from 0 to 1; of a pair of times, one in between is drawn uniformly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RigScript {
    /// The name in its hello.
    pub name: String,
    /// Seed of all random choices.
    pub seed: u64,
    /// Number of casings; unlimited if left out.
    pub casings: Option<u64>,
    /// Serials of the first casings, in order.
    pub serials: Vec<String>,
    /// Pattern of the serials after those: `{}` is the number of the casing, from 1.
    pub pattern: String,
    /// Range of the time from one casing to the next, in s.
    pub gap_s: [f64; 2],
    /// Time in s to move to a location.
    pub move_s: f64,
    /// Time in s to find its home.
    pub home_s: f64,
    /// Time in s to hit.
    pub hit_s: f64,
    /// Largest relative error of the velocity.
    pub velocity_error: f64,
    /// Fraction of casings whose serial cannot be read.
    pub unknown: f64,
    /// Fraction of casings with the serial of the one before.
    pub repeated: f64,
    /// Fraction of casings that are removed before their last tap.
    pub removed: f64,
    /// Fraction of casings during which the rig is switched off.
    pub switched_off: f64,
    /// Range of the time that it is off, in s.
    pub off_s: [f64; 2],
    /// Fraction of casings during which its emergency stop is pressed, for as long as it is off otherwise.
    pub stopped: f64,
    /// Fraction of those with another casing on the rig when it is switched on again.
    pub swapped: f64,
    /// Fraction of hits that fail.
    pub failed_hits: f64,
    /// Where the samples of its hits are written, for a station that listens: a pipe; nowhere if left out.
    pub play: Option<PathBuf>,
    /// Fraction of those hits that it reports and does not make.
    pub missed_hits: f64,
    /// Fraction of those hits that it makes twice.
    pub double_hits: f64,
    /// Locations of what is played, and the cracks of the casings it names; others are sound.
    pub scan: ScanConfig,
    /// What is played.
    pub simulation: SimulationConfig,
}

impl Default for RigScript {
    fn default() -> Self {
        Self {
            name: "simulated".to_owned(),
            seed: 1,
            casings: None,
            serials: Vec::new(),
            pattern: "RIG-{}".to_owned(),
            gap_s: [0.0, 0.0],
            move_s: 0.0,
            home_s: 0.0,
            hit_s: 0.0,
            velocity_error: 0.01,
            unknown: 0.0,
            repeated: 0.0,
            removed: 0.0,
            switched_off: 0.0,
            off_s: [0.0, 0.0],
            stopped: 0.0,
            swapped: 0.0,
            failed_hits: 0.0,
            play: None,
            missed_hits: 0.0,
            double_hits: 0.0,
            scan: ScanConfig::default(),
            simulation: SimulationConfig::default(),
        }
    }
}

impl RigScript {
    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds.
    pub fn validate(&self) -> Result<(), Error> {
        let refuse = |key: &str, value: String, bound: &str| {
            Err(Error::Setting { key: format!("rig.{key}"), value, bound: bound.to_owned() })
        };
        if Serial::new(&self.name).is_err() {
            return refuse("name", format!("{:?}", self.name), "1 to 32 bytes of plain text");
        }
        if !self.pattern.contains("{}") || Serial::new(&self.serial_of(u64::MAX)).is_err() {
            return refuse("pattern", format!("{:?}", self.pattern), "a serial of at most 14 bytes with {} in it");
        }
        if let Some(serial) =
            self.serials.iter().find(|serial| serial.is_empty() || serial.len() > 64 || serial.contains(['\n', '\r']))
        {
            return refuse("serials", format!("{serial:?}"), "lines of 1 to 64 bytes");
        }
        for (key, share) in [
            ("velocity_error", self.velocity_error),
            ("unknown", self.unknown),
            ("repeated", self.repeated),
            ("removed", self.removed),
            ("switched_off", self.switched_off),
            ("stopped", self.stopped),
            ("swapped", self.swapped),
            ("failed_hits", self.failed_hits),
            ("missed_hits", self.missed_hits),
            ("double_hits", self.double_hits),
        ] {
            if !(0.0..=1.0).contains(&share) {
                return refuse(key, share.to_string(), "from 0 to 1");
            }
        }
        for (key, from, to) in [
            ("gap_s", self.gap_s[0], self.gap_s[1]),
            ("off_s", self.off_s[0], self.off_s[1]),
            ("move_s", self.move_s, self.move_s),
            ("home_s", self.home_s, self.home_s),
            ("hit_s", self.hit_s, self.hit_s),
        ] {
            if !(0.0..=TIME_MAX_S).contains(&from) || !(from..=TIME_MAX_S).contains(&to) {
                return refuse(key, format!("{from} to {to}"), "from 0 to 86400, the second not below the first");
            }
        }
        Ok(())
    }

    /// Serial of casing `number`, from 1, by the pattern.
    fn serial_of(&self, number: u64) -> String {
        self.pattern.replacen("{}", &number.to_string(), 1)
    }
}

/// What a simulated rig did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RigReport {
    /// Casings that were put on it.
    pub casings: u64,
    /// Casings that the station reported as closed.
    pub closed: u64,
    /// Casings that the station refused or did not accept.
    pub refused: u64,
    /// Casings that were removed before their last tap.
    pub removed: u64,
    /// How often it was switched off.
    pub switched_off: u64,
    /// How often its emergency stop was pressed.
    pub stopped: u64,
    /// How often it has found its home.
    pub homed: u64,
    /// Hits.
    pub hits: u64,
    /// Hits that failed.
    pub failed_hits: u64,
    /// Hits that were reported and not made.
    pub missed_hits: u64,
    /// Hits that were made twice.
    pub double_hits: u64,
}

/// Plays `script` for whoever connects to `listener`, one connection at a time, until its casings are done or `stop` is
/// set.
///
/// # Errors
/// [`Error::Setting`] for a script out of its bounds, [`Error::Rig`] if the listener fails. A station that disconnects
/// is no error; the rig waits for it to return.
pub fn serve_rig(listener: &TcpListener, script: &RigScript, stop: &AtomicBool) -> Result<RigReport, Error> {
    script.validate()?;
    listener.set_nonblocking(true).map_err(Error::Rig)?;
    let player = script.play.as_ref().map(|path| Player::start(path, &script.scan, &script.simulation)).transpose()?;
    let mut rig = Rig {
        script,
        stop,
        player,
        dice: Dice(script.seed),
        report: RigReport::default(),
        on_it: None,
        is_homed: false,
        before: String::new(),
        next_at: Instant::now(),
    };
    while !rig.is_done() {
        match listener.accept() {
            Ok((stream, _)) => {
                // Whatever ends the conversation, the next connection begins with hello.
                if let Err(error) = rig.converse(stream) {
                    tracing::info!("the station has gone: {error}");
                }
            }
            Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::ConnectionAborted) => {
                thread::sleep(TICK)
            }
            Err(error) => return Err(Error::Rig(error)),
        }
    }
    Ok(rig.report)
}

struct Rig<'a> {
    script: &'a RigScript,
    stop: &'a AtomicBool,
    player: Option<Player>,
    dice: Dice,
    report: RigReport,
    on_it: Option<OnRig>,
    /// Whether it knows its position: not after it was off, or stopped.
    is_homed: bool,
    /// Serial of the previous casing.
    before: String,
    /// When the next casing comes.
    next_at: Instant,
}

/// The casing on the rig, and what will happen to it.
struct OnRig {
    serial: String,
    hits: u64,
    is_removed: bool,
    is_switched_off: bool,
    is_stopped: bool,
    /// The hit at which it happens.
    at_hit: u64,
}

impl Rig<'_> {
    fn is_done(&self) -> bool {
        let are_all_there = self.script.casings.is_some_and(|most| self.report.casings >= most);
        self.stop.load(Ordering::Relaxed) || are_all_there && self.on_it.is_none()
    }

    /// Talks to one station until that disconnects, the rig is switched off, or all casings are done.
    fn converse(&mut self, mut stream: TcpStream) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(TICK))?;
        self.is_homed = false;
        say(&mut stream, &format!("hello {} {VERSION}", self.script.name))?;
        if let Some(casing) = &self.on_it {
            say(&mut stream, &format!("casing {}", casing.serial))?;
        }
        let mut lines = LineReader::default();
        while !self.is_done() {
            if self.on_it.is_none() && Instant::now() >= self.next_at {
                let serial = self.load();
                say(&mut stream, &format!("casing {serial}"))?;
            }
            match lines.read(&mut stream)? {
                ReadLine::Text(line) => {
                    if !self.answer(&mut stream, &line)? {
                        drop(stream);
                        self.be_off();
                        return Ok(());
                    }
                }
                ReadLine::Nothing => {}
                ReadLine::End => return Err(io::ErrorKind::UnexpectedEof.into()),
                ReadLine::TooLong | ReadLine::NotText => return Err(io::Error::other("it has sent no line of text")),
            }
        }
        Ok(())
    }

    /// Puts the next casing on the rig; returns its serial.
    fn load(&mut self) -> String {
        let script = self.script;
        self.report.casings += 1;
        let number = self.report.casings;
        let (is_unknown, is_repeated) = (self.dice.is(script.unknown), self.dice.is(script.repeated));
        let place = usize::try_from(number - 1).unwrap_or(usize::MAX);
        let serial = match script.serials.get(place) {
            Some(serial) => serial.clone(),
            None if is_unknown => UNKNOWN.to_owned(),
            None if is_repeated && !self.before.is_empty() => self.before.clone(),
            None => script.serial_of(number),
        };
        if serial != UNKNOWN {
            self.before.clone_from(&serial);
        }
        let (is_removed, is_switched_off) = (self.dice.is(script.removed), self.dice.is(script.switched_off));
        let is_stopped = script.stopped > 0.0 && self.dice.is(script.stopped);
        if let Some(Err(error)) = self.player.as_mut().map(|player| player.load(&serial)) {
            tracing::error!("casing {serial} is not heard: {error}");
        }
        self.on_it =
            Some(OnRig { serial: serial.clone(), hits: 0, is_removed, is_switched_off, is_stopped, at_hit: 1 });
        serial
    }

    /// Takes the casing off the rig; the next one comes after its gap.
    fn unload(&mut self) {
        self.on_it = None;
        self.next_at = Instant::now() + self.dice.between(self.script.gap_s);
    }

    /// Answers the station's `line`; returns whether the rig is still on.
    fn answer(&mut self, stream: &mut TcpStream, line: &str) -> io::Result<bool> {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        match word {
            "ping" => say(stream, "pong")?,
            "scan" => {
                let taps: u64 = rest.rsplit(' ').next().and_then(|taps| taps.parse().ok()).unwrap_or(1);
                let at_hit = 1 + self.dice.below(taps);
                if let Some(casing) = self.on_it.as_mut().filter(|casing| casing.hits == 0) {
                    casing.at_hit = at_hit;
                }
            }
            "home" => {
                self.rest(self.script.home_s);
                self.is_homed = true;
                self.report.homed += 1;
                say(stream, "homed")?;
            }
            "move" if self.on_it.is_none() => say(stream, "error there is no casing")?,
            "move" if !self.is_homed => say(stream, "error it was not homed")?,
            "move" => {
                self.rest(self.script.move_s);
                self.player.iter_mut().for_each(|player| player.go(rest));
                say(stream, "ready")?;
            }
            "hit" => return self.hit(stream, rest),
            "closed" | "refused" => {
                if self.on_it.as_ref().is_some_and(|casing| rest.starts_with(casing.serial.as_str())) {
                    *if word == "closed" { &mut self.report.closed } else { &mut self.report.refused } += 1;
                    say(stream, "removed")?;
                    self.unload();
                }
            }
            // The station does not accept the serial, so the casing is taken off.
            "error" if self.on_it.as_ref().is_some_and(|casing| casing.hits == 0) => {
                self.report.refused += 1;
                say(stream, "removed")?;
                self.unload();
            }
            _ => tracing::info!("the station says {line:?}"),
        }
        Ok(true)
    }

    fn hit(&mut self, stream: &mut TcpStream, velocity: &str) -> io::Result<bool> {
        let script = self.script;
        let velocity: f64 = velocity.parse().unwrap_or(0.0);
        let Some(casing) = self.on_it.as_mut() else { return say(stream, "error there is no casing").map(|()| true) };
        casing.hits += 1;
        if casing.hits == casing.at_hit && casing.is_switched_off {
            casing.is_switched_off = false;
            self.report.switched_off += 1;
            if self.dice.is(script.swapped) {
                self.report.removed += 1;
                self.on_it = None;
            }
            return Ok(false);
        }
        if casing.hits == casing.at_hit && casing.is_stopped {
            self.report.stopped += 1;
            self.is_homed = false;
            say(stream, "stopped emergency stop")?;
            self.be_off();
            say(stream, "running")?;
            return Ok(true);
        }
        if casing.hits >= casing.at_hit && casing.is_removed {
            self.report.removed += 1;
            say(stream, "removed")?;
            say(stream, "error there is no casing")?;
            self.unload();
            return Ok(true);
        }
        self.rest(script.hit_s);
        if self.dice.is(script.failed_hits) {
            self.report.failed_hits += 1;
            say(stream, "error no air")?;
            return Ok(true);
        }
        self.report.hits += 1;
        if let Some(player) = &mut self.player {
            let (is_missed, is_double) = (self.dice.is(script.missed_hits), self.dice.is(script.double_hits));
            self.report.missed_hits += u64::from(is_missed);
            self.report.double_hits += u64::from(is_double && !is_missed);
            player.hit(velocity, if is_missed { 0 } else { 1 + usize::from(is_double) });
        }
        let measured = velocity * (1.0 + script.velocity_error * (2.0 * self.dice.uniform() - 1.0));
        say(stream, &format!("hit {measured}"))?;
        Ok(true)
    }

    fn be_off(&mut self) {
        let time = self.dice.between(self.script.off_s);
        self.rest(time.as_secs_f64());
    }

    /// Waits for `time_s`, unless it is to stop.
    fn rest(&self, time_s: f64) {
        let until = Instant::now() + Duration::try_from_secs_f64(time_s).unwrap_or_default();
        while !self.stop.load(Ordering::Relaxed)
            && let Some(left) = until.checked_duration_since(Instant::now())
        {
            thread::sleep(left.min(TICK));
        }
    }
}

fn say(stream: &mut TcpStream, line: &str) -> io::Result<()> {
    stream.write_all(format!("{line}\n").as_bytes())
}

/// Random numbers for what happens to casings (SplitMix64); no result depends on them.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    #[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
    fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 * (-53.0_f64).exp2()
    }

    fn is(&mut self, share: f64) -> bool {
        self.uniform() < share
    }

    fn below(&mut self, end: u64) -> u64 {
        self.next() % end.max(1)
    }

    fn between(&mut self, [from, to]: [f64; 2]) -> Duration {
        Duration::try_from_secs_f64(from + (to - from) * self.uniform()).unwrap_or_default()
    }
}
