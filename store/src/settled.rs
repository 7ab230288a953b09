//! What state taps and scans are in, and what a torn row of a ledger counts as.

use std::path::Path;

use hdf5::File;
use tapline_wire::{Ledger, ScanState, TapState};

use crate::archive::{Archive, open_table};
use crate::context::Context;
use crate::layout::{DiscriminatorsRow, LedgerRow, ScanRow};
use crate::parts::PartMap;
use crate::reason::reason;
use crate::sealed::SealedRow as _;
use crate::table::Table;
use crate::{Lost, Result};

/// Another archive, whose taps results are of.
#[derive(Debug)]
pub(crate) struct Raw {
    pub(crate) ledger: Table<LedgerRow>,
    pub(crate) discriminators: Table<DiscriminatorsRow>,
    /// Kept open for its tables.
    _file: File,
}

impl Raw {
    /// The archive in `file`, of `tap_count` taps; `path` is that of the results.
    pub(crate) fn of(file: File, path: &Path, tap_count: usize) -> Result<Self> {
        let ledger = open_table(&file, path, tap_count)?;
        Ok(Self { ledger, discriminators: open_table(&file, path, tap_count)?, _file: file })
    }
}

/// State and attempt of the tap in row `k` of the ledger.
///
/// A row whose checksum differs was being written when its writer was killed, or was damaged later. What it vouches for was
/// written before it: where that is whole the tap counts as archived; else as missing, so that it is taken again.
pub(crate) fn settled(archive: &Archive, k: usize, row: &LedgerRow) -> Result<(TapState, u16)> {
    settled_by(archive, &archive.discriminators, k, row)
}

/// The same of the ledger that vouches for the samples, which may be another archive's.
pub(crate) fn settled_raw(archive: &Archive, k: usize, row: &LedgerRow) -> Result<(TapState, u16)> {
    settled_by(archive, archive.of_taps().1, k, row)
}

fn settled_by(
    archive: &Archive,
    discriminators: &Table<DiscriminatorsRow>,
    k: usize,
    row: &LedgerRow,
) -> Result<(TapState, u16)> {
    if !row.is_whole(k) {
        let attempt = attempt_of_whole_rows(archive, discriminators, k)?;
        let counts_as = if attempt.is_some() { "archived, as its other rows are whole" } else { "missing" };
        tracing::warn!(row = k, "the ledger's row is torn; the tap counts as {counts_as}, and as never retaken");
        return Ok(attempt.map_or((TapState::Missing, 0), |attempt| (TapState::Archived, attempt)));
    }
    let unknown = || archive.damaged(format!("row {k} of its ledger has state {}", row.state));
    Ok((row.state().ok_or_else(unknown)?, row.attempt))
}

/// Attempt of the tap that row `k` of the headers and of the discriminators are of; `None` where either is not whole.
fn attempt_of_whole_rows(
    archive: &Archive,
    discriminators: &Table<DiscriminatorsRow>,
    k: usize,
) -> Result<Option<u16>> {
    let context = "read what is archived";
    let (headers, found) = (archive.headers.read(k..k + 1), discriminators.read(k..k + 1));
    let (headers, found) = (headers.context(context, &archive.path)?, found.context(context, &archive.path)?);
    let (Some(header), Some(found)) = (headers.first(), found.first()) else { return Ok(None) };
    let are_whole = header.is_whole(k) && found.is_whole(k);
    let are_of_it = [header.plan_index, found.plan_index].iter().all(|&row| row as usize == k);
    Ok((are_whole && are_of_it && header.attempt == found.attempt).then_some(header.attempt))
}

