//! Which verdicts are still to be reported to whom.
//!
//! `store` leaves a note of each casing before it gives the finished file its name; the note stays until every receiver has
//! acknowledged the verdict. Work to do = notes - acknowledgements, even after `kill -9`. An acknowledgement is a word
//! at the end of the note's name (`5c0f….stdout.mqtt`): it takes no space, and is never half there. The last removes
//! the note. The verdict itself is in the casing's file.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};
use tapline_host::messages::counted;
use tapline_store::{Places, Reader, Unreported, casing_id};
use tapline_wire::{OVER, now_ns};

use crate::shown::status::ReceiverStatus;
use crate::shown::verdict::CasingVerdict;

/// Most verdicts that may wait at once. The oldest make room for further ones: their notes stay on the disk for the next start of the
/// line.
const WAITING_MAX: usize = 100_000;

/// Most verdicts that wait in memory, the newest; the others are read from their files.
const KEPT_MAX: usize = 1000;

/// Most alarms that wait to be taken.
const ALARMS_MAX: usize = 64;

/// After how long a verdict whose file could not be read is read again.
pub(super) const READ_AGAIN_AFTER: Duration = Duration::from_secs(60);

/// A verdict that waits for this long is a trouble.
const LATE_AFTER_NS: i64 = 60_000_000_000;

/// How long unnamed files of an earlier line may take to get their names.
const NAMED_WITHIN: Duration = Duration::from_secs(10);

/// Where verdicts go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) enum Receiver {
    /// Standard output.
    Print,
    /// The command `on_verdict`.
    Command,
    Mqtt,
    OpcUa,
    Modbus,
}

impl Receiver {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Print => "stdout",
            Self::Command => "on_verdict",
            Self::Mqtt => "mqtt",
            Self::OpcUa => "opcua",
            Self::Modbus => "modbus",
        }
    }
}

/// The place of a verdict among others: when its casing was finished, and the casing's number.
type Place = (i64, u64);

/// Called when there is a new verdict to report.
type Wake = Box<dyn Fn() + Send>;

/// A verdict that somebody has not acknowledged.
#[derive(Debug)]
struct Waiting {
    note: Unreported,
    /// Name of the note.
    file_name: String,
    /// Who is still to acknowledge it.
    owed: Vec<Receiver>,
    /// The verdict, so that it is reported although its file is moved away meanwhile; `None` if an earlier line has left it, or
    /// many wait.
    verdict: Option<Arc<CasingVerdict>>,
    /// Its number among those that came in, from 1.
    #[cfg_attr(not(feature = "plant"), expect(dead_code, reason = "only OPC UA asks for it"))]
    serial: u64,
    /// When its file could not be read, unless it has been read since.
    unreadable_at: Option<Instant>,
}

#[derive(Default)]
struct State {
    waiting: BTreeMap<Place, Waiting>,
    /// How many came in.
    count: u64,
    /// Notes of casings whose files did not have their names when the line was started.
    unnamed: Vec<Unreported>,
    /// Whether an alarm says that some of them did not get their names.
    has_alarmed: bool,
    /// Each with the text with which it began, which is that of its alarm, and its text now.
    troubles: BTreeMap<(Receiver, &'static str), (String, String)>,
    alarms: Vec<String>,
    wakes: Vec<Wake>,
    /// How many have made room for others.
    left_count: u64,
}

/// The verdicts that are still to be reported.
pub(crate) struct Outbox {
    places: Places,
    receivers: Vec<Receiver>,
    opened_at: Instant,
    /// Held for moments: the line itself waits for it.
    state: Mutex<State>,
    /// Held while notes are renamed and removed: if the disk hangs, only receivers wait.
    disk: Mutex<()>,
}

impl Outbox {
    /// The verdicts for each of `receivers`: those that an earlier line left, and new ones.
    pub(crate) fn open(places: &Places, receivers: Vec<Receiver>) -> Result<Arc<Self>> {
        let (state, disk) = (Mutex::default(), Mutex::default());
        let outbox = Self { places: places.clone(), receivers, opened_at: Instant::now(), state, disk };
        for (path, id, acknowledged) in outbox.notes()? {
            let note = match Unreported::read(&path) {
                Ok(note) if note.id() == id => note,
                Ok(_) | Err(_) => {
                    // `store` writes notes completely: something else has put this file there.
                    tracing::error!("{} is not a note of a verdict; it stays where it is", path.display());
                    continue;
                }
            };
            match outbox.file_of(&note).exists() {
                true => outbox.add(note, &acknowledged, None),
                false => outbox.state().unnamed.push(note),
            }
        }
        Ok(Arc::new(outbox))
    }

