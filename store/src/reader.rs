//! Reads an archive back, as the records that were put into it.

use std::path::Path;

use tapline_wire::{
    DamageCell, Discriminators, Judgement, Ledger, Plan, Quality, Samples, ScanState, TapHeader, TapId, TapState, Truth,
};

use crate::archive::{Access, Archive, read_text};
use crate::error::Context;
use crate::layout::{LedgerRow, ScanRow, attribute};
use crate::lineage::raw_digest;
use crate::rows::{at_attempt, text};
use crate::samples::{Room, SampleFile, Taps, checked_header};
use crate::sealed::SealedRow;
use crate::{Codec, Lineage, Lost, Result};

/// The samples of a tap, planar `[channel][sample]`, as the converter gave them.
#[derive(Debug, Clone, PartialEq)]
pub enum OwnedSamples {
    /// Converter counts.
    I16(Vec<i16>),
    /// Floating point.
    F32(Vec<f32>),
}

impl OwnedSamples {
    /// The samples, borrowed.
    pub fn as_samples(&self) -> Samples<'_> {
        match self {
            Self::I16(samples) => Samples::I16(samples),
            Self::F32(samples) => Samples::F32(samples),
        }
    }
}

/// A planned tap that will not come.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// Row of the tap in the scan plan.
    pub plan_index: u32,
    /// Name of the tap, with the attempt that was refused.
    pub id: TapId,
    /// Why.
    pub reason: String,
}

/// The verdict on a scan, and its damage map.
pub type Judged = (Judgement, Vec<DamageCell>);

/// An archive that is read.
///
/// Readers share an archive with one another, not with a writer.
#[derive(Debug)]
pub struct Reader {
    archive: Archive,
    ledger: Ledger,
    samples: SampleFile,
    /// Rows of the ledger as they are in the file.
    states: Vec<LedgerRow>,
}

