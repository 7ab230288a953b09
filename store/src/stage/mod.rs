//! `store` on a line: opens a file for each casing, writes what comes, says what is safe, and closes the file when all of the
//! casing is judged.

mod closer;
mod markers;
mod notices;
mod open_casing;
mod outage;
mod places;
mod proposals;

use std::path::Path;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tapline_wire::{
    DamageTopic, DiscriminatorTopic, Line, LineError, ProposalTopic, Publisher, Quality, Received, RecordKind,
    SettledTopic, Subscriber, TapHeader, TapTopic, Topic as _, bytes_of,
};

pub use self::places::{LEFT_FOLDER, OPEN_FOLDER, Places};

use tapline_codec::Codec;

use self::closer::Closer;
use self::notices::Notices;
use self::open_casing::OpenCasing;
use crate::error::{Error, Result};
use crate::format::lineage::Lineage;
use crate::write::Writer;
use crate::write::put_taps::put_taps_of;
use crate::write::tap_state::PutOutcome;

/// Taps that are taken in together, packed by several threads: as many as may be held at once.
const BATCH_TAPS: usize = TapTopic::BORROWED;

/// Taps after which the archive is flushed even while more are coming.
const FLUSH_TAPS: usize = 64;

/// Time after which it is flushed in any case.
const FLUSH_EVERY: Duration = Duration::from_millis(50);

/// How often it is looked for taps, which wake nobody here, while a casing is open.
const LOOK_EVERY: Duration = Duration::from_millis(40);

/// Why `store` cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The archive cannot be written.
    #[error(transparent)]
    Archive(#[from] Error),
    /// Shared memory fails.
    #[error(transparent)]
    Line(#[from] LineError),
    /// The file system of the archive has failed, or may not be written: everything in it is let go, so that it can be mended.
    #[error("{error}; the line waits and nothing is lost: {}", .error.remedy())]
    FileSystem {
        /// What it said.
        error: Error,
    },
    /// The thread that closes files cannot be started.
    #[error("cannot start the thread {name}")]
    Thread {
        /// Its name.
        name: String,
        /// The system's reason.
        source: std::io::Error,
    },
}

/// What `store` did.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Files that were closed.
    pub closed_count: u64,
    /// Records that came again and were there already.
    pub again_count: u64,
    /// Records that contradict what is archived; the first stands.
    pub conflict_count: u64,
    /// Records of casings that are not open.
    pub stray_count: u64,
    /// Records lost on the way to any stage that says so to `store`.
    pub lost_count: u64,
    /// Bytes of samples written.
    pub sample_bytes: u64,
    /// Flushes.
    pub flush_count: u64,
}

/// What every file of a line is begun with, and where the files lie.
#[derive(Debug, Clone)]
pub struct StoreRun {
    /// Where the files lie.
    pub places: Places,
    /// Whether a casing whose file is finished already is done, as where the same run is gone on with; else it is another
    /// casing with the same serial, or the same one again.
    pub skips_finished: bool,
    /// The configuration, verbatim.
    pub config_toml: String,
    /// The reference file, verbatim.
    pub reference: Option<String>,
    /// What the results are made by.
    pub made_by: String,
    /// What packs the samples.
    pub codec: Codec,
}

impl StoreRun {
    /// The file under way at `path`, to be gone on with. A line that never ends may have been given other stations, another
    /// hook or a comment since: what its results are made by must be the same.
    fn resume(&self, path: &Path) -> Result<Writer> {
        match self.skips_finished {
            true => Writer::resume(path, self.lineage()),
            false => Writer::resume_as_begun(path, self.lineage()),
        }
    }

    fn lineage(&self) -> Lineage<'_> {
        Lineage {
            config_toml: &self.config_toml,
            reference: self.reference.as_deref(),
            codec: self.codec,
            made_by: &self.made_by,
            raw: None,
        }
    }
}

/// Writes the casings of `line` until told to stop.
///
/// # Errors
/// [`RunError`] when the archive cannot be written or shared memory fails. Being asked to stop is no error.
pub fn run(line: &Line, run: &StoreRun) -> Result<Outcome, RunError> {
    let mut stage = StageLoop::open(line, run)?;
    match stage.reopen().and_then(|()| stage.serve()) {
        Ok(()) | Err(RunError::Line(LineError::Stopped { .. })) => stage.close(),
        Err(error) => {
            // As a writer that is killed: nothing more is written, and what was not safe is asked for again.
            stage.open.iter_mut().for_each(|casing| casing.writer.abandon());
            Err(error)
        }
    }
}

