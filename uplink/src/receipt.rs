//! What a centre says of a file.

use serde::{Deserialize, Serialize};

/// What a centre says of a file: that it has it, checked and on its disk, or that it will not take it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Receipt {
    /// Digest of the bytes that were sent, as NATS writes it: `SHA-256=` and base64.
    pub digest: String,
    /// How many bytes were sent.
    pub bytes: u64,
    /// Which collector says so.
    pub collector: String,
    /// When it was given, ns since 1970.
    pub at_ns: i64,
    /// What has become of the file.
    pub fate: Fate,
}

/// What has become of a file that was sent.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fate {
    /// It is on the collector's disk, checked.
    Received,
    /// It is not taken, and why.
    Refused(String),
}
