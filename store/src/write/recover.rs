//! A writer whose file cannot be written abandons the file, keeps the waiting records, and recovers when the cause is gone.
//!
//! After a failed write the library's memory must be neither used nor written: see [`crate::h5::file::abandon`]. The file is then
//! valid, as a killed writer leaves it, and is reopened; samples and rows since the last flush are still in memory and
//! are written again.

use tapline_wire::TapState;

use crate::archive::{Access, Archive};
use crate::error::{Error, Result};
use crate::file::guard::FileGuard;
use crate::format::lineage::Lineage;
use crate::write::Writer;
use crate::write::resume::load_resume_state;

impl Writer {
    /// Checks that the file is still at its path and has not become shorter; if not, abandons it.
    ///
    /// # Errors
    /// [`Error::Removed`], [`Error::Moved`], [`Error::Replaced`], [`Error::Cut`], or what the system returns.
    pub fn check_file(&mut self) -> Result<()> {
        let checked = if self.archive.is_some() { self.guard.check() } else { Ok(()) };
        checked.inspect_err(|_| self.abandon())
    }

    /// After an error that [is recoverable](Error::is_recoverable): reopens the file and writes what was put since the
    /// last flush.
    ///
    /// A file that was removed is written to its path again as soon as its folder exists; this writer has kept it open. Nothing
    /// that was put is lost by the error, and the failed call may be repeated.
    ///
    /// # Errors
    /// Why it still cannot be written; the call may be repeated.
    pub fn recover(&mut self) -> Result<()> {
        if self.archive.is_none() {
            self.guard.put_back()?;
            let bytes = self.pending.sample_bytes() + self.plan.recording.payload_bytes_max();
            self.guard.check_room(bytes as u64)?;
            let archive = self.reopen()?;
            self.guard = FileGuard::new(archive.read_handle()?, &archive.path, &self.sync_errors)?;
            self.archive = Some(archive);
        }
        let Some(archive) = &self.archive else { return Ok(()) };
        let written = self.pending.write_samples(archive);
        written.inspect_err(|_| self.abandon())?;
        self.flush()
    }

    /// Whether the file is still at its path and has not become shorter.
    pub fn is_in_place(&self) -> bool {
        self.guard.check().is_ok()
    }

    /// The archive, if it was not abandoned.
    pub(crate) fn open(&self) -> Result<&Archive> {
        self.archive.as_ref().ok_or_else(|| Error::Abandoned { path: self.path.clone() })
    }

    /// Closes the file without writing anything more to it.
    pub(crate) fn abandon(&mut self) {
        if let Some(archive) = self.archive.take()
            && let Err(error) = archive.abandon()
        {
            tracing::error!(%error, "cannot abandon {}", self.path.display());
        }
    }

    fn reopen(&self) -> Result<Archive> {
        let archive = Archive::open(&self.path, Access::Write)?;
        let provenance = &self.provenance;
        let lineage =
            Lineage { reference: provenance.reference.as_deref(), made_by: &provenance.made_by, ..Lineage::from("") };
        archive.check_same(&self.plan, lineage)?;
        // It may have more than is known, if a flush failed half-way.
        let found = load_resume_state(&archive)?.ledger;
        let is_known = |row: usize| {
            let state = self.ledger.taps()[row];
            state == TapState::Missing || (found.taps()[row], found.attempt(row)) == (state, self.ledger.attempt(row))
        };
        let lost = (0..self.ledger.taps().len()).find(|&row| !is_known(row));
        let scan = self.ledger.scans().iter().zip(found.scans()).position(|(known, found)| found < known);
        match (lost, scan) {
            (None, None) => Ok(archive),
            (Some(row), _) => Err(archive.damaged(format!("the tap of plan row {row} was in it, but is missing now"))),
            (_, Some(scan)) => Err(archive.damaged(format!("scan {scan} was further along than it is now"))),
        }
    }
}
