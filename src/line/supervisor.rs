//! The process that starts the others: it tends them, hears from `store` what becomes of the casings, and tells people.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use tapline_wire::{
    CasingHeader, CasingTopic, Line, LineAddress, LineError, Publisher, Received, RecordKind, Role, Signal, Stamp,
    StatusTopic, Subscriber, WaitTopic, now_ns, room,
};

use crate::host::progress::Progress;
use crate::line::child::Stage;
use crate::line::hook::Hook;
use crate::line::limits::RESTART_BYTES;
use crate::line::out_folder::OutFolder;
use crate::line::setup::Setup;
use crate::line::stage::{StageReport, arguments};
use crate::line::status::{CasingStatus, RATE_OVER, StageStatus, StationStatus, Status};
use crate::line::verdicts::CasingVerdict;

/// `store`, `fuse` and `process`, in this order, come before the sources.
const DOWNSTREAM: [&str; 3] = ["store", "fuse", "process"];

/// How long a stage may take to end after it was told to.
const END_WITHIN: Duration = Duration::from_secs(20);

/// How often the stages are looked at, and the status is shown if it has changed.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// `store` says twice a second how far it is while a casing is open; when it has not for so long, its disk is slow or hangs.
const SILENT_AFTER: Duration = Duration::from_millis(1500);

/// How often it is looked for viewers that have died.
const CLEAR_EVERY: Duration = Duration::from_secs(60);

/// For how long after a start what is connected is reserved.
const SECURED_AFTER: Duration = Duration::from_secs(10);

/// How often it is tried whether a disk that has failed can be written again.
const TRY_DISK_EVERY: Duration = Duration::from_secs(1);

/// Most verdicts and alarms that the status shows.
const SHOWN_MAX: usize = 16;

/// How a line went.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pace {
    /// Taps that were settled here; `None` when there was nothing to do.
    pub(crate) settled: Option<usize>,
    /// Time that took.
    pub(crate) elapsed_s: f64,
    /// How often each stage was restarted.
    pub(crate) restarts: Vec<(String, u32)>,
    /// What the stages said when they ended.
    pub(crate) reports: Vec<StageReport>,
    /// Casings that were closed.
    pub(crate) closed: usize,
    /// Casings that were refused.
    pub(crate) refused: usize,
    /// Why; of a line that never ends, of the first of them.
    pub(crate) refusals: Vec<String>,
}

/// A casing that is open.
#[derive(Debug)]
struct Open {
    number: u64,
    name: String,
    header: CasingHeader,
    /// Whether its ledger was heard since this process began.
    is_heard: bool,
}

/// Who is told of verdicts and progress, and how.
pub(crate) struct Audience {
    pub(crate) progress: Progress,
    /// The command that a plant has run at each verdict.
    pub(crate) hook: Option<Hook>,
    /// Whether verdicts are said as JSON.
    pub(crate) as_json: bool,
}

/// A line that runs.
pub(crate) struct Supervisor<'a> {
    line: &'a Line,
    address: &'a LineAddress,
    folder: &'a mut OutFolder,
    casings: Subscriber<'a, CasingTopic>,
    waits: Subscriber<'a, WaitTopic>,
    status_out: Publisher<'a, StatusTopic>,
    // Dropped before the line's folder is cleared: no stage may be left then.
    stages: Vec<Stage>,
    stop: Arc<AtomicBool>,
    audience: Audience,
    is_list: bool,
    stations: Vec<u16>,
    open: Vec<Open>,
    /// What each station says it waits for; nothing while it taps.
    awaited: BTreeMap<u16, String>,
    shown: Status,
    shown_at: Instant,
    is_news: bool,
    /// Files of a list that are known to be closed: `store` says of each again when a station asks again.
    known: BTreeSet<PathBuf>,
    /// Settled taps of casings that are closed.
    settled_closed: usize,
    /// Of those that are settled, what an earlier life of the line has settled.
    settled_before: usize,
    silence: Silence,
    /// When the line was first seen at work, and when the last change was.
    span: Option<(Instant, Instant)>,
    /// How many taps were settled when, of late.
    history: VecDeque<(Instant, usize)>,
    pace: Pace,
    is_short_of_room: bool,
    /// While the disk of the archive has failed: when it was last tried.
    disk_failed_at: Option<Instant>,
    /// When a stage was last started.
    started_at: Instant,
    secured_at: Instant,
    /// When it was last looked for viewers that have died.
    cleared_at: Instant,
}

