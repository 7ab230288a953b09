//! Writes an archive: a state machine that takes records in any order and settles each planned tap exactly once.
//!
//! # Why a crash costs nothing but the last batch
//!
//! After creation no structure of the file changes; every write lands in space that was allotted for that very row.
//! [`Writer::flush`] first writes what the rows hold and hands it to the system, then the states that vouch for them,
//! and hands over those. A writer that dies in between leaves rows whose state still says "missing": they are put
//! again, and overwrite themselves.

use std::collections::BTreeMap;
use std::path::Path;

use tapline_wire::{
    DamageCell, Discriminators, Judgement, Ledger, Plan, Quality, ScanState, TapHeader, TapId, TapState,
};

use crate::archive::{Access, Archive};
use crate::check::{check_cells, check_id, check_scan, check_shape};
use crate::chunk::padded;
use crate::create::create;
use crate::error::Context;
use crate::layout::{CellRow, DiscriminatorsRow, HeaderRow, LedgerRow, ReasonRow, ScanRow};
use crate::recall::recall;
use crate::rows::{at_attempt, fixed};
use crate::track::{Half, PutOutcome, Take, Track};
use crate::{Lineage, Result};

/// Rows that wait for a flush; one more and it is done unasked, so that memory stays bounded.
const PENDING_ROWS_MAX: usize = 4096;

/// Rows that one call of [`Writer::settled_from`] looks at.
const REPLAY_ROWS_MAX: usize = 4096;

/// How many records a writer was given, by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PutCounts {
    /// Taken in.
    pub stored: u64,
    /// Ignored, for they were there.
    pub already_there: u64,
    /// Ignored, for their tap or scan was settled with another record.
    pub conflicts: u64,
}

/// Rows that are to be written at the next flush.
#[derive(Debug, Default)]
struct Pending {
    headers: BTreeMap<u32, HeaderRow>,
    discriminators: BTreeMap<u32, DiscriminatorsRow>,
    reasons: BTreeMap<u32, ReasonRow>,
    cells: BTreeMap<u32, CellRow>,
    /// Rows that vouch for the others, written after them.
    taps: BTreeMap<u32, LedgerRow>,
    scans: BTreeMap<u32, ScanRow>,
}

impl Pending {
    fn is_empty(&self) -> bool {
        self.row_count() == 0
    }

    fn row_count(&self) -> usize {
        let halves = self.headers.len() + self.discriminators.len() + self.reasons.len();
        halves + self.cells.len() + self.taps.len() + self.scans.len()
    }
}

/// Writes the archive of one run.
///
/// Dropping a writer without [`Writer::finish`] is what a crash does: what was put since the last flush is lost.
#[derive(Debug)]
pub struct Writer {
    archive: Archive,
    tracks: Vec<Track>,
    scans: Vec<ScanRow>,
    scan_fingerprints: Vec<Option<u64>>,
    first_cells: Vec<usize>,
    pending: Pending,
    ledger: Ledger,
    counts: PutCounts,
    /// One row of samples, for records that are shorter than the row.
    scratch: Vec<u8>,
}

