//! `store` on a line: opens a file for each casing, writes the records that come, reports what is durable, and closes the file
//! when the casing is judged.
//!
//! - here: the loop
//! - `proposals`, `receive`: what stations propose; taps, discriminators and verdicts
//! - `flush`, `notices`: what is made durable, replayed and closed; what every other stage is sent
//! - `outage`: while an archive cannot be written
//! - `open_casing`: one open casing
//! - `places`, `closer`, `markers`: paths of the files, and how a finished file gets its name
//! - `unreported`: which verdicts are still to be reported

mod closer;
mod flush;
mod markers;
mod notices;
mod open_casing;
mod outage;
mod outcome;
mod places;
mod proposals;
mod receive;
mod unreported;

use std::time::{Duration, Instant};

use tapline_codec::Codec;
use tapline_wire::{
    AskTopic, DamageTopic, DiscriminatorTopic, Line, LineError, ProposalTopic, Publisher, SettledTopic, Subscriber,
    TapTopic,
};

pub use self::outcome::{Outcome, RunError};
pub use self::places::Places;
pub use self::unreported::{Unreported, casing_id};

use self::closer::Closer;
use self::notices::Notices;
use self::open_casing::OpenCasing;
use crate::error::Result;
use crate::format::lineage::Lineage;

/// Time after which a changed archive is flushed even while more records are coming.
const FLUSH_EVERY: Duration = Duration::from_millis(50);

/// How often the stage looks for taps, which do not wake it, while a casing is open.
const LOOK_EVERY: Duration = Duration::from_millis(40);

/// What every archive of a line is begun with, and the paths of its files.
#[derive(Debug, Clone)]
pub struct StoreRun {
    /// Paths of the files.
    pub places: Places,
    /// Whether a casing with a finished file is skipped, because the same run is continued; else it is another casing with the
    /// same serial, or is to be judged again.
    pub skips_finished: bool,
    /// Whether each finished casing has a note ([`Unreported`]) until its verdict is reported.
    pub notes_unreported: bool,
    /// The configuration, verbatim.
    pub config_toml: String,
    /// The reference file, verbatim.
    pub reference: Option<String>,
    /// What the results are computed by.
    pub made_by: String,
    /// The codec of the samples.
    pub codec: Codec,
}

impl StoreRun {
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

/// Writes the casings of `line` until the line stops.
///
/// # Errors
/// [`RunError`] if an archive cannot be written or shared memory fails. A stop is no error.
pub fn run(line: &Line, run: &StoreRun) -> Result<Outcome, RunError> {
    let mut stage = StageLoop::open(line, run)?;
    match stage.reopen().and_then(|()| stage.serve()) {
        Ok(()) | Err(RunError::Line(LineError::Stopped { .. })) => stage.close(),
        Err(error) => {
            // As if killed: nothing more is written, and records that were not flushed are requested again.
            stage.open.iter_mut().for_each(|casing| casing.writer.abandon());
            Err(error)
        }
    }
}

struct StageLoop<'a> {
    line: &'a Line,
    run: &'a StoreRun,
    taps: Subscriber<'a, TapTopic>,
    found: Subscriber<'a, DiscriminatorTopic>,
    verdicts: Subscriber<'a, DamageTopic>,
    asked: Subscriber<'a, AskTopic>,
    proposals: Subscriber<'a, ProposalTopic>,
    settled: Publisher<'a, SettledTopic>,
    notices: Notices<'a>,
    closer: Closer,
    open: Vec<OpenCasing>,
    /// Whether the line waits for an archive that cannot be written.
    is_held: bool,
    /// When the files were last checked.
    looked_at: Instant,
    /// Whether another stage waits for the next flush.
    is_urgent: bool,
    flushed_at: Instant,
    /// Number of times that `fuse` was restarted.
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
            asked: Subscriber::open(line)?,
            proposals: Subscriber::open(line)?,
            settled: Publisher::open(line)?,
            notices: Notices::open(line)?,
            closer: Closer::start(line.waker(), run)?,
            open: Vec::new(),
            is_held: false,
            looked_at: now,
            is_urgent: false,
            flushed_at: now,
            fuse_generation: 0,
            outcome: Outcome::default(),
        })
    }

    fn serve(&mut self) -> Result<(), RunError> {
        loop {
            let is_idle = !self.receive()?;
            self.flush_if_due(is_idle)?;
            self.close_judged()?;
            self.check_files()?;
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

    /// How long the stage may sleep unless it is woken.
    fn patience(&self) -> Duration {
        let is_flush_due = self.open.iter().any(|casing| casing.is_dirty);
        let is_notice_due = self.notices.are_pending() || self.open.iter().any(|casing| !casing.replays.is_empty());
        match () {
            () if is_notice_due => Duration::from_millis(5),
            () if is_flush_due => FLUSH_EVERY.saturating_sub(self.flushed_at.elapsed()).max(Duration::from_millis(1)),
            () if !self.open.is_empty() => LOOK_EVERY,
            () => Duration::MAX,
        }
    }

    fn lost_count(&self) -> u64 {
        [self.taps.lost(), self.found.lost(), self.verdicts.lost(), self.asked.lost(), self.proposals.lost()]
            .iter()
            .sum()
    }

    /// Ends the stage: settles and suspends every open archive.
    fn close(mut self) -> Result<Outcome, RunError> {
        self.outcome.lost_count = self.lost_count();
        for casing in std::mem::take(&mut self.open) {
            self.outcome.conflict_count += casing.writer.counts().conflicts;
            outage::settle_at_end(casing.writer)?;
        }
        for closed in self.closer.finish() {
            self.note_closed(closed?);
        }
        // A stage that does not get a notice now gets it when the line is started again.
        self.send_notices()?;
        Ok(self.outcome)
    }
}
