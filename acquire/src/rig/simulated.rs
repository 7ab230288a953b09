//! The simulated rig: the other side of the protocol, with all that can go wrong on a real rig.

use std::io::{self, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::played::Player;
use super::protocol::{LineReader, ReadLine, UNKNOWN, VERSION};
use super::script::RigScript;
use crate::Error;

/// How often a waiting rig checks whether it is to stop.
const TICK: Duration = Duration::from_millis(20);

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

/// Plays `script` for any station that connects to `listener`, one at a time, until its casings are done or `stop` is
/// set.
///
/// # Errors
/// [`Error::Setting`] for a script out of its bounds, [`Error::Rig`] if the listener fails. A station that disconnects
/// is not an error; the rig waits for it to return.
pub fn serve_rig(listener: &TcpListener, script: &RigScript, stop: &AtomicBool) -> Result<RigReport, Error> {
    script.validate()?;
    listener.set_nonblocking(true).map_err(Error::Rig)?;
    let player = script.play.as_ref().map(|path| Player::start(path, &script.scan, &script.simulation)).transpose()?;
    let mut rig = Rig {
        script,
        stop,
        player,
        dice: ChaCha8Rng::seed_from_u64(script.seed),
        report: RigReport::default(),
        on_it: None,
        is_homed: false,
        before: String::new(),
        next_at: Instant::now(),
    };
    while !rig.is_done() {
        match listener.accept() {
            Ok((stream, _)) => {
                // However the conversation ends, the next connection begins with hello.
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
    /// Decides what happens to casings, and which velocity a hit has.
    dice: ChaCha8Rng,
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

    /// Talks to one station until it disconnects, the rig is switched off, or all casings are done.
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
        let (is_unknown, is_repeated) = (self.dice.random_bool(script.unknown), self.dice.random_bool(script.repeated));
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
        let (is_removed, is_switched_off) =
            (self.dice.random_bool(script.removed), self.dice.random_bool(script.switched_off));
        let is_stopped = self.dice.random_bool(script.stopped);
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
        let [from, to] = self.script.gap_s;
        let gap_s = self.dice.random_range(from..=to);
        self.next_at = Instant::now() + Duration::try_from_secs_f64(gap_s).unwrap_or_default();
    }

    /// Answers the station's `line`; returns whether the rig is still on.
    fn answer(&mut self, stream: &mut TcpStream, line: &str) -> io::Result<bool> {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        match word {
            "ping" => say(stream, "pong")?,
            "scan" => {
                let taps: u64 = rest.rsplit(' ').next().and_then(|taps| taps.parse().ok()).unwrap_or(1);
                let at_hit = 1 + self.dice.random_range(0..taps.max(1));
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
            if self.dice.random_bool(script.swapped) {
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
        if self.dice.random_bool(script.failed_hits) {
            self.report.failed_hits += 1;
            say(stream, "error no air")?;
            return Ok(true);
        }
        self.report.hits += 1;
        if let Some(player) = &mut self.player {
            let (is_missed, is_double) =
                (self.dice.random_bool(script.missed_hits), self.dice.random_bool(script.double_hits));
            self.report.missed_hits += u64::from(is_missed);
            self.report.double_hits += u64::from(is_double && !is_missed);
            player.hit(velocity, if is_missed { 0 } else { 1 + usize::from(is_double) });
        }
        let error = self.dice.random_range(-script.velocity_error..=script.velocity_error);
        let measured = velocity * (1.0 + error);
        say(stream, &format!("hit {measured}"))?;
        Ok(true)
    }

    fn be_off(&mut self) {
        let [from, to] = self.script.off_s;
        let time_s = self.dice.random_range(from..=to);
        self.rest(time_s);
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
