//! A watched folder: the tap sets that are moved into it are the casings of a station.
//!
//! A set is moved in as a whole, by a rename, or copied: then its tables and recordings come one by one, and it is waited for. A set
//! under way stays where it is, so that a line that was stopped finds it again. A set that is done moves to `done`, one that cannot be
//! read to `failed`, with the reason.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use rustix::fs::{CWD, OFlags, RenameFlags, renameat_with};
use tapline_wire::{OVER, RecordKind};

use crate::tap_set::recordings::listed_recordings;
use crate::{Arrival, Arrivals, Casing, CasingEnd, Error, TapSetList, listed_tap_set};

/// Folders of sets that are done, and of those that cannot be read.
const DONE: &str = "done";
const FAILED: &str = "failed";

/// File with the reason in a failed set.
const REASON: &str = "reason.txt";

/// File in a set under way that lists its casings that are done, one per line.
const CLOSED: &str = ".closed";

/// File that the line which watches the folder locks, attempts to do so, and the time between two.
const LOCK: &str = ".tapline.lock";
const LOCK_TRIES: u32 = 100;
const LOCK_PAUSE: Duration = Duration::from_millis(20);

/// Time between two looks at a set that is not whole. If nothing has changed between them, nobody is writing it.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// The same for one that has not changed for minutes.
const LOOK_AT_LEAST: Duration = Duration::from_secs(30);

/// How long a set may be incomplete without a change until it is an alarm.
const ALARM_AFTER: Duration = Duration::from_secs(60);

/// Largest number of sets of one name in one folder.
const SAME_NAME_MAX: u32 = 100_000;

/// The tap sets of one folder, in the order of their names.
#[derive(Debug)]
pub struct FolderArrivals {
    folder: PathBuf,
    /// The lock that keeps other lines from sharing its sets.
    _lock: File,
    station: u16,
    /// Sets begun and not put aside yet: the one under way, and perhaps an earlier one whose casings are being
    /// closed.
    sets: Vec<OpenSet>,
    /// Sets that cannot be put aside; they stay where they are, and are not tried again.
    stuck: BTreeSet<OsString>,
    /// Sets that were not whole when they were looked at last.
    half: BTreeMap<OsString, HalfSet>,
    /// The alarm that some of them stay incomplete.
    half_alarm: Option<String>,
    /// The alarm that sets were put aside before.
    failed_alarm: Option<String>,
    /// Files that are in the folder itself and so in no set.
    loose_count: usize,
    /// Sets that may not be read; they are tried again.
    unreadable: BTreeSet<OsString>,
    /// Why the folder itself cannot be read.
    fault: Option<String>,
    /// Messages for people, such as sets that are left out.
    messages: Vec<(RecordKind, String)>,
}

/// A set that is not whole, as it was at the last look.
#[derive(Debug)]
struct HalfSet {
    /// What is waited for, for people.
    waits_for: String,
    /// What it lacks, for people; `None` if it is complete, or cannot be read.
    lacks: Option<String>,
    /// Bytes of its files.
    bytes: u64,
    looked_at: Instant,
    /// Since when they are no more.
    since: Instant,
}

impl HalfSet {
    /// Whether it is time for another look: seldom at a set that has not changed for long, whose many files take time.
    fn is_due(&self) -> bool {
        let pause = (self.since.elapsed() / 10).clamp(LOOK_AGAIN, LOOK_AT_LEAST);
        self.looked_at.elapsed() >= pause
    }
}

/// What is there of a set.
#[derive(Debug)]
struct Content {
    /// Bytes of its files; an empty file counts as one.
    bytes: u64,
    /// What it lacks, for people; `None` if it is complete.
    lacks: Option<String>,
}

/// A set that was begun.
#[derive(Debug)]
struct OpenSet {
    folder_name: OsString,
    list: TapSetList,
    /// Casings still to come, by their number.
    todo: VecDeque<usize>,
    /// Names of the casings that came and have not ended.
    open: Vec<String>,
    /// Casings of the set that could not be read, with the reasons.
    faults: Vec<String>,
}

