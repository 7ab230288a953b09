//! Records that wait for a flush.

use std::collections::BTreeMap;

use tapline_wire::ScanState;

use crate::archive::Archive;
use crate::error::{Context, Result};
use crate::format::layout::{CellRow, DiscriminatorsRow, HeaderRow, LedgerRow, ReasonRow, ScanRow};
use crate::write::packer::recycle;

/// Most rows that may wait; with one more the writer flushes, so that memory stays bounded.
const PENDING_ROWS_MAX: usize = 4096;

/// Most bytes of samples that may wait.
const SAMPLE_BYTES_MAX: usize = 32 << 20;

/// Rows that the next flush writes, and samples that are written but not yet in the index of the file.
#[derive(Debug, Default)]
pub(crate) struct Pending {
    /// Packed chunks: they are written again if a flush fails.
    samples: BTreeMap<u32, Vec<u8>>,
    sample_bytes: usize,
    pub(crate) headers: BTreeMap<u32, HeaderRow>,
    pub(crate) discriminators: BTreeMap<u32, DiscriminatorsRow>,
    pub(crate) reasons: BTreeMap<u32, ReasonRow>,
    pub(crate) cells: BTreeMap<u32, CellRow>,
    /// States, which are written after the rows that they refer to.
    pub(crate) taps: BTreeMap<u32, LedgerRow>,
    pub(crate) scans: BTreeMap<u32, ScanRow>,
}

impl Pending {
    /// Begins with rows that replace corrupt rows of the file.
    pub(crate) fn of_changed(taps: BTreeMap<u32, LedgerRow>, scans: BTreeMap<u32, ScanRow>) -> Self {
        Self { taps, scans, ..Self::default() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.row_count() == 0
    }

    /// Whether more waits than the limits allow.
    pub(crate) fn is_full(&self) -> bool {
        self.row_count() > PENDING_ROWS_MAX || self.sample_bytes > SAMPLE_BYTES_MAX
    }

    /// Bytes of the samples that wait.
    pub(crate) fn sample_bytes(&self) -> usize {
        self.sample_bytes
    }

    fn row_count(&self) -> usize {
        let halves = self.headers.len() + self.discriminators.len() + self.reasons.len();
        halves + self.cells.len() + self.taps.len() + self.scans.len()
    }

    /// Keeps the packed samples of plan row `row`.
    pub(crate) fn keep(&mut self, row: u32, stored: Vec<u8>) {
        self.sample_bytes += stored.len();
        if let Some(before) = self.samples.insert(row, stored) {
            self.sample_bytes -= before.len();
            recycle([before]);
        }
    }

    /// Removes all that waits, and returns it.
    pub(crate) fn take(&mut self) -> Self {
        let mut taken = std::mem::take(self);
        recycle(std::mem::take(&mut taken.samples).into_values());
        taken
    }

    /// Writes the samples again, to an archive that was reopened.
    pub(crate) fn write_samples(&self, archive: &Archive) -> Result<()> {
        let write = |(&row, stored): (&u32, &Vec<u8>)| archive.samples.write(row, stored);
        self.samples.iter().try_for_each(write).context("write samples", &archive.path)
    }

    /// Writes the rows of records and passes them to the system, and then the states.
    pub(crate) fn flush(&self, archive: &Archive) -> Result<()> {
        self.write_contents(archive).context("write the contents of taps and scans", &archive.path)?;
        self.write_states(archive).context("write the states of taps and scans", &archive.path)
    }

    fn write_contents(&self, archive: &Archive) -> hdf5::Result<()> {
        archive.headers.write(&self.headers)?;
        archive.discriminators.write(&self.discriminators)?;
        archive.refusals.write(&self.reasons)?;
        archive.damage.write(&self.cells)?;
        archive.flush()
    }

    fn write_states(&self, archive: &Archive) -> hdf5::Result<()> {
        // A scan that is open again must be so in the file before the taps it was judged with are missing.
        let (open, others): (BTreeMap<u32, ScanRow>, BTreeMap<u32, ScanRow>) =
            self.scans.iter().partition(|(_, row)| row.state() == Some(ScanState::Open));
        if !open.is_empty() {
            archive.scans.write(&open)?;
            archive.flush()?;
        }
        archive.ledger.write(&self.taps)?;
        archive.scans.write(&others)?;
        archive.flush()
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::TapState;

    use super::*;
    use crate::archive::Access;
    use crate::testing::two_scans;
    use crate::write::Writer;

    /// Catches a scan that stays judged when its writer is killed while it opens the scan again for a lost tap, which nobody
    /// would then take.
    #[test]
    fn a_scan_is_open_before_its_taps_are_missing() {
        let folder = tempfile::tempdir().unwrap();
        let (path, plan) = (folder.path().join("run.h5"), two_scans());
        drop(Writer::create(&path, &plan, 2, "").unwrap());
        let archive = Archive::open(&path, Access::Write).unwrap();
        let ended = ScanRow { state: ScanState::Ended.code().into(), ..ScanRow::open(&plan.scans()[0], 0) };
        archive.scans.write(&[(0, ended), (1, ended)].into()).unwrap();
        // A row that does not exist makes the write of the ledger fail.
        let taps = [(99, LedgerRow::new(TapState::Missing, 0))].into();
        let open = ScanRow::open(&plan.scans()[0], 0);
        let pending = Pending::of_changed(taps, [(0, open), (1, open.judged(&Default::default()))].into());
        assert!(pending.flush(&archive).is_err());
        let states: Vec<_> = archive.scans.read_all().unwrap().iter().map(ScanRow::state).collect();
        assert_eq!(states, [Some(ScanState::Open), Some(ScanState::Ended)]);
    }
}
