//! One archive, created, or opened and checked.
//!
//! - here: an open archive and its tables
//! - `open`: opens it; checks the lock, the seal or the structure, the layout, and that the tables fit each other
//! - `create`: a new archive, every table at its final size
//! - `metadata`: what never changes after creation, and its digest
//! - `plan`: the scan plan, with the taps that were added
//! - `ledger`, `states`: the state of each tap and scan
//! - `units`: the units of the tables

pub(crate) mod create;
pub(crate) mod ledger;
mod metadata;
mod open;
mod plan;
pub(crate) mod states;
mod units;

use std::ops::Range;
use std::path::PathBuf;

use hdf5::File;
use tapline_wire::Plan;

pub(crate) use self::open::Access;
pub use self::open::has_only_results;
use crate::archive::ledger::raw_digest;
use crate::error::{Context, Error, Result};
use crate::format::layout::{
    CellRow, DiscriminatorsRow, HeaderRow, Key, LedgerRow, PlanRow, ReasonRow, ScanRow, attribute, table,
};
use crate::format::lineage::{Digest, Lineage, lineage_change, lineage_key};
use crate::h5::file::{abandon, read_handle};
use crate::h5::samples::ChunkRows;
use crate::h5::table::Table;
use crate::h5::text::read_text;

/// An open archive.
#[derive(Debug)]
pub(crate) struct Archive {
    pub(crate) path: PathBuf,
    /// Its plan, with the taps that were added.
    pub(crate) plan: Plan,
    /// The configuration that it was begun with, verbatim.
    pub(crate) config: String,
    /// The reference file that it was begun with, verbatim.
    pub(crate) reference: Option<String>,
    pub(crate) samples: ChunkRows,
    pub(crate) headers: Table<HeaderRow>,
    pub(crate) discriminators: Table<DiscriminatorsRow>,
    pub(crate) ledger: Table<LedgerRow>,
    pub(crate) refusals: Table<ReasonRow>,
    pub(crate) scans: Table<ScanRow>,
    pub(crate) damage: Table<CellRow>,
    /// The plan as rows, with spare rows.
    pub(crate) plan_rows: Table<PlanRow>,
    /// The plan as it was begun.
    pub(crate) begun: Plan,
    /// Most taps that it has room for.
    pub(crate) taps_max: usize,
    /// For every scan, the damage-table row of its first cell; at the end, the number of rows.
    first_cells: Vec<usize>,
    /// Whether it is finished and sealed.
    pub(crate) is_finished: bool,
    /// What computed its results.
    pub(crate) made_by: String,
    file: File,
    /// The archive of the taps, if this one has only results.
    raw: Option<Box<Archive>>,
}

impl Archive {
    /// Version of the program that created it; `None` if it gives none.
    pub(crate) fn written_by(&self) -> Option<String> {
        read_text(&self.file, attribute::TAPLINE_VERSION).ok()
    }

    /// Closes the file without writing to it: see [`crate::h5::file::abandon`].
    pub(crate) fn abandon(self) -> hdf5::Result<()> {
        abandon(&self.file)
    }

    /// Passes all that was written to the system.
    pub(crate) fn flush(&self) -> hdf5::Result<()> {
        self.file.flush()
    }

    /// Checks that this is the archive of `plan`, begun with the program, the options and the reference of `lineage`.
    pub(crate) fn check_same(&self, plan: &Plan, lineage: Lineage<'_>) -> Result<()> {
        let (archived, given) = (self.plan.digest(), plan.digest());
        if archived != given {
            return Err(Error::OtherPlan { path: self.path.clone(), archived, given });
        }
        self.check_lineage(lineage)
    }

    /// Checks that its results are computed by the same program and options as those of `lineage`, and with the same reference.
    pub(crate) fn check_lineage(&self, lineage: Lineage<'_>) -> Result<()> {
        if self.reference.as_deref() != lineage.reference {
            return Err(Error::OtherReference { path: self.path.clone() });
        }
        if self.made_by != lineage.made_by {
            let (archived, given) = lineage_change(&self.made_by, lineage.made_by);
            return Err(Error::OtherLineage { path: self.path.clone(), archived, given });
        }
        Ok(())
    }

    /// The key that is stored; empty if none is.
    pub(crate) fn stored_key(&self) -> Result<String> {
        let key: hdf5::Result<Key> = self.file.dataset(table::LINEAGE_KEY).and_then(|key| key.read_scalar());
        // In a damaged file it may not be UTF-8.
        Ok(String::from_utf8_lossy(key.context("read the key of the results", &self.path)?.as_bytes()).into_owned())
    }

    /// Whether this archive has only results, of the taps of another.
    pub(crate) fn is_results(&self) -> bool {
        self.raw.is_some()
    }

    /// The ledger of the samples, which may be another archive's.
    pub(crate) fn ledger_of_taps(&self) -> &Table<LedgerRow> {
        self.raw.as_ref().map_or(&self.ledger, |raw| &raw.ledger)
    }

    /// The error for this corrupt archive: `what` says how.
    pub(crate) fn damaged(&self, what: impl Into<String>) -> Error {
        Error::damaged(&self.path, what)
    }

    /// BLAKE3 of what was recorded in the archived taps: see [`raw_digest`].
    pub(crate) fn raw_digest(&self) -> Result<Digest> {
        raw_digest(&self.path, &self.plan, self.ledger_of_taps(), &self.headers)
    }

    /// The key of the present results.
    pub(crate) fn key(&self) -> Result<String> {
        Ok(lineage_key(&self.raw_digest()?, &self.made_by, self.reference.as_deref()))
    }

    /// Stores the key of the results, which must be complete, and flushes.
    pub(crate) fn write_key(&self) -> Result<()> {
        let key = Key::from_ascii(self.key()?.as_bytes()).map_err(|error| hdf5::Error::from(error.to_string()));
        key.and_then(|key| self.file.dataset(table::LINEAGE_KEY)?.write_scalar(&key))
            .and_then(|()| self.file.flush())
            .context("write the key of the results", &self.path)
    }

    /// Row in the damage table of the first cell of scan `scan`.
    pub(crate) fn first_cell(&self, scan: usize) -> usize {
        self.first_cells[scan]
    }

    /// Rows of the cells of scan `scan`.
    pub(crate) fn cells(&self, scan: usize) -> Range<usize> {
        let first = self.first_cells[scan];
        first..first + self.plan.scans()[scan].locations.len()
    }

    /// Another handle of the open file, for reading: see [`crate::h5::file::read_handle`].
    pub(crate) fn read_handle(&self) -> Result<std::fs::File> {
        read_handle(&self.file).context("open the archive", &self.path)
    }

    /// Replaces the plan by `plan`, which has more taps.
    pub(crate) fn grow_to(&mut self, plan: Plan) {
        let tap_count = plan.taps().len();
        self.plan_rows.grow_to(tap_count);
        self.headers.grow_to(tap_count);
        self.discriminators.grow_to(tap_count);
        self.ledger.grow_to(tap_count);
        self.refusals.grow_to(tap_count);
        self.plan = plan;
    }
}