/// The error of a stage that a file cannot be written: of the disk, when all of that has failed.
fn of_the_disk(error: Error) -> RunError {
    if error.is_of_the_file_system() { RunError::FileSystem { error } } else { RunError::Archive(error) }
}

struct StageLoop<'a> {
    line: &'a Line,
    run: &'a StoreRun,
    taps: Subscriber<'a, TapTopic>,
    found: Subscriber<'a, DiscriminatorTopic>,
    verdicts: Subscriber<'a, DamageTopic>,
    proposals: Subscriber<'a, ProposalTopic>,
    settled: Publisher<'a, SettledTopic>,
    notices: Notices<'a>,
    closer: Closer,
    open: Vec<OpenCasing>,
    /// Whether an archive cannot be written.
    is_held: bool,
    /// When the files were last looked for.
    looked_at: Instant,
    unflushed_taps: usize,
    /// Whether someone waits for what is flushed next.
    is_urgent: bool,
    flushed_at: Instant,
    /// When the supervisor was last told something of its own accord.
    heard_at: Instant,
    /// How often `fuse` has been replaced.
    fuse_generation: u64,
    outcome: Outcome,
}

impl<'a> StageLoop<'a> {
    fn open(line: &'a Line, run: &'a StoreRun) -> Result<Self, RunError> {
        let now = Instant::now();
        Ok(Self {
            line,
            run,
            taps: Subscriber::open(line)?,
            found: Subscriber::open(line)?,
            verdicts: Subscriber::open(line)?,
            proposals: Subscriber::open(line)?,
            settled: Publisher::open(line)?,
            notices: Notices::open(line)?,
            closer: Closer::start(line.waker()?, &run.places)?,
            open: Vec::new(),
            is_held: false,
            looked_at: now,
            unflushed_taps: 0,
            is_urgent: false,
            flushed_at: now,
            heard_at: now,
            fuse_generation: 0,
            outcome: Outcome::default(),
        })
    }

    fn serve(&mut self) -> Result<(), RunError> {
        loop {
            let is_idle = !self.receive()?;
            self.flush_if_due(is_idle)?;
            self.close_judged()?;
            self.look_after_places()?;
            self.send_notices()?;
            self.replay()?;
            if is_idle && self.line.is_stopped() {
                return Ok(());
            }
            if is_idle {
                self.line.wait(self.patience())?;
            }
        }
    }

    /// How long there is nothing to do unless someone wakes us.
    fn patience(&self) -> Duration {
        let is_flush_due = self.open.iter().any(|casing| casing.is_dirty);
        let to_be_told = self.notices.are_pending() || self.open.iter().any(|casing| !casing.replays.is_empty());
        match () {
            () if to_be_told => Duration::from_millis(5),
            () if is_flush_due => FLUSH_EVERY.saturating_sub(self.flushed_at.elapsed()).max(Duration::from_millis(1)),
            () if !self.open.is_empty() => LOOK_EVERY,
            () => Duration::MAX,
        }
    }

    /// Takes in what has come, a buffer's worth at most; whether anything had.
    fn receive(&mut self) -> Result<bool, RunError> {
        let mut has_come = false;
        while let Some(proposal) = self.proposals.receive()? {
            has_come = true;
            self.take_proposal(&proposal)?;
        }
        for _ in 0..FLUSH_TAPS / BATCH_TAPS {
            let mut batch = Vec::with_capacity(BATCH_TAPS);
            while batch.len() < BATCH_TAPS
                && let Some(tap) = self.taps.receive()?
            {
                batch.push(tap);
            }
            has_come |= !batch.is_empty();
            // What is no data keeps its place among the taps.
            for part in batch.chunk_by(|a, b| a.kind() == Some(RecordKind::Data) && b.kind() == a.kind()) {
                self.take_taps(part)?;
            }
        }
        while let Some(found) = self.found.receive()? {
            has_come = true;
            self.take_found(&found)?;
        }
        while let Some(judged) = self.verdicts.receive()? {
            has_come = true;
            let header = judged.header();
            let scan = u32::try_from(header.stamp.mark).unwrap_or(u32::MAX);
            if let Some(place) = self.place_of(header.stamp.casing) {
                let outcome =
                    self.retry_until_recovered(place, |writer| writer.put_judgement(scan, judged.header(), &judged))?;
                self.note(place, outcome, "a verdict", scan);
                self.is_urgent = true;
            }
        }
        Ok(has_come)
    }

