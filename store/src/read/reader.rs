//! Reads an archive back, as the records that were put into it.

use std::path::Path;

use tapline_codec::Codec;
use tapline_wire::{
    DamageCell, Discriminators, Judgement, Ledger, Plan, Quality, Reasons, Samples, ScanState, TapHeader, TapId,
    TapState, Truth, Verdict,
};

use crate::archive::states::States;
use crate::archive::{Access, Archive};
use crate::error::{Context, Result};
use crate::format::checksum::ChecksummedRow;
use crate::format::fields::{at_attempt, text};
use crate::format::layout::LedgerRow;
use crate::format::lost::Lost;
use crate::read::samples::{ReadBuffer, SampleFile, Taps, checked_header};

/// The reason of a refused tap whose row is corrupt.
pub(crate) const REASON_LOST: &str = "refused, but the reason is lost: its row is damaged";

/// The samples of a tap, planar `[channel][sample]`, as recorded.
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

/// A refused tap.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// Row of the tap in the scan plan.
    pub plan_index: u32,
    /// Name of the tap, with the attempt that was refused.
    pub id: TapId,
    /// The reason.
    pub reason: String,
}

/// The verdict on a scan, and its damage map.
pub type Judged = (Judgement, Vec<DamageCell>);

/// Reads the archive of a casing.
///
/// Several readers may have an archive open, but not while a writer has.
#[derive(Debug)]
pub struct Reader {
    pub(crate) archive: Archive,
    ledger: Ledger,
    samples: SampleFile,
    /// Rows of the ledger; a corrupt row is replaced by that of a missing tap.
    states: Vec<LedgerRow>,
}