/// Makes the file `path` and locks it, where its file system has locks. A killed process may hold its lock for a moment longer.
fn lock(path: &Path) -> io::Result<File> {
    // Locks of some network file systems need a file that is open for writing.
    let file = OpenOptions::new().write(true).create(true).truncate(false).custom_flags(file_flags()).open(path)?;
    for _ in 0..LOCK_TRIES {
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => sleep(LOCK_PAUSE),
            Ok(()) => return Ok(file),
            Err(TryLockError::Error(error)) => {
                tracing::warn!("{}: it cannot be locked: no other line may watch its folder: {error}", path.display());
                return Ok(file);
            }
        }
    }
    Err(io::Error::other("another line watches it"))
}

impl FolderArrivals {
    /// Watches `folder` for the casings of `station`; creates the folder if it does not exist.
    ///
    /// All casings of a set are at `station`, whatever its list says.
    ///
    /// # Errors
    /// [`Error::Unwatchable`] if the folder, or those for finished sets, cannot be created.
    pub fn open(folder: &Path, station: u16) -> Result<Self, Error> {
        let was_there = folder.exists();
        for part in [folder.to_owned(), folder.join(DONE), folder.join(FAILED)] {
            fs::create_dir_all(&part).map_err(|source| Error::Unwatchable { station, part, source })?;
        }
        let lock =
            lock(&folder.join(LOCK)).map_err(|source| Error::Watched { station, folder: folder.to_owned(), source })?;
        if !was_there {
            // The name may have been mistyped.
            tracing::warn!("station {station}: the folder {} did not exist; it is made", folder.display());
        }
        let mut messages = Vec::new();
        // The line before this one, or the process, has taken its alarms with it.
        let failed_alarm = failed_before(&folder.join(FAILED));
        if let Some(text) = &failed_alarm {
            tracing::warn!("station {station}: {text}");
            messages.push((RecordKind::Alarm, text.clone()));
        }
        Ok(Self {
            folder: folder.to_owned(),
            _lock: lock,
            station,
            sets: Vec::new(),
            stuck: BTreeSet::new(),
            half: BTreeMap::new(),
            half_alarm: None,
            failed_alarm,
            loose_count: 0,
            unreadable: BTreeSet::new(),
            fault: None,
            messages,
        })
    }

    /// The next casing of the sets under way.
    fn next_begun(&mut self) -> Option<Casing> {
        for at in 0..self.sets.len() {
            let set = &mut self.sets[at];
            while let Some(number) = set.todo.pop_front() {
                match set.list.casing(number, self.station) {
                    Ok(casing) => {
                        set.open.push(casing.name.clone());
                        return Some(casing);
                    }
                    Err(error) => set.faults.push(format!("{}: {error}", set.list.name(number))),
                }
            }
        }
        None
    }

    /// Puts aside the sets without casings to come or under way.
    fn put_aside(&mut self) {
        let mut at = 0;
        while let Some(set) = self.sets.get(at) {
            if !set.todo.is_empty() || !set.open.is_empty() {
                at += 1;
                continue;
            }
            let set = self.sets.remove(at);
            if set.faults.is_empty() {
                self.finish(&set.folder_name);
            } else {
                self.fail(&set.folder_name, &set.faults.join("\n"));
            }
        }
    }

    fn finish(&mut self, name: &OsStr) {
        let set = self.folder.join(name);
        match put_into(&set, &self.folder.join(DONE)) {
            Ok(place) => {
                // If the set ever comes back, all of its casings count again.
                if let Err(error) = fs::remove_file(place.join(CLOSED))
                    && error.kind() != io::ErrorKind::NotFound
                {
                    tracing::warn!("station {}: {}: {error}", self.station, place.join(CLOSED).display());
                }
                tracing::info!("station {}: tap set {} is done", self.station, place.display());
            }
            Err(error) => self.keep(name, &error),
        }
    }

    fn fail(&mut self, name: &OsStr, reason: &str) {
        let set = self.folder.join(name);
        // The set is moved, and may be moved again: its files are named relative to it.
        let reason = &reason.replace(&format!("{}/", set.display()), "");
        let text = format!("tap set {} cannot be used: {reason}", name.display());
        self.messages.push((RecordKind::Refusal, text));
        match put_into(&set, &self.folder.join(FAILED)) {
            Ok(place) => {
                tracing::error!("station {}: tap set {} was put aside: {reason}", self.station, place.display());
                if let Err(error) = write_reason(&place, reason) {
                    tracing::warn!("station {}: {}: {error}", self.station, place.join(REASON).display());
                }
            }
            Err(error) => {
                tracing::error!("station {}: tap set {} cannot be used: {reason}", self.station, set.display());
                self.keep(name, &error);
            }
        }
    }

