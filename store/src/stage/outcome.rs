//! How a run of `store` ends.

use serde::{Deserialize, Serialize};
use tapline_wire::LineError;

use crate::error::Error;

/// Why `store` cannot continue.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum RunError {
    /// The archive cannot be written.
    #[error(transparent)]
    Archive(#[from] Error),
    /// Shared memory fails.
    #[error(transparent)]
    Line(#[from] LineError),
    /// The file system of the archive has failed or is read-only: every file in it is closed, so that it can be repaired.
    #[error("{error}; the line waits and nothing is lost: {}", .error.remedy())]
    FileSystem { error: Error },
    /// The thread that closes files cannot be started.
    #[error("cannot start the thread {name}")]
    Thread { name: String, source: std::io::Error },
}

/// What `store` did.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Records that contradict what is archived; the first is kept.
    pub conflict_count: u64,
    /// Records that were lost on their way to this stage.
    pub lost_count: u64,
}

/// The error of a stage that cannot write a file: of the file system, if that has failed.
pub(super) fn write_failure(error: Error) -> RunError {
    if error.is_file_system_failure() { RunError::FileSystem { error } } else { RunError::Archive(error) }
}
