//! What results are made of and by: kept in the archive word for word, and drawn together into one key.

use std::path::Path;

use tapline_codec::Codec;

/// Bytes of a digest of samples.
pub(crate) const DIGEST_BYTES: usize = 32;

/// BLAKE3 of what something holds.
pub(crate) type Digest = [u8; DIGEST_BYTES];

/// What a run was told, beside its plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lineage<'a> {
    /// Its configuration, as it was written.
    pub config_toml: &'a str,
    /// The reference file it compared with, where it had one.
    pub reference: Option<&'a str>,
    /// What packs its samples; an archive that is gone on with keeps what it was begun with.
    pub codec: Codec,
    /// What its results are made by, as lines of text: digests of the program's sources, and every option with its value,
    /// defaults among them.
    pub made_by: &'a str,
    /// The archive whose taps the results are of, where these are results alone, and the digest of its taps; it must lie in
    /// the same folder, or in the folder of that folder.
    pub raw: Option<(&'a Path, [u8; 32])>,
}

impl<'a> From<&'a str> for Lineage<'a> {
    /// A run with that configuration and no reference file, packed as usual, of which nothing else is known.
    fn from(config_toml: &'a str) -> Self {
        Self { config_toml, reference: None, codec: Codec::default(), made_by: "", raw: None }
    }
}

impl<'a> From<&'a String> for Lineage<'a> {
    fn from(config_toml: &'a String) -> Self {
        config_toml.as_str().into()
    }
}

/// The key of results: 256 bits over the recorded taps, what the results were made by, and the reference.
///
/// On one machine and build, results with the same key are the same numbers; results with different keys never enter one normalisation.
pub fn lineage_key(raw_digest: &[u8; 32], made_by: &str, reference: Option<&str>) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(raw_digest);
    for part in [Some(made_by), reference] {
        let length = part.map_or(u64::MAX, |part| part.len() as u64);
        hasher.update(&length.to_le_bytes()).update(part.unwrap_or_default().as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

/// BLAKE3 of `bytes`: what this crate calls a digest.
pub fn digest_of(bytes: &[u8]) -> [u8; 32] {
    *blake3::hash(bytes).as_bytes()
}

/// A digest in hexadecimal digits.
pub fn hex_of(digest: &[u8; 32]) -> String {
    blake3::Hash::from_bytes(*digest).to_hex().to_string()
}
