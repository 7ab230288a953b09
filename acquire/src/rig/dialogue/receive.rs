//! The effect of each line from the rig.

use std::time::{Duration, Instant};

use tapline_wire::{RecordKind, Serial, now_ns};

use super::{Command, Current, Dialogue, Hit, PendingCommand, RigConfig, Step, Tap, stopped};
use crate::rig::protocol::{RigMessage, UNKNOWN, VELOCITY_MAX_M_PER_S, VERSION, one_line};

/// Most unexpected lines within a second.
const UNEXPECTED_MAX: u32 = 100;

/// Most casings and stops within a minute, over all connections: each becomes an archive or an alarm.
const CHANGES_MAX: u32 = 120;

impl Dialogue {
    /// Handles a line from the rig; returns whether something has changed for the station, or why to end the connection.
    pub(crate) fn receive(&mut self, line: &str) -> Result<bool, String> {
        let now = Instant::now();
        self.last_received = Some(now);
        let Some(message) = RigMessage::parse(line) else {
            if self.rig_name.is_none() && self.is_serial() {
                // Boot output of a board.
                return Ok(false);
            }
            let bound = if line.starts_with("hit ") {
                format!(": a velocity is a number from 0 to {VELOCITY_MAX_M_PER_S}, as 1.85")
            } else {
                String::new()
            };
            let why = format!("{:?}, which is not in the protocol{bound}", one_line(line));
            self.send(&format!("error {why}"));
            return Err(format!("the rig has said {why}"));
        };
        if self.rig_name.is_none() {
            return self.receive_hello(message, line);
        }
        let is_of_motion =
            matches!(message, RigMessage::Homed | RigMessage::Ready | RigMessage::Hit(_) | RigMessage::Error(_));
        // An answer that was on its way when the rig stopped: its tap is made when the rig continues.
        if self.stopped.is_some() && is_of_motion {
            self.count_unexpected(now)?;
            return Ok(false);
        }
        // The board has restarted.
        if self.is_serial() && matches!(message, RigMessage::Hello { .. }) {
            self.forget_rig();
            return self.receive_hello(message, line);
        }
        self.last_end.heard();
        let may_answer = |pending: &PendingCommand| match pending.command {
            Command::Ping => message == RigMessage::Pong,
            _ => is_of_motion,
        };
        if !self.pending.as_ref().is_some_and(may_answer) {
            self.count_unexpected(now)?;
        }
        match message {
            RigMessage::Hello { .. } => Err("the rig has said hello twice".to_owned()),
            RigMessage::Casing(serial) => self.load(&serial, now),
            RigMessage::Removed => {
                self.discard_loaded();
                self.report(RecordKind::Removed, String::new());
                self.last_end.clear();
                if let Some(path) = &self.config.last_end {
                    // A line that starts anew is not to take the next casing of this serial for it.
                    drop(std::fs::remove_file(path));
                }
                self.remove_current("it was taken away from the rig before its last tap");
                Ok(true)
            }
            RigMessage::Homed => {
                self.answered(Command::Home, line)?;
                self.is_homed = true;
                Ok(true)
            }
            RigMessage::Ready => {
                let casing = self.answered(Command::Move, line)?;
                let hit = self.begun(casing).map(|current| {
                    current.hit_sent = Some(Instant::now());
                    current.hit.clone()
                });
                if let Some(hit) = hit {
                    self.command(Command::Hit, hit, casing);
                }
                Ok(false)
            }
            RigMessage::Hit(velocity_m_per_s) => {
                let casing = self.answered(Command::Hit, line)?;
                let sent = self.begun(casing).and_then(|current| current.hit_sent).unwrap_or(now);
                let hit = Hit { velocity_m_per_s, time_ns: now_ns(), sent, at: now };
                self.advance(casing, |tap| Step::Hit(tap, hit));
                Ok(true)
            }
            RigMessage::Stopped(why) => {
                let RigConfig { station, address, .. } = &self.config;
                tracing::warn!("station {station}: the rig at {address} is stopped: {why}");
                let mut since = now;
                if self.stopped.as_ref().is_none_or(|(before, _)| *before != why) {
                    self.count_change(now)?;
                    since = self.end_stop().unwrap_or(now);
                    self.alarm(stopped(&why));
                }
                // The pending command was not done: it is sent again when the rig continues.
                if let Some(pending) = self.pending.take_if(|pending| pending.command != Command::Ping)
                    && let Some(current) = self.begun(pending.casing)
                {
                    current.step = Step::Idle;
                }
                // The person who freed it may have turned it.
                self.is_homed = false;
                self.stopped.get_or_insert((why, since));
                Ok(true)
            }
            RigMessage::Running => {
                let RigConfig { station, address, .. } = &self.config;
                tracing::warn!("station {station}: the rig at {address} continues");
                let patience = self.config.patience;
                if self.end_stop().is_some_and(|since| since.elapsed() >= patience) {
                    self.give_up_if_turned(&format!("the rig was stopped for more than {} s", patience.as_secs_f64()));
                }
                Ok(true)
            }
            RigMessage::Pong => self.answered(Command::Ping, line).map(|_| true),
            RigMessage::Error(why) => {
                let RigConfig { station, address, .. } = &self.config;
                tracing::warn!("station {station}: the rig at {address} reports {why:?}");
                // A ping may have crossed it, and is still to be answered.
                if let Some(pending) = self.pending.take_if(|pending| pending.command != Command::Ping) {
                    self.unanswered.take_if(|(text, _)| *text == pending.text);
                    // It has no home. A rig that cannot find its home says that it is stopped, or refuses to move.
                    if pending.command == Command::Home {
                        self.is_homed = true;
                        self.give_up_if_turned("the rig was stopped or away, and has no home to find");
                    }
                    self.advance(pending.casing, |tap| Step::Failed(tap, why));
                }
                Ok(true)
            }
        }
    }