impl Reader {
    /// Opens the finished archive at `path`; its seal is checked before anything else.
    ///
    /// # Errors
    /// [`crate::Error::NotFinished`], [`crate::Error::NotHdf5`], [`crate::Error::NotAnArchive`],
    /// [`crate::Error::FormatVersion`], [`crate::Error::InUse`], [`crate::Error::Damaged`], or what the system returns.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::new(Archive::open(path.as_ref(), Access::Read)?)
    }

    /// Opens the archive at `path`, finished or not, unless a writer has it open. The structure of an unfinished archive is checked
    /// before anything else; a corrupt row counts as a missing tap or an open scan.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn open_unfinished(path: impl AsRef<Path>) -> Result<Self> {
        Self::new(Archive::open(path.as_ref(), Access::ReadUnfinished)?)
    }

    fn new(archive: Archive) -> Result<Self> {
        let states = States::load(&archive, |_| false)?;
        let (ledger, samples) = (states.ledger(&archive), SampleFile::open(&archive)?);
        Ok(Self { archive, ledger, samples, states: states.taps })
    }

    /// Whether the archive is finished, so that it never changes.
    pub fn is_finished(&self) -> bool {
        self.archive.is_finished
    }

    /// Path of the archive.
    pub fn path(&self) -> &Path {
        &self.archive.path
    }

    /// The scan plan.
    pub fn plan(&self) -> &Plan {
        &self.archive.plan
    }

    /// The configuration, verbatim.
    pub fn config(&self) -> &str {
        &self.archive.config
    }

    /// Version of the program that created the archive; `None` if it gives none.
    pub fn written_by(&self) -> Option<String> {
        self.archive.written_by()
    }

    /// The reference file of the run, verbatim; `None` if it had none.
    pub fn reference(&self) -> Option<&str> {
        self.archive.reference.as_deref()
    }

    /// What computed the results: digests of the program's sources and every option, one per line.
    pub fn made_by(&self) -> &str {
        &self.archive.made_by
    }

    /// BLAKE3 of what was recorded in the archived taps.
    ///
    /// # Errors
    /// What the system returns.
    pub fn raw_digest(&self) -> Result<[u8; 32]> {
        self.archive.raw_digest()
    }

    /// The key of the present results: [`crate::lineage_key`] of the recorded taps, of what computed the results, and of the
    /// reference.
    ///
    /// # Errors
    /// What the system returns.
    pub fn lineage_key(&self) -> Result<String> {
        self.archive.key()
    }

    /// Whether this archive has only results, of the taps of another.
    pub fn is_results(&self) -> bool {
        self.archive.is_results()
    }

    /// Where cracks are; empty if that is unknown.
    pub fn truth(&self) -> &Truth {
        self.plan().truth()
    }

    /// State of every tap and scan; barriers and losses, which are not archived, are zero.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// The attempt that settled the tap in plan row `row`; `None` if it is missing or there is no such row.
    pub fn attempt(&self, row: u32) -> Option<u16> {
        let is_settled = self.ledger.taps().get(row as usize)?.is_settled();
        is_settled.then(|| self.ledger.attempt(row as usize))
    }

    /// Number of unusable attempts at the tap in plan row `row`, and the flags of the last of them; `None` if there were none.
    pub fn retaken(&self, row: u32) -> Option<(u32, Quality)> {
        let row = self.states.get(row as usize).filter(|row| row.retaken_count > 0)?;
        Some((row.retaken_count, Quality::from_bits_retain(row.retaken_quality)))
    }

    /// Where the tap in plan row `row` was lost; `None` if it is not missing.
    pub fn lost_at(&self, row: u32) -> Option<Lost> {
        let row = self.states.get(row as usize).filter(|row| row.state() == Some(TapState::Missing))?;
        Some(Lost::from_code(row.lost_at).unwrap_or_default())
    }

    /// The tap in plan row `row`, bit for bit; `None` if it is not archived or there is no such row.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`] if a checksum differs, or what the system returns.
    pub fn tap(&self, row: u32) -> Result<Option<(TapHeader, OwnedSamples)>> {
        let k = row as usize;
        if self.ledger.taps().get(k) != Some(&TapState::Archived) {
            return Ok(None);
        }
        let archive = &self.archive;
        let rows = archive.headers.read(k..k + 1).context("read a header", &archive.path)?;
        let header = checked_header(&archive.path, &archive.plan, row, rows[0])?;
        let mut buffer = ReadBuffer::default();
        let location = self.samples.location(row)?;
        let samples = match self.samples.read(&header, rows[0].stored_checksum, location, false, &mut buffer)? {
            Samples::I16(samples) => OwnedSamples::I16(samples.to_vec()),
            Samples::F32(samples) => OwnedSamples::F32(samples.to_vec()),
        };
        Ok(Some((header, samples)))
    }

    /// All archived taps, for several threads.
    ///
    /// # Errors
    /// What the system returns.
    pub fn taps(&self) -> Result<Taps> {
        Taps::new(&self.archive, self.ledger.taps())
    }

    /// The codec of the samples.
    pub fn codec(&self) -> Codec {
        self.archive.samples.codec()
    }

    /// The headers of all planned taps, by plan row; `None` for a tap that is not archived.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`] if a checksum differs, or what the system returns.
    pub fn headers(&self) -> Result<Vec<Option<TapHeader>>> {
        let archive = &self.archive;
        let rows = archive.headers.read_all().context("read the headers", &archive.path)?;
        let header = |row: u32| checked_header(&archive.path, &archive.plan, row, rows[row as usize]);
        (0..).zip(self.ledger.taps()).map(|(row, state)| archived(*state).then(|| header(row)).transpose()).collect()
    }

    /// The discriminators of all planned taps, by plan row; `None` for a tap that is not archived.
    ///
    /// # Errors
    /// What the system returns.
    pub fn discriminators(&self) -> Result<Vec<Option<Discriminators>>> {
        let archive = &self.archive;
        let rows = archive.discriminators.read_all().context("read the discriminators", &archive.path)?;
        let found = |row: u32| {
            let k = row as usize;
            let found = valid(archive, k, rows[k])?.to_discriminators(&archive.plan.taps()[k].id);
            Ok(Discriminators { plan_index: row, ..found })
        };
        (0..).zip(self.ledger.taps()).map(|(row, state)| archived(*state).then(|| found(row)).transpose()).collect()
    }

    /// The refused taps, in plan order; the reason of a corrupt row says so.
    ///
    /// # Errors
    /// What the system returns.
    pub fn refusals(&self) -> Result<Vec<Refusal>> {
        let mut refusals = Vec::new();
        for (row, planned) in (0..).zip(self.plan().taps()) {
            if self.ledger.taps()[row as usize] == TapState::Refused {
                let id = at_attempt(planned.id, self.ledger.attempt(row as usize));
                refusals.push(Refusal { plan_index: row, id, reason: self.reason(row)? });
            }
        }
        Ok(refusals)
    }

    /// Why the tap in plan row `row` was refused; empty if it was not, or if there is no such row.
    ///
    /// # Errors
    /// What the system returns.
    pub fn reason(&self, row: u32) -> Result<String> {
        if row as usize >= self.plan().taps().len() {
            return Ok(String::new());
        }
        Ok(reason(&self.archive, row as usize)?.unwrap_or_else(|| REASON_LOST.to_owned()))
    }

    /// Verdict and damage map of every scan, by scan number; `None` for a scan that is not judged. The stamp of a judgement has
    /// only what does not depend on how it was sent.
    ///
    /// # Errors
    /// What the system returns.
    pub fn judgements(&self) -> Result<Vec<Option<Judged>>> {
        let archive = &self.archive;
        let rows = archive.scans.read_all().context("read the scans", &archive.path)?;
        let judged = |scan: u32| {
            let k = scan as usize;
            let cells = archive.damage.read(archive.cells(k)).context("read a damage map", &archive.path)?;
            let judgement = valid(archive, k, rows[k])?.to_judgement(scan);
            let cells = archive.cells(k).zip(cells).map(|(k, cell)| Ok(valid(archive, k, cell)?.to_cell()));
            Ok((judgement, cells.collect::<Result<_>>()?))
        };
        let is_judged = |state: &ScanState| *state == ScanState::Judged;
        (0..).zip(self.ledger.scans()).map(|(scan, state)| is_judged(state).then(|| judged(scan)).transpose()).collect()
    }

    /// Verdict and reasons of scan `scan`, of which `judged` is known. Without a verdict it is never PASS: someone must look at it.
    pub fn verdict(&self, scan: usize, judged: Option<&Judged>) -> (Verdict, Reasons) {
        let known = judged.and_then(|(judgement, _)| Some((Verdict::from_code(judgement.verdict)?, judgement.reasons)));
        let is_open = self.ledger.scans().get(scan) == Some(&ScanState::Open);
        known.unwrap_or((Verdict::ReInspect, if is_open { Reasons::NOT_ENDED } else { Reasons::NO_INDEX }))
    }
}

fn archived(state: TapState) -> bool {
    state == TapState::Archived
}

/// `row`, if its checksum is valid for row `number` of its table.
fn valid<R: ChecksummedRow>(archive: &Archive, number: usize, row: R) -> Result<R> {
    if row.is_valid(number) {
        return Ok(row);
    }
    let what = format!("row {number} of its table {:?} is not what was written: its checksum differs", R::TABLE);
    Err(archive.damaged(what))
}

/// Why the tap in row `k` was refused; `None` if the row is corrupt or cannot be read.
fn reason(archive: &Archive, k: usize) -> Result<Option<String>> {
    let rows = match archive.refusals.read(k..k + 1).context("read a reason", &archive.path) {
        Err(error) if error.is_unreadable_part() => return Ok(None),
        rows => rows?,
    };
    Ok(rows.first().filter(|row| row.is_valid(k)).and_then(|row| text(&row.reason)).map(str::to_owned))
}
