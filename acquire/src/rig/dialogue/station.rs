//! The requests of the station: casings, taps, and reports of how casings ended.

use std::sync::Arc;

use tapline_wire::{OVER, RecordKind, now_ns};

use super::{Command, Current, Dialogue, Hit, LoadedCasing, Progress, Removal, Step, Tap};
use crate::rig::protocol::UNKNOWN;
use crate::source::unknown_name;

impl Dialogue {
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
        self.current = Some(Current {
            id,
            serial,
            removal: Arc::clone(&removal),
            step: Step::Idle,
            hit: String::new(),
            hit_sent: None,
            is_away_told: false,
        });
        Some(LoadedCasing { id, name, removal })
    }

    /// Progress of `tap` of the casing `id`. Commands the rig to make the tap as soon as the rig is free.
    pub(crate) fn tap(
        &mut self,
        id: u64,
        tap: Tap,
        to_move: impl FnOnce() -> String,
        to_hit: impl FnOnce() -> String,
    ) -> Progress {
        self.end_patience();
        let is_free =
            self.rig_name.is_some() && self.away_since.is_none() && self.pending.is_none() && self.stopped.is_none();
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
        if !self.is_homed {
            self.command(Command::Home, "home".to_owned(), id);
            return Progress::UnderWay;
        }
        current.step = Step::Begun(tap);
        current.hit = to_hit();
        self.command(Command::Move, to_move(), id);
        Progress::UnderWay
    }

    /// The impact of `tap` of the casing `id`; `None` until the rig has hit.
    pub(crate) fn hit(&self, id: u64, tap: Tap) -> Option<Hit> {
        match &self.current {
            Some(Current { id: of, step: Step::Hit(at, hit), .. }) if *of == id && *at == tap => Some(*hit),
            _ => None,
        }
    }

    /// Counts `tap` of the casing `id`, which the rig reported as made, as failed for the reason `why`.
    pub(crate) fn fail(&mut self, id: u64, tap: Tap, why: &str) {
        let station = self.config.station;
        if let Some(current) = self.current.as_mut().filter(|current| current.id == id) {
            tracing::warn!("station {station}: casing {}: {why}", current.serial);
            current.step = Step::Failed(tap, why.to_owned());
        }
    }

    /// Raises the alarm that hits are not heard, for the reason `why`: once, until one is heard.
    pub(crate) fn begin_unheard(&mut self, why: &str) {
        if self.unheard_alarm.is_none() {
            self.unheard_alarm = Some(why.to_owned());
            self.alarm(why.to_owned());
        }
    }

    /// Notes that a hit was heard.
    pub(crate) fn end_unheard(&mut self) {
        if let Some(text) = self.unheard_alarm.take() {
            self.alarm(format!("{OVER}{text}"));
        }
    }

    /// Raises an alarm about the casing `id`, if that is the current one.
    pub(crate) fn alarm_of(&mut self, id: u64, why: &str) {
        if let Some(current) = self.current.as_ref().filter(|current| current.id == id) {
            self.alarm(format!("casing {}: {why}", current.serial));
        }
    }

    /// Reports to the rig how the casing `id` ended, now or once it is connected again: `word`, the serial, and `why`.
    pub(crate) fn report_end(&mut self, id: u64, word: &str, why: &str) {
        let Some(current) = self.current.take_if(|current| current.id == id) else { return };
        let line = format!("{word} {}{why}", current.serial);
        let is_sent = self.rig_name.is_some() && self.away_since.is_none();
        if is_sent {
            self.send(&line);
        }
        self.last_end.set(current.serial, line, is_sent);
        self.away_since = None;
        self.end_away();
    }

    /// The messages since the last call.
    pub(crate) fn take_messages(&mut self) -> Vec<(RecordKind, String)> {
        std::mem::take(&mut self.messages)
    }

    /// Why there is no connection to the rig, as text for people; `None` while there is one.
    pub(crate) fn fault(&self) -> Option<String> {
        let why = self.fault.as_deref().unwrap_or("it has not answered yet");
        self.rig_name.is_none().then(|| format!("there is no connection to the rig at {}: {why}", self.config.address))
    }

    /// Why the rig is stopped, as it says; `None` while it is not.
    pub(crate) fn stopped(&self) -> Option<String> {
        self.stopped.as_ref().filter(|_| self.rig_name.is_some()).map(|(why, _)| why.clone())
    }

    /// What the station is waiting for, as text for people.
    pub(crate) fn waits_for(&self) -> String {
        let address = &self.config.address;
        match (&self.rig_name, &self.current, &self.pending) {
            (None, Some(current), _) => format!("the rig at {address}, which went away with casing {}", current.serial),
            (None, None, _) => {
                let fault = self.fault.as_ref().map_or_else(String::new, |fault| format!(": {fault}"));
                format!("the rig at {address}{fault}")
            }
            (Some(name), ..) if let Some((why, _)) = &self.stopped => {
                format!("the rig {name:?} at {address} to continue: it is stopped ({why})")
            }
            (Some(name), Some(_), Some(pending)) => {
                format!("the rig {name:?} at {address} to {}", in_words(&pending.text))
            }
            (Some(_), Some(Current { step: Step::Hit(..), .. }), None) => "its hit to be heard".to_owned(),
            (Some(name), Some(_), None) => format!("the rig {name:?} at {address}, to try again"),
            (Some(name), ..) => match self.last_end.on_rig() {
                Some(ended) => format!("another casing on the rig {name:?} at {address}: {ended}"),
                None => format!("a casing on the rig {name:?} at {address}"),
            },
        }
    }
}

/// What a rig does that obeys `command`, for people.
pub(crate) fn in_words(command: &str) -> String {
    match command.split(' ').collect::<Vec<_>>()[..] {
        ["home"] => "find its home".to_owned(),
        ["move", shoulder, location, angle_deg, offset_mm] => format!(
            "move to location {location} ({angle_deg}°) of shoulder {shoulder}, {offset_mm} mm from the belt edge"
        ),
        ["hit", velocity_m_per_s] => format!("hit at {velocity_m_per_s} m/s"),
        ["ping"] => "answer".to_owned(),
        _ => command.to_owned(),
    }
}
