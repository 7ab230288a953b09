//! Writes an archive: a state machine that accepts records in any order and settles each planned tap exactly once.
//!
//! # Why a crash loses no more than the last batch
//!
//! After creation every table has all of its rows, and every chunk of samples its entry in the index. Rows are written in
//! place; a packed chunk is written to the end of the file, and the next flush changes its entry in place. [`Writer::flush`]
//! first writes the rows of records and passes them to the system, and then the states that refer to them. A writer that is
//! killed in between leaves rows whose state is still "missing": they are put again and overwritten. A file that cannot be
//! written is left in the same state: see [`Writer::recover`].
//!
//! - here: [`Writer`], and the records that it accepts except taps
//! - `put_taps`, `packer`: taps, packed by several threads
//! - `tap_state`, `check`: whether a record is accepted
//! - `pending`: what waits for a flush
//! - `grow`, `finish`, `recover`, `replay`: the plan grows, the archive is finished, a failed disk is back, `fuse` is sent
//!   records again
//! - `resume`: a writer continues an archive

mod check;
pub(crate) mod finish;
mod grow;
pub(crate) mod packer;
mod pending;
pub(crate) mod put_taps;
mod recover;
mod replay;
mod resume;
pub(crate) mod tap_state;

use std::path::{Path, PathBuf};

use tapline_wire::{DamageCell, Discriminators, Judgement, Ledger, Plan, Quality, ScanState, TapId, TapState};

use crate::archive::Archive;
use crate::archive::create::create;
use crate::error::{Context, Error, Result};
use crate::file::background_sync::SyncErrors;
use crate::file::guard::FileGuard;
use crate::format::checksum::ChecksummedRow as _;
use crate::format::layout::{CellRow, DiscriminatorsRow, ReasonRow, ScanRow};
use crate::format::lineage::Lineage;
use crate::format::scan_rows::fingerprint;
use crate::write::check::{check_cells, check_id, check_scan};
use crate::write::packer::Shape;
use crate::write::pending::Pending;
use crate::write::resume::load_resume_state;
use crate::write::tap_state::{Half, PutCounts, PutOutcome, Track, Version};

/// What computes an archive's results; it is compared when the archive is opened again.
#[derive(Debug)]
struct Provenance {
    reference: Option<String>,
    made_by: String,
}

/// Writes the archive of one casing.
///
/// Dropping a writer has the effect of a crash: records put since the last flush are lost.
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    plan: Plan,
    provenance: Provenance,
    guard: FileGuard,
    sync_errors: SyncErrors,
    /// `None` after a write failed, or when it is closed.
    archive: Option<Archive>,
    is_results: bool,
    /// Maximum number of taps of the archive.
    taps_max: usize,
    /// The state of each planned tap.
    tracks: Vec<Track>,
    scans: Vec<ScanRow>,
    scan_fingerprints: Vec<Option<u64>>,
    pending: Pending,
    ledger: Ledger,
    last_tap_ns: i64,
    counts: PutCounts,
    shape: Shape,
}