impl<'a> Supervisor<'a> {
    /// Starts the stages of the line that `setup` describes, which is found at `address`.
    pub(crate) fn start(
        line: &'a Line,
        setup: &Setup,
        address: &'a LineAddress,
        folder: &'a mut OutFolder,
        stop: Arc<AtomicBool>,
        audience: Audience,
    ) -> Result<Self> {
        let casings = Subscriber::open(line)?;
        let waits = Subscriber::open(line)?;
        let status_out = Publisher::open(line)?;
        // Downstream first, so that nobody sends to no one.
        let acquires = (0..setup.limits.acquire_count).map(|number| format!("acquire-{number}"));
        let mut stages = Vec::new();
        for name in DOWNSTREAM.iter().map(|&name| name.to_owned()).chain(acquires) {
            let arguments = arguments(&name, address.root())?;
            stages.push(Stage::start(name, arguments)?);
        }
        let mut supervisor = Self {
            line,
            address,
            folder,
            disk_failed_at: None,
            is_short_of_room: false,
            started_at: Instant::now(),
            secured_at: Instant::now(),
            cleared_at: Instant::now(),
            casings,
            waits,
            awaited: BTreeMap::new(),
            status_out,
            stages,
            stop,
            audience,
            is_list: setup.is_list(),
            stations: setup.limits.stations.clone(),
            open: Vec::new(),
            shown: Status { out: setup.out.clone(), pid: std::process::id(), ..Status::default() },
            shown_at: Instant::now(),
            is_news: true,
            known: BTreeSet::new(),
            settled_closed: 0,
            settled_before: 0,
            silence: Silence::default(),
            span: None,
            history: VecDeque::new(),
            pace: Pace::default(),
        };
        supervisor.show()?;
        Ok(supervisor)
    }

    /// Tends the line until `count` casings are closed or refused, or, where it never ends, until it is told to stop.
    pub(crate) fn until_done(mut self, count: Option<usize>) -> Result<Pace> {
        let is_over = |s: &Self| count.is_some_and(|count| s.pace.closed + s.pace.refused >= count);
        while !is_over(&self) && !self.stop.load(Ordering::Relaxed) {
            self.line.wait(LOOK_EVERY)?;
            self.hear()?;
            self.tend(0..self.stages.len())?;
            self.secure()?;
            self.show_if_due()?;
        }
        if !is_over(&self) {
            self.audience.progress.say("stopping: waiting for what is under way to be archived");
        }
        self.shown.is_ending = true;
        self.show()?;
        // The sources first; while they wait for what they sent, whoever dies downstream is still replaced.
        self.end(DOWNSTREAM.len()..self.stages.len())?;
        for number in (0..DOWNSTREAM.len()).rev() {
            self.end(number..number + 1)?;
        }
        self.hear()?;
        self.audience.progress.finish();
        // The last verdicts are told before the line is said to be over.
        drop(self.audience.hook.take());
        Ok(self.into_pace())
    }