impl Reader {
    /// Opens the archive at `path`, whole or left by a writer that died.
    ///
    /// # Errors
    /// [`crate::Error::NotHdf5`], [`crate::Error::NotAnArchive`], [`crate::Error::FormatVersion`],
    /// [`crate::Error::InUse`], [`crate::Error::Damaged`], or what the system says.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let archive = Archive::open(path.as_ref(), Access::Read)?;
        let (tap_count, scan_count) = (archive.plan.taps().len(), archive.plan.scans().len());
        let mut ledger = Ledger::empty(tap_count, scan_count, archive.plan.stations().len());
        let states = archive.ledger.read_all().context("read the ledger", &archive.path)?;
        for (k, row) in states.iter().enumerate() {
            let (state, attempt) = settled(&archive, k, row)?;
            ledger.set_tap(k, state, attempt);
        }
        for (k, row) in archive.scans.read_all().context("read the scans", &archive.path)?.into_iter().enumerate() {
            ledger.set_scan(k, scan_state(&archive, k, &row)?);
        }
        let samples = SampleFile::open(&archive)?;
        Ok(Self { archive, ledger, samples, states })
    }

    /// Checks that this is the archive of `plan`, begun with the configuration and the reference of `lineage`.
    ///
    /// # Errors
    /// [`crate::Error::OtherPlan`], [`crate::Error::OtherConfiguration`] and [`crate::Error::OtherReference`].
    pub fn check_same<'a>(&self, plan: &Plan, lineage: impl Into<Lineage<'a>>) -> Result<()> {
        self.archive.check_same(plan, lineage.into())
    }

    pub(crate) fn archive(&self) -> &Archive {
        &self.archive
    }

    /// Where the archive is.
    pub fn path(&self) -> &Path {
        &self.archive.path
    }

    /// The scan plan, as it was given to the writer.
    pub fn plan(&self) -> &Plan {
        &self.archive.plan
    }

    /// The configuration, verbatim.
    pub fn config(&self) -> &str {
        &self.archive.config
    }

    /// Version of the program that created the archive; `None` where it does not say.
    pub fn written_by(&self) -> Option<String> {
        read_text(&self.archive.file, attribute::TAPLINE_VERSION).ok()
    }

    /// The reference file of the run, verbatim; `None` where it had none.
    pub fn reference(&self) -> Option<&str> {
        self.archive.reference.as_deref()
    }

    /// What the results were made by: digests of the program's sources and every option, a line each.
    pub fn made_by(&self) -> &str {
        &self.archive.made_by
    }

    /// BLAKE3 of all that was recorded in the archived taps.
    ///
    /// # Errors
    /// What the system says.
    pub fn raw_digest(&self) -> Result<[u8; 32]> {
        raw_digest(&self.archive)
    }

    /// The key of the results as they are: [`crate::lineage_key`] of the recorded taps, what made the results, and the reference.
    ///
    /// # Errors
    /// What the system says.
    pub fn lineage_key(&self) -> Result<String> {
        self.archive.key()
    }

    /// Whether this archive has results alone, of the taps of another.
    pub fn is_results(&self) -> bool {
        self.archive.is_results()
    }

    /// What is known of where cracks are; empty where nothing is.
    pub fn truth(&self) -> &Truth {
        self.archive.plan.truth()
    }

    /// State of every tap and scan; barriers and losses are not archived and zero.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// The attempt that settled the tap in plan row `row`, `None` when it is missing or there is no such row.
    pub fn attempt(&self, row: u32) -> Option<u16> {
        let is_settled = self.ledger.taps().get(row as usize)?.is_settled();
        is_settled.then(|| self.ledger.attempt(row as usize))
    }

    /// Why and how often the tap in plan row `row` was taken again before the attempt that counts, as the flags of the last
    /// attempt that was of no use; `None` where it never was.
    pub fn retaken(&self, row: u32) -> Option<(u32, Quality)> {
        let row = self.states.get(row as usize).filter(|row| row.retaken_count > 0)?;
        Some((row.retaken_count, Quality::from_bits(row.retaken_quality)))
    }

    /// Where the tap in plan row `row` was lost; `None` where it is not missing.
    pub fn lost_at(&self, row: u32) -> Option<Lost> {
        let is_missing = self.ledger.taps().get(row as usize) == Some(&TapState::Missing);
        self.states.get(row as usize).filter(|_| is_missing).map(|row| Lost::from_code(row.lost_at).unwrap_or_default())
    }

    /// The tap in plan row `row`, bit for bit; `None` when it is not archived or there is no such row.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`] where a checksum differs, or what the system says.
    pub fn tap(&self, row: u32) -> Result<Option<(TapHeader, OwnedSamples)>> {
        let k = row as usize;
        if self.ledger.taps().get(k) != Some(&TapState::Archived) {
            return Ok(None);
        }
        let rows = self.archive.headers.read(k..k + 1).context("read a header", &self.archive.path)?;
        let header = checked_header(&self.archive.path, self.plan(), row, rows[0])?;
        let mut room = Room::default();
        let place = self.samples.place(row)?;
        let samples = match self.samples.read(&header, rows[0].stored_checksum, place, &mut room)? {
            Samples::I16(samples) => OwnedSamples::I16(samples.to_vec()),
            Samples::F32(samples) => OwnedSamples::F32(samples.to_vec()),
        };
        Ok(Some((header, samples)))
    }

    /// All archived taps, for readers that share the work between threads.
    ///
    /// # Errors
    /// What the system says.
    pub fn taps(&self) -> Result<Taps> {
        Taps::of(&self.archive, self.ledger.taps())
    }

    /// What packs the samples.
    pub fn codec(&self) -> Codec {
        self.archive.samples.codec()
    }

    /// The headers of all planned taps, by plan row; `None` where the tap is not archived.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`] where a checksum differs, or what the system says.
    pub fn headers(&self) -> Result<Vec<Option<TapHeader>>> {
        let mut headers = Vec::with_capacity(self.ledger.taps().len());
        let rows = self.archive.headers.read_all().context("read the headers", &self.archive.path)?;
        for ((number, row), state) in (0..).zip(rows).zip(self.ledger.taps()) {
            let is_there = *state == TapState::Archived;
            headers.push(match is_there {
                true => Some(checked_header(&self.archive.path, self.plan(), number, row)?),
                false => None,
            });
        }
        Ok(headers)
    }

    /// What was found in every planned tap, by plan row; `None` where the tap is not archived.
    ///
    /// # Errors
    /// What the system says.
    pub fn discriminators(&self) -> Result<Vec<Option<Discriminators>>> {
        let mut found = Vec::with_capacity(self.ledger.taps().len());
        let taps = self.plan().taps();
        let rows = self.archive.discriminators.read_all().context("read the discriminators", &self.archive.path)?;
        for ((k, row), state) in rows.into_iter().enumerate().zip(self.ledger.taps()) {
            found.push(match state {
                TapState::Archived => Some(self.whole(k, row)?.to_discriminators(&taps[k].id)),
                TapState::Missing | TapState::Refused => None,
            });
        }
        Ok(found)
    }

    /// Why taps were refused, in plan order.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], or what the system says.
    pub fn refusals(&self) -> Result<Vec<Refusal>> {
        let mut refusals = Vec::new();
        for (row, planned) in (0..).zip(self.plan().taps()) {
            let k = row as usize;
            if self.ledger.taps()[k] == TapState::Refused {
                let reasons = self.archive.refusals.read(k..k + 1).context("read a reason", &self.archive.path)?;
                let row_of_reason = self.whole(k, reasons[0])?;
                let reason = text(&row_of_reason.reason)
                    .ok_or_else(|| self.archive.damaged(format!("the reason in row {row} is not UTF-8")))?;
                let id = at_attempt(planned.id, self.ledger.attempt(k));
                refusals.push(Refusal { plan_index: row, id, reason: reason.to_owned() });
            }
        }
        Ok(refusals)
    }

    /// Verdict and damage map of every scan, by scan number; `None` where it is not judged.
    ///
    /// Of a judgement's stamp only what does not depend on how it was sent is archived.
    ///
    /// # Errors
    /// What the system says.
    pub fn judgements(&self) -> Result<Vec<Option<Judged>>> {
        let rows = self.archive.scans.read_all().context("read the scans", &self.archive.path)?;
        let first_cells = self.archive.first_cells();
        let mut judgements = Vec::with_capacity(rows.len());
        for (number, row) in (0..).zip(rows) {
            let k = number as usize;
            if self.ledger.scans()[k] != ScanState::Judged {
                judgements.push(None);
                continue;
            }
            let cells = self.archive.damage.read(first_cells[k]..first_cells[k + 1]);
            let cells = cells.context("read a damage map", &self.archive.path)?;
            let judgement = row.to_judgement(number, self.plan().digest());
            let cells =
                cells.into_iter().enumerate().map(|(n, cell)| Ok(self.whole(first_cells[k] + n, cell)?.to_cell()));
            judgements.push(Some((judgement, cells.collect::<Result<_>>()?)));
        }
        Ok(judgements)
    }

    /// `row` as row `number` of its table, if it is what was written.
    fn whole<R: SealedRow>(&self, number: usize, row: R) -> Result<R> {
        if row.is_whole(number) {
            return Ok(row);
        }
        let what = format!("row {number} of its table {:?} is not what was written: its checksum differs", R::TABLE);
        Err(self.archive.damaged(what))
    }
}

/// State and attempt of the tap in row `k` of the ledger.
///
/// A row whose checksum differs was being written when its writer was killed, or was damaged later: the tap counts as missing,
/// so that it is taken again.
pub(crate) fn settled(archive: &Archive, k: usize, row: &LedgerRow) -> Result<(TapState, u16)> {
    if !row.is_whole(k) {
        tracing::warn!(row = k, "the ledger's row is torn; the tap counts as missing");
        return Ok((TapState::Missing, 0));
    }
    let unknown = || archive.damaged(format!("row {k} of its ledger has state {}", row.state));
    Ok((row.state().ok_or_else(unknown)?, row.attempt))
}

/// State of scan `k`; one whose row is torn is open.
pub(crate) fn scan_state(archive: &Archive, k: usize, row: &ScanRow) -> Result<ScanState> {
    if !row.is_whole(k) {
        tracing::warn!(scan = k, "the scan's row is torn; it counts as open");
        return Ok(ScanState::Open);
    }
    row.state().ok_or_else(|| archive.damaged(format!("scan {k} has state {}", row.state)))
}
