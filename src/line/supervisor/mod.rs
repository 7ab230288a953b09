//! The process that starts the others, restarts them, follows what `store` reports of the casings, and informs people.

mod closed;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use tapline_host::messages::counted;
use tapline_host::progress::Progress;
use tapline_wire::{
    CasingHeader, CasingTopic, Ledger, Line, LineAddress, OVER, Quality, Received, RecordKind, Subscriber, WaitTopic,
    decode_opened, now_ns, scans_of,
};

use crate::line::out_folder::OutFolder;
use crate::line::progress_rate::ProgressRate;
use crate::line::setup::{Setup, status_file};
use crate::line::stage::StageReport;
use crate::line::stages::Stages;
use crate::shown::casing::{CasingStatus, Layout, retaken};
use crate::shown::rig::Rigs;
use crate::shown::status::{Alarm, StationStatus, Status};
use crate::shown::verdict::Form;
use crate::wires::Wires;

/// How long a stage may take to end after it was asked to.
const END_WITHIN: Duration = Duration::from_secs(20);

/// How often the stages are checked, and the status is sent if it has changed.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// How often the status is sent if nothing has changed, so that people know that the line still runs: with [`LOOK_EVERY`] at least once a
/// second, which controllers on Modbus may watch for.
const SHOW_EVERY: Duration = Duration::from_millis(700);

/// Most faults of stations among the troubles of the line.
const FAULTS_MAX: usize = 4;

/// Most verdicts and alarms that the status shows, besides the last verdict of each station.
const SHOWN_MAX: usize = 16;

/// The line is in trouble while its disk has room for fewer casings like the last.
const ROOM_MIN: u64 = 100;

/// How often it is then looked whether there is more.
const ROOM_EVERY: Duration = Duration::from_secs(5);

/// The outcome of a line.
#[derive(Debug, Clone, Default)]
pub(crate) struct LineOutcome {
    /// Taps that were settled before; `None` when there was nothing to do.
    pub settled_before: Option<usize>,
    /// How long it took.
    pub elapsed_s: f64,
    /// How often stages were restarted.
    pub restarts: u32,
    /// What the stages reported when they ended.
    pub reports: Vec<StageReport>,
    /// Casings that were closed.
    pub closed: usize,
    /// Casings that were refused.
    pub refused: usize,
    /// What was left out: casings that were refused, skipped or judged without all taps, and tap sets that were put
    /// aside. For a line that never ends, only the first ones.
    pub left_out: Vec<String>,
    /// Casings that are not done.
    pub unfinished: Vec<String>,
    /// Receivers with verdicts yet to acknowledge, counted.
    pub waiting: Vec<(String, u64)>,
}

/// A casing that is open.
#[derive(Debug)]
struct Open {
    number: u64,
    name: String,
    header: CasingHeader,
    layout: Layout,
    /// Taps of a second reading in its plan.
    again: usize,
    /// `None` until one is received.
    ledger: Option<Ledger>,
}

impl Open {
    fn status(&self) -> CasingStatus {
        CasingStatus {
            name: self.name.clone(),
            planned: self.header.tap_count as usize,
            archived: self.header.archived_count as usize,
            refused: self.header.refused_count as usize,
            retaken: self.ledger.as_ref().map_or(0, retaken),
            shoulders: self.layout.shoulders(self.ledger.as_ref()),
        }
    }
}

/// Gets each status, in addition to its file; returns whether it still can.
pub(crate) type ShowStatus = Box<dyn Fn(&str) -> bool>;

/// Where verdicts and progress are published.
pub(crate) struct Audience {
    pub progress: Progress,
    /// The plant's receivers of verdicts; `None` for a list.
    pub wires: Option<Wires>,
    /// How verdicts of a list are printed.
    pub form: Form,
    pub show: Option<ShowStatus>,
}