    fn place_of(&mut self, number: u64) -> Option<usize> {
        let place = self.open.iter().position(|casing| casing.number == number);
        self.outcome.stray_count += u64::from(place.is_none());
        place
    }

    /// Takes in taps, or one record of another kind.
    fn take_taps(&mut self, part: &[Received<TapTopic>]) -> Result<(), RunError> {
        let Some(first) = part.first() else { return Ok(()) };
        let header = first.header();
        match first.kind() {
            Some(RecordKind::Data) => self.put_taps(part)?,
            Some(RecordKind::Refusal) => {
                let Some(place) = self.place_of(header.stamp.casing) else { return Ok(()) };
                let text = bytes_of(first).get(..header.text_bytes as usize).unwrap_or_default();
                let reason = String::from_utf8_lossy(text);
                tracing::warn!(tap = %header.id, %reason, "a tap was refused");
                let outcome = self.retry_until_recovered(place, |writer| {
                    writer.put_refusal(header.plan_index, &header.id, &reason)
                })?;
                self.note(place, outcome, "a refusal", header.plan_index);
            }
            Some(RecordKind::Barrier) => {
                let Some(place) = self.place_of(header.stamp.casing) else {
                    self.notices.unknown(&header.stamp);
                    return Ok(());
                };
                self.open[place].barriers.0 = low_byte(header.stamp.mark);
                self.open[place].is_dirty = true;
            }
            // The end counts when it has passed through `process` too, and comes with the discriminators.
            _ => {}
        }
        Ok(())
    }

    /// Takes in taps of any casings, packed together.
    fn put_taps(&mut self, part: &[Received<TapTopic>]) -> Result<(), RunError> {
        let mut taps: Vec<(usize, &TapHeader, &[u8])> = Vec::with_capacity(part.len());
        for tap in part {
            if let Some(place) = self.place_of(tap.header().stamp.casing) {
                taps.push((place, tap.header(), bytes_of(tap)));
            }
        }
        let mut writers: Vec<&mut Writer> = self.open.iter_mut().map(|casing| &mut casing.writer).collect();
        let outcomes = put_taps_of(&mut writers, &taps);
        for ((place, header, samples), outcome) in taps.into_iter().zip(outcomes) {
            let outcome = match outcome {
                // By itself, as often as it takes.
                Err(error) if error.is_of_the_disk() => {
                    self.wait_for_recovery(place, error)?;
                    self.retry_until_recovered(place, |writer| writer.put_tap(header, samples))?
                }
                outcome => outcome?,
            };
            self.note(place, outcome, "a tap", header.plan_index);
            self.unflushed_taps += 1;
            self.outcome.sample_bytes += header.payload_bytes() as u64;
        }
        Ok(())
    }

    fn take_found(&mut self, found: &Received<DiscriminatorTopic>) -> Result<(), RunError> {
        let stamp = *found.header();
        let Some(place) = self.place_of(stamp.casing) else { return Ok(()) };
        match found.kind() {
            Some(RecordKind::Data) => {
                // Of a refused tap the refusal itself comes with the taps.
                for record in found.iter().filter(|r| !r.quality.contains(Quality::REFUSED)) {
                    let outcome = if record.quality.contains(Quality::RETAKE) {
                        tracing::info!(tap = %record.id, quality = %record.quality, "a tap is taken again");
                        self.retry_until_recovered(place, |w| {
                            w.put_retake(record.plan_index, &record.id, record.quality)
                        })?
                    } else {
                        self.retry_until_recovered(place, |writer| writer.put_discriminators(record))?
                    };
                    self.note(place, outcome, "discriminators", record.plan_index);
                }
            }
            Some(RecordKind::Barrier) => {
                self.open[place].barriers.1 = low_byte(stamp.mark);
                self.open[place].is_dirty = true;
                self.is_urgent = true;
            }
            Some(RecordKind::End) => {
                let scan = u32::try_from(stamp.mark).unwrap_or(u32::MAX);
                let outcome = self.retry_until_recovered(place, |writer| writer.end_scan(scan))?;
                self.note(place, outcome, "an end", scan);
                self.is_urgent = true;
            }
            _ => {}
        }
        Ok(())
    }

