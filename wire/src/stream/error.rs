//! What can go wrong on a line.

/// Why a line cannot be joined, or a record not sent or received.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LineError {
    /// Too little shared memory is free.
    #[error(
        "{what} may need {:.1} MB of shared memory, but /dev/shm has {:.1} MB free: enlarge it \
         (mount -o remount,size=..., or --shm-size for a container) or use fewer stations",
        *.need as f64 / 1e6, *.free as f64 / 1e6
    )]
    NoRoom {
        /// What needs it.
        what: String,
        /// Bytes needed at most.
        need: u64,
        /// Bytes free.
        free: u64,
    },
    /// A file or folder of the line is not private to its user.
    #[error("{} {why}: a line uses only private files that it made itself", path.display())]
    NotOurs {
        /// The file or folder.
        path: std::path::PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// The line's folder cannot be made anywhere.
    #[error("no place for the line's working folder; set TMPDIR to a folder of yours with a short path ({why})")]
    NoFolder {
        /// Why the last place that was tried is unsuitable.
        why: String,
    },
    /// A file of the line's own, or `/dev/shm`, cannot be used.
    #[error("cannot use {}", path.display())]
    File {
        /// The file or folder.
        path: std::path::PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// An operation of the shared-memory layer failed.
    #[error("{operation}: {reason}")]
    Shared {
        /// What was tried.
        operation: String,
        /// What the layer says.
        reason: String,
    },
    /// The process was asked to stop while it waited.
    #[error("stopped while waiting to send on {topic}")]
    Stopped {
        /// The topic.
        topic: &'static str,
    },
    /// A record is longer than the line allows.
    #[error("a record on {topic} has {got} elements; the line has room for {most}")]
    TooLong {
        /// The topic.
        topic: &'static str,
        /// Elements asked for.
        got: usize,
        /// Most elements a record can have.
        most: usize,
    },
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