/// A line that runs.
pub(crate) struct Supervisor<'a> {
    line: &'a Line,
    casings: Subscriber<'a, CasingTopic>,
    waits: Subscriber<'a, WaitTopic>,
    /// The file of its status.
    status_file: PathBuf,
    /// Whether the status could not be written the last time.
    is_status_stale: bool,
    // Dropped before the line's folder is cleared: no stage may be left then.
    stages: Stages<'a>,
    stop: Arc<AtomicBool>,
    audience: Audience,
    is_list: bool,
    /// Stations whose casings are on rigs.
    with_rig: Vec<u16>,
    open: Vec<Open>,
    shown: Status,
    /// Flags on most taps of the last casing of each station, and the alarm that said so.
    flagged: BTreeMap<u16, (Quality, String)>,
    /// Bytes of the largest casing so far.
    casing_bytes: u64,
    /// That the disk has room for few more casings, and when that was looked at.
    room: Option<String>,
    room_looked_at: Instant,
    /// The alarm that said that the archive cannot be written, until it can.
    held_since: Option<String>,
    shown_at: Instant,
    /// When it was last asked whether there is something to show.
    looked_at: Instant,
    is_news: bool,
    /// Files of a list that are known to be closed: `store` reports each again when a station asks again.
    known: BTreeSet<PathBuf>,
    /// Settled taps of casings that are closed.
    settled_closed: usize,
    /// Those of them that were settled before this process started.
    settled_before: usize,
    /// The rig of each station.
    rigs: Rigs,
    rate: ProgressRate,
    outcome: LineOutcome,
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
        // Before the stages, whose first reports would be missed.
        let casings = Subscriber::open(line)?;
        let waits = Subscriber::open(line)?;
        let station = |&number: &u16| StationStatus { number, ..StationStatus::default() };
        let stations = setup.limits.stations.iter().map(station).collect();
        let mut supervisor = Self {
            line,
            casings,
            waits,
            status_file: status_file(address),
            is_status_stale: false,
            stages: Stages::start(line, setup, address, folder)?,
            stop,
            audience,
            is_list: setup.is_list(),
            with_rig: setup.rigs.clone(),
            open: Vec::new(),
            shown: Status { out: setup.out.clone(), pid: std::process::id(), stations, ..Status::default() },
            flagged: BTreeMap::new(),
            casing_bytes: 0,
            room: None,
            room_looked_at: Instant::now(),
            held_since: None,
            shown_at: Instant::now(),
            looked_at: Instant::now(),
            is_news: true,
            known: BTreeSet::new(),
            settled_closed: 0,
            settled_before: 0,
            rigs: Rigs::default(),
            rate: ProgressRate::default(),
            outcome: LineOutcome::default(),
        };
        supervisor.show()?;
        Ok(supervisor)
    }

    /// Runs the line until `count` casings are closed or refused, or, if it never ends, until it is asked to stop.
    pub(crate) fn until_done(mut self, count: Option<usize>) -> Result<LineOutcome> {
        if !self.is_list {
            self.recall();
        }
        let is_over = |s: &Self| count.is_some_and(|count| s.outcome.closed + s.outcome.refused >= count);
        while !is_over(&self) && !self.stop.load(Ordering::Relaxed) {
            self.line.wait(LOOK_EVERY)?;
            self.receive()?;
            self.is_news |= self.stages.tend(self.stages.every())?;
            self.stages.listen();
            self.stages.secure()?;
            self.show_if_due()?;
        }
        if !is_over(&self) {
            self.audience.progress.print("stopping: waiting for what is under way to be archived");
        }
        self.shown.is_ending = true;
        self.audience.wires.iter().for_each(|wires| wires.now.end());
        self.show()?;
        // While sources wait for what they sent, downstream stages that die are still replaced.
        for which in self.stages.ending_order() {
            self.end(which)?;
        }
        self.receive()?;
        self.audience.progress.finish();
        // Receivers have the last verdicts before the line is reported to have ended.
        let receivers = self.audience.wires.take().map(Wires::close).unwrap_or_default();
        let waiting = receivers.into_iter().filter(|receiver| receiver.waiting > 0);
        self.outcome.waiting = waiting.map(|receiver| (receiver.name, receiver.waiting)).collect();
        Ok(self.into_outcome())
    }

    /// Takes in what `store`, the stations and the wires report.
    fn receive(&mut self) -> Result<()> {
        while let Some(record) = self.casings.receive()? {
            self.receive_of_casing(&record);
        }
        while let Some(record) = self.waits.receive()? {
            self.receive_of_station(&record);
        }
        let of_wires = self.audience.wires.as_ref().map(|wires| wires.outbox.take_alarms()).unwrap_or_default();
        for alarm in self.stages.take_alarms().into_iter().chain(of_wires) {
            self.alarm(alarm);
        }
        let settled = self.settled();
        let settled_here = settled.saturating_sub(self.settled_before);
        let since = self.rate.note(settled_here);
        if self.audience.progress.update_since(settled as u64, settled_here as u64, since) {
            self.stages.note_progress();
        }
        Ok(())
    }

    /// Takes in what `store` reports of a casing, or of the archive.
    fn receive_of_casing(&mut self, record: &Received<CasingTopic>) {
        let header = *record.header();
        let number = header.stamp.casing;
        match record.kind() {
            Some(RecordKind::Plan) => self.opened(header, record),
            Some(RecordKind::Ledger) => {
                if let Some(casing) = self.open.iter_mut().find(|casing| casing.number == number) {
                    casing.header = header;
                    casing.ledger = Ledger::decode(&header, record).or(casing.ledger.take());
                }
            }
            Some(RecordKind::Closed) => self.closed(&header, PathBuf::from(text_of(record))),
            Some(RecordKind::Alarm) if number != 0 => self.alarm(text_of(record)),
            Some(RecordKind::Alarm) => self.held(text_of(record)),
            Some(RecordKind::Refusal) if number != 0 => self.lost_file(number, &text_of(record)),
            Some(RecordKind::Refusal) => {
                self.refused(station_of(&header), format!("station {}: {}", header.station, text_of(record)));
                self.outcome.refused += 1;
            }
            _ => return,
        }
        self.is_news = true;
    }

    /// Notes a casing that is open, with its plan in `record`. It comes again after `store` was restarted, and when the plan has
    /// grown.
    fn opened(&mut self, header: CasingHeader, record: &[u8]) {
        let number = header.stamp.casing;
        let (name, taps) = decode_opened(record).unwrap_or_else(|error| (error.to_string(), Vec::new()));
        // All are at one station, so they have scans.
        let layout = Layout::new(&taps, &scans_of(&taps).unwrap_or_default());
        let again = taps.iter().filter(|tap| tap.is_second_reading()).count();
        if let Some(casing) = self.open.iter_mut().find(|casing| casing.number == number) {
            self.audience.progress.more((again.saturating_sub(casing.again)) as u64);
            (casing.layout, casing.again) = (layout, again);
            return;
        }
        self.audience.progress.more(again as u64);
        let station = station_of(&header);
        self.audience.wires.iter().for_each(|wires| wires.now.opened(station));
        self.settled_before += header.settled_before_count as usize;
        if header.settled_before_count > 0 {
            let there = format!("{} of {}", header.settled_before_count, header.tap_count);
            if self.has_station(station) {
                self.audience.progress.print(&format!("casing {name} was begun before: {there} taps are done"));
            } else {
                let text = format!(
                    "casing {name} waits for station {station}, which is not in the configuration: {there} taps are done"
                );
                self.audience.progress.print(&text);
                self.alarm(text);
            }
        } else if !self.is_list {
            self.watch_serial(station, &name);
        }
        if let Some(station) = self.station(station) {
            (station.refused, station.is_removed) = (None, false);
        }
        // What was done before is not on the rig any more.
        drop(fs::remove_file(tapline_acquire::last_on_rig(&self.shown.out, station)));
        tracing::info!(casing = name, station, "is begun");
        self.open.push(Open { number, name, header, layout, again, ledger: None });
    }

    /// Takes in what a station reports.
    fn receive_of_station(&mut self, record: &Received<WaitTopic>) {
        let Ok(number) = u16::try_from(record.header().mark) else { return };
        let text = text_of(record);
        match record.kind() {
            Some(kind @ (RecordKind::Refusal | RecordKind::Alarm)) => {
                let text = match text.strip_prefix(OVER) {
                    Some(begun) => format!("{OVER}station {number}: {begun}"),
                    None => format!("station {number}: {text}"),
                };
                match kind {
                    RecordKind::Refusal => self.refused(number, text),
                    _ => self.alarm(text),
                }
            }
            Some(RecordKind::Removed) => {
                self.audience.wires.iter().for_each(|wires| wires.now.refused(number));
                if let Some(station) = self.station(number) {
                    (station.is_removed, station.refused) = (true, None);
                }
            }
            kind => {
                if let Some(station) = self.station(number) {
                    match kind {
                        Some(RecordKind::Fault) => station.fault = Some(text).filter(|text| !text.is_empty()),
                        Some(RecordKind::Stopped) => station.stopped = Some(text).filter(|text| !text.is_empty()),
                        _ => station.waits_for = text,
                    }
                }
            }
        }
        self.is_news = true;
    }

    /// Handles a casing that came to the station `number` and is refused: the last verdict is not about what is there now.
    fn refused(&mut self, number: u16, text: String) {
        self.shown.refused_count += 1;
        self.audience.wires.iter().for_each(|wires| wires.now.refused(number));
        if let Some(station) = self.station(number) {
            station.last = None;
            station.refused = Some(Alarm { at_ns: now_ns(), text: text.clone() });
        }
        self.leave_out(text.clone());
        self.alarm(text);
    }

    /// Handles the loss of an open casing's file: its station taps it again.
    fn lost_file(&mut self, number: u64, reason: &str) {
        let Some(place) = self.open.iter().position(|casing| casing.number == number) else { return };
        let casing = self.open.remove(place);
        self.alarm(format!("casing {}: {reason}; it is tapped again", casing.name));
    }

    /// Notes why the archive cannot be written; an empty text ends that.
    fn held(&mut self, why: String) {
        let why = Some(why).filter(|why| !why.is_empty());
        match (&why, self.held_since.take()) {
            (Some(_), Some(begun)) => self.held_since = Some(begun),
            (Some(why), None) => {
                self.held_since = Some(why.clone());
                self.alarm(why.clone());
            }
            (None, Some(begun)) => self.alarm(format!("{OVER}{begun}")),
            (None, None) => {}
        }
        self.shown.held_by = why;
    }

    fn leave_out(&mut self, text: String) {
        if self.outcome.left_out.len() < SHOWN_MAX {
            self.outcome.left_out.push(text);
        }
    }

    /// Adds an alarm; one that is shown already is shown as new, so that it pushes out no other. A text that begins with [`OVER`] is no new
    /// one: it replaces the text of its alarm, if that is still shown.
    fn alarm(&mut self, text: String) {
        if let Some(begun) = text.strip_prefix(OVER) {
            for alarm in self.shown.alarms.iter_mut().filter(|alarm| alarm.text == begun) {
                alarm.text.clone_from(&text);
                self.is_news = true;
            }
            return;
        }
        let alarms = &mut self.shown.alarms;
        alarms.retain(|alarm| alarm.text != text);
        // One that is over goes first: a rig that stops again and again pushes out no alarm that stands.
        if alarms.len() >= SHOWN_MAX
            && let Some(over) = alarms.iter().rposition(|alarm| alarm.text.starts_with(OVER))
        {
            alarms.remove(over);
        }
        alarms.truncate(SHOWN_MAX - 1);
        self.shown.alarms.insert(0, Alarm { at_ns: now_ns(), text });
        self.is_news = true;
    }

    fn settled(&self) -> usize {
        let of = |casing: &Open| (casing.header.archived_count + casing.header.refused_count) as usize;
        self.settled_closed + self.open.iter().map(of).sum::<usize>()
    }

    /// Asks some stages to end, and waits for them; those before them are still restarted meanwhile.
    fn end(&mut self, which: Range<usize>) -> Result<()> {
        let since = Instant::now();
        self.stages.ask_to_end(which.clone());
        while self.stages.are_running(which.clone()) {
            self.is_news |= self.stages.tend(0..which.start)?;
            self.stages.wake(which.clone());
            if since.elapsed() > END_WITHIN {
                self.stages.kill(which.clone());
            }
            self.line.wait(Duration::from_millis(10))?;
            self.receive()?;
        }
        Ok(())
    }

    fn show_if_due(&mut self) -> Result<()> {
        if self.looked_at.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.looked_at = Instant::now();
        // Somebody may have made room.
        if self.room.is_some() && self.room_looked_at.elapsed() > ROOM_EVERY {
            self.watch_room();
        }
        if self.is_news || !self.open.is_empty() || self.shown_at.elapsed() > SHOW_EVERY {
            self.show()?;
        }
        Ok(())
    }

    /// Shows the status to viewers.
    fn show(&mut self) -> Result<()> {
        (self.shown_at, self.is_news) = (Instant::now(), false);
        for station in &mut self.shown.stations {
            let of = |casing: &&Open| casing.header.station == u32::from(station.number);
            // The casing that is being tapped was opened last.
            station.casing = self.open.iter().rev().find(of).map(Open::status);
        }
        self.shown.stages = self.stages.statuses();
        // Of the whole line, in the header of each casing: it stays when the casing has gone.
        let lost_counts = self.open.iter().map(|casing| casing.header.lost_count);
        self.shown.lost_count = lost_counts.fold(self.shown.lost_count, u64::max);
        self.shown.settled_count = self.settled() as u64;
        self.shown.taps_per_s = self.rate.taps_per_s();
        if let Some(wires) = &self.audience.wires {
            let is_held = self.shown.held_by.is_some() || self.stages.troubles().next().is_some();
            wires.now.show(&self.shown.stations, is_held);
            self.shown.receivers = wires.outbox.statuses();
        }
        self.shown.troubles = self.troubles();
        self.shown.at_ns = now_ns();
        let text = serde_json::to_string(&self.shown).unwrap_or_default(); // only a path that is no text has none
        self.write_status(&text);
        if self.audience.show.as_ref().is_some_and(|show| !show(&text)) {
            self.audience.show = None;
            self.alarm("the page of the line is no longer served; the line continues".to_owned());
        }
        Ok(())
    }

    /// Replaces the file of the status by one that has `text`. Without it the line works on.
    fn write_status(&mut self, text: &str) {
        let new = self.status_file.with_extension("new");
        let written = fs::write(&new, text).and_then(|()| fs::rename(&new, &self.status_file));
        if let Err(error) = &written
            && !self.is_status_stale
        {
            tracing::error!("{}: the status cannot be written: {error}", self.status_file.display());
        }
        self.is_status_stale = written.is_err();
    }

    /// What keeps the line from working as it should.
    fn troubles(&self) -> Vec<String> {
        let is_ending = self.shown.is_ending.then(|| "the line is ending".to_owned());
        let of_line = self.shown.held_by.clone().into_iter().chain(self.room.clone()).chain(is_ending);
        let of_wires = self.audience.wires.as_ref().map(|wires| wires.outbox.troubles()).unwrap_or_default();
        let of_receivers = self.shown.receivers.iter().filter_map(|receiver| receiver.trouble.clone());
        let of_stations = self.shown.stations.iter();
        let mut faults: Vec<String> = of_stations
            .filter_map(|station| Some(format!("station {}: {}", station.number, station.fault.as_ref()?)))
            .collect();
        if faults.len() > FAULTS_MAX {
            let others = faults.split_off(FAULTS_MAX).len();
            faults.push(format!("{} too", counted(others, "other station has a fault", "other stations have faults")));
        }
        of_line.chain(self.stages.troubles()).chain(of_wires).chain(of_receivers).chain(faults).collect()
    }

    fn into_outcome(self) -> LineOutcome {
        let how = |casing: &Open| {
            let (name, station) = (&casing.name, station_of(&casing.header));
            match self.has_station(station) {
                true if self.with_rig.contains(&station) => {
                    format!(
                        "casing {name} is not done: the same command continues it, if that comes within rig_patience_s"
                    )
                }
                true => format!("casing {name} is not done: the same command continues it"),
                false => format!("casing {name} is not done: its station {station} is not in the configuration"),
            }
        };
        let unfinished = self.open.iter().map(how).collect();
        LineOutcome {
            settled_before: Some(self.settled_before),
            elapsed_s: self.rate.elapsed_s(),
            restarts: self.stages.restarts(),
            reports: self.stages.reports(),
            unfinished,
            ..self.outcome
        }
    }

    /// Whether the line has the station with this number; a list has all stations.
    fn has_station(&self, number: u16) -> bool {
        self.is_list || self.shown.stations.iter().any(|station| station.number == number)
    }

    /// What is shown of the station with this number, if it is one of the line's.
    fn station(&mut self, number: u16) -> Option<&mut StationStatus> {
        self.shown.stations.iter_mut().find(|station| station.number == number)
    }
}

/// Number of the station that has the casing.
fn station_of(header: &CasingHeader) -> u16 {
    u16::try_from(header.station).unwrap_or(u16::MAX)
}

fn text_of(record: &[u8]) -> String {
    String::from_utf8_lossy(record).into_owned()
}