    fn note(&mut self, place: usize, outcome: PutOutcome, what: &str, number: u32) {
        self.open[place].is_dirty = true;
        if outcome == PutOutcome::Conflict {
            let casing = &self.open[place].name;
            tracing::error!(casing, what, number, "came again and differs from what is archived; the first stands");
        }
    }

    /// Flushes when someone waits for it and nothing more has come, and at the latest after a while.
    fn flush_if_due(&mut self, is_idle: bool) -> Result<(), RunError> {
        let is_due = (is_idle && self.is_urgent)
            || self.unflushed_taps >= FLUSH_TAPS
            || self.flushed_at.elapsed() >= FLUSH_EVERY;
        if !is_due {
            return Ok(());
        }
        for place in 0..self.open.len() {
            if self.open[place].is_dirty {
                self.retry_until_recovered(place, Writer::flush)?;
                self.open[place].flushed();
                self.outcome.flush_count += 1;
            }
        }
        self.unflushed_taps = 0;
        self.is_urgent = false;
        self.flushed_at = Instant::now();
        Ok(())
    }

    fn lost_count(&self) -> u64 {
        self.taps.lost() + self.found.lost() + self.verdicts.lost() + self.proposals.lost()
    }

    /// Sends `fuse` what is safe of scans that have ended. It must never wait, since `fuse` may be waiting for us.
    fn replay(&mut self) -> Result<(), RunError> {
        if !self.settled.poll_ready()? {
            return Ok(());
        }
        let generation = self.settled.generation();
        if std::mem::replace(&mut self.fuse_generation, generation) != generation {
            self.open.iter_mut().for_each(OpenCasing::replay_ended);
        }
        for place in 0..self.open.len() {
            while let Some(rows) = self.open[place].replays.front().cloned() {
                if self.open[place].fuse.plan {
                    break; // the plan comes first
                }
                let most = tapline_wire::SETTLED_RECORDS_MAX.min(rows.len());
                let (records, next) =
                    self.retry_until_recovered(place, |writer| writer.settled_from(rows.start, most))?;
                let stamp = self.open[place].settled_stamp();
                if !records.is_empty() && !self.settled.try_send(RecordKind::Data, stamp, &records)? {
                    return Ok(());
                }
                let rest = next.unwrap_or(rows.end)..rows.end;
                match self.open[place].replays.front_mut() {
                    Some(front) if !rest.is_empty() => *front = rest,
                    _ => drop(self.open[place].replays.pop_front()),
                }
            }
        }
        Ok(())
    }

    /// Closes the files of which every scan is judged.
    fn close_judged(&mut self) -> Result<(), RunError> {
        let mut place = 0;
        while place < self.open.len() {
            if !self.open[place].is_judged() {
                place += 1;
                continue;
            }
            self.retry_until_recovered(place, Writer::settle)?;
            let casing = self.open.swap_remove(place);
            let counts = casing.writer.counts();
            self.outcome.again_count += counts.already_there;
            self.outcome.conflict_count += counts.conflicts;
            self.closer.close(casing);
        }
        while let Some(closed) = self.closer.take_closed() {
            self.note_closed(closed.map_err(|error| match error.is_of_the_disk() {
                // What is finished and not in its place yet is taken up by the next life of this stage.
                true => RunError::FileSystem { error },
                false => error.into(),
            })?);
        }
        Ok(())
    }

    /// After being asked to end: makes safe what has come, and lets the files go as they are.
    fn close(mut self) -> Result<Outcome, RunError> {
        self.outcome.lost_count = self.lost_count();
        for casing in std::mem::take(&mut self.open) {
            let counts = casing.writer.counts();
            self.outcome.again_count += counts.already_there;
            self.outcome.conflict_count += counts.conflicts;
            outage::settle_at_end(casing.writer)?;
        }
        for closed in self.closer.finish() {
            self.note_closed(closed?);
        }
        // Whoever does not hear it now is told by the next life of the line.
        self.send_notices()?;
        Ok(self.outcome)
    }
}

/// Barriers count modulo 256.
fn low_byte(mark: u64) -> u8 {
    (mark & 0xff) as u8
}
