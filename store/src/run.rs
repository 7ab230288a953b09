//! `store` on a line: writes what comes, says what is safe, and replays what `fuse` has missed.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tapline_wire::{
    DamageTopic, DiscriminatorTopic, Ledger, LedgerTopic, Line, LineError, Plan, Publisher, Quality,
    REPLAY_RECORDS_MAX, RecordKind, ReplayTopic, Role, Signal, Stamp, Subscriber, TapHeader, TapTopic, Topic as _,
    bytes_of,
};

use crate::{Error, PutOutcome, RunWriter};

/// Taps that are taken in together, packed by several threads: as many as may be held at once.
const BATCH_TAPS: usize = TapTopic::BORROWED;
const _: () = assert!(BATCH_TAPS <= FLUSH_TAPS, "taps would never be taken");

/// Taps after which the archive is flushed even while more are coming.
const FLUSH_TAPS: usize = 64;

/// Time after which it is flushed in any case.
const FLUSH_EVERY: Duration = Duration::from_millis(50);

/// How often the ledger is told to those who missed the last telling.
const TELL_EVERY: Duration = Duration::from_millis(100);

/// How long the last telling is kept up for those who have not heard it.
const LINGER: Duration = Duration::from_secs(5);

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
}

/// What `store` did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Taps in the archive.
    pub archived_count: u64,
    /// Taps refused.
    pub refused_count: u64,
    /// Taps that the plan asks for and the archive lacks.
    pub missing_count: u64,
    /// Records that came again and were there already.
    pub again_count: u64,
    /// Records that contradict what is archived; the first stands.
    pub conflict_count: u64,
    /// Records lost on the way to any stage that says so to `store`.
    pub lost_count: u64,
    /// Bytes of samples written.
    pub sample_bytes: u64,
    /// Flushes.
    pub flush_count: u64,
    /// Whether every scan is judged, and not just the process told to stop.
    pub is_complete: bool,
}

/// Writes what comes on `line` through `writer` until every scan of `plan` is judged.
///
/// # Errors
/// [`RunError`] when the archive cannot be written or shared memory fails. Being asked to stop is no error.
pub fn run(line: &Line, plan: &Plan, writer: RunWriter) -> Result<Outcome, RunError> {
    let mut desk = Desk::open(line, plan, writer)?;
    match desk.serve().and_then(|()| desk.insist(RunWriter::settle)) {
        Ok(()) | Err(RunError::Line(LineError::Stopped { .. })) => desk.close(),
        Err(error) => Err(error),
    }
}

pub(crate) struct Desk<'a> {
    pub(crate) line: &'a Line,
    plan: &'a Plan,
    stations: Vec<u16>,
    taps: Subscriber<'a, TapTopic>,
    found: Subscriber<'a, DiscriminatorTopic>,
    verdicts: Subscriber<'a, DamageTopic>,
    told: Publisher<'a, LedgerTopic>,
    replay: Publisher<'a, ReplayTopic>,
    pub(crate) writer: RunWriter,
    /// Whether the archive cannot be written.
    pub(crate) is_held: bool,
    /// When the file was last looked for.
    pub(crate) looked_at: Instant,
    /// For each station, the last barrier seen among the taps and among the discriminators.
    barriers: Vec<(u8, u8)>,
    /// Barriers that have passed, as of the last flush.
    passed: Vec<u8>,
    /// Plan row from which to replay on, while a replay is under way.
    replay_from: Option<u32>,
    unflushed_taps: usize,
    is_dirty: bool,
    flushed_at: Instant,
    told_at: Instant,
    sample_bytes: u64,
    flush_count: u64,
}

impl<'a> Desk<'a> {
    fn open(line: &'a Line, plan: &'a Plan, writer: RunWriter) -> Result<Self, RunError> {
        let stations = plan.stations();
        let now = Instant::now();
        Ok(Self {
            line,
            plan,
            taps: Subscriber::open(line, plan)?,
            found: Subscriber::open(line, plan)?,
            verdicts: Subscriber::open(line, plan)?,
            told: Publisher::open(line, plan)?,
            replay: Publisher::open(line, plan)?,
            writer,
            is_held: false,
            looked_at: now,
            barriers: vec![(0, 0); stations.len()],
            passed: vec![0; stations.len()],
            stations,
            replay_from: None,
            unflushed_taps: 0,
            is_dirty: false,
            flushed_at: now,
            told_at: now,
            sample_bytes: 0,
            flush_count: 0,
        })
    }

