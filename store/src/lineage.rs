//! What a run was told, beside its plan: kept in the archive word for word.

use crate::Codec;

/// The texts that a run began with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lineage<'a> {
    /// Its configuration.
    pub config_toml: &'a str,
    /// The reference file it compared with, where it had one.
    pub reference: Option<&'a str>,
    /// What packs its samples; an archive that is gone on with keeps what it was begun with.
    pub codec: Codec,
}

impl<'a> From<&'a str> for Lineage<'a> {
    /// A run with that configuration and no reference file, packed as usual.
    fn from(config_toml: &'a str) -> Self {
        Self { config_toml, reference: None, codec: Codec::default() }
    }
}

impl<'a> From<&'a String> for Lineage<'a> {
    fn from(config_toml: &'a String) -> Self {
        config_toml.as_str().into()
    }
}