    fn keep(&mut self, name: &OsStr, error: &io::Error) {
        let set = self.folder.join(name);
        if fs::symlink_metadata(&set).is_err_and(|error| error.kind() == io::ErrorKind::NotFound) {
            tracing::error!(
                "station {}: tap set {} was taken away while it was under way",
                self.station,
                set.display()
            );
            let text = format!("tap set {} was taken away while it was under way", name.display());
            self.messages.push((RecordKind::Alarm, text));
            return;
        }
        tracing::error!(
            "station {}: tap set {} cannot be moved away and is left: {error}",
            self.station,
            set.display()
        );
        self.stuck.insert(name.to_owned());
    }

    /// Begins the first complete set in the folder; returns whether one was begun or put aside.
    fn begin(&mut self) -> bool {
        let (names, loose_count) = match set_names(&self.folder) {
            Ok(found) => found,
            Err(error) => {
                let error = error.to_string();
                if self.fault.as_ref() != Some(&error) {
                    tracing::error!("station {}: {}: cannot be read: {error}", self.station, self.folder.display());
                }
                self.fault = Some(error);
                return false;
            }
        };
        (self.fault, self.loose_count) = (None, loose_count);
        self.stuck.retain(|name| names.contains(name));
        self.unreadable.retain(|name| names.contains(name));
        self.half.retain(|name, _| names.contains(name));
        let mut ready = None;
        for name in names {
            let is_taken = self.stuck.contains(&name) || self.sets.iter().any(|set| set.folder_name == name);
            // One that waits is looked at also where another is ready.
            let is_due = self.half.get(&name).map_or(ready.is_none(), HalfSet::is_due);
            if !is_taken && is_due && self.is_whole(&name) && ready.is_none() {
                ready = Some(name);
            }
        }
        self.watch_what_stays();
        let Some(name) = ready else { return false };
        let dir = self.folder.join(&name);
        match listed_tap_set(&dir, 1) {
            Ok(list) => self.sets.push(OpenSet::new(name, &dir, list)),
            Err(error) => self.fail(&name, &error.to_string()),
        }
        true
    }

    /// Raises one alarm of the sets that have been incomplete for long, and ends it when these are others; ends that of sets that were put
    /// aside when somebody has taken them away.
    fn watch_what_stays(&mut self) {
        let is_long = |half: &&HalfSet| half.since.elapsed() >= ALARM_AFTER;
        let mut long =
            self.half.iter().filter_map(|(name, half)| Some((name, Some(half).filter(is_long)?.lacks.as_ref()?)));
        let text = long.next().map(|(name, lacks)| {
            let others = match long.count() {
                0 => String::new(),
                1 => "; another set waits too".to_owned(),
                count => format!("; {count} other sets wait too"),
            };
            format!("tap set {} is not judged: it waits for {lacks}{others}", name.display())
        });
        if text != self.half_alarm {
            if let Some(text) = &text {
                tracing::warn!("station {}: {text}", self.station);
            }
            let over = self.half_alarm.take().map(|begun| format!("{OVER}{begun}"));
            self.messages.extend(over.into_iter().chain(text.clone()).map(|text| (RecordKind::Alarm, text)));
            self.half_alarm = text;
        }
        if self.failed_alarm.is_some() && failed_before(&self.folder.join(FAILED)).is_none() {
            let over = self.failed_alarm.take().map(|begun| (RecordKind::Alarm, format!("{OVER}{begun}")));
            self.messages.extend(over);
        }
    }

    /// Whether the set `name` is complete, and nobody writes it: one that was incomplete before has not changed since.
    fn is_whole(&mut self, name: &OsStr) -> bool {
        let (dir, before) = (self.folder.join(name), self.half.remove(name));
        let (bytes, waits_for, lacks) = match content_of(&dir) {
            Ok(Content { bytes, lacks: None }) if before.as_ref().is_none_or(|half| half.bytes == bytes) => {
                return true;
            }
            Ok(Content { bytes, lacks: None }) => {
                (bytes, format!("the tap set {}, which is still being written", dir.display()), None)
            }
            Ok(Content { bytes, lacks: Some(lacks) }) => (bytes, format!("{lacks} in {}", dir.display()), Some(lacks)),
            Err(error) => {
                if self.unreadable.insert(name.to_owned()) {
                    tracing::error!("station {}: {}: cannot be read: {error}", self.station, dir.display());
                    let text = format!("tap set {} cannot be read: {error}", name.display());
                    self.messages.push((RecordKind::Refusal, text));
                }
                (0, format!("the tap set {}: {error}", dir.display()), None)
            }
        };
        let now = Instant::now();
        let since = before.filter(|half| half.bytes == bytes).map_or(now, |half| half.since);
        self.half.insert(name.to_owned(), HalfSet { waits_for, lacks, bytes, looked_at: now, since });
        false
    }
}

