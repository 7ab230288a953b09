//! Writes an archive: a state machine that takes records in any order and settles each planned tap exactly once.
//!
//! # Why a crash costs nothing but the last batch
//!
//! After creation every row of every table has its place, and every chunk of samples its entry in the index. Rows are
//! written where they lie; a packed chunk takes room at the end, and its entry changes where it stands, with the next flush.
//! [`Writer::flush`] first writes what the rows hold and hands it to the system, then the states that vouch for them,
//! and hands over those. A writer that dies in between leaves rows whose state still says "missing": they are put
//! again, and overwrite themselves. A file that cannot be written is left as such a writer leaves it: see [`Writer::recover`].

use std::path::{Path, PathBuf};

use tapline_wire::{
    DamageCell, Discriminators, Judgement, Ledger, Plan, Quality, ScanState, TapHeader, TapId, TapState,
};

use crate::archive::{Access, Archive};
use crate::behind::Failures;
use crate::check::{check_cells, check_id, check_scan, check_shape};
use crate::context::Context;
use crate::create::create;
use crate::encode::{Packer, Shape};
use crate::layout::{CellRow, DiscriminatorsRow, HeaderRow, ReasonRow, ScanRow};
use crate::pending::Pending;
use crate::place::Place;
use crate::recall::recall;
use crate::track::{Half, PutCounts, PutOutcome, Take, Track};
use crate::{Error, Lineage, Result};

/// What an archive was begun with, to know it again by.
#[derive(Debug)]
pub(crate) struct Kept {
    pub(crate) config: String,
    pub(crate) reference: Option<String>,
    pub(crate) made_by: String,
}

/// Writes the archive of one run.
///
/// Dropping a writer without [`Writer::finish`] is what a crash does: what was put since the last flush is lost.
#[derive(Debug)]
pub struct Writer {
    pub(crate) path: PathBuf,
    pub(crate) plan: Plan,
    pub(crate) kept: Kept,
    pub(crate) place: Place,
    pub(crate) failures: Failures,
    /// Whether nothing is left to do to the file, and it was closed.
    pub(crate) is_closed: bool,
    /// `None` after it could not be written, or is closed.
    pub(crate) archive: Option<Archive>,
    is_results: bool,
    pub(crate) tracks: Vec<Track>,
    pub(crate) scans: Vec<ScanRow>,
    scan_fingerprints: Vec<Option<u64>>,
    first_cells: Vec<usize>,
    pub(crate) pending: Pending,
    pub(crate) ledger: Ledger,
    counts: PutCounts,
    pub(crate) packer: Packer,
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
    /// [`crate::Error::OtherConfiguration`], [`crate::Error::OtherReference`], [`crate::Error::OfflineCodec`],
    /// [`crate::Error::InUse`], [`crate::Error::Damaged`], or what the system says.
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

    pub(crate) fn of(archive: Archive) -> Result<Self> {
        let (recording, codec) = (&archive.plan.recording, archive.samples.codec());
        if !codec.is_for_lines() && !archive.is_results() {
            return Err(Error::OfflineCodec { path: archive.path.clone(), codec });
        }
        let packer = Packer::new(Shape {
            codec,
            seal: archive.chunk_seal,
            channel_count: recording.channels.len(),
            element_bytes: recording.sample_format.bytes(),
            row_bytes: archive.samples.row_bytes(),
        });
        let (recalled, failures) = (recall(&archive)?, Failures::default());
        Ok(Self {
            tracks: recalled.tracks,
            scans: recalled.scans,
            scan_fingerprints: recalled.scan_fingerprints,
            ledger: recalled.ledger,
            first_cells: archive.first_cells(),
            pending: Pending::of_mended(recalled.mended_taps, recalled.mended_reasons, recalled.mended_scans),
            counts: PutCounts::default(),
            packer,
            place: Place::of(&archive.file, &archive.path, &failures)?,
            failures,
            is_closed: false,
            path: archive.path.clone(),
            plan: archive.plan.clone(),
            kept: Kept {
                config: archive.config.clone(),
                reference: archive.reference.clone(),
                made_by: archive.made_by.clone(),
            },
            is_results: archive.is_results(),
            archive: Some(archive),
        })
    }

