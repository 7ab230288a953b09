//! What can go wrong on a line.

/// Why a line cannot be joined, or a record not sent or received.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum LineError {
    /// Too little shared memory is free.
    #[error(
        "{what} may need {:.1} MB of shared memory, but /dev/shm has {:.1} MB free: enlarge it \
         (mount -o remount,size=..., or --shm-size for a container) or use fewer stations",
        *.need as f64 / 1e6, *.free as f64 / 1e6
    )]
    NoRoom { what: String, need: u64, free: u64 },
    /// A file or folder of the line is not private to its user.
    #[error("{} {why}: a line uses only private files that it made itself", path.display())]
    NotOurs { path: std::path::PathBuf, why: String },
    /// The line's folder cannot be made anywhere.
    #[error("no place for the line's working folder; set TMPDIR to a folder of yours with a short path ({why})")]
    NoFolder { why: String },
    /// A file of the line's own, or `/dev/shm`, cannot be used.
    #[error("cannot use {}", path.display())]
    File { path: std::path::PathBuf, source: std::io::Error },
    /// An operation of the shared-memory layer failed.
    #[error("{operation}: {reason}")]
    Shared { operation: String, reason: String },
    /// The process was asked to stop while it waited.
    #[error("stopped while waiting to send on {topic}")]
    Stopped { topic: &'static str },
    /// A record is longer than the line allows.
    #[error("a record on {topic} has {got} elements; the line has room for {most}")]
    TooLong { topic: &'static str, got: usize, most: usize },
}

impl LineError {
    pub(crate) fn not_ours(path: &std::path::Path, why: impl Into<String>) -> Self {
        Self::NotOurs { path: path.to_owned(), why: why.into() }
    }

    pub(crate) fn io(path: &std::path::Path, source: impl Into<std::io::Error>) -> Self {
        Self::File { path: path.to_owned(), source: source.into() }
    }

    pub(crate) fn shared(operation: impl Into<String>, reason: impl std::fmt::Debug) -> Self {
        Self::Shared { operation: operation.into(), reason: format!("{reason:?}") }
    }
}
