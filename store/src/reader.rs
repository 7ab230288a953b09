//! Reads an archive back, as the records that were put into it.

use std::path::{Path, PathBuf};

use tapline_wire::{
    DamageCell, Discriminators, Judgement, Ledger, Plan, Quality, Samples, ScanState, TapHeader, TapId, TapState, Truth,
};

use crate::archive::{Archive, read_text};
use crate::context::Context;
use crate::layout::{LedgerRow, attribute};
use crate::lineage::{digest_of, lineage_key, raw_digest};
use crate::parts::{PartMap, open_all};
use crate::reason::{REASON_LOST, reason};
use crate::rows::at_attempt;
use crate::samples::{Room, SampleFile, Taps, checked_header};
use crate::sealed::SealedRow;
use crate::settled::take_stock;
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

/// The archive of a run that is read: one file, or all those of a folder.
///
/// Readers share an archive with one another, not with a writer.
#[derive(Debug)]
pub struct Reader {
    path: PathBuf,
    /// The files of the run; the first has the plan of all of it.
    archives: Vec<Archive>,
    map: PartMap,
    ledger: Ledger,
    samples: Vec<SampleFile>,
    /// Rows of the ledgers, those that are torn as what they count as.
    states: Vec<Vec<LedgerRow>>,
    torn_row_count: usize,
    torn_reason_count: usize,
}