    fn serve(&mut self) -> Result<(), RunError> {
        self.tell()?;
        loop {
            let is_idle = !self.receive()?;
            if self.is_dirty
                && (is_idle || self.unflushed_taps >= FLUSH_TAPS || self.flushed_at.elapsed() >= FLUSH_EVERY)
            {
                self.flush()?;
            }
            if self.told_at.elapsed() >= TELL_EVERY {
                self.tell()?;
            }
            self.look_after_place()?;
            self.go_on_replaying()?;
            let is_done = self.writer.ledger().is_judged();
            if is_idle && is_done {
                return self.linger();
            }
            if is_idle && self.line.is_stopped() {
                return Ok(());
            }
            if is_idle {
                self.line.wait(TELL_EVERY)?;
            }
        }
    }

    /// Takes in what has come, a buffer's worth at most; whether anything had.
    fn receive(&mut self) -> Result<bool, RunError> {
        let mut has_come = false;
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
            let scan = u32::try_from(judged.header().stamp.mark).unwrap_or(u32::MAX);
            let outcome = self.insist(|writer| writer.put_judgement(scan, judged.header(), &judged))?;
            self.note(outcome, "a verdict", scan);
        }
        Ok(has_come)
    }

    /// Takes in taps, or one record of another kind.
    fn take_taps(&mut self, part: &[tapline_wire::Received<TapTopic>]) -> Result<(), RunError> {
        let Some(first) = part.first() else { return Ok(()) };
        let header = first.header();
        match first.kind() {
            Some(RecordKind::Data) => {
                let taps: Vec<(&TapHeader, &[u8])> = part.iter().map(|tap| (tap.header(), bytes_of(tap))).collect();
                let outcomes = self.insist(|writer| writer.put_taps(&taps))?;
                for ((header, _), outcome) in taps.into_iter().zip(outcomes) {
                    self.note(outcome, "a tap", header.plan_index);
                    self.unflushed_taps += 1;
                    self.sample_bytes += header.payload_bytes() as u64;
                }
            }
            Some(RecordKind::Refusal) => {
                let text = bytes_of(first).get(..header.text_bytes as usize).unwrap_or_default();
                let reason = String::from_utf8_lossy(text);
                tracing::warn!(tap = %header.id, %reason, "a tap was refused");
                let outcome = self.insist(|writer| writer.put_refusal(header.plan_index, &header.id, &reason))?;
                self.note(outcome, "a refusal", header.plan_index);
            }
            Some(RecordKind::Barrier) => {
                if let Some(number) = self.number(header.stamp.source) {
                    self.barriers[number].0 = low_byte(header.stamp.mark);
                    self.is_dirty = true;
                }
            }
            // The end counts when it has passed through `process` too, and comes with the discriminators.
            Some(RecordKind::End | RecordKind::Greeting) | None => {}
        }
        Ok(())
    }

    fn take_found(&mut self, found: &tapline_wire::Received<DiscriminatorTopic>) -> Result<(), RunError> {
        let stamp = found.header();
        match found.kind() {
            Some(RecordKind::Data) => {
                // Of a refused tap the refusal itself comes with the taps.
                for record in found.iter().filter(|r| !r.quality.contains(Quality::REFUSED)) {
                    let outcome = if record.quality.contains(Quality::RETAKE) {
                        tracing::info!(tap = %record.id, quality = %record.quality, "a tap is taken again");
                        self.insist(|writer| writer.put_retake(record.plan_index, &record.id, record.quality))?
                    } else {
                        self.insist(|writer| writer.put_discriminators(record))?
                    };
                    self.note(outcome, "discriminators", record.plan_index);
                }
            }
            Some(RecordKind::Barrier) => {
                if let Some(number) = self.number(stamp.source) {
                    self.barriers[number].1 = low_byte(stamp.mark);
                    self.is_dirty = true;
                }
            }
            Some(RecordKind::End) => {
                let scan = u32::try_from(stamp.mark).unwrap_or(u32::MAX);
                let outcome = self.insist(|writer| writer.end_scan(scan))?;
                self.note(outcome, "an end", scan);
            }
            Some(RecordKind::Refusal | RecordKind::Greeting) | None => {}
        }
        Ok(())
    }

    fn note(&mut self, outcome: PutOutcome, what: &str, number: u32) {
        self.is_dirty = true;
        if outcome == PutOutcome::Conflict {
            tracing::error!(what, number, "came again and differs from what is archived; the first stands");
        }
    }

    fn number(&self, station: u32) -> Option<usize> {
        self.stations.iter().position(|&s| u32::from(s) == station)
    }

    fn flush(&mut self) -> Result<(), RunError> {
        self.insist(RunWriter::flush)?;
        for (passed, &(taps, found)) in self.passed.iter_mut().zip(&self.barriers) {
            if taps == found {
                *passed = taps;
            }
        }
        self.is_dirty = false;
        self.unflushed_taps = 0;
        self.flushed_at = Instant::now();
        self.flush_count += 1;
        self.tell()
    }

    fn lost_count(&self) -> u64 {
        self.taps.lost() + self.found.lost() + self.verdicts.lost()
    }

    /// Tells everyone the ledger as of the last flush.
    pub(crate) fn tell(&mut self) -> Result<(), RunError> {
        let mut ledger: Ledger = self.writer.ledger().clone();
        for (number, &barrier) in self.passed.iter().enumerate() {
            ledger.set_barrier(number, barrier);
        }
        (ledger.lost_count, ledger.is_held) = (self.lost_count(), self.is_held);
        let bytes = Ledger::encoded_bytes(self.plan.taps().len(), self.plan.scans().len(), self.stations.len());
        let mut loan = self.told.loan(bytes)?;
        loan.fill(|header, bytes| *header = ledger.encode(bytes));
        loan.send(RecordKind::Data)?;
        for &station in &self.stations {
            self.line.ring(Role::Acquire(station), Signal::Data);
        }
        self.told_at = Instant::now();
        Ok(())
    }

    /// Takes one step of a replay: it must never wait, since `fuse` may be waiting for us.
    fn go_on_replaying(&mut self) -> Result<(), RunError> {
        if self.line.take(Signal::ReplayWanted) {
            self.replay_from = Some(0);
        }
        while let Some(from) = self.replay_from {
            let (records, next) = self.insist(|writer| writer.settled_from(from, REPLAY_RECORDS_MAX))?;
            if !records.is_empty() && !self.replay.try_send(RecordKind::Data, Stamp::default(), &records)? {
                return Ok(());
            }
            self.replay_from = next;
        }
        Ok(())
    }

    /// Keeps telling that all is judged until everyone has left, or long enough.
    fn linger(&mut self) -> Result<(), RunError> {
        let since = Instant::now();
        self.tell()?;
        while self.told.has_subscriber_other_than(Role::Watch) && since.elapsed() < LINGER && !self.line.is_stopped() {
            self.line.wait(Duration::from_millis(20))?;
            self.tell()?;
        }
        Ok(())
    }

    fn close(mut self) -> Result<Outcome, RunError> {
        let lost_count = self.lost_count();
        // What came after the last flush becomes safe with this one, and counts in the archive, if not here.
        let ledger = self.writer.ledger().clone();
        let is_in_order = self.is_closed_in_order()?;
        let counts = self.writer.counts();
        if is_in_order {
            self.writer.close()?;
        }
        let count = |state| ledger.count(state) as u64;
        Ok(Outcome {
            archived_count: count(tapline_wire::TapState::Archived),
            refused_count: count(tapline_wire::TapState::Refused),
            missing_count: count(tapline_wire::TapState::Missing),
            again_count: counts.already_there,
            conflict_count: counts.conflicts,
            lost_count,
            sample_bytes: self.sample_bytes,
            flush_count: self.flush_count,
            is_complete: ledger.is_judged() && is_in_order,
        })
    }
}

/// Barriers count modulo 256.
fn low_byte(mark: u64) -> u8 {
    (mark & 0xff) as u8
}
