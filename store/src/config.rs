//! What a run says of its archive.

use serde::{Deserialize, Serialize};

use crate::{Codec, Error, Result};

/// How taps are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StoreConfig {
    /// What packs the samples: `lz4`, `zstd` or `none`.
    pub codec: Codec,
    /// Size of a file, in MB of 10^6 bytes, at which the next scan to be begun begins a new one; 0: never.
    pub rotate_after_mb: u32,
    /// Age of a file, in seconds, likewise; 0: never. While no run writes it a file does not age.
    pub rotate_after_s: u32,
}

impl StoreConfig {
    /// Whether a run may take several files, in a folder of their own.
    pub fn rotates(&self) -> bool {
        self.rotate_after_mb > 0 || self.rotate_after_s > 0
    }

    /// Whether a line can keep to it.
    ///
    /// # Errors
    /// [`Error::SlowCodec`].
    pub fn validate(&self) -> Result<()> {
        if self.codec.is_for_lines() { Ok(()) } else { Err(Error::SlowCodec { codec: self.codec }) }
    }
}