impl OpenSet {
    fn new(folder_name: OsString, dir: &Path, list: TapSetList) -> Self {
        let closed = closed_casings(dir);
        let todo = (0..list.len()).filter(|&number| !closed.contains(list.name(number))).collect();
        Self { folder_name, list, todo, open: Vec::new(), faults: Vec::new() }
    }
}

impl Arrivals for FolderArrivals {
    fn station(&self) -> u16 {
        self.station
    }

    fn next(&mut self) -> Result<Arrival, Error> {
        loop {
            if let Some(casing) = self.next_begun() {
                return Ok(Arrival::Casing(casing));
            }
            self.put_aside();
            if !self.begin() {
                return Ok(Arrival::NotYet);
            }
        }
    }

    fn ended(&mut self, name: &str, end: &CasingEnd) {
        // Of two casings with one name, the one that is closed first is in the set that was begun first.
        let has = |set: &OpenSet| set.open.iter().any(|open| open == name);
        let at = match end {
            CasingEnd::Closed { .. } => self.sets.iter().position(has),
            CasingEnd::Refused { .. } => self.sets.iter().rposition(has),
        };
        let Some(set) = at.map(|at| &mut self.sets[at]) else { return };
        set.open.retain(|open| open != name);
        match end {
            CasingEnd::Closed { file, was_there } => {
                let dir = self.folder.join(&set.folder_name);
                if *was_there {
                    tracing::warn!(
                        "station {}: casing {name} of the tap set {} is not judged twice: {} has the same recordings",
                        self.station,
                        dir.display(),
                        file.display()
                    );
                }
                if let Err(error) = note_closed(&dir, name) {
                    tracing::warn!("station {}: {}: {error}", self.station, dir.join(CLOSED).display());
                }
            }
            CasingEnd::Refused { reason } => set.faults.push(format!("{name}: {reason}")),
        }
        self.put_aside();
    }

    fn waits_for(&self) -> String {
        let folder = self.folder.display();
        let half: Vec<&str> = self.half.values().map(|half| half.waits_for.as_str()).collect();
        match (&self.fault, &half[..]) {
            (Some(fault), _) => format!("the folder {folder}: {fault}"),
            (None, []) => match self.loose_count {
                0 => format!("a tap set in {folder}"),
                1 => format!("a tap set in {folder}: 1 file there is in no folder of its own"),
                count => format!("a tap set in {folder}: {count} files there are in no folder of their own"),
            },
            (None, [half]) => (*half).to_owned(),
            (None, [first, _]) => format!("{first}; another set is incomplete too"),
            (None, [first, others @ ..]) => format!("{first}; {} other sets are incomplete too", others.len()),
        }
    }

    fn fault(&self) -> Option<String> {
        self.fault.as_ref().map(|fault| format!("the folder {}: {fault}", self.folder.display()))
    }

    fn is_blind(&self) -> bool {
        self.fault.is_some() || !self.unreadable.is_empty()
    }

    fn take_messages(&mut self) -> Vec<(RecordKind, String)> {
        std::mem::take(&mut self.messages)
    }
}

/// Says how many sets are in the folder `failed`; `None` if there are none.
fn failed_before(failed: &Path) -> Option<String> {
    // A folder that cannot be read is a fault of its own, with the first set that is to be moved there.
    let (names, _) = set_names(failed).ok()?;
    match names.len() {
        0 => None,
        1 => Some(format!("1 tap set is in {}: its {REASON} says why", failed.display())),
        count => Some(format!("{count} tap sets are in {}: {REASON} in each says why", failed.display())),
    }
}

