//! What results are computed from and with: stored in the archive verbatim, and hashed into one key.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use tapline_codec::Codec;

/// Bytes of a digest of samples.
pub(crate) const DIGEST_BYTES: usize = 32;

/// A BLAKE3.
pub(crate) type Digest = [u8; DIGEST_BYTES];

/// What a run is given besides its plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lineage<'a> {
    /// Its configuration, verbatim.
    pub config_toml: &'a str,
    /// The reference file that it compares with, verbatim.
    pub reference: Option<&'a str>,
    /// What packs its samples; a resumed archive keeps its codec.
    pub codec: Codec,
    /// What computes its results, one item per line: digests of the program's sources, and every option that affects
    /// them with its value, defaults included.
    pub made_by: &'a str,
    /// For only results: the archive of their taps, which must lie in the same folder or its parent, and the digest of
    /// those taps.
    pub raw: Option<(&'a Path, [u8; 32])>,
}

impl<'a> From<&'a str> for Lineage<'a> {
    /// A run with that configuration, no reference file and the default codec.
    fn from(config_toml: &'a str) -> Self {
        Self { config_toml, reference: None, codec: Codec::default(), made_by: "", raw: None }
    }
}

impl<'a> From<&'a String> for Lineage<'a> {
    fn from(config_toml: &'a String) -> Self {
        config_toml.as_str().into()
    }
}

/// Differences of two [`Lineage::made_by`] texts, as (key, before, after), sorted by key; a missing option is empty.
pub fn lineage_changes(before: &str, after: &str) -> Vec<(String, String, String)> {
    let options = |text: &str| -> BTreeMap<String, String> {
        text.lines().filter_map(|line| line.split_once(" = ")).map(|(k, v)| (k.to_owned(), v.to_owned())).collect()
    };
    let (before, after) = (options(before), options(after));
    let keys: BTreeSet<&String> = before.keys().chain(after.keys()).collect();
    let of = |options: &BTreeMap<String, String>, key: &String| options.get(key).cloned().unwrap_or_default();
    let changes = keys.into_iter().map(|key| (key.clone(), of(&before, key), of(&after, key)));
    changes.filter(|(_, before, after)| before != after).collect()
}

/// The first change, as the line before and the line after; "nothing" means a missing option.
pub fn lineage_change(before: &str, after: &str) -> (String, String) {
    let (key, before, after) = lineage_changes(before, after).into_iter().next().unwrap_or_default();
    let line = |value: String| if value.is_empty() { "nothing".to_owned() } else { format!("{key} = {value}") };
    (line(before), line(after))
}

/// The key of results: 256 bits over the recorded taps, what computed the results, and the reference.
///
/// On one machine and build, results with the same key are the same numbers. Results with different keys are never mixed.
pub fn lineage_key(raw_digest: &[u8; 32], made_by: &str, reference: Option<&str>) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(raw_digest);
    for part in [Some(made_by), reference] {
        let length = part.map_or(u64::MAX, |part| part.len() as u64);
        hasher.update(&length.to_le_bytes()).update(part.unwrap_or_default().as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

/// BLAKE3 of `bytes`, which this crate calls a digest.
pub fn digest_of(bytes: &[u8]) -> [u8; 32] {
    *blake3::hash(bytes).as_bytes()
}

/// A digest as hexadecimal digits.
pub fn hex_of(digest: &[u8; 32]) -> String {
    blake3::Hash::from_bytes(*digest).to_hex().to_string()
}