    /// Every note: its path, the casing's id, and the names of those who have acknowledged it.
    fn notes(&self) -> Result<Vec<(PathBuf, String, Vec<String>)>> {
        let folder = self.places.unreported_folder();
        let mut notes = Vec::new();
        for entry in fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))? {
            let entry = entry.with_context(|| format!("cannot read {}", folder.display()))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let mut words = name.split('.').map(str::to_owned);
            let id = words.next().unwrap_or_default();
            let acknowledged: Vec<String> = words.collect();
            if acknowledged.iter().any(|word| word == "new") {
                // A draft that was never finished: its casing's file has no name yet, and gets another note.
                drop(fs::remove_file(entry.path()));
                continue;
            }
            notes.push((entry.path(), id, acknowledged));
        }
        Ok(notes)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add(&self, note: Unreported, acknowledged: &[String], verdict: Option<Arc<CasingVerdict>>) {
        let mut file_name = note.id();
        acknowledged.iter().for_each(|name| file_name = format!("{file_name}.{name}"));
        let is_owed = |receiver: &&Receiver| acknowledged.iter().all(|name| name != receiver.name());
        let owed: Vec<Receiver> = self.receivers.iter().filter(is_owed).copied().collect();
        if owed.is_empty() {
            // Only receivers that are no longer configured have not acknowledged it.
            return self.remove(&file_name);
        }
        let mut state = self.state();
        if verdict.is_some()
            && let Some(older) = state.waiting.values_mut().rev().nth(KEPT_MAX - 1)
        {
            older.verdict = None;
        }
        let key = (note.at_ns, note.number);
        state.count += 1;
        let serial = state.count;
        state.waiting.insert(key, Waiting { note, file_name, owed, verdict, serial, unreadable_at: None });
        // A receiver that never acknowledges keeps no verdict from the others.
        if state.waiting.len() > WAITING_MAX && state.waiting.pop_first().is_some() {
            state.left_count += 1;
        }
        state.wakes.iter().for_each(|wake| wake());
    }

    /// The note of the casing `number`, whose file has its name now; `None` if its verdict is or was in here.
    pub(crate) fn note(&self, number: u64) -> Result<Option<Unreported>> {
        if self.state().waiting.values().any(|waiting| waiting.note.number == number) {
            return Ok(None);
        }
        let path = self.places.unreported_folder().join(casing_id(number));
        let is_there = path.try_exists().with_context(|| format!("cannot look for {}", path.display()))?;
        Ok(if is_there { Some(Unreported::read(&path)?) } else { None })
    }

    /// Has the `verdict` of `note` reported to every receiver; without it, what its file says.
    pub(crate) fn put(&self, note: Unreported, verdict: Option<Arc<CasingVerdict>>) {
        self.state().unnamed.retain(|unnamed| unnamed.number != note.number);
        self.add(note, &[], verdict);
    }

    /// The oldest verdict that `receiver` is to be sent; of one station, if it asks for one.
    pub(crate) fn next(&self, receiver: Receiver, station: Option<u16>) -> Option<Unreported> {
        let of = |waiting: &&Waiting| station.is_none_or(|station| waiting.note.station == station);
        self.state().owed(receiver).find(of).map(|waiting| waiting.note.clone())
    }

