//! What results are made of and by: kept in the archive word for word, and drawn together into one key.

use std::path::Path;

use crate::Codec;
use crate::Result;
use crate::archive::Archive;
use crate::context::Context;
use crate::layout::HeaderRow;
use crate::sealed::{Digest, SealedRow as _};
use crate::settled::tap_state;

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

/// BLAKE3 of all that was recorded in the archived taps of `archive`: which taps they are, how they were recorded, and their
/// samples; how and when they were sent does not enter, nor how they are packed.
pub(crate) fn raw_digest(archive: &Archive) -> Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&archive.plan.digest().to_le_bytes());
    let ledger = archive.ledger_of_taps().read_all().context("read the ledger", &archive.path)?;
    let headers = archive.headers.read_all().context("read the headers", &archive.path)?;
    for (k, (row, header)) in ledger.iter().zip(headers).enumerate() {
        let (state, attempt) = tap_state(archive, k, row)?;
        hasher.update(&(k as u64).to_le_bytes()).update(&[state.code()]).update(&attempt.to_le_bytes());
        if state == tapline_wire::TapState::Archived {
            if !header.is_whole(k) {
                let what = format!("the header of plan row {k} is not what was written: its checksum differs");
                return Err(archive.damaged(what));
            }
            add_header(&mut hasher, &header);
        }
    }
    Ok(*hasher.finalize().as_bytes())
}

fn add_header(hasher: &mut blake3::Hasher, header: &HeaderRow) {
    let HeaderRow { source, pre_trigger_samples, sample_count, tap_time_ns, samples_digest, .. } = *header;
    let floats = [header.sample_rate_hz, header.velocity_measured_m_per_s, header.microphone_distance_m];
    for value in floats.into_iter().chain(header.unit_per_count) {
        hasher.update(&value.to_bits().to_le_bytes());
    }
    for number in [source, pre_trigger_samples, sample_count] {
        hasher.update(&number.to_le_bytes());
    }
    hasher.update(&tap_time_ns.to_le_bytes()).update(&samples_digest);
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
