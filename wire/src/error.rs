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
        /// For what.
        what: String,
        /// Bytes needed at most.
        need: u64,
        /// Bytes free.
        free: u64,
    },
    /// Free shared memory cannot be determined.
    #[error("cannot ask how much of /dev/shm is free")]
    NoSharedMemory {
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
    /// A record was made from another plan than this process works from.
    #[error("a record on {topic} was made from plan {got:016x}, but this process works from plan {want:016x}")]
    OtherPlan {
        /// The topic.
        topic: &'static str,
        /// Digest of the record's plan.
        got: u64,
        /// Digest of this process's plan.
        want: u64,
    },
    /// The process was asked to stop while it waited.
    #[error("stopped while waiting to send on {topic}")]
    Stopped {
        /// The topic.
        topic: &'static str,
    },
    /// A record is longer than the plan allows.
    #[error("a record on {topic} has {got} elements; the plan allows {most}")]
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
    pub(crate) fn shared(operation: impl Into<String>, reason: impl std::fmt::Debug) -> Self {
        Self::Shared { operation: operation.into(), reason: format!("{reason:?}") }
    }
}