    /// The plan whose archive this is.
    pub fn plan(&self) -> &Plan {
        &self.plan
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

    /// Takes in a tap, as [`Writer::put_taps`] does.
    ///
    /// # Errors
    /// As [`Writer::put_taps`].
    pub fn put_tap(&mut self, header: &TapHeader, samples: &[u8]) -> Result<PutOutcome> {
        Ok(self.put_taps(&[(header, samples)])?[0])
    }

    /// Takes in taps: their samples are packed by as many threads as there are cores and written at once; their headers wait
    /// for the next flush.
    ///
    /// The samples of a tap are the `[channel][sample]` bytes that its header describes, in the machine's order; what lies
    /// behind them is ignored. Where nothing packs them they go to the file from where they lie; a record that is shorter
    /// than the plan allows is copied once, to be padded with zeros.
    /// Samples are not compared with those that are there: two takes are told apart by their headers.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], [`crate::Error::OtherPlanRecord`],
    /// [`crate::Error::RecordShape`], or what the system says: the file is then let go of, none of the taps is taken in, and
    /// after [`Writer::recover`] the same call may be made again.
    pub fn put_taps(&mut self, taps: &[(&TapHeader, &[u8])]) -> Result<Vec<PutOutcome>> {
        if self.is_results {
            return Err(Error::ResultsAlone { path: self.path.clone() });
        }
        for (header, samples) in taps {
            check_id(self.plan(), header.plan_index, &header.id)?;
            check_shape(self.plan(), header, samples)?;
        }
        self.check_place()?;
        let mut outcomes = Vec::with_capacity(taps.len());
        let mut rest = taps;
        while !rest.is_empty() {
            // A tap that comes twice is judged by what became of it the first time.
            let repeated = |k: &usize| rest[..*k].iter().any(|(header, _)| header.plan_index == rest[*k].0.plan_index);
            let (now, later) = rest.split_at((1..rest.len()).find(repeated).unwrap_or(rest.len()));
            self.put_different(now, &mut outcomes)?;
            rest = later;
        }
        Ok(outcomes)
    }

    /// Takes in taps of different plan rows.
    fn put_different(&mut self, taps: &[(&TapHeader, &[u8])], outcomes: &mut Vec<PutOutcome>) -> Result<()> {
        let rows: Vec<HeaderRow> = taps.iter().map(|(header, _)| HeaderRow::from(*header)).collect();
        let take = |row: &HeaderRow| Take { attempt: row.attempt, fingerprint: row.fingerprint() };
        let outcome = |row: &HeaderRow| self.tracks[row.plan_index as usize].outcome(Half::Samples, take(row));
        let now: Vec<PutOutcome> = rows.iter().map(outcome).collect();
        let is_new = |k: &usize| now[*k] == PutOutcome::Stored;
        let samples: Vec<&[u8]> =
            (0..taps.len()).filter(is_new).map(|k| &taps[k].1[..taps[k].0.payload_bytes()]).collect();
        (0..taps.len()).filter(is_new).for_each(|k| self.place.forget(rows[k].plan_index));
        let new_rows: Vec<&HeaderRow> = (0..taps.len()).filter(is_new).map(|k| &rows[k]).collect();
        let mut headers = Vec::with_capacity(samples.len());
        let written = self.packer.pack(&samples, |number, packed| {
            let Some(archive) = &self.archive else { return Err(Error::LetGo { path: self.path.clone() }) };
            let (row, stored) = (new_rows[number], packed.stored(samples[number]));
            archive.samples.write(row.plan_index, stored).context("write samples", &self.path)?;
            let (samples_digest, stored_checksum) = (packed.samples_digest, packed.stored_checksum);
            headers.push(HeaderRow { samples_digest, stored_checksum, ..*row });
            Ok(())
        });
        let packed = match written {
            Ok(packed) => packed,
            Err(error) => {
                self.let_go();
                return Err(error);
            }
        };
        // All are written: only now they take the place of earlier attempts.
        for ((header, packed), samples) in headers.iter().zip(packed).zip(samples) {
            let stored = packed.give(samples, self.pending.room());
            self.place.note_written(stored.len());
            self.pending.keep(header.plan_index, stored);
        }
        for header in headers {
            self.pending.headers.insert(header.plan_index, header);
            self.take(header.plan_index, Half::Samples, take(&header));
        }
        now.into_iter().try_for_each(|outcome| self.count(outcome).map(|counted| outcomes.push(counted)))
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
            self.pending.taps.insert(plan_index, self.tracks[plan_index as usize].to_row(false));
        }
        if outcome == PutOutcome::Stored || self.pending.reasons.get(&plan_index).is_some_and(ReasonRow::is_lost) {
            self.pending.reasons.insert(plan_index, ReasonRow::new(reason));
        }
        self.count(outcome)
    }

    /// Takes in that attempt `id.attempt` at the tap of row `plan_index` was of no use, for the flags `quality`, and another is
    /// to be made; it waits for the next flush.
    ///
    /// # Errors
    /// [`crate::Error::NoSuchRow`], [`crate::Error::OtherTap`], or what the system says.
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
        let planned = &self.plan.scans()[number];
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
    /// What the system says, for one when the disk is full, or as [`Writer::check_place`]. The file is then let go of, and what
    /// waited still waits, for [`Writer::recover`].
    pub fn flush(&mut self) -> Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        self.check_place()?;
        let Some(archive) = &self.archive else { return Err(Error::LetGo { path: self.path.clone() }) };
        let written =
            self.pending.flush(archive).and_then(|()| self.place.note(&archive.samples, self.pending.samples()));
        written.inspect_err(|_| self.let_go())?;
        let pending = self.pending.take();
        for (&row, settled) in &pending.taps {
            self.ledger.set_tap(row as usize, settled.state().unwrap_or(TapState::Missing), settled.attempt);
        }
        for (&scan, row) in &pending.scans {
            self.ledger.set_scan(scan as usize, row.state().unwrap_or(ScanState::Open));
        }
        Ok(())
    }

    /// Writes down where missing taps were lost, and, where all is judged, the key of the results; then flushes.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn settle(&mut self) -> Result<()> {
        let missing = (0..).zip(&self.tracks).filter(|(_, track)| track.state().0 == TapState::Missing);
        self.pending.taps.extend(missing.map(|(row, track)| (row, track.to_row(true))));
        self.flush()?;
        let archive = self.open()?;
        let written = if self.is_judged() { archive.write_key() } else { Ok(()) };
        written.inspect_err(|_| self.let_go())
    }

    /// Does what [`Writer::settle`] does, closes the archive and waits until it is on the disk, where a power cut cannot take
    /// it back.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn finish(mut self) -> Result<()> {
        self.settle()?;
        self.close()
    }

    fn take(&mut self, row: u32, half: Half, take: Take) {
        let track = &mut self.tracks[row as usize];
        track.take(half, take);
        if track.state().0 == TapState::Archived {
            self.pending.taps.insert(row, track.to_row(false));
        }
    }

    fn count(&mut self, outcome: PutOutcome) -> Result<PutOutcome> {
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
