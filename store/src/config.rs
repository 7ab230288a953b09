//! The section `[store]` of the configuration.

use serde::{Deserialize, Serialize};
use tapline_codec::Codec;

use crate::error::{Error, Result};

/// How taps are archived.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StoreConfig {
    /// What packs the samples: `lz4`, `zstd` or `none`.
    pub codec: Codec,
}

impl StoreConfig {
    /// Checks that a line can use it.
    ///
    /// # Errors
    /// [`Error::SlowCodec`].
    pub fn validate(&self) -> Result<()> {
        if self.codec.is_for_lines() { Ok(()) } else { Err(Error::SlowCodec { codec: self.codec }) }
    }
}