/// State of scan `k`, of whose taps those in `missing` count as missing, and those in `lost` because their rows are torn.
///
/// One whose row is torn is judged again: it has ended if all its taps are there. One that was judged is open again when a tap
/// is lost that it was judged from.
pub(crate) fn scan_state(
    archive: &Archive,
    k: usize,
    row: &ScanRow,
    missing: impl Fn(usize) -> bool,
    lost: impl Fn(usize) -> bool,
) -> Result<ScanState> {
    let has = |of: &dyn Fn(usize) -> bool| archive.plan.scans()[k].taps.iter().any(|&row| of(row as usize));
    if !row.is_whole(k) {
        let (state, name) = if has(&missing) { (ScanState::Open, "open") } else { (ScanState::Ended, "ended") };
        tracing::warn!(scan = k, "the scan's row is torn; it counts as {name}, and as not judged");
        return Ok(state);
    }
    let state = row.state().ok_or_else(|| archive.damaged(format!("scan {k} has state {}", row.state)))?;
    if state != ScanState::Open && has(&lost) {
        tracing::warn!(scan = k, "a tap of the scan is lost, as its rows are torn; it counts as open");
        return Ok(ScanState::Open);
    }
    Ok(state)
}

/// What one file of a run says of where its taps stand.
#[derive(Debug)]
pub(crate) struct Stock {
    /// Rows of its ledger, those that are torn as what they count as.
    pub(crate) rows: Vec<LedgerRow>,
    /// How many rows of its ledger and of its scans are torn.
    pub(crate) torn_row_count: usize,
    /// How many of why taps were refused.
    pub(crate) torn_reason_count: usize,
}

/// Takes the states of the taps and scans that file `part` of a run has into the `ledger` of the run.
pub(crate) fn take_stock(archive: &Archive, map: &PartMap, part: usize, ledger: &mut Ledger) -> Result<Stock> {
    let mut rows = archive.ledger.read_all().context("read the ledger", &archive.path)?;
    let scans = archive.scans.read_all().context("read the scans", &archive.path)?;
    let torn: Vec<usize> = (0..rows.len()).filter(|&k| !rows[k].is_whole(k)).collect();
    let torn_scans: Vec<usize> = (0..scans.len()).filter(|&k| !scans[k].is_whole(k)).collect();
    // A torn row of a tap that is not here is of one that is in a later file.
    let later = LedgerRow { lost_at: Lost::LaterFile.code(), ..LedgerRow::new(TapState::Missing, 0) };
    let mut counts_as = vec![later; rows.len()];
    let mut is_here = vec![false; rows.len()];
    for (row, there) in map.taps_in(part) {
        let there = there as usize;
        let (state, attempt) = settled(archive, there, &rows[there])?;
        ledger.set_tap(row as usize, state, attempt);
        (counts_as[there], is_here[there]) = (LedgerRow::new(state, attempt), true);
    }
    for &row in &torn {
        rows[row] = counts_as[row];
        if !is_here[row] {
            tracing::warn!(row, "the ledger's row is torn; the tap is in a later file");
        }
    }
    let mut is_scan_here = vec![false; scans.len()];
    for (scan, there) in map.scans_in(part) {
        let there = there as usize;
        is_scan_here[there] = true;
        let is_missing = |row: usize| rows[row].state() == Some(TapState::Missing);
        let is_lost = |row: usize| is_missing(row) && torn.binary_search(&row).is_ok();
        ledger.set_scan(scan as usize, scan_state(archive, there, &scans[there], is_missing, is_lost)?);
    }
    for &scan in torn_scans.iter().filter(|&&k| !is_scan_here[k]) {
        tracing::warn!(scan, "the scan's row is torn; the scan is in a later file");
    }
    let mut torn_reason_count = 0;
    for row in (0..rows.len()).filter(|&row| is_here[row] && rows[row].state() == Some(TapState::Refused)) {
        if reason(archive, row)?.is_none() {
            torn_reason_count += 1;
            tracing::warn!(row, "the row that says why the tap was refused is torn");
        }
    }
    Ok(Stock { rows, torn_row_count: torn.len() + torn_scans.len(), torn_reason_count })
}