    fn receive_hello(&mut self, message: RigMessage, line: &str) -> Result<bool, String> {
        let RigConfig { station, address, .. } = &self.config;
        match message {
            RigMessage::Hello { name, version: VERSION } => {
                match &self.current {
                    Some(_) => tracing::warn!("station {station}: the rig {name:?} at {address} is back"),
                    None => tracing::info!("station {station}: connected to the rig {name:?} at {address}"),
                }
                self.rig_name = Some(name);
                self.fault = None;
                if self.current.is_none() {
                    self.end_away();
                }
                Ok(true)
            }
            RigMessage::Hello { version, .. } => {
                self.send(&format!("error version {version} is not supported, only {VERSION}"));
                Err(format!("the rig speaks version {version} of the protocol; this station speaks {VERSION}"))
            }
            _ if self.is_serial() => Ok(false),
            _ => Err(format!("the rig has said {:?} before hello", one_line(line))),
        }
    }

    /// Handles a casing on the rig: the current one again, one that has ended, or a new one. Returns whether something
    /// has changed for the station.
    fn load(&mut self, serial: &str, now: Instant) -> Result<bool, String> {
        let station = self.config.station;
        if serial != UNKNOWN
            && let Err(error) = Serial::new(serial)
        {
            self.count_change(now)?;
            tracing::error!("station {station}: a casing is skipped: {error}");
            self.report(RecordKind::Refusal, format!("a casing is skipped: {error}"));
            self.send(&format!("error {}", one_line(&error.to_string())));
            self.discard_loaded();
            self.remove_current("another casing was put on the rig before its last tap");
            return Ok(true);
        }
        let scan = format!("scan {serial} {}", self.tap_count);
        if let Some(current) = self.current.as_mut().filter(|current| current.serial == serial && serial != UNKNOWN) {
            if self.away_since.take().is_none() {
                self.send(&format!("error casing {serial} is on the rig already"));
                return Ok(false);
            }
            tracing::info!("station {station}: the rig is back with casing {serial}");
            if !matches!(current.step, Step::Hit(..)) {
                current.step = Step::Idle;
            }
            self.send(&scan);
            return Ok(true);
        }
        if let Some(line) = self.last_end.answer(serial).filter(|_| serial != UNKNOWN) {
            tracing::info!("station {station}: casing {serial} has ended; the rig has announced it again");
            self.send(&line);
            return Ok(false);
        }
        self.count_change(now)?;
        self.last_end.clear();
        self.remove_current("another casing was put on the rig before its last tap");
        self.discard_loaded();
        self.loaded = Some(serial.to_owned());
        self.send(&scan);
        Ok(true)
    }

    /// The casing for which `command` was sent. An error if another command was sent, or none.
    fn answered(&mut self, command: Command, line: &str) -> Result<u64, String> {
        match self.pending.take() {
            Some(pending) if pending.command == command => {
                self.unanswered.take_if(|(text, _)| *text == pending.text);
                Ok(pending.casing)
            }
            Some(pending) => Err(format!("the rig has answered {:?} with {:?}", pending.text, one_line(line))),
            None => Err(format!("the rig has said {:?} unexpectedly", one_line(line))),
        }
    }

    /// The casing `casing`, if it is on the rig and a tap of it has begun.
    fn begun(&mut self, casing: u64) -> Option<&mut Current> {
        self.current.as_mut().filter(|current| current.id == casing && matches!(current.step, Step::Begun(_)))
    }

    /// Moves the tap of `casing` that has begun, if there is one, to the `next` step.
    fn advance(&mut self, casing: u64, next: impl FnOnce(Tap) -> Step) {
        if let Some(current) = self.begun(casing)
            && let Step::Begun(tap) = current.step
        {
            current.step = next(tap);
            if matches!(current.step, Step::Hit(..)) {
                current.is_away_told = false;
                self.end_away();
            }
        }
    }

    fn count_unexpected(&mut self, now: Instant) -> Result<(), String> {
        match self.unexpected.are_more(UNEXPECTED_MAX, Duration::from_secs(1), now) {
            true => Err(format!("the rig has sent more than {UNEXPECTED_MAX} unexpected lines within a second")),
            false => Ok(()),
        }
    }

    fn count_change(&mut self, now: Instant) -> Result<(), String> {
        match self.changes.are_more(CHANGES_MAX, Duration::from_secs(60), now) {
            true => Err(format!("the rig has announced more than {CHANGES_MAX} casings and stops within a minute")),
            false => Ok(()),
        }
    }
}

/// Counts events within a time.
#[derive(Debug, Default)]
pub(super) struct Counter {
    count: u32,
    since: Option<Instant>,
}

impl Counter {
    /// Counts one at `now`; whether there are more than `most` since the present span of length `within` has begun.
    fn are_more(&mut self, most: u32, within: Duration, now: Instant) -> bool {
        if self.since.is_none_or(|since| now.duration_since(since) >= within) {
            *self = Self { count: 0, since: Some(now) };
        }
        self.count += 1;
        self.count > most
    }
}