    /// The verdict on the casing `number`, if `receiver` is to be sent it.
    #[cfg(feature = "plant")]
    pub(crate) fn find(&self, receiver: Receiver, number: u64) -> Option<Unreported> {
        self.state().owed(receiver).find(|waiting| waiting.note.number == number).map(|waiting| waiting.note.clone())
    }

    /// Ids of the verdicts that `receiver` is to be sent, the oldest first, at most so many.
    #[cfg(feature = "plant")]
    pub(crate) fn ids(&self, receiver: Receiver, most: usize) -> Vec<String> {
        self.state().owed(receiver).take(most).map(|waiting| waiting.note.id()).collect()
    }

    /// How many verdicts have come in.
    #[cfg(feature = "plant")]
    pub(crate) fn count(&self) -> u64 {
        self.state().count
    }

    /// The verdicts that came in after the first `count`, and that `receiver` is to be sent, each with its number, in the order in which
    /// they came: the clock may have been set back between them.
    #[cfg(feature = "plant")]
    pub(crate) fn newer(&self, receiver: Receiver, count: u64) -> Vec<(u64, Unreported)> {
        let state = self.state();
        let newer = state.owed(receiver).filter(|waiting| waiting.serial > count);
        let mut newer: Vec<(u64, Unreported)> = newer.map(|waiting| (waiting.serial, waiting.note.clone())).collect();
        newer.sort_by_key(|(serial, _)| *serial);
        newer
    }

    /// The verdict that `note` is about. Where it cannot be read, `note` is not reported for [`READ_AGAIN_AFTER`].
    pub(crate) fn read(&self, note: &Unreported) -> Option<Arc<CasingVerdict>> {
        let key = (note.at_ns, note.number);
        let kept = self.state().waiting.get(&key).and_then(|waiting| waiting.verdict.clone());
        if kept.is_some() {
            return kept;
        }
        let path = self.file_of(note);
        let read = Reader::open(&path).map_err(anyhow::Error::from);
        let read = read.and_then(|reader| CasingVerdict::read(&note.name, note.number, note.at_ns, &reader));
        let mut state = self.state();
        let now = read.is_err().then(Instant::now);
        let before = state.waiting.get_mut(&key).and_then(|waiting| std::mem::replace(&mut waiting.unreadable_at, now));
        match read {
            Ok(verdict) => Some(Arc::new(verdict)),
            Err(error) => {
                if before.is_none() {
                    tracing::error!("the verdict on casing {} cannot be reported: {error:#}", note.name);
                    state.alarm(format!("casing {}: its verdict cannot be reported: {error:#}", note.name));
                }
                None
            }
        }
    }

    /// The file of the casing that `note` is about.
    pub(crate) fn file_of(&self, note: &Unreported) -> PathBuf {
        self.places.out().join(&note.file)
    }

    /// Notes that `receiver` has the verdict on the casing `number`; whether it was to be sent.
    pub(crate) fn acknowledge(&self, receiver: Receiver, number: u64) -> bool {
        let _turn = self.disk.lock().unwrap_or_else(PoisonError::into_inner);
        let mut state = self.state();
        let Some((&key, waiting)) = state.waiting.iter_mut().find(|(_, waiting)| waiting.note.number == number) else {
            return false;
        };
        let Some(place) = waiting.owed.iter().position(|owed| *owed == receiver) else { return false };
        waiting.owed.swap_remove(place);
        let before = waiting.file_name.clone();
        if waiting.owed.is_empty() {
            drop(state);
            // First the note: while it is there, `note` must find that its verdict is in here.
            self.remove(&before);
            self.state().waiting.remove(&key);
        } else {
            waiting.file_name = format!("{before}.{}", receiver.name());
            let after = waiting.file_name.clone();
            drop(state);
            let folder = self.places.unreported_folder();
            report(&before, fs::rename(folder.join(&before), folder.join(after)));
        }
        true
    }

