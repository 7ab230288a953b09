//! Reads an archive back, as the records that were put into it.

use std::path::Path;

use hdf5::H5Type;
use ndarray::s;
use tapline_wire::{
    DamageCell, Discriminators, Judgement, Ledger, Plan, SampleFormat, Samples, ScanState, TapHeader, TapId, TapState,
    Truth,
};

use crate::archive::{Access, Archive, read_text};
use crate::error::Context;
use crate::layout::attribute;
use crate::rows::{at_attempt, text};
use crate::{Lineage, Result};

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
        for (k, row) in archive.ledger.read_all().context("read the ledger", &archive.path)?.into_iter().enumerate() {
            let state = row.state();
            let unknown = || archive.damaged(format!("row {k} of its ledger has state {}", row.state));
            ledger.set_tap(k, state.ok_or_else(unknown)?, row.attempt);
        }
        for (k, row) in archive.scans.read_all().context("read the scans", &archive.path)?.into_iter().enumerate() {
            let state = row.state();
            ledger.set_scan(k, state.ok_or_else(|| archive.damaged(format!("scan {k} has state {}", row.state)))?);
        }
        Ok(Self { archive, ledger })
    }

    /// Checks that this is the archive of `plan`, begun with the configuration and the reference of `lineage`.
    ///
    /// # Errors
    /// [`crate::Error::OtherPlan`], [`crate::Error::OtherConfiguration`] and [`crate::Error::OtherReference`].
    pub fn check_same<'a>(&self, plan: &Plan, lineage: impl Into<Lineage<'a>>) -> Result<()> {
        self.archive.check_same(plan, lineage.into())
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

    /// The tap in plan row `row`, bit for bit; `None` when it is not archived or there is no such row.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], or what the system says.
    pub fn tap(&self, row: u32) -> Result<Option<(TapHeader, OwnedSamples)>> {
        let k = row as usize;
        if self.ledger.taps().get(k) != Some(&TapState::Archived) {
            return Ok(None);
        }
        let plan = &self.archive.plan;
        let rows = self.archive.headers.read(k..k + 1).context("read a header", &self.archive.path)?;
        let header = rows[0].to_header(row, plan);
        if header.plan_index != row || header.sample_count > plan.recording.sample_count_max {
            let (named, count) = (header.plan_index, header.sample_count);
            return Err(self.archive.damaged(format!("the header in row {row} names row {named} and {count} samples")));
        }
        let count = header.sample_count as usize;
        let samples = match plan.recording.sample_format {
            SampleFormat::I16 => OwnedSamples::I16(self.samples(k, count)?),
            SampleFormat::F32 => OwnedSamples::F32(self.samples(k, count)?),
        };
        Ok(Some((header, samples)))
    }

    /// The headers of all planned taps, by plan row; `None` where the tap is not archived.
    ///
    /// # Errors
    /// What the system says.
    pub fn headers(&self) -> Result<Vec<Option<TapHeader>>> {
        let mut headers = Vec::with_capacity(self.ledger.taps().len());
        let (plan, states) = (self.plan(), self.ledger.taps());
        self.archive
            .headers
            .for_each(|k, row| {
                let number = u32::try_from(k).unwrap_or(u32::MAX); // a plan numbers its rows so
                headers.push((states[k] == TapState::Archived).then(|| row.to_header(number, plan)));
            })
            .context("read the headers", &self.archive.path)?;
        Ok(headers)
    }

    fn samples<T: H5Type>(&self, row: usize, count: usize) -> Result<Vec<T>> {
        let dataset = self.archive.samples.dataset();
        let samples =
            dataset.read_slice_2d::<T, _>(s![row, .., ..count]).context("read samples", &self.archive.path)?;
        Ok(samples.into_iter().collect())
    }

    /// What was found in every planned tap, by plan row; `None` where the tap is not archived.
    ///
    /// # Errors
    /// What the system says.
    pub fn discriminators(&self) -> Result<Vec<Option<Discriminators>>> {
        let mut found = Vec::with_capacity(self.ledger.taps().len());
        let (taps, states) = (self.plan().taps(), self.ledger.taps());
        self.archive
            .discriminators
            .for_each(|k, row| {
                found.push((states[k] == TapState::Archived).then(|| row.to_discriminators(&taps[k].id)));
            })
            .context("read the discriminators", &self.archive.path)?;
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
                let reason = text(&reasons[0])
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
            judgements.push(Some((judgement, cells.into_iter().map(|c| c.to_cell()).collect())));
        }
        Ok(judgements)
    }
}
