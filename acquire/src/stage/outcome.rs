//! What one `acquire` process did, and why it cannot go on.

use serde::{Deserialize, Serialize};
use tapline_wire::LineError;

use crate::Error;

/// Why `acquire` cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A source cannot be used.
    #[error(transparent)]
    Source(#[from] Error),
    /// Shared memory fails.
    #[error(transparent)]
    Line(#[from] LineError),
}

/// What one process did.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Its stations.
    pub stations: Vec<u16>,
    /// Taps sent, including repeats.
    pub sent_count: u64,
    /// Taps sent again because they were lost after they had been sent.
    pub resent_count: u64,
    /// Taps struck again because their record was unusable.
    pub retake_count: u64,
    /// Bytes of samples sent.
    pub sample_bytes: u64,
}