    /// Takes in what `store` says.
    fn hear(&mut self) -> Result<()> {
        while let Some(record) = self.casings.receive()? {
            self.silence.end();
            let header = *record.header();
            let number = header.stamp.casing;
            match record.kind() {
                Some(RecordKind::Plan) => {
                    // Again, where `store` was restarted.
                    if !self.open.iter().any(|casing| casing.number == number) {
                        self.open.push(Open { number, name: text_of(&record), header, is_heard: false });
                    }
                }
                Some(RecordKind::Ledger) => {
                    if let Some(casing) = self.open.iter_mut().find(|casing| casing.number == number) {
                        casing.header = header;
                        if !std::mem::replace(&mut casing.is_heard, true) {
                            // What an earlier life of the line has settled.
                            self.settled_before += (header.archived_count + header.refused_count) as usize;
                        }
                    }
                }
                Some(RecordKind::Closed) => self.closed(&header, PathBuf::from(text_of(&record)))?,
                Some(RecordKind::Refusal) if number != 0 => self.lost_file(number, &text_of(&record)),
                Some(RecordKind::Refusal) => {
                    let reason = text_of(&record);
                    self.alarm(format!("station {}: {reason}", header.station));
                    self.pace.refused += 1;
                    if self.is_list || self.pace.refusals.len() < SHOWN_MAX {
                        self.pace.refusals.push(reason);
                    }
                }
                _ => continue,
            }
            self.is_news = true;
        }
        while let Some(record) = self.waits.receive()? {
            let Ok(station) = u16::try_from(record.header().mark) else { continue };
            let text = String::from_utf8_lossy(&record).into_owned();
            match record.kind() {
                Some(RecordKind::Refusal) => self.alarm(format!("station {station}: {text}")),
                _ => drop(self.awaited.insert(station, text)),
            }
            self.is_news = true;
        }
        while let Some(failure) = self.audience.hook.as_ref().and_then(Hook::take_failure) {
            self.alarm(failure);
        }
        self.note_progress();
        if self.silence.is_long(!self.open.is_empty()) {
            self.alarm("store does not answer".to_owned());
        }
        Ok(())
    }

    fn closed(&mut self, header: &CasingHeader, path: PathBuf) -> Result<()> {
        let number = header.stamp.casing;
        let place = self.open.iter().position(|casing| casing.number == number && number != 0);
        let name = match place {
            Some(place) => self.open.swap_remove(place).name,
            // It was finished before, by an earlier life of this line.
            None => path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        };
        let is_again = if self.is_list {
            !self.known.insert(path.clone())
        } else {
            self.shown.verdicts.iter().any(|verdict| verdict.file == path)
        };
        if is_again {
            return Ok(());
        }
        // Of a line that never ends, those count that it has judged.
        self.pace.closed += usize::from(self.is_list || number != 0);
        self.settled_closed += header.tap_count as usize;
        if number == 0 {
            self.settled_before += header.tap_count as usize;
            if !self.is_list {
                tracing::warn!(casing = name, "these very recordings were judged before: {}", path.display());
            }
            return Ok(());
        }
        let mut is_printed = true;
        match CasingVerdict::read(&name, &path) {
            Ok(verdict) => {
                let Audience { progress, hook, as_json } = &self.audience;
                if let Err(error) = progress.beside(|| verdict.print(*as_json)) {
                    tracing::error!(
                        casing = name,
                        "cannot print the verdict, which is in {}: {error:#}",
                        path.display()
                    );
                    is_printed = false;
                }
                if let Some(hook) = hook {
                    hook.run(&verdict);
                }
                self.shown.verdicts.truncate(SHOWN_MAX - 1);
                self.shown.verdicts.insert(0, verdict);
            }
            Err(error) => {
                tracing::error!("{}: cannot read the verdict: {error:#}", path.display());
                self.alarm(format!("{}: cannot read the verdict", path.display()));
            }
        }
        if !is_printed {
            self.alarm(format!("{name}: the verdict could not be printed; it is in its file"));
        }
        self.shown.closed_count += 1;
        Ok(())
    }

    /// Takes in that a casing which was open is not any more: its station taps it anew.
    fn lost_file(&mut self, number: u64, reason: &str) {
        let Some(place) = self.open.iter().position(|casing| casing.number == number) else { return };
        let casing = self.open.swap_remove(place);
        self.alarm(format!("casing {}: {reason}; it is tapped anew", casing.name));
    }

    fn alarm(&mut self, text: String) {
        self.shown.alarms.truncate(SHOWN_MAX - 1);
        self.shown.alarms.insert(0, text);
        self.is_news = true;
    }

    fn settled(&self) -> usize {
        let of = |casing: &Open| (casing.header.archived_count + casing.header.refused_count) as usize;
        self.settled_closed + self.open.iter().map(of).sum::<usize>()
    }

