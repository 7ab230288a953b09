//! What a writer was given and no flush has made safe yet.

use std::collections::BTreeMap;

use tapline_wire::ScanState;

use crate::archive::Archive;
use crate::error::{Context, Result};
use crate::format::layout::{CellRow, DiscriminatorsRow, HeaderRow, LedgerRow, ReasonRow, ScanRow};
use crate::write::packer::give_back;

/// Rows that wait for a flush; one more and it is done unasked, so that memory stays bounded.
const PENDING_ROWS_MAX: usize = 4096;

/// Bytes of samples, likewise.
const SAMPLE_BYTES_MAX: usize = 32 << 20;

/// Rows that are to be written at the next flush, and samples that are written but of which the file does not know yet.
#[derive(Debug, Default)]
pub(crate) struct Pending {
    /// As they go to the file: where a flush fails they are written again.
    samples: BTreeMap<u32, Vec<u8>>,
    sample_bytes: usize,
    pub(crate) headers: BTreeMap<u32, HeaderRow>,
    pub(crate) discriminators: BTreeMap<u32, DiscriminatorsRow>,
    pub(crate) reasons: BTreeMap<u32, ReasonRow>,
    pub(crate) cells: BTreeMap<u32, CellRow>,
    /// Rows that vouch for the others, written after them.
    pub(crate) taps: BTreeMap<u32, LedgerRow>,
    pub(crate) scans: BTreeMap<u32, ScanRow>,
}

impl Pending {
    /// Rows that count otherwise than they stand in the file.
    pub(crate) fn of_changed(taps: BTreeMap<u32, LedgerRow>, scans: BTreeMap<u32, ScanRow>) -> Self {
        Self { taps, scans, ..Self::default() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.row_count() == 0
    }

    /// Whether there is as much as memory is to hold.
    pub(crate) fn is_full(&self) -> bool {
        self.row_count() > PENDING_ROWS_MAX || self.sample_bytes > SAMPLE_BYTES_MAX
    }

    /// Bytes of the samples kept.
    pub(crate) fn sample_bytes(&self) -> usize {
        self.sample_bytes
    }

    fn row_count(&self) -> usize {
        let halves = self.headers.len() + self.discriminators.len() + self.reasons.len();
        halves + self.cells.len() + self.taps.len() + self.scans.len()
    }

    /// Keeps the samples of plan row `row` as they were written.
    pub(crate) fn keep(&mut self, row: u32, stored: Vec<u8>) {
        self.sample_bytes += stored.len();
        if let Some(before) = self.samples.insert(row, stored) {
            self.sample_bytes -= before.len();
            give_back([before]);
        }
    }

    /// Nothing waits any more; what did is returned.
    pub(crate) fn take(&mut self) -> Self {
        let mut taken = std::mem::take(self);
        give_back(std::mem::take(&mut taken.samples).into_values());
        taken
    }

    /// Writes the samples to an archive that does not have them.
    pub(crate) fn write_samples(&self, archive: &Archive) -> Result<()> {
        let write = |(&row, stored): (&u32, &Vec<u8>)| archive.samples().write(row, stored);
        self.samples.iter().try_for_each(write).context("write samples", archive.path())
    }

    /// Writes the rows and hands them to the system: first what they hold, then the states that vouch for it.
    pub(crate) fn flush(&self, archive: &Archive) -> Result<()> {
        self.write_contents(archive).context("write what taps and scans hold", archive.path())?;
        self.write_states(archive).context("write what state taps and scans are in", archive.path())
    }

    fn write_contents(&self, archive: &Archive) -> hdf5::Result<()> {
        archive.headers().write(&self.headers)?;
        archive.discriminators().write(&self.discriminators)?;
        archive.refusals().write(&self.reasons)?;
        archive.damage().write(&self.cells)?;
        archive.flush()
    }

    fn write_states(&self, archive: &Archive) -> hdf5::Result<()> {
        // A scan that is open again must be so before the taps that it was judged from are not there.
        let (open, others): (BTreeMap<u32, ScanRow>, BTreeMap<u32, ScanRow>) =
            self.scans.iter().partition(|(_, row)| row.state() == Some(ScanState::Open));
        if !open.is_empty() {
            archive.scans().write(&open)?;
            archive.flush()?;
        }
        archive.ledger().write(&self.taps)?;
        archive.scans().write(&others)?;
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

    /// Catches a scan that stays judged where its writer dies while it is opened again for a tap that is lost: nobody would
    /// take that.
    #[test]
    fn a_scan_is_open_before_its_taps_are_missing() {
        let folder = tempfile::tempdir().unwrap();
        let (path, plan) = (folder.path().join("run.h5"), two_scans());
        drop(Writer::create(&path, &plan, 2, "").unwrap());
        let archive = Archive::open(&path, Access::Write).unwrap();
        let ended = ScanRow { state: ScanState::Ended.code().into(), ..ScanRow::open(&plan.scans()[0], 0) };
        archive.scans().write(&[(0, ended), (1, ended)].into()).unwrap();
        // A row that is not there stops it at the ledger.
        let taps = [(99, LedgerRow::new(TapState::Missing, 0))].into();
        let open = ScanRow::open(&plan.scans()[0], 0);
        let pending = Pending::of_changed(taps, [(0, open), (1, open.judged(&Default::default()))].into());
        assert!(pending.flush(&archive).is_err());
        let states: Vec<_> = archive.scans().read_all().unwrap().iter().map(ScanRow::state).collect();
        assert_eq!(states, [Some(ScanState::Open), Some(ScanState::Ended)]);
    }
}