impl Reader {
    /// Opens the archive at `path`, whole or left by a writer that died: a file, or the folder of a run that took several.
    ///
    /// # Errors
    /// [`crate::Error::NotHdf5`], [`crate::Error::NotAnArchive`], [`crate::Error::NotARun`], [`crate::Error::FormatVersion`],
    /// [`crate::Error::InUse`], [`crate::Error::Damaged`], or what the system says.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_owned();
        let archives = open_all(&path)?;
        let map = PartMap::of_all(&archives)?;
        let run = &archives[0].plan;
        let mut ledger = Ledger::empty(run.taps().len(), run.scans().len(), run.stations().len());
        let mut states = Vec::with_capacity(archives.len());
        let (mut torn_row_count, mut torn_reason_count) = (0, 0);
        for (part, archive) in archives.iter().enumerate() {
            let stock = take_stock(archive, &map, part, &mut ledger)?;
            torn_row_count += stock.torn_row_count;
            torn_reason_count += stock.torn_reason_count;
            states.push(stock.rows);
        }
        let samples = archives.iter().map(SampleFile::open).collect::<Result<_>>()?;
        Ok(Self { path, archives, map, ledger, samples, states, torn_row_count, torn_reason_count })
    }

    /// Checks that this is the archive of `plan`, begun with the configuration and the reference of `lineage`.
    ///
    /// # Errors
    /// [`crate::Error::OtherPlan`], [`crate::Error::OtherConfiguration`] and [`crate::Error::OtherReference`].
    pub fn check_same<'a>(&self, plan: &Plan, lineage: impl Into<Lineage<'a>>) -> Result<()> {
        self.first().check_same(plan, lineage.into())
    }

    /// The files of the run.
    pub(crate) fn archives(&self) -> &[Archive] {
        &self.archives
    }

    /// The first of them, which has the plan of all.
    pub(crate) fn first(&self) -> &Archive {
        &self.archives[0]
    }

    /// Where the archive is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The scan plan, as it was given to the writer.
    pub fn plan(&self) -> &Plan {
        &self.first().plan
    }

    /// How many rows that say where taps and scans stand are not what was written: each is told as a warning, and the next
    /// [`Writer`](crate::Writer) mends it. What a tap's said of retakes is lost; a scan's is judged again.
    pub fn torn_row_count(&self) -> usize {
        self.torn_row_count
    }

    /// Whether any row is torn that says where taps and scans stand, or why a tap was refused.
    pub fn is_torn(&self) -> bool {
        self.torn_row_count + self.torn_reason_count > 0
    }

    /// The configuration, verbatim.
    pub fn config(&self) -> &str {
        &self.first().config
    }

    /// Version of the program that created the archive; `None` where it does not say.
    pub fn written_by(&self) -> Option<String> {
        read_text(&self.first().file, attribute::TAPLINE_VERSION).ok()
    }

    /// The reference file of the run, verbatim; `None` where it had none.
    pub fn reference(&self) -> Option<&str> {
        self.first().reference.as_deref()
    }

    /// What the results were made by: digests of the program's sources and every option, a line each.
    pub fn made_by(&self) -> &str {
        &self.first().made_by
    }

    /// BLAKE3 of all that was recorded in the archived taps.
    ///
    /// # Errors
    /// What the system says.
    pub fn raw_digest(&self) -> Result<[u8; 32]> {
        let digests = self.raw_digests()?;
        if let [digest] = digests[..] {
            return Ok(digest);
        }
        Ok(digest_of(digests.as_flattened()))
    }

    /// The key of the results as they are: [`crate::lineage_key`] of the recorded taps, what made the results, and the reference.
    ///
    /// # Errors
    /// What the system says.
    pub fn lineage_key(&self) -> Result<String> {
        Ok(lineage_key(&self.raw_digest()?, self.made_by(), self.reference()))
    }

    /// Of every file of the run what [`Reader::raw_digest`] is of all.
    pub(crate) fn raw_digests(&self) -> Result<Vec<[u8; 32]>> {
        self.archives.iter().map(raw_digest).collect()
    }

    /// Whether file `part` leaves its scan `there` to a later one.
    pub(crate) fn is_later(&self, part: usize, there: u32) -> bool {
        let is_later = |&row: &u32| Lost::from_code(self.states[part][row as usize].lost_at) == Some(Lost::LaterFile);
        self.archives[part].plan.scans()[there as usize].taps.iter().all(is_later)
    }

    /// Whether this archive has results alone, of the taps of another.
    pub fn is_results(&self) -> bool {
        self.first().is_results()
    }

    /// What is known of where cracks are; empty where nothing is.
    pub fn truth(&self) -> &Truth {
        self.plan().truth()
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
        let row = self.state(row).filter(|row| row.retaken_count > 0)?;
        Some((row.retaken_count, Quality::from_bits(row.retaken_quality)))
    }

    /// The row of the ledger of plan row `row`.
    fn state(&self, row: u32) -> Option<&LedgerRow> {
        let (part, there) = self.map.tap_if_any(row)?;
        Some(&self.states[part][there as usize])
    }

    /// Where the tap in plan row `row` was lost, or that it is in a later file; `None` where it is not missing.
    pub fn lost_at(&self, row: u32) -> Option<Lost> {
        let is_missing = self.ledger.taps().get(row as usize) == Some(&TapState::Missing);
        let lost = self.state(row).filter(|_| is_missing).map(|row| Lost::from_code(row.lost_at).unwrap_or_default());
        // Of a run there is no later file than those of its folder: the scan was not begun.
        lost.map(|lost| if lost == Lost::LaterFile && self.path.is_dir() { Lost::Acquire } else { lost })
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
        let (part, there) = self.map.tap(row);
        let archive = &self.archives[part];
        let rows = archive.headers.read(there as usize..there as usize + 1).context("read a header", &archive.path)?;
        let header = checked_header(&archive.path, &archive.plan, there, rows[0])?;
        let mut room = Room::default();
        let place = self.samples[part].place(there)?;
        let samples = match self.samples[part].read(&header, rows[0].stored_checksum, place, false, &mut room)? {
            Samples::I16(samples) => OwnedSamples::I16(samples.to_vec()),
            Samples::F32(samples) => OwnedSamples::F32(samples.to_vec()),
        };
        Ok(Some((in_run(header, row, self.plan()), samples)))
    }

    /// All archived taps, for readers that share the work between threads.
    ///
    /// # Errors
    /// What the system says.
    pub fn taps(&self) -> Result<Taps> {
        Taps::of(&self.archives, &self.map, self.ledger.taps())
    }

    /// What packs the samples.
    pub fn codec(&self) -> Codec {
        self.first().samples.codec()
    }

    /// The headers of all planned taps, by plan row; `None` where the tap is not archived.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`] where a checksum differs, or what the system says.
    pub fn headers(&self) -> Result<Vec<Option<TapHeader>>> {
        let rows = self.each(|archive| archive.headers.read_all(), "read the headers")?;
        let header = |row: u32| {
            let (part, there) = self.map.tap(row);
            let archive = &self.archives[part];
            let header = checked_header(&archive.path, &archive.plan, there, rows[part][there as usize])?;
            Ok(in_run(header, row, self.plan()))
        };
        (0..).zip(self.ledger.taps()).map(|(row, state)| archived(*state).then(|| header(row)).transpose()).collect()
    }

    /// What was found in every planned tap, by plan row; `None` where the tap is not archived.
    ///
    /// # Errors
    /// What the system says.
    pub fn discriminators(&self) -> Result<Vec<Option<Discriminators>>> {
        let rows = self.each(|archive| archive.discriminators.read_all(), "read the discriminators")?;
        let found = |row: u32| {
            let (part, there) = self.map.tap(row);
            let found = whole(&self.archives[part], there as usize, rows[part][there as usize])?;
            let found = found.to_discriminators(&self.plan().taps()[row as usize].id);
            Ok(Discriminators { plan_index: row, ..found })
        };
        (0..).zip(self.ledger.taps()).map(|(row, state)| archived(*state).then(|| found(row)).transpose()).collect()
    }

    /// Why taps were refused, in plan order; where that is damaged, the reason says so.
    ///
    /// # Errors
    /// What the system says.
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

    /// Why the tap in plan row `row` was refused; empty where it was not.
    pub(crate) fn reason(&self, row: u32) -> Result<String> {
        let (part, there) = self.map.tap(row);
        Ok(reason(&self.archives[part], there as usize)?.unwrap_or_else(|| REASON_LOST.to_owned()))
    }

    /// Verdict and damage map of every scan, by scan number; `None` where it is not judged.
    ///
    /// Of a judgement's stamp only what does not depend on how it was sent is archived.
    ///
    /// # Errors
    /// What the system says.
    pub fn judgements(&self) -> Result<Vec<Option<Judged>>> {
        let rows = self.each(|archive| archive.scans.read_all(), "read the scans")?;
        let first_cells: Vec<Vec<usize>> = self.archives.iter().map(Archive::first_cells).collect();
        let judged = |scan: u32| {
            let (part, there) = self.map.scan(scan);
            let (archive, there) = (&self.archives[part], there as usize);
            let (first, end) = (first_cells[part][there], first_cells[part][there + 1]);
            let cells = archive.damage.read(first..end).context("read a damage map", &archive.path)?;
            let judgement = rows[part][there].to_judgement(scan, self.plan().digest());
            let cells = (first..).zip(cells).map(|(k, cell)| Ok(whole(archive, k, cell)?.to_cell()));
            Ok((judgement, cells.collect::<Result<_>>()?))
        };
        let is_judged = |state: &ScanState| *state == ScanState::Judged;
        (0..).zip(self.ledger.scans()).map(|(scan, state)| is_judged(state).then(|| judged(scan)).transpose()).collect()
    }

    /// What `read` gives of every file.
    fn each<R>(&self, read: impl Fn(&Archive) -> hdf5::Result<Vec<R>>, what: &'static str) -> Result<Vec<Vec<R>>> {
        self.archives.iter().map(|archive| read(archive).context(what, &archive.path)).collect()
    }
}

fn archived(state: TapState) -> bool {
    state == TapState::Archived
}

/// `header`, as it stands in the file that has it, as that of plan row `row` of the run.
pub(crate) fn in_run(mut header: TapHeader, row: u32, run: &Plan) -> TapHeader {
    (header.plan_index, header.stamp.plan_digest) = (row, run.digest());
    header
}

/// `row` as row `number` of its table, if it is what was written.
fn whole<R: SealedRow>(archive: &Archive, number: usize, row: R) -> Result<R> {
    if row.is_whole(number) {
        return Ok(row);
    }
    let what = format!("row {number} of its table {:?} is not what was written: its checksum differs", R::TABLE);
    Err(archive.damaged(what))
}