/// What is there of the tap set in `dir`.
fn content_of(dir: &Path) -> io::Result<Content> {
    const TABLES: [&str; 2] = ["scan.toml", "taps.csv"];
    let mut bytes = 0;
    // A file that is there and cannot be read, or is none, is refused with its tap.
    let mut is_missing = |file: &str| match fs::metadata(dir.join(file)) {
        Ok(about) => {
            bytes += about.len().max(1);
            false
        }
        Err(error) => error.kind() == io::ErrorKind::NotFound,
    };
    let mut missing = Vec::new();
    for table in TABLES {
        dir.join(table).try_exists()?;
        missing.extend(is_missing(table).then_some(table));
    }
    if !missing.is_empty() {
        return Ok(Content { bytes, lacks: Some(missing.join(" and ")) });
    }
    // Tables with an error are waited for no longer: the set is put aside with the reason.
    let recordings = listed_recordings(dir).unwrap_or_default();
    let mut missing = recordings.iter().filter(|file| is_missing(file));
    let lacks = missing.next().map(|first| match (first.escape_debug(), missing.count()) {
        (first, 0) => first.to_string(),
        (first, 1) => format!("{first} and 1 more recording"),
        (first, count) => format!("{first} and {count} more recordings"),
    });
    Ok(Content { bytes, lacks })
}

/// The folders in `folder` that may be tap sets, in the order of their names, and how many files lie beside them. Links are left out.
fn set_names(folder: &Path) -> io::Result<(BTreeSet<OsString>, usize)> {
    let (mut names, mut loose_count) = (BTreeSet::new(), 0);
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let is_aside = name.as_encoded_bytes().starts_with(b".") || name == DONE || name == FAILED;
        match entry.file_type() {
            Ok(kind) if !is_aside && kind.is_dir() => drop(names.insert(name)),
            Ok(kind) if !is_aside && kind.is_file() => loose_count += 1,
            _ => {}
        }
    }
    Ok((names, loose_count))
}

/// Moves `set` into `folder`, with a number after its name if that is taken; returns its new path.
fn put_into(set: &Path, folder: &Path) -> io::Result<PathBuf> {
    let name = set.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    // Somebody may have removed it with all that was in it.
    match fs::create_dir(folder) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    let mut place = folder.join(name);
    for number in 2..SAME_NAME_MAX {
        match rename_new(set, &place) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            outcome => return outcome.map(|()| place),
        }
        let mut numbered = name.to_owned();
        numbered.push(format!(".{number}"));
        place = folder.join(numbered);
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

/// Renames without replacing anything.
fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    match renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        // Some network file systems do not support the flag.
        Err(rustix::io::Errno::INVAL) if fs::symlink_metadata(to).is_ok() => Err(io::ErrorKind::AlreadyExists.into()),
        Err(rustix::io::Errno::INVAL) => fs::rename(from, to),
        outcome => Ok(outcome?),
    }
}

fn write_reason(set: &Path, reason: &str) -> io::Result<()> {
    let path = set.join(REASON);
    match fs::remove_file(&path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    writeln!(File::create_new(path)?, "{reason}")
}

/// How [`CLOSED`] is opened: a folder may come from a stranger, so no link is followed, and no pipe is waited for.
fn file_flags() -> i32 {
    (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed()
}

/// Records that the casing `name` of the set in `dir` is done.
fn note_closed(dir: &Path, name: &str) -> io::Result<()> {
    let mut file = OpenOptions::new().append(true).create(true).custom_flags(file_flags()).open(dir.join(CLOSED))?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("it is no file"));
    }
    file.write_all(format!("{name}\n").as_bytes())
}

/// The casings of the set in `dir` that were done before the line was stopped; none if that cannot be read.
fn closed_casings(dir: &Path) -> BTreeSet<String> {
    /// Longest list that is read; a folder may come from a stranger.
    const LINES_MAX: usize = 1_000_000;
    let file = OpenOptions::new().read(true).custom_flags(file_flags()).open(dir.join(CLOSED));
    let Ok(file) =
        file.and_then(|file| if file.metadata()?.is_file() { Ok(file) } else { Err(io::ErrorKind::Other.into()) })
    else {
        return BTreeSet::new();
    };
    // The last line may be incomplete.
    let lines = BufReader::new(io::Read::take(file, 1 << 26)).lines().map_while(Result::ok);
    lines.take(LINES_MAX).collect()
}

#[cfg(test)]
#[path = "watched_folder_tests.rs"]
mod tests;
