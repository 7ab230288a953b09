//! The states of taps and scans. A tap whose row is corrupt counts as missing and is taken again; a scan whose row is corrupt
//! counts as open.

use tapline_wire::{Ledger, ScanState, TapState};

use crate::archive::Archive;
use crate::archive::ledger::tap_state;
use crate::error::{Context, Result};
use crate::format::checksum::ChecksummedRow as _;
use crate::format::layout::{LedgerRow, ScanRow};

/// The states of the taps and scans of an archive.
#[derive(Debug)]
pub(crate) struct States {
    /// Rows of its ledger; a corrupt row is replaced by that of a missing tap.
    pub taps: Vec<LedgerRow>,
    /// Rows of its scans; a corrupt row is replaced by that of an open scan.
    pub scans: Vec<ScanRow>,
    /// Plan rows, and scans, whose row was replaced.
    pub changed_taps: Vec<usize>,
    pub changed_scans: Vec<usize>,
}

impl States {
    /// Loads the states of `archive`. An archived tap also counts as missing if `is_corrupt` of its plan row.
    pub(crate) fn load(archive: &Archive, is_corrupt: impl Fn(usize) -> bool) -> Result<Self> {
        let mut taps = archive.ledger.read_all().context("read the ledger", &archive.path)?;
        let mut changed_taps = Vec::new();
        for (k, row) in taps.iter_mut().enumerate() {
            let (state, _) = tap_state(&archive.path, k, row)?;
            if !row.is_valid(k) || (state == TapState::Archived && is_corrupt(k)) {
                *row = LedgerRow::new(TapState::Missing, 0);
                changed_taps.push(k);
            }
        }
        let mut scans = archive.scans.read_all().context("read the scans", &archive.path)?;
        let mut changed_scans = Vec::new();
        for (k, row) in scans.iter_mut().enumerate() {
            let planned = &archive.plan.scans()[k];
            let is_changed = |row: &u32| changed_taps.binary_search(&(*row as usize)).is_ok();
            let is_valid = row.is_valid(k);
            if is_valid && row.state().is_none() {
                return Err(archive.damaged(format!("scan {k} has unknown state {}", row.state)));
            }
            let open = ScanRow::open(planned, u32::try_from(archive.first_cell(k)).unwrap_or(u32::MAX));
            // A scan that was judged with a tap that is lost is judged again.
            if !is_valid || (row.state() != Some(ScanState::Open) && planned.taps.iter().any(is_changed)) {
                *row = open;
                changed_scans.push(k);
            } else if row.state() != Some(ScanState::Judged) {
                // Its counts may include taps that a writer was adding when it was killed.
                *row = ScanRow { state: row.state, ..open };
            }
        }
        if !changed_taps.is_empty() || !changed_scans.is_empty() {
            let (taps, scans, path) = (changed_taps.len(), changed_scans.len(), archive.path.display());
            tracing::warn!("{path}: corrupt rows: {taps} taps count as missing, {scans} scans as open");
        }
        Ok(Self { taps, scans, changed_taps, changed_scans })
    }

    /// The states as a ledger.
    pub(crate) fn ledger(&self, archive: &Archive) -> Ledger {
        let plan = &archive.plan;
        let mut ledger = Ledger::empty(plan.taps().len(), plan.scans().len());
        for (k, row) in self.taps.iter().enumerate() {
            ledger.set_tap(k, row.state().unwrap_or(TapState::Missing), row.attempt);
        }
        for (k, row) in self.scans.iter().enumerate() {
            ledger.set_scan(k, row.state().unwrap_or(ScanState::Open));
        }
        ledger
    }
}
