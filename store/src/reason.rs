//! Why a tap was refused, as a row of its table.

use hdf5::types::FixedUnicode;

use crate::Result;
use crate::archive::Archive;
use crate::context::Context;
use crate::layout::ReasonRow;
use crate::rows::{fixed, text};
use crate::sealed::SealedRow as _;

/// Stands where it was said why a tap was refused, and the row is torn.
pub(crate) const REASON_LOST: &str = "refused, but why is lost: what was written is damaged";

impl ReasonRow {
    /// The row of `reason`, which is cut where it is too long.
    pub(crate) fn new(reason: &str) -> Self {
        Self { reason: fixed(reason), checksum: 0 }
    }

    /// The reason of no refusal.
    pub(crate) fn none() -> Self {
        Self { reason: FixedUnicode::new(), checksum: 0 }
    }
}

/// Why the tap in row `k` was refused; `None` where that is torn, or cannot be read.
pub(crate) fn reason(archive: &Archive, k: usize) -> Result<Option<String>> {
    let rows = match archive.refusals.read(k..k + 1).context("read a reason", &archive.path) {
        Err(error) if error.is_of_one_place() => return Ok(None),
        rows => rows?,
    };
    Ok(rows.first().filter(|row| row.is_whole(k)).and_then(|row| text(&row.reason)).map(str::to_owned))
}
