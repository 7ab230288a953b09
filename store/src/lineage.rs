//! What a run was told, beside its plan: kept in the archive word for word.

/// The texts that a run began with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lineage<'a> {
    /// Its configuration.
    pub config_toml: &'a str,
    /// The reference file it compared with, where it had one.
    pub reference: Option<&'a str>,
}

impl<'a> From<&'a str> for Lineage<'a> {
    /// A run with that configuration and no reference file.
    fn from(config_toml: &'a str) -> Self {
        Self { config_toml, reference: None }
    }
}

impl<'a> From<&'a String> for Lineage<'a> {
    fn from(config_toml: &'a String) -> Self {
        config_toml.as_str().into()
    }
}