    fn note_progress(&mut self) {
        let (now, settled) = (Instant::now(), self.settled());
        let (since, last) = self.span.get_or_insert((now, now));
        if self.history.back().is_none_or(|&(_, last)| last != settled) {
            self.history.push_back((now, settled));
        }
        while self.history.len() > 2 && self.history.front().is_some_and(|&(at, _)| at.elapsed() > RATE_OVER) {
            self.history.pop_front();
        }
        if self.audience.progress.update(settled, settled.saturating_sub(self.settled_before), *since) {
            *last = now;
            self.stages.iter_mut().for_each(Stage::note_progress);
        }
    }

    /// Looks after the stages: whoever has died is cleared away, so that nobody waits for it, and started again.
    fn tend(&mut self, which: Range<usize>) -> Result<()> {
        let is_short = self.is_short_of_room()?;
        if !is_short {
            self.look_after_disk()?;
        }
        let mut has_died = false;
        for (number, stage) in self.stages.iter_mut().enumerate() {
            // One that must be started again is not taken up before there is room for it.
            let must_wait = is_short && which.contains(&number) && !stage.is_asked_to_end();
            if !must_wait && stage.has_ended()? {
                has_died = true;
                // What it held in shared memory is given back before another takes its place.
                self.line.clear_dead();
                stage.take_up(which.contains(&number))?;
            }
        }
        if has_died {
            self.is_news = true;
            self.started_at = Instant::now();
            for stage in &self.stages {
                self.line.notify(role_of(stage.name()), Signal::Joined);
            }
        }
        Ok(())
    }

    /// While a stage waits for its disk: holds nothing in the output folder, and starts it again when that can be written.
    fn look_after_disk(&mut self) -> Result<()> {
        let Some(place) = self.stages.iter().position(|stage| stage.awaits_disk) else { return Ok(()) };
        if self.disk_failed_at.is_none() {
            self.folder.release();
            self.alarm("the disk of the archive has failed, or may not be written: the log says what to do".to_owned());
        }
        let tried_at = self.disk_failed_at.get_or_insert_with(Instant::now);
        if tried_at.elapsed() < TRY_DISK_EVERY {
            return Ok(());
        }
        *tried_at = Instant::now();
        if !self.folder.take_back()? {
            return Ok(());
        }
        let probe = self.folder.open_path().join(".probe");
        if std::fs::write(&probe, "tapline").and_then(|()| std::fs::remove_file(&probe)).is_err() {
            self.folder.release();
            return Ok(());
        }
        tracing::warn!("the disk of the archive can be written again; nothing is lost");
        self.disk_failed_at = None;
        self.stages[place].disk_is_back()
    }

    /// Whether there is too little shared memory to start a stage again; says so when it begins and when it ends.
    fn is_short_of_room(&mut self) -> Result<bool> {
        let is_short = room::free_bytes()? < RESTART_BYTES;
        if is_short != self.is_short_of_room {
            self.is_short_of_room = is_short;
            match is_short {
                true => {
                    let text = "/dev/shm is full: a stage that ends is not started again before there is room";
                    tracing::error!("{text}");
                    self.alarm(text.to_owned());
                }
                false => tracing::warn!("there is room in /dev/shm again"),
            }
        }
        Ok(is_short)
    }

    /// Reserves what the stages' connections take, for a while after they were started, and checks that it is theirs alone.
    fn secure(&mut self) -> Result<()> {
        if self.started_at.elapsed() > SECURED_AFTER || self.secured_at.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.secured_at = Instant::now();
        match room::reserve("this line", self.address) {
            Ok(_) => {}
            Err(LineError::NoRoom { .. }) => drop(self.is_short_of_room()?),
            Err(error) => return Err(error.into()),
        }
        Ok(self.address.verify()?)
    }

    /// Asks some stages to end, and waits for them; those before them are tended meanwhile.
    fn end(&mut self, which: Range<usize>) -> Result<()> {
        let since = Instant::now();
        for stage in &self.stages[which.clone()] {
            stage.ask_to_end();
        }
        while self.stages[which.clone()].iter().any(Stage::is_running) {
            self.tend(0..which.start)?;
            for stage in &self.stages[which.clone()] {
                // It may have begun to wait in the moment before it was asked.
                self.line.notify(role_of(stage.name()), Signal::Data);
                if stage.is_running() && since.elapsed() > END_WITHIN {
                    stage.kill();
                }
            }
            self.line.wait(Duration::from_millis(10))?;
            self.hear()?;
        }
        Ok(())
    }