impl Writer {
    /// Creates the archive of `plan` at `path`, with room for `taps_max` taps if the plan [grows](Writer::grow); configuration and
    /// reference are stored verbatim.
    ///
    /// The file appears at `path` complete or not at all. Except for packed samples, all of its space is allocated.
    ///
    /// # Errors
    /// [`crate::Error::Exists`], [`crate::Error::EmptyRecording`], [`crate::Error::LongRecording`], or what the system returns.
    pub fn create<'a>(
        path: impl AsRef<Path>,
        plan: &Plan,
        taps_max: usize,
        lineage: impl Into<Lineage<'a>>,
    ) -> Result<Self> {
        let lineage = lineage.into();
        create(path.as_ref(), plan, taps_max, lineage)?;
        Self::resume(path, lineage)
    }

    /// Creates or continues, at `path`, results of the taps of the archive `raw` (its path, and the digest of its taps). `path` is
    /// in the folder of that archive, or in a folder within it; `plan` is that of the archive.
    ///
    /// # Errors
    /// As [`Writer::create`] and [`Writer::resume`]: [`crate::Error::Finished`] if the results exist already.
    pub fn results(path: impl AsRef<Path>, raw: (&Path, [u8; 32]), plan: &Plan, lineage: Lineage<'_>) -> Result<Self> {
        let (path, lineage) = (path.as_ref(), Lineage { raw: Some(raw), ..lineage });
        let create = || Self::create(path, plan, plan.taps().len(), lineage);
        if !path.try_exists().context("look for", path)? {
            return create();
        }
        let writer = match Self::resume(path, lineage) {
            // Results are computed again from their taps, so nothing is lost. A power cut just after their start may leave a name without
            // content: to sync each new file would cost a line some 5 ms a casing.
            Err(error @ (Error::Damaged { .. } | Error::NotHdf5 { .. })) => {
                tracing::warn!("{error}; these results are computed again");
                std::fs::remove_file(path).context("remove", path)?;
                return create();
            }
            resumed => resumed?,
        };
        let (archived, given) = (writer.plan.digest(), plan.digest());
        match archived == given {
            true => Ok(writer),
            false => Err(Error::OtherPlan { path: path.to_owned(), archived, given }),
        }
    }

    fn new(archive: Archive) -> Result<Self> {
        let shape = Shape::of(&archive);
        if !shape.codec.is_for_lines() && !archive.is_results() {
            return Err(Error::OfflineCodec { path: archive.path.clone(), codec: shape.codec });
        }
        let (state, sync_errors) = (load_resume_state(&archive)?, SyncErrors::default());
        Ok(Self {
            tracks: state.tracks,
            scans: state.scans,
            scan_fingerprints: state.scan_fingerprints,
            ledger: state.ledger,
            last_tap_ns: state.last_tap_ns,
            pending: Pending::of_changed(state.changed_taps, state.changed_scans),
            taps_max: archive.taps_max,
            counts: PutCounts::default(),
            shape,
            guard: FileGuard::new(archive.read_handle()?, &archive.path, &sync_errors)?,
            sync_errors,
            path: archive.path.clone(),
            plan: archive.plan.clone(),
            provenance: Provenance { reference: archive.reference.clone(), made_by: archive.made_by.clone() },
            is_results: archive.is_results(),
            archive: Some(archive),
        })
    }

    /// The plan whose archive this is.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The ledger as of the last flush, which no crash undoes.
    ///
    /// A tap is archived in it only when its samples *and* its discriminators, of one attempt, are in the file. Barriers and
    /// losses stay zero: the writer does not know them.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// When the last tap that was put was made, nanoseconds since the Unix epoch; 0 if there is none.
    pub(crate) fn last_tap_ns(&self) -> i64 {
        self.last_tap_ns
    }

    /// Counts of the records put so far.
    pub fn counts(&self) -> PutCounts {
        self.counts
    }

    /// Puts the discriminators of a tap; they wait for the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], or what the system returns.
    pub fn put_discriminators(&mut self, discriminators: &Discriminators) -> Result<PutOutcome> {
        let row = discriminators.plan_index;
        check_id(self.plan(), row, &discriminators.id)?;
        let discriminators_row = DiscriminatorsRow::from(discriminators).with_checksum(row as usize);
        let version = Version { attempt: discriminators.id.attempt, fingerprint: discriminators_row.checksum };
        let outcome = self.tracks[row as usize].outcome(Half::Discriminators, version);
        if outcome == PutOutcome::Stored {
            self.pending.discriminators.insert(row, discriminators_row);
            self.accept(row, Half::Discriminators, version);
        }
        self.count(outcome)
    }

    /// Puts the refusal of the tap of row `plan_index`, which will not come; it waits for the next flush.
    ///
    /// A reason longer than [`crate::REASON_BYTES`] is cut and ends in an ellipsis.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], or what the system returns.
    pub fn put_refusal(&mut self, plan_index: u32, id: &TapId, reason: &str) -> Result<PutOutcome> {
        check_id(self.plan(), plan_index, id)?;
        let outcome = self.tracks[plan_index as usize].refusal_outcome(id.attempt);
        if outcome == PutOutcome::Stored {
            self.tracks[plan_index as usize].refuse(id.attempt);
            self.pending.taps.insert(plan_index, self.tracks[plan_index as usize].to_row(false));
            self.pending.reasons.insert(plan_index, ReasonRow::new(reason));
        }
        self.count(outcome)
    }

    /// Notes that attempt `id.attempt` at the tap of row `plan_index` was unusable, because of the flags `quality`, and that
    /// another is to be made; this waits for the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], or what the system returns.
    pub fn put_retake(&mut self, plan_index: u32, id: &TapId, quality: Quality) -> Result<PutOutcome> {
        check_id(self.plan(), plan_index, id)?;
        let track = &mut self.tracks[plan_index as usize];
        let outcome = track.retake_outcome(id.attempt);
        if outcome == PutOutcome::Stored {
            track.retake(id.attempt, quality.bits());
            self.pending.taps.insert(plan_index, track.to_row(false));
        }
        self.count(outcome)
    }

    /// Notes that scan `scan` has ended; this waits for the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchScan`], or what the system returns.
    pub fn end_scan(&mut self, scan: u32) -> Result<PutOutcome> {
        check_scan(self.plan(), scan)?;
        let row = &mut self.scans[scan as usize];
        if row.state() != Some(ScanState::Open) {
            return self.count(PutOutcome::AlreadyThere);
        }
        row.state = ScanState::Ended.code().into();
        self.pending.scans.insert(scan, *row);
        self.count(PutOutcome::Stored)
    }

    /// Puts the verdict on scan `scan` and its damage map, one cell for each of the scan's locations in their order; they wait for
    /// the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchScan`], [`crate::Error::OtherCells`], or what the system returns.
    pub fn put_judgement(&mut self, scan: u32, judgement: &Judgement, cells: &[DamageCell]) -> Result<PutOutcome> {
        check_scan(self.plan(), scan)?;
        check_cells(self.plan(), scan, cells)?;
        let number = scan as usize;
        let planned = &self.plan.scans()[number];
        let cells: Vec<CellRow> = cells.iter().map(|cell| CellRow::new(scan, planned, cell)).collect();
        let row = self.scans[number].judged(judgement);
        let first = row.first_cell;
        let fingerprint = fingerprint(number, row, first as usize, &cells);
        let outcome = match self.scan_fingerprints[number] {
            None => PutOutcome::Stored,
            Some(archived) if archived == fingerprint => PutOutcome::AlreadyThere,
            Some(_) => PutOutcome::Conflict,
        };
        if outcome == PutOutcome::Stored {
            self.scan_fingerprints[number] = Some(fingerprint);
            self.scans[number] = row;
            self.pending.scans.insert(scan, row);
            self.pending.cells.extend((first..).zip(cells));
        }
        self.count(outcome)
    }

    /// Writes the waiting records and passes them to the system: from then on no crash of this program loses them.
    ///
    /// # Errors
    /// What the system returns, for example if the disk is full, or as [`Writer::check_file`]. The file is then abandoned, and the
    /// records still wait, for [`Writer::recover`].
    pub fn flush(&mut self) -> Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        self.check_file()?;
        let Some(archive) = &self.archive else { return Err(Error::Abandoned { path: self.path.clone() }) };
        let written = self.pending.flush(archive).and_then(|()| self.guard.note());
        written.inspect_err(|_| self.abandon())?;
        let pending = self.pending.take();
        for (&row, settled) in &pending.taps {
            self.ledger.set_tap(row as usize, settled.state().unwrap_or(TapState::Missing), settled.attempt);
        }
        for (&scan, row) in &pending.scans {
            self.ledger.set_scan(scan as usize, row.state().unwrap_or(ScanState::Open));
        }
        Ok(())
    }

    /// Notes where missing taps were lost and, if every scan is judged, the key of the results; flushes.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn settle(&mut self) -> Result<()> {
        let missing = (0..).zip(&self.tracks).filter(|(_, track)| track.state().0 == TapState::Missing);
        self.pending.taps.extend(missing.map(|(row, track)| (row, track.to_row(true))));
        self.flush()?;
        let archive = self.open()?;
        let written = if self.ledger.is_judged() { archive.write_key() } else { Ok(()) };
        written.inspect_err(|_| self.abandon())
    }

    /// Whether every tap is settled and every scan judged, as of the last flush.
    pub fn is_complete(&self) -> bool {
        self.ledger.is_judged() && self.ledger.count(TapState::Missing) == 0
    }

    /// Path of the archive.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether scan `scan` is judged, flushed or not.
    pub(crate) fn is_judged(&self, scan: u32) -> bool {
        self.scan_fingerprints[scan as usize].is_some()
    }

    pub(crate) fn accept(&mut self, row: u32, half: Half, version: Version) {
        let track = &mut self.tracks[row as usize];
        track.record(half, version);
        if track.state().0 == TapState::Archived {
            self.pending.taps.insert(row, track.to_row(false));
        }
    }

    pub(crate) fn count(&mut self, outcome: PutOutcome) -> Result<PutOutcome> {
        match outcome {
            PutOutcome::Stored => self.counts.stored += 1,
            PutOutcome::AlreadyThere => self.counts.already_there += 1,
            PutOutcome::Conflict => self.counts.conflicts += 1,
        }
        if self.pending.is_full() {
            self.flush()?;
        }
        Ok(outcome)
    }
}
