//! Exports archives in the formats of other programs: tables as CSV and, with the feature `parquet`, as Parquet; taps as tap sets
//! of WAV files, as Universal Files (UFF), and as MATLAB files.

mod column;
mod csv_file;
mod error;
mod folder;
mod fortran;
mod mat;
#[cfg(feature = "parquet")]
mod parquet_file;
mod tables;
mod tap_set;
mod taps;
mod uff;
mod values;

use std::{fmt, io};

pub use error::{Error, Result};
pub use mat::MatFolder;
pub use tap_set::writer::{Scales, TapSetWriter};
pub use tap_set::{TapSetFolder, export_tap_set};
pub use taps::{ListedTap, TapCounts};
pub use uff::{UffEncoding, UffFolder, export_uff};
pub use values::{ColumnInfo, ColumnKind, Values};

use crate::column::Sink as _;
use crate::csv_file::CsvFile;
#[cfg(feature = "parquet")]
use crate::parquet_file::ParquetFile;
use tapline_store::Reader;

/// A table that can be exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Export {
    /// The discriminators of every archived tap.
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
/// [`Error::Csv`] if `out` fails, or an error of reading the archive.
pub fn export(reader: &Reader, table: Export, out: impl io::Write + Send) -> Result<()> {
    one(reader, TableFile::csv(table, out))
}

/// Writes `table` of the archive to `out` as Parquet: the columns and rows of the CSV, typed, and sets of flags also as bits.
///
/// Units are in the columns' metadata (`unit`). The metadata of the file names the table, the digest of the scan plan, and
/// the programs that made the archive and the file. One row group is in memory at a time.
///
/// # Errors
/// [`Error`] if `out` fails, or an error of reading the archive.
#[cfg(feature = "parquet")]
pub fn export_parquet(reader: &Reader, table: Export, out: impl io::Write + Send) -> Result<()> {
    one(reader, TableFile::parquet(table, out))
}

/// Describes the columns of `table`, which are those of every archive.
pub fn columns(table: Export) -> Vec<ColumnInfo> {
    tables::describe(table)
}

/// Hands the rows of `table` of the archive to `take`, some thousand at a time, as the values of each of its [`columns`].
///
/// # Errors
/// An error of reading the archive.
pub fn read_values(reader: &Reader, table: Export, take: impl FnMut(Vec<Values>)) -> Result<()> {
    tables::write(reader, None, table, &mut values::Batches::new(take))
}

fn one(reader: &Reader, mut file: TableFile<impl io::Write + Send>) -> Result<()> {
    file.add(reader, None)?;
    file.finish()
}

/// A table of one archive or of many, written archive by archive: no more than one is in memory.
pub struct TableFile<W: io::Write + Send> {
    table: Export,
    format: TableFormat<W>,
}

enum TableFormat<W: io::Write + Send> {
    Csv(Box<CsvFile<W>>),
    #[cfg(feature = "parquet")]
    Parquet(ParquetFile<W>),
}

impl<W: io::Write + Send> fmt::Debug for TableFile<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TableFile").field("table", &self.table).finish_non_exhaustive()
    }
}

impl<W: io::Write + Send> TableFile<W> {
    /// `table` as CSV with one header line, into `out`.
    pub fn csv(table: Export, out: W) -> Self {
        Self { table, format: TableFormat::Csv(Box::new(CsvFile::new(out))) }
    }

    /// `table` as Parquet, into `out`; see [`export_parquet`].
    #[cfg(feature = "parquet")]
    pub fn parquet(table: Export, out: W) -> Self {
        Self { table, format: TableFormat::Parquet(ParquetFile::new(table, out)) }
    }

    /// Adds the rows of an archive. An archive that is one of many has a `name`, which is the first column, `file`, of its rows:
    /// either all archives of a table have a name, or none has.
    ///
    /// # Errors
    /// [`Error`] if the table cannot be written, or an error of reading the archive; then none of its rows is written.
    pub fn add(&mut self, reader: &Reader, name: Option<&str>) -> Result<()> {
        match &mut self.format {
            TableFormat::Csv(file) => tables::write(reader, name, self.table, file.as_mut()),
            #[cfg(feature = "parquet")]
            TableFormat::Parquet(file) => {
                if name.is_none() {
                    file.describe(reader);
                }
                tables::write(reader, name, self.table, file)
            }
        }
    }

    /// Ends the table.
    ///
    /// # Errors
    /// [`Error`] if it cannot be written.
    pub fn finish(self) -> Result<()> {
        match self.format {
            TableFormat::Csv(file) => file.finish(),
            #[cfg(feature = "parquet")]
            TableFormat::Parquet(file) => file.finish(),
        }
    }
}