    fn show_if_due(&mut self) -> Result<()> {
        if self.shown_at.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.shown_at = Instant::now();
        if self.is_news || !self.open.is_empty() {
            self.show()?;
        }
        // Who looked on, and was killed, is cleared away too.
        if self.cleared_at.elapsed() > CLEAR_EVERY {
            self.cleared_at = Instant::now();
            self.line.clear_dead();
        }
        Ok(self.status_out.show_newcomers()?)
    }

    /// Shows whoever looks on how the line is.
    fn show(&mut self) -> Result<()> {
        (self.shown_at, self.is_news) = (Instant::now(), false);
        let station = |&number: &u16| {
            let of = |casing: &&Open| casing.header.station == u32::from(number);
            // The one that is tapped is the one that was opened last.
            let casing = self.open.iter().rev().find(of).map(|casing| CasingStatus {
                name: casing.name.clone(),
                planned: casing.header.tap_count as usize,
                archived: casing.header.archived_count as usize,
                refused: casing.header.refused_count as usize,
            });
            let waits_for = self.awaited.get(&number).cloned().unwrap_or_default();
            StationStatus { number, waits_for, casing }
        };
        self.shown.stations = self.stations.iter().map(station).collect();
        self.shown.stages = self
            .stages
            .iter()
            .map(|stage| StageStatus { name: stage.name().to_owned(), pid: stage.pid(), restarts: stage.restart_count })
            .collect();
        self.shown.is_held = self.open.iter().any(|casing| casing.header.is_held != 0);
        self.shown.lost_count = self.open.iter().map(|casing| casing.header.lost_count).max().unwrap_or(0);
        self.shown.settled_count = self.settled() as u64;
        self.shown.taps_per_s = match (self.history.front(), self.history.back()) {
            (Some(&(from, least)), Some(&(_, most))) if most > least => {
                (most - least) as f64 / from.elapsed().max(LOOK_EVERY).as_secs_f64()
            }
            _ => 0.0,
        };
        self.shown.at_ns = now_ns();
        let text = self.shown.encode();
        self.status_out.send(RecordKind::Data, Stamp::default(), &text)?;
        Ok(())
    }

    fn into_pace(self) -> Pace {
        let elapsed = self.span.map(|(first, last)| last - first);
        let settled = self.settled().saturating_sub(self.settled_before);
        Pace {
            settled: Some(settled),
            elapsed_s: elapsed.map_or(0.0, |d| d.as_secs_f64()),
            restarts: self.stages.iter().map(|s| (s.name().to_owned(), s.restart_count)).collect(),
            reports: self.stages.iter().filter_map(|s| s.report.clone()).collect(),
            ..self.pace
        }
    }
}

/// How long `store` has said nothing, while it has a casing open.
#[derive(Debug, Default)]
struct Silence {
    heard_at: Option<Instant>,
    is_said: bool,
}

impl Silence {
    /// Whether it has just become long.
    fn is_long(&mut self, is_expected: bool) -> bool {
        let is_long = is_expected && self.heard_at.is_some_and(|at| at.elapsed() > SILENT_AFTER);
        if is_long && !self.is_said {
            tracing::error!("store does not answer: its disk is slow or hangs, or it is held up; the line waits");
            self.is_said = true;
            return true;
        }
        false
    }

    fn end(&mut self) {
        let now = Instant::now();
        let since = self.heard_at.replace(now).unwrap_or(now);
        if std::mem::take(&mut self.is_said) {
            tracing::warn!("store answers again, after {:.1} s", (now - since).as_secs_f64());
        }
    }
}

fn text_of(record: &Received<CasingTopic>) -> String {
    String::from_utf8_lossy(record).into_owned()
}

fn role_of(stage: &str) -> Role {
    match stage.split_once('-').and_then(|(_, number)| number.parse().ok()) {
        Some(number) => Role::Acquire(number),
        None if stage == "store" => Role::Store,
        None if stage == "fuse" => Role::Fuse,
        None => Role::Process,
    }
}
