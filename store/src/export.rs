//! What an archive holds in the formats of other programs: tables as CSV and Parquet, taps as WAV and UFF.

mod column;
mod csv_file;
mod folder;
mod fortran;
mod parquet_file;
mod tables;
mod tap_set;
mod taps;
mod uff;

use std::io;

pub use tap_set::export_tap_set;
pub use taps::TapCounts;
pub use uff::{UffEncoding, export_uff};

use crate::Result;
use crate::reader::Reader;

/// A table that can be exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Export {
    /// What was found in every archived tap.
    Discriminators,
    /// The damage index of every location of the judged scans.
    Damage,
    /// The arcs of damage of the judged scans.
    Regions,
    /// The verdict on every scan.
    Verdicts,
    /// The state of every planned tap.
    Ledger,
}

impl Export {
    /// All five.
    pub const ALL: [Self; 5] = [Self::Discriminators, Self::Damage, Self::Regions, Self::Verdicts, Self::Ledger];

    /// The table's name on the command line.
    pub fn name(self) -> &'static str {
        ["discriminators", "damage", "regions", "verdicts", "ledger"][self as usize]
    }

    /// The table of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|table| table.name() == name)
    }
}

/// Writes `table` of the archive to `out` as CSV with a header line.
///
/// # Errors
/// [`crate::Error::Csv`] when `out` fails, or what reading the archive gives.
pub fn export(reader: &Reader, table: Export, out: impl io::Write) -> Result<()> {
    tables::give(reader, table, csv_file::CsvFile(out))
}

/// Writes `table` of the archive to `out` as Parquet: the columns and rows of the CSV, typed, and sets of flags also as bits.
///
/// Units are in the columns' metadata (`unit`). The metadata of the file names the table, the digest of the scan plan, and
/// the programs that made the archive and the file. One row group is in memory at a time.
///
/// # Errors
/// [`crate::Error::Parquet`] when `out` fails, or what reading the archive gives.
pub fn export_parquet(reader: &Reader, table: Export, out: impl io::Write + Send) -> Result<()> {
    tables::give(reader, table, parquet_file::ParquetFile::new(reader, table, out))
}
