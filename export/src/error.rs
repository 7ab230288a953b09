//! Why a table or taps cannot be exported.

use std::io;
use std::path::{Path, PathBuf};

/// Why a table or taps cannot be exported.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum Error {
    /// The archive cannot be read.
    #[error(transparent)]
    Archive(#[from] tapline_store::Error),
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io { action: &'static str, path: PathBuf, source: io::Error },
    /// A table could not be written.
    #[error("cannot write the table: {0}")]
    Csv(#[from] csv::Error),
    /// A table could not be written as Parquet.
    #[cfg(feature = "parquet")]
    #[error("cannot write the Parquet table: {0}")]
    Parquet(#[from] parquet::errors::ParquetError),
    /// A recording could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Wav { path: PathBuf, source: hound::Error },
    /// An export of taps would mix with other files.
    #[error("{} is a folder with files in it; taps are written into a new or an empty one", path.display())]
    FolderNotEmpty { path: PathBuf },
    /// There are no taps to export, or none that can be read.
    #[error("{} has readable samples for none of its {tap_count} planned taps", path.display())]
    NoSamples { path: PathBuf, tap_count: usize },
    /// A file would be larger than its readers take.
    #[error("{} would have a matrix of {bytes} bytes; MATLAB reads at most {most}: export fewer taps, or as wav", path.display())]
    TooLarge { path: PathBuf, bytes: usize, most: usize },
    /// A tap set cannot represent something of the archive.
    #[error("{} cannot be a tap set: {what}", path.display())]
    NoTapSet { path: PathBuf, what: String },
}

/// What a fallible call of this crate returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Adds the action and the file to an error of the system.
pub(crate) trait Context<T> {
    /// The result, its error naming `action` and `path`.
    fn context(self, action: &'static str, path: &Path) -> Result<T>;
}

impl<T> Context<T> for io::Result<T> {
    fn context(self, action: &'static str, path: &Path) -> Result<T> {
        self.map_err(|source| Error::Io { action, path: path.to_owned(), source })
    }
}