    fn remove(&self, file_name: &str) {
        report(file_name, fs::remove_file(self.places.unreported_folder().join(file_name)));
    }

    /// Has `wake` called when there is a new verdict to report.
    pub(crate) fn wake_by(&self, wake: Wake) {
        self.state().wakes.push(wake);
    }

    /// Sets or clears a trouble of `receiver`. An alarm says when one begins and when it is over. `kind` distinguishes its troubles from
    /// each other.
    pub(crate) fn set_trouble(&self, receiver: Receiver, kind: &'static str, trouble: Option<String>) {
        let mut state = self.state();
        match trouble {
            Some(text) => match state.troubles.entry((receiver, kind)) {
                Entry::Occupied(mut known) => known.get_mut().1 = text,
                Entry::Vacant(place) => {
                    place.insert((text.clone(), text.clone()));
                    tracing::warn!("{text}");
                    state.alarm(text);
                }
            },
            None => {
                if let Some((text, _)) = state.troubles.remove(&(receiver, kind)) {
                    let text = format!("{OVER}{text}");
                    tracing::warn!("{text}");
                    state.alarm(text);
                }
            }
        }
    }

    pub(crate) fn alarm(&self, text: String) {
        self.state().alarm(text);
    }

    /// The alarms since this was last called.
    pub(crate) fn take_alarms(&self) -> Vec<String> {
        std::mem::take(&mut self.state().alarms)
    }

    /// The state of each receiver. Standard output that nobody reads is no trouble: other receivers have the verdicts.
    pub(crate) fn statuses(&self) -> Vec<ReceiverStatus> {
        let state = self.state();
        let now_ns = now_ns();
        let of = |receiver: Receiver| {
            let (count, oldest) = (state.owed(receiver).count(), state.owed(receiver).next());
            let age_ns = oldest.map_or(0, |oldest| now_ns.saturating_sub(oldest.note.at_ns));
            let late = (age_ns > LATE_AFTER_NS).then(|| {
                format!(
                    "{}: {} not acknowledged, the oldest for {} s",
                    receiver.name(),
                    counted(count, "verdict is", "verdicts are"),
                    age_ns / 1_000_000_000
                )
            });
            let trouble =
                state.troubles.iter().find(|((of, _), _)| *of == receiver).map(|(_, (_, now))| now.clone()).or(late);
            let trouble = trouble.filter(|_| receiver != Receiver::Print);
            ReceiverStatus { name: receiver.name().to_owned(), waiting: count as u64, trouble }
        };
        self.receivers.iter().map(|&receiver| of(receiver)).collect()
    }

    /// What cannot be reported, or not before the next start of the line.
    pub(crate) fn troubles(&self) -> Vec<String> {
        let mut state = self.state();
        if self.opened_at.elapsed() > NAMED_WITHIN && !state.has_alarmed && !state.unnamed.is_empty() {
            state.has_alarmed = true;
            let count = counted(state.unnamed.len(), "verdict of an earlier line", "verdicts of earlier lines");
            let first = self.file_of(&state.unnamed[0]);
            let text = format!("{count} cannot be reported: there is no {}", first.display());
            tracing::error!("{text}");
            state.alarm(text);
        }
        let left = (state.left_count > 0).then(|| {
            let older = counted(state.left_count as usize, "older one waits", "older ones wait");
            format!("{WAITING_MAX} verdicts wait to be acknowledged: {older} for the next start of the line")
        });
        let unreadable = state.waiting.values().filter(|waiting| waiting.unreadable_at.is_some());
        let unreadable = unreadable.map(|waiting| &waiting.note);
        let unnamed = state.unnamed.iter().filter(|_| self.opened_at.elapsed() > NAMED_WITHIN);
        let notes: Vec<&Unreported> = unreadable.chain(unnamed).collect();
        let lost = notes.first().map(|first| {
            let file = self.file_of(first);
            format!(
                "{} cannot be reported: the first one's file, {}, is missing or cannot be read",
                counted(notes.len(), "verdict", "verdicts"),
                file.display()
            )
        });
        left.into_iter().chain(lost).collect()
    }
}

