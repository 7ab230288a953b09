//! The state of each tap, and the digest of what was recorded.

use std::path::Path;

use tapline_wire::{Plan, TapState};

use crate::error::{Context as _, Error, Result};
use crate::format::checksum::ChecksummedRow as _;
use crate::format::layout::{HeaderRow, LedgerRow};
use crate::format::lineage::{Digest, digest_of};
use crate::h5::table::Table;

/// State and attempt of the tap in row `k` of a ledger; missing if the row is corrupt.
pub(crate) fn tap_state(path: &Path, k: usize, row: &LedgerRow) -> Result<(TapState, u16)> {
    if !row.is_valid(k) {
        return Ok((TapState::Missing, 0));
    }
    let unknown = || Error::damaged(path, format!("row {k} of its ledger has unknown state {}", row.state));
    Ok((row.state().ok_or_else(unknown)?, row.attempt))
}

/// BLAKE3 of what was recorded in the taps that `ledger` lists as archived: which they are, how they were recorded, and
/// their samples. How and when they were sent, and how they are packed, is not included.
pub(crate) fn raw_digest(
    path: &Path,
    plan: &Plan,
    ledger: &Table<LedgerRow>,
    headers: &Table<HeaderRow>,
) -> Result<Digest> {
    // All at once: hashing each number separately takes ten times as long.
    let mut content = plan.digest().to_le_bytes().to_vec();
    let ledger = ledger.read_all().context("read the ledger", path)?;
    let headers = headers.read_all().context("read the headers", path)?;
    for (k, (row, header)) in ledger.iter().zip(headers).enumerate() {
        let (state, attempt) = tap_state(path, k, row)?;
        content.extend((k as u64).to_le_bytes());
        content.push(state.code());
        content.extend(attempt.to_le_bytes());
        if state == TapState::Archived {
            if !header.is_valid(k) {
                let what = format!("the header of plan row {k} is not what was written: its checksum differs");
                return Err(Error::damaged(path, what));
            }
            add_header(&mut content, &header);
        }
    }
    Ok(digest_of(&content))
}

fn add_header(content: &mut Vec<u8>, header: &HeaderRow) {
    let HeaderRow { source, pre_trigger_samples, sample_count, tap_time_ns, samples_digest, .. } = *header;
    let floats = [header.sample_rate_hz, header.velocity_measured_m_per_s, header.microphone_distance_m];
    for value in floats.into_iter().chain(header.unit_per_count) {
        content.extend(value.to_le_bytes());
    }
    for number in [source, pre_trigger_samples, sample_count] {
        content.extend(number.to_le_bytes());
    }
    content.extend(tap_time_ns.to_le_bytes());
    content.extend(samples_digest);
}
