//! Exports archives in the formats of other programs: tables as CSV and, with the feature `parquet`, as Parquet; taps as tap sets
//! of WAV files, as Universal Files (UFF), and as MATLAB files.
//!
//! - tables: `tables` has their columns and rows, `column` is what each format is written from: `csv_file`, `parquet_file`
//! - taps: `taps` has what all formats share: `tap_set`, `uff` (with `fortran`), `mat`
//! - `folder`: a folder that appears complete or not at all

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

use std::path::Path;
use std::{fmt, io};

#[cfg(feature = "parquet")]
use arrow_array::ArrayRef;
#[cfg(feature = "parquet")]
use arrow_schema::Field;
use serde::{Deserialize, Serialize};

pub use error::{Error, Result};
pub use tap_set::writer::{Scales, TapSetWriter, write_wav};
pub use taps::{ListedTap, TapCounts, TapFolder};

use crate::csv_file::CsvFile;
use crate::mat::Mat;
#[cfg(feature = "parquet")]
use crate::parquet_file::{Batches, ParquetFile};
use crate::tap_set::{Members, TapSetFolder};
use crate::taps::scan_files::ScanFiles;
use crate::uff::Uff;
use tapline_store::Reader;

/// A table that can be exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
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
    /// The casing, with what it was judged from and with.
    Casings,
}

impl Export {
    /// All six.
    pub const ALL: [Self; 6] =
        [Self::Discriminators, Self::Damage, Self::Regions, Self::Verdicts, Self::Ledger, Self::Casings];
}

tapline_wire::named!(
    Export,
    Discriminators = "discriminators",
    Damage = "damage",
    Regions = "regions",
    Verdicts = "verdicts",
    Ledger = "ledger",
    Casings = "casings",
);

/// What taps are exported as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TapFormat {
    /// A tap set, with one WAV per tap, and with the configuration of the run and the reference that it had.
    Wav,
    /// Universal Files.
    Uff,
    /// MATLAB files.
    Mat,
}

impl TapFormat {
    /// Checks that taps of all these archives can be in one folder: then [`TapFolder::add`] refuses none of them after it has read the taps of
    /// others.
    ///
    /// # Errors
    /// [`Error::NoTapSet`] for the first archive that does not fit those before it.
    pub fn check(self, mut archives: impl Iterator<Item = Reader>) -> Result<()> {
        let mut members = Members::default();
        match self {
            Self::Wav => archives.try_for_each(|reader| members.check(&reader)),
            // Each shoulder has a file of its own.
            Self::Uff | Self::Mat => Ok(()),
        }
    }

    /// Begins the new or empty folder `folder` of taps.
    ///
    /// # Errors
    /// [`Error::FolderNotEmpty`], or an error of writing.
    pub fn begin(self, folder: &Path) -> Result<Box<dyn TapFolder>> {
        Ok(match self {
            Self::Wav => Box::new(TapSetFolder::begin(folder)?),
            Self::Uff => Box::new(ScanFiles::begin(folder, Uff)?),
            Self::Mat => Box::new(ScanFiles::begin(folder, Mat)?),
        })
    }
}

/// Describes the columns of `table`, which are those of every archive. Units are in their metadata (`unit`).
#[cfg(feature = "parquet")]
pub fn columns(table: Export) -> Vec<Field> {
    tables::describe(table)
}

/// Hands the rows of `table` of the archive to `take`, thousands at a time, as an array for each of its [`columns`].
///
/// # Errors
/// An error of reading the archive.
#[cfg(feature = "parquet")]
pub fn read_batches(reader: &Reader, table: Export, take: impl FnMut(Vec<ArrayRef>)) -> Result<()> {
    tables::write(reader, None, table, &mut Batches(take))
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

    /// `table` as Parquet, into `out`: the columns and rows of the CSV, typed, and sets of flags also as bits.
    ///
    /// Units are in the columns' metadata (`unit`). The metadata of the file names the table, the digest of the scan plan, and
    /// the programs that made the archive and the file. One row group is in memory at a time.
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
