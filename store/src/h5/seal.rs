//! The seal of a finished archive: a digest of every byte that the checksums of taps do not cover. It lies after what
//! HDF5 reads, and is checked with plain reads before the library, which trusts what it reads, sees the file.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use twox_hash::XxHash3_64;

use crate::error::{Context as _, Error, Result};
use crate::h5::extent::Extent;

/// First bytes of the seal; the last of them is its version.
const BEGIN: [u8; 8] = *b"TAPSEAL\x01";
/// Last bytes of the file.
const END: [u8; 8] = *b"\x01tapline";

/// Bytes of the seal before its extents: [`BEGIN`], length of the data, their digest, number of extents.
const HEAD_BYTES: usize = 8 + 8 + 32 + 8;
/// Bytes after the seal: its address, its checksum, [`END`].
const FOOT_BYTES: usize = 8 + 8 + 8;
const EXTENT_BYTES: usize = 16;

/// Bytes that are read at a time.
const READ_BYTES: usize = 1 << 20;

/// `extents` in ascending order, without empty ones; those that touch or overlap are joined.
pub(crate) fn merged(mut extents: Vec<Extent>) -> Vec<Extent> {
    extents.sort_unstable();
    let mut merged: Vec<Extent> = Vec::with_capacity(extents.len());
    for extent in extents.into_iter().filter(|extent| extent.bytes > 0) {
        match merged.last_mut().filter(|last| last.end() >= extent.begin) {
            Some(last) => last.bytes = last.end().max(extent.end()) - last.begin,
            None => merged.push(extent),
        }
    }
    merged
}

/// Adds the first `bytes` of `file` to `hasher`, except the extents `without`, which must be [`merged`].
pub(crate) fn add_bytes(hasher: &mut blake3::Hasher, file: &File, bytes: u64, without: &[Extent]) -> io::Result<()> {
    let mut buffer = vec![0; READ_BYTES];
    let mut at = 0;
    for gap in without.iter().copied().chain([Extent { begin: bytes, bytes: 0 }]) {
        let end = gap.begin.min(bytes);
        while at < end {
            let count = usize::try_from(end - at).unwrap_or(usize::MAX).min(READ_BYTES);
            file.read_exact_at(&mut buffer[..count], at)?;
            hasher.update(&buffer[..count]);
            at += count as u64;
        }
        at = at.max(gap.end());
    }
    Ok(())
}

/// The little-endian word in `bytes` at `at`; 0 if they are too short.
pub(crate) fn word(bytes: &[u8], at: usize) -> u64 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |word| u64::from_le_bytes(*word))
}

fn digest(file: &File, bytes: u64, samples: &[Extent]) -> io::Result<[u8; 32]> {
    let mut hasher = blake3::Hasher::new();
    add_bytes(&mut hasher, file, bytes, samples)?;
    Ok(*hasher.finalize().as_bytes())
}

/// Seals the archive at `path`, which the library has closed. `samples` are the extents of its taps' chunks, which have
/// checksums of their own.
///
/// # Errors
/// What the system returns; the file is then as it was.
pub(crate) fn seal(path: &Path, samples: Vec<Extent>) -> Result<()> {
    let file = File::options().read(true).write(true).open(path).context("seal", path)?;
    let bytes = file.metadata().context("seal", path)?.len();
    let samples = merged(samples);
    let digest = digest(&file, bytes, &samples).context("seal", path)?;
    let mut seal = Vec::with_capacity(HEAD_BYTES + samples.len() * EXTENT_BYTES + FOOT_BYTES);
    seal.extend_from_slice(&BEGIN);
    seal.extend_from_slice(&bytes.to_le_bytes());
    seal.extend_from_slice(&digest);
    seal.extend_from_slice(&(samples.len() as u64).to_le_bytes());
    for extent in samples {
        seal.extend_from_slice(&extent.begin.to_le_bytes());
        seal.extend_from_slice(&extent.bytes.to_le_bytes());
    }
    let checksum = XxHash3_64::oneshot(&seal);
    seal.extend_from_slice(&bytes.to_le_bytes());
    seal.extend_from_slice(&checksum.to_le_bytes());
    seal.extend_from_slice(&END);
    let written = file.write_all_at(&seal, bytes);
    written
        .inspect_err(|_| {
            // Part of a seal is removed.
            drop(file.set_len(bytes));
        })
        .context("seal", path)
}

/// Whether the archive in `file`, at `path`, is sealed; checks the seal if it is.
///
/// # Errors
/// [`Error::Damaged`] if the file has a seal that is not valid, or what the system returns.
pub(crate) fn is_sealed(file: &File, path: &Path) -> Result<bool> {
    let length = file.metadata().context("read the seal", path)?.len();
    let mut foot = [0; FOOT_BYTES];
    let Some(foot_at) = length.checked_sub(FOOT_BYTES as u64) else { return Ok(false) };
    file.read_exact_at(&mut foot, foot_at).context("read the seal", path)?;
    if foot[16..] != END {
        return Ok(false);
    }
    let damaged = |what: &str| Error::Damaged { path: path.to_owned(), what: what.to_owned() };
    let (begin, checksum) = (word(&foot, 0), word(&foot, 8));
    let seal_bytes = foot_at.checked_sub(begin).and_then(|bytes| usize::try_from(bytes).ok());
    let Some(seal_bytes) = seal_bytes.filter(|bytes| *bytes >= HEAD_BYTES) else {
        return Err(damaged("its seal is not what was written"));
    };
    let mut seal = vec![0; seal_bytes];
    file.read_exact_at(&mut seal, begin).context("read the seal", path)?;
    let extents: Vec<Extent> = seal[HEAD_BYTES..]
        .chunks_exact(EXTENT_BYTES)
        .map(|extent| Extent { begin: word(extent, 0), bytes: word(extent, 8) })
        .collect();
    let is_valid = XxHash3_64::oneshot(&seal) == checksum
        && seal[..8] == BEGIN
        && word(&seal, 8) == begin
        && word(&seal, 48) == extents.len() as u64;
    if !is_valid {
        return Err(damaged("its seal is not what was written"));
    }
    let digest = digest(file, begin, &extents).context("check the seal", path)?;
    if digest[..] != seal[16..48] {
        return Err(damaged("it is not what was written when it was finished: the seal does not match"));
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a changed byte that is neither a sample nor noticed, also in the seal itself, and a file that was cut or
    /// extended.
    #[test]
    fn every_byte_but_samples_is_sealed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        let bytes: Vec<u8> = (0..600_u32).map(|k| (k * 7) as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        let extent = |begin, bytes| Extent { begin, bytes };
        seal(&path, vec![extent(300, 50), extent(100, 20), extent(120, 30)]).unwrap();
        let sealed = std::fs::read(&path).unwrap();
        assert_eq!(sealed[..600], bytes);
        let check = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            is_sealed(&File::open(&path).unwrap(), &path)
        };
        assert!(check(&sealed).unwrap());
        for at in 0..sealed.len() {
            let mut bent = sealed.clone();
            bent[at] ^= 4;
            let is_sample = (100..150).contains(&at) || (300..350).contains(&at);
            assert_eq!(check(&bent).is_ok_and(|is| is), is_sample, "byte {at}");
            assert!(!check(&sealed[..at]).unwrap_or(false), "cut at {at}");
        }
        assert!(!check(&[&sealed[..], &[0]].concat()).unwrap());
    }
}