impl Writer {
    /// Begins the archive of `plan` at `path`; configuration and reference go into it verbatim.
    ///
    /// The file appears at `path` whole or not at all. It has its final length from the start, of which the system
    /// allots what is written.
    ///
    /// # Errors
    /// [`crate::Error::Exists`], [`crate::Error::EmptyRecording`], or what the system says.
    pub fn create<'a>(path: impl AsRef<Path>, plan: &Plan, lineage: impl Into<Lineage<'a>>) -> Result<Self> {
        let lineage = lineage.into();
        create(path.as_ref(), plan, lineage)?;
        Self::resume(path, plan, lineage)
    }

    /// Goes on with the archive at `path`, which must have been begun for the same plan, configuration and reference.
    ///
    /// # Errors
    /// [`crate::Error::NotHdf5`], [`crate::Error::NotAnArchive`], [`crate::Error::FormatVersion`], [`crate::Error::OtherPlan`],
    /// [`crate::Error::OtherConfiguration`], [`crate::Error::OtherReference`], [`crate::Error::InUse`], [`crate::Error::Damaged`], or what the system says.
    pub fn resume<'a>(path: impl AsRef<Path>, plan: &Plan, lineage: impl Into<Lineage<'a>>) -> Result<Self> {
        let path = path.as_ref();
        let archive = Archive::open(path, Access::Write)?;
        archive.check_same(plan, lineage.into())?;
        Self::of(archive)
    }

    /// Goes on with the archive at `path` or, where there is none, begins it.
    ///
    /// # Errors
    /// As [`Writer::create`] and [`Writer::resume`].
    pub fn open_or_create<'a>(path: impl AsRef<Path>, plan: &Plan, lineage: impl Into<Lineage<'a>>) -> Result<Self> {
        let path = path.as_ref();
        if path.try_exists().context("look for", path)? {
            Self::resume(path, plan, lineage)
        } else {
            Self::create(path, plan, lineage)
        }
    }

    fn of(archive: Archive) -> Result<Self> {
        let recalled = recall(&archive)?;
        Ok(Self {
            tracks: recalled.tracks,
            scans: recalled.scans,
            scan_fingerprints: recalled.scan_fingerprints,
            ledger: recalled.ledger,
            first_cells: archive.first_cells(),
            pending: Pending::default(),
            counts: PutCounts::default(),
            scratch: Vec::new(),
            archive,
        })
    }

    /// The plan whose archive this is.
    pub fn plan(&self) -> &Plan {
        &self.archive.plan
    }

    /// What no crash can take back: the ledger as of the last flush.
    ///
    /// A tap is archived in it only when its samples *and* its discriminators, of one attempt, are in the file.
    /// The writer knows nothing of barriers and losses: these entries stay zero.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// What became of the records given so far.
    pub fn counts(&self) -> PutCounts {
        self.counts
    }

    /// Takes in a tap: `samples` are written at once from where they lie; the header waits for the next flush.
    ///
    /// `samples` are the `[channel][sample]` bytes that `header` describes, in the machine's order; what lies behind
    /// them is ignored. A record that is shorter than the plan allows is copied once, to be padded with zeros.
    /// Samples are not compared with those that are there: two takes are told apart by their headers.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], [`crate::Error::OtherPlanRecord`], [`crate::Error::RecordShape`], or what the
    /// system says.
    pub fn put_tap(&mut self, header: &TapHeader, samples: &[u8]) -> Result<PutOutcome> {
        let row = header.plan_index;
        check_id(self.plan(), row, &header.id)?;
        check_shape(self.plan(), header, samples)?;
        let header_row = HeaderRow::from(header);
        let take = Take { attempt: header.id.attempt, fingerprint: header_row.fingerprint() };
        let outcome = self.tracks[row as usize].outcome(Half::Samples, take);
        if outcome == PutOutcome::Stored {
            self.write_samples(header, &samples[..header.payload_bytes()])?;
            self.pending.headers.insert(row, header_row);
            self.take(row, Half::Samples, take);
        }
        self.count(outcome)
    }

    /// Takes in what was found in a tap; it waits for the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], or what the system says.
    pub fn put_discriminators(&mut self, discriminators: &Discriminators) -> Result<PutOutcome> {
        let row = discriminators.plan_index;
        check_id(self.plan(), row, &discriminators.id)?;
        let discriminators_row = DiscriminatorsRow::from(discriminators);
        let take = Take { attempt: discriminators.id.attempt, fingerprint: discriminators_row.fingerprint() };
        let outcome = self.tracks[row as usize].outcome(Half::Discriminators, take);
        if outcome == PutOutcome::Stored {
            self.pending.discriminators.insert(row, discriminators_row);
            self.take(row, Half::Discriminators, take);
        }
        self.count(outcome)
    }

    /// Takes in that the tap of row `plan_index` will not come, and why; it waits for the next flush.
    ///
    /// A reason longer than [`crate::REASON_BYTES`] is cut and ends in an ellipsis.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], or what the system says.
    pub fn put_refusal(&mut self, plan_index: u32, id: &TapId, reason: &str) -> Result<PutOutcome> {
        check_id(self.plan(), plan_index, id)?;
        let outcome = self.tracks[plan_index as usize].refusal_outcome(id.attempt);
        if outcome == PutOutcome::Stored {
            self.tracks[plan_index as usize].refuse(id.attempt);
            self.pending.reasons.insert(plan_index, fixed(reason));
            self.pending.taps.insert(plan_index, LedgerRow::new(TapState::Refused, id.attempt));
        }
        self.count(outcome)
    }

    /// Takes in that attempt `id.attempt` at the tap of row `plan_index` was of no use and another is to be made; it
    /// waits for the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], or what the system says.
    pub fn put_retake(&mut self, plan_index: u32, id: &TapId) -> Result<PutOutcome> {
        check_id(self.plan(), plan_index, id)?;
        let track = &mut self.tracks[plan_index as usize];
        let outcome = track.retake_outcome(id.attempt);
        if outcome == PutOutcome::Stored {
            track.retake(id.attempt);
            let (state, attempt) = track.state();
            self.pending.taps.insert(plan_index, LedgerRow::new(state, attempt));
        }
        self.count(outcome)
    }

    /// Takes in that scan `scan` has ended; it waits for the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchScan`], or what the system says.
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

    /// Takes in the verdict on scan `scan` and its damage map, one cell for each of the scan's locations in their
    /// order; it waits for the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchScan`], [`crate::Error::OtherCells`], or what the system says.
    pub fn put_judgement(&mut self, scan: u32, judgement: &Judgement, cells: &[DamageCell]) -> Result<PutOutcome> {
        check_scan(self.plan(), scan)?;
        check_cells(self.plan(), scan, cells)?;
        let number = scan as usize;
        let planned = &self.archive.plan.scans()[number];
        let cells: Vec<CellRow> = cells.iter().map(|cell| CellRow::new(scan, planned, cell)).collect();
        let row = self.scans[number].judged(judgement);
        let fingerprint = row.fingerprint(&cells);
        let outcome = match self.scan_fingerprints[number] {
            None => PutOutcome::Stored,
            Some(there) if there == fingerprint => PutOutcome::AlreadyThere,
            Some(_) => PutOutcome::Conflict,
        };
        if outcome == PutOutcome::Stored {
            self.scan_fingerprints[number] = Some(fingerprint);
            self.scans[number] = row;
            self.pending.scans.insert(scan, row);
            let first = u32::try_from(self.first_cells[number]).unwrap_or(u32::MAX);
            self.pending.cells.extend((first..).zip(cells));
        }
        self.count(outcome)
    }

    /// Writes what waits and hands it to the system: from then on no crash of this program loses it.
    ///
    /// # Errors
    /// What the library says, for one when the disk is full; what waited still waits, and the next flush tries again.
    pub fn flush(&mut self) -> Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        let Self { archive, pending, ledger, .. } = self;
        write_contents(archive, pending).context("write what taps and scans hold", &archive.path)?;
        write_states(archive, pending).context("write what state taps and scans are in", &archive.path)?;
        for (&row, settled) in &pending.taps {
            ledger.set_tap(row as usize, settled.state().unwrap_or(TapState::Missing), settled.attempt);
        }
        for (&scan, row) in &pending.scans {
            ledger.set_scan(scan as usize, row.state().unwrap_or(ScanState::Open));
        }
        *pending = Pending::default();
        Ok(())
    }

    /// What was found in the taps from plan row `from` on, as far as this writer has it, for a stage that missed it:
    /// at most `most` records, and the row to go on from, `None` at the plan's end.
    ///
    /// Records that wait for a flush or for their samples are among them; a refused tap is a record of no values under
    /// [`Quality::REFUSED`]. A call looks at a bounded number of rows, so it may find none before the end.
    ///
    /// # Errors
    /// What the library says.
    pub fn settled_from(&self, from: u32, most: usize) -> Result<(Vec<Discriminators>, Option<u32>)> {
        let taps = self.archive.plan.taps();
        let first = (from as usize).min(taps.len());
        let last = (first + most.min(REPLAY_ROWS_MAX)).min(taps.len());
        let rows = self.archive.discriminators.read(first..last).context("read discriminators", &self.archive.path)?;
        let mut records = Vec::new();
        for (plan_index, row) in (from..).zip(rows) {
            let (track, planned) = (&self.tracks[plan_index as usize], &taps[plan_index as usize].id);
            let (state, attempt) = track.state();
            if state == TapState::Refused {
                records.push(refused(plan_index, at_attempt(*planned, attempt)));
            } else if track.has_discriminators() {
                let row = self.pending.discriminators.get(&plan_index).copied().unwrap_or(row);
                records.push(row.to_discriminators(planned));
            }
        }
        Ok((records, u32::try_from(last).ok().filter(|_| last < taps.len())))
    }

    /// Flushes, closes the archive and waits until it is on the disk, where a power cut cannot take it back.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn finish(mut self) -> Result<()> {
        self.flush()?;
        let path = self.archive.path.clone();
        drop(self);
        std::fs::File::open(&path).and_then(|file| file.sync_all()).context("sync", &path)
    }

    fn take(&mut self, row: u32, half: Half, take: Take) {
        let track = &mut self.tracks[row as usize];
        track.take(half, take);
        let (state, attempt) = track.state();
        if state == TapState::Archived {
            self.pending.taps.insert(row, LedgerRow::new(state, attempt));
        }
    }

    fn count(&mut self, outcome: PutOutcome) -> Result<PutOutcome> {
        match outcome {
            PutOutcome::Stored => self.counts.stored += 1,
            PutOutcome::AlreadyThere => self.counts.already_there += 1,
            PutOutcome::Conflict => self.counts.conflicts += 1,
        }
        if self.pending.row_count() > PENDING_ROWS_MAX {
            self.flush()?;
        }
        Ok(outcome)
    }

    fn write_samples(&mut self, header: &TapHeader, samples: &[u8]) -> Result<()> {
        let Self { archive, scratch, .. } = self;
        let channel_count = archive.plan.recording.channels.len();
        let bytes = padded(samples, channel_count, archive.samples.row_bytes(), scratch);
        archive.samples.write(header.plan_index, bytes).context("write samples", &archive.path)
    }
}

/// The record that stands for a refused tap.
fn refused(plan_index: u32, id: TapId) -> Discriminators {
    let quality = Quality::REFUSED;
    Discriminators { id, plan_index, quality, velocity_measured_m_per_s: f64::NAN, ..Discriminators::default() }
}

/// What the rows hold, on its way to the system before any state that vouches for it.
fn write_contents(archive: &Archive, pending: &Pending) -> hdf5::Result<()> {
    archive.headers.write(&pending.headers)?;
    archive.discriminators.write(&pending.discriminators)?;
    archive.refusals.write(&pending.reasons)?;
    archive.damage.write(&pending.cells)?;
    archive.file.flush()
}

fn write_states(archive: &Archive, pending: &Pending) -> hdf5::Result<()> {
    archive.ledger.write(&pending.taps)?;
    archive.scans.write(&pending.scans)?;
    archive.file.flush()
}