impl State {
    /// The verdicts that `receiver` is to be sent, the oldest first.
    fn owed(&self, receiver: Receiver) -> impl Iterator<Item = &Waiting> {
        let may_be_read = |waiting: &&Waiting| waiting.unreadable_at.is_none_or(|at| at.elapsed() > READ_AGAIN_AFTER);
        self.waiting.values().filter(may_be_read).filter(move |waiting| waiting.owed.contains(&receiver))
    }

    fn alarm(&mut self, text: String) {
        if self.alarms.len() < ALARMS_MAX {
            self.alarms.push(text);
        }
    }
}

/// Reports a note that cannot be changed: after the next start of the line its verdict is reported again, under the same id.
fn report(note: &str, changed: std::io::Result<()>) {
    if let Err(error) = changed {
        tracing::error!("cannot keep the acknowledgement of the verdict {note}: {error}; it will be reported again");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn note(number: u64) -> Unreported {
        Unreported { number, name: "A".to_owned(), station: 1, at_ns: number as i64, file: PathBuf::from("A.h5") }
    }

    fn outbox(receivers: Vec<Receiver>) -> (tempfile::TempDir, Arc<Outbox>) {
        let folder = tempfile::tempdir().unwrap();
        let places = Places::new(folder.path(), true);
        places.create().unwrap();
        (folder, Outbox::open(&places, receivers).unwrap())
    }

    /// Catches a receiver that never acknowledges, and for which the others get no more verdicts.
    #[test]
    fn the_oldest_verdict_makes_room() {
        let (_folder, outbox) = outbox(vec![Receiver::Modbus, Receiver::Print]);
        (1..=WAITING_MAX as u64).for_each(|number| outbox.put(note(number), None));
        assert_eq!((outbox.next(Receiver::Print, None), outbox.troubles()), (Some(note(1)), Vec::new()));
        let newest = WAITING_MAX as u64 + 1;
        outbox.put(note(newest), None);
        assert_eq!(outbox.next(Receiver::Modbus, None), Some(note(2)));
        assert!(outbox.acknowledge(Receiver::Print, newest));
        assert!(outbox.troubles().concat().contains("1 older one waits"));
    }

    /// Catches a verdict that is given up since its file could not be read once, and one that is read again and again.
    #[test]
    fn what_cannot_be_read_is_read_again_later() {
        let (_folder, outbox) = outbox(vec![Receiver::Print]);
        let note = note(1);
        outbox.put(note.clone(), None);
        assert!(outbox.read(&note).is_none());
        assert_eq!((outbox.next(Receiver::Print, None), outbox.troubles().len()), (None, 1));
        for waiting in outbox.state().waiting.values_mut() {
            waiting.unreadable_at = Instant::now().checked_sub(READ_AGAIN_AFTER);
        }
        assert_eq!(outbox.next(Receiver::Print, None), Some(note));
    }

    /// Catches verdicts of an earlier line whose files were moved away, and of which no alarm says so, or one at every look.
    #[test]
    fn a_file_that_is_gone_is_an_alarm() {
        let (_folder, outbox) = outbox(vec![Receiver::Print]);
        outbox.state().unnamed.push(note(1));
        assert_eq!((outbox.troubles(), outbox.take_alarms()), (Vec::new(), Vec::new()), "it may get its name");
        let mut outbox = Arc::into_inner(outbox).unwrap();
        outbox.opened_at = Instant::now().checked_sub(2 * NAMED_WITHIN).unwrap();
        let alarms = [0, 1].map(|_| (outbox.troubles().len(), outbox.take_alarms().len()));
        assert_eq!(alarms, [(1, 1), (1, 0)]);
    }
}
