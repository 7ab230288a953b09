//! `fuse` on a line: judges each shoulder as soon as it can be judged.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tapline_wire::{
    DamageTopic, DiscriminatorTopic, Ledger, LedgerTopic, Line, LineError, Plan, Publisher, RecordKind, ReplayTopic,
    Role, ScanState, Signal, Subscriber,
};

use crate::{Error, Fusion};

/// How long discriminators that the archive has may be missing here before they are asked for: they may be on the way.
const PATIENCE: Duration = Duration::from_millis(500);

/// How long a verdict may take to reach the archive before it is sent again.
const JUDGE_AGAIN: Duration = Duration::from_secs(1);

/// Why `fuse` cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A record does not fit the plan.
    #[error(transparent)]
    Fusion(#[from] Error),
    /// Shared memory fails.
    #[error(transparent)]
    Line(#[from] LineError),
}

/// What `fuse` did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Discriminator records received, replayed ones among them.
    pub record_count: u64,
    /// Verdicts reached.
    pub verdict_count: u64,
    /// Records lost on the way here.
    pub lost_count: u64,
    /// Whether every scan is judged, and not just the process told to stop.
    pub is_complete: bool,
    /// What was asked for and could not be learned from a reference, and why; each text once, in the order of the texts.
    pub fallbacks: Vec<String>,
}

/// Turns the discriminators on `line` into verdicts, by `fusion`, until every scan of `plan` is judged.
///
/// # Errors
/// [`RunError`] when a record does not fit the plan or shared memory fails. Being asked to stop is no error.
pub fn run(line: &Line, plan: &Plan, fusion: Fusion) -> Result<Outcome, RunError> {
    let mut bench = Bench::open(line, plan, fusion)?;
    match bench.serve() {
        Ok(()) | Err(RunError::Line(LineError::Stopped { .. })) => Ok(bench.outcome()),
        Err(error) => Err(error),
    }
}

struct Bench<'a> {
    line: &'a Line,
    plan: &'a Plan,
    found: Subscriber<'a, DiscriminatorTopic>,
    replayed: Subscriber<'a, ReplayTopic>,
    snapshots: Subscriber<'a, LedgerTopic>,
    verdicts: Publisher<'a, DamageTopic>,
    fusion: Fusion,
    ledger: Option<Ledger>,
    /// When each scan's verdict was last sent.
    judged_at: Vec<Option<Instant>>,
    progress_at: Instant,
    record_count: u64,
    verdict_count: u64,
    fallbacks: BTreeSet<String>,
}

impl<'a> Bench<'a> {
    fn open(line: &'a Line, plan: &'a Plan, fusion: Fusion) -> Result<Self, RunError> {
        Ok(Self {
            line,
            plan,
            found: Subscriber::open(line, plan)?,
            replayed: Subscriber::open(line, plan)?,
            snapshots: Subscriber::open(line, plan)?,
            verdicts: Publisher::open(line, plan)?,
            fusion,
            ledger: None,
            judged_at: vec![None; plan.scans().len()],
            progress_at: Instant::now(),
            record_count: 0,
            verdict_count: 0,
            fallbacks: BTreeSet::new(),
        })
    }

    fn serve(&mut self) -> Result<(), RunError> {
        loop {
            let is_idle = !self.receive()?;
            if let Some(snapshot) = self.snapshots.receive_newest()? {
                self.ledger = Ledger::decode(snapshot.header(), &snapshot).or(self.ledger.take());
            }
            self.judge()?;
            let is_done = self.ledger.as_ref().is_some_and(Ledger::is_judged);
            if is_idle && (is_done || self.line.is_stopped()) {
                return Ok(());
            }
            if is_idle {
                self.ask_for_missing();
                self.line.wait(Duration::from_millis(100))?;
            }
        }
    }

    /// Takes in what has come; whether anything had.
    fn receive(&mut self) -> Result<bool, RunError> {
        let before = self.record_count;
        let mut has_ended = false;
        while let Some(record) = self.found.receive()? {
            match record.kind() {
                Some(RecordKind::Data) => self.push(&record)?,
                Some(RecordKind::End) => {
                    self.fusion.end(usize::try_from(record.header().mark).unwrap_or(usize::MAX))?;
                    has_ended = true;
                }
                _ => {}
            }
        }
        while let Some(record) = self.replayed.receive()? {
            self.push(&record)?;
        }
        let has_come = self.record_count != before;
        if has_come {
            self.progress_at = Instant::now();
        }
        Ok(has_come || has_ended)
    }

    fn push(&mut self, records: &[tapline_wire::Discriminators]) -> Result<(), RunError> {
        for record in records {
            self.fusion.push(record)?;
            self.record_count += 1;
        }
        Ok(())
    }

    /// Sends the verdicts that can be reached and are not in the archive.
    fn judge(&mut self) -> Result<(), RunError> {
        let Some(ledger) = &self.ledger else { return Ok(()) };
        for (scan, &state) in ledger.scans().iter().enumerate() {
            // The end may have come while another `fuse` was here.
            if state >= ScanState::Ended {
                self.fusion.end(scan)?;
            }
        }
        let is_archived: Vec<bool> = ledger.scans().iter().map(|&state| state == ScanState::Judged).collect();
        let overdue = |at: Option<Instant>| at.is_some_and(|at| at.elapsed() > JUDGE_AGAIN);
        let mut todo: Vec<usize> = self.fusion.ready();
        todo.extend((0..is_archived.len()).filter(|&scan| overdue(self.judged_at[scan])));
        for scan in todo.into_iter().filter(|&scan| !is_archived[scan]) {
            let (judgement, cells) = self.fusion.judge(scan)?;
            self.note_fallbacks(scan)?;
            self.verdicts.send(RecordKind::Data, judgement, &cells)?;
            self.verdict_count += u64::from(self.judged_at[scan].is_none());
            self.judged_at[scan] = Some(Instant::now());
        }
        Ok(())
    }

    /// Says once what the verdict on `scan` was to rest on and does not.
    fn note_fallbacks(&mut self, scan: usize) -> Result<(), RunError> {
        for text in self.fusion.fallbacks(scan)? {
            if !self.fallbacks.contains(&text) {
                tracing::warn!("{text}");
                self.fallbacks.insert(text);
            }
        }
        Ok(())
    }

    /// Asks `store` for discriminators that it has and we have not, as after a restart or in a resumed run.
    fn ask_for_missing(&mut self) {
        let Some(ledger) = &self.ledger else { return };
        if self.progress_at.elapsed() < PATIENCE {
            return;
        }
        let is_lacking = |scan| self.fusion.missing(scan).iter().any(|&row| ledger.taps()[row as usize].is_settled());
        if (0..self.plan.scans().len()).any(is_lacking) {
            self.line.ring(Role::Store, Signal::ReplayWanted);
            self.progress_at = Instant::now();
        }
    }

    fn outcome(&self) -> Outcome {
        Outcome {
            record_count: self.record_count,
            verdict_count: self.verdict_count,
            lost_count: self.found.lost() + self.replayed.lost(),
            is_complete: self.ledger.as_ref().is_some_and(Ledger::is_judged),
            fallbacks: self.fallbacks.iter().cloned().collect(),
        }
    }
}
