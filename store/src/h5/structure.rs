//! The record of an archive's structure: a digest of what must not change while the archive is written. It is checked
//! with plain reads before the HDF5 library, which trusts what it reads, sees an unfinished file.
//!
//! After creation these parts of a file change: rows of tables and chunks of samples, which have checksums of their own, the
//! entries of the index of chunks, and the end of the file. Nothing else does.

use std::fs::File;
use std::io::ErrorKind;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use hdf5::plist::dataset_create::{AllocTime, FillTime};
use tapline_codec::Codec;
use twox_hash::XxHash3_64;

use crate::error::{Context as _, Error, Result};
use crate::format::layout::table;
use crate::h5::chunk_index::{Index, index, node_with_changes_left_out};
use crate::h5::extent::Extent;
use crate::h5::samples::ChunkRows;
use crate::h5::seal::{add_bytes, merged, word};

/// First bytes of the record, which are nowhere else in the first bytes of a file.
const MAGIC: [u8; 16] = *b"tapline struct\r\x01";

/// The record, which is created first, begins within so many bytes.
const WITHIN_BYTES: usize = 1 << 16;

/// The field of the superblock with the end of the file.
const END_OF_FILE: Extent = Extent { begin: 40, bytes: 8 };

/// The cached address of the root group in the superblock: in a file without groups, the library writes it at a later flush.
const ROOT_CACHE: Extent = Extent { begin: 72, bytes: 24 };

/// The field of the superblock whose first byte says that the file is open for writing.
const STATUS: Extent = Extent { begin: 20, bytes: 4 };

/// Dimensions of the samples.
const RANK: usize = 3;

/// Words of the record before its lists: magic (2), checksum, words of the record, bytes at creation, digest (4), object header
/// of the samples, rows, number of extents, number of nodes.
const HEAD_WORDS: usize = 13;

/// The tables whose rows may change.
const TABLES: [&str; 9] = [
    table::STRUCTURE,
    table::LINEAGE_KEY,
    table::PLAN,
    table::HEADER,
    table::DISCRIMINATORS,
    table::LEDGER,
    table::REFUSALS,
    table::SCANS,
    table::DAMAGE,
];

/// Most bytes of the record of an archive with room for `taps_max` taps.
fn record_bytes(taps_max: usize) -> usize {
    8 * (128 + taps_max / 4)
}

/// Creates the dataset of the record.
pub(crate) fn create(file: &hdf5::File, taps_max: usize) -> hdf5::Result<()> {
    let builder = file.new_dataset::<u8>().shape(record_bytes(taps_max)).obj_track_times(false);
    let dataset = builder.alloc_time(Some(AllocTime::Early)).fill_time(FillTime::Alloc).create(table::STRUCTURE)?;
    // Written now, so that the library has no copy that it writes later.
    dataset.write_raw(&vec![0_u8; record_bytes(taps_max)])
}

/// The parts of an archive that may change, as the library reports them.
#[derive(Debug)]
pub(crate) struct Changing {
    tables: Vec<Extent>,
    /// Object header and rows of the samples, if their index is final.
    samples: Option<(u64, usize)>,
    has_codec: bool,
}

/// The parts of the new archive in `file`, at `path`, that may change.
pub(crate) fn changing(file: &hdf5::File, is_results: bool, path: &Path) -> Result<Changing> {
    let extents = || -> hdf5::Result<(Vec<Extent>, Option<ChunkRows>)> {
        let mut tables = Vec::new();
        for name in TABLES.into_iter().filter(|name| !(is_results && name.starts_with(table::TAPS))) {
            let dataset = file.dataset(name)?;
            tables.extend(dataset.offset().map(|begin| Extent { begin, bytes: dataset.storage_size() }));
        }
        if is_results {
            tables.push(ROOT_CACHE);
            return Ok((tables, None));
        }
        let dataset = file.dataset(table::SAMPLES)?;
        let codec = crate::h5::text::read_text(&dataset, crate::format::layout::attribute::CODEC)?;
        let codec = Codec::from_name(&codec).filter(|codec| codec.is_for_lines());
        let row_bytes = dataset.shape().iter().skip(1).product::<usize>() * dataset.dtype()?.size();
        Ok((tables, codec.and_then(|codec| ChunkRows::new(dataset, codec, row_bytes))))
    };
    let (tables, rows) = extents().context("lay out the tables", path)?;
    let has_codec = rows.as_ref().is_some_and(|rows| rows.codec() != Codec::None);
    let samples = rows.and_then(|rows| Some((rows.header_address()?, rows.row_count())));
    Ok(Changing { tables, samples, has_codec })
}

/// Writes the record of the archive at `path`, which the library has closed.
pub(crate) fn write(path: &Path, changing: Changing) -> std::io::Result<()> {
    let file = File::options().read(true).write(true).open(path)?;
    let bytes = file.metadata()?.len();
    let own = changing.tables.first().copied().ok_or(ErrorKind::InvalidData)?;
    let mut extents = [changing.tables, vec![STATUS, END_OF_FILE]].concat();
    let mut nodes = Vec::new();
    if let Some((header, row_count)) = changing.samples {
        let index = index(&file, header, row_count, RANK).ok_or(ErrorKind::InvalidData)?;
        extents.extend(index.chunks.iter().flatten().map(|(extent, _)| *extent));
        nodes = if changing.has_codec { index.nodes } else { nodes };
    }
    let (header, row_count) = changing.samples.unwrap_or((u64::MAX, 0));
    let record = Record { bytes, header, row_count, extents: merged(extents), nodes };
    let digest = record.digest(&file)?;
    let encoded = record.encode(&digest);
    if encoded.len() as u64 > own.bytes {
        return Err(ErrorKind::InvalidData.into());
    }
    file.write_all_at(&encoded, own.begin)
}

/// Checks the structure of the archive in `file`, at `path`: only what may change has changed, and every chunk lies
/// where it may.
///
/// # Errors
/// [`Error::Damaged`], [`Error::NotAnArchive`], or what the system returns.
pub(crate) fn check(file: &File, path: &Path) -> Result<()> {
    let context = "check the structure";
    let length = file.metadata().context(context, path)?.len();
    let mut beginning = vec![0; usize::try_from(length).unwrap_or(usize::MAX).min(WITHIN_BYTES)];
    file.read_exact_at(&mut beginning, 0).context(context, path)?;
    let at = beginning.chunks_exact(8).position(|word| *word == MAGIC[..8]).map(|number| 8 * number);
    let Some(at) = at.filter(|&at| beginning[at..].starts_with(&MAGIC)) else {
        let what = "it has no record of its structure, or a damaged one".to_owned();
        return Err(Error::NotAnArchive { path: path.to_owned(), what });
    };
    let damaged = |what: &str| Error::Damaged { path: path.to_owned(), what: what.to_owned() };
    let words = usize::try_from(word(&beginning, at + 24)).unwrap_or(usize::MAX);
    let encoded_bytes = words.checked_mul(8).filter(|&bytes| bytes as u64 <= length - at as u64 && words >= HEAD_WORDS);
    let Some(encoded_bytes) = encoded_bytes else { return Err(damaged("the record of its structure is damaged")) };
    let mut encoded = vec![0; encoded_bytes];
    file.read_exact_at(&mut encoded, at as u64).context(context, path)?;
    let Some((record, digest)) = Record::decode(&encoded) else {
        return Err(damaged("the record of its structure is damaged"));
    };
    if record.bytes > length {
        return Err(damaged("it is shorter than it was when it was begun"));
    }
    let current = match record.digest(file) {
        // A node of the index leads nowhere.
        Err(error) if matches!(error.kind(), ErrorKind::InvalidData | ErrorKind::UnexpectedEof) => None,
        current => Some(current.context(context, path)?),
    };
    if current != Some(digest) {
        return Err(damaged("its structure is not what it was when it was begun"));
    }
    let mut status = [0; 4];
    file.read_exact_at(&mut status, STATUS.begin).context(context, path)?;
    if u32::from_le_bytes(status) > 1 {
        return Err(damaged("its structure is not what it was when it was begun"));
    }
    let mut end = [0; 8];
    file.read_exact_at(&mut end, END_OF_FILE.begin).context(context, path)?;
    if !(record.bytes..=length).contains(&u64::from_le_bytes(end)) {
        return Err(damaged("it is shorter than it says"));
    }
    if record.row_count > 0 {
        let index = index(file, record.header, record.row_count, RANK);
        let is_valid = |Index { chunks, .. }: &Index| {
            chunks
                .iter()
                .all(|chunk| chunk.is_some_and(|(location, mask)| mask == 0 && record.may_have(location, length)))
        };
        if !index.as_ref().is_some_and(is_valid) {
            return Err(damaged("the index of its samples is not what was written"));
        }
    }
    Ok(())
}

/// The record.
#[derive(Debug, PartialEq)]
struct Record {
    /// Bytes of the file at creation.
    bytes: u64,
    /// Object header of the samples.
    header: u64,
    /// Rows of the samples; 0 if they are in another file.
    row_count: usize,
    /// Extents that may change.
    extents: Vec<Extent>,
    /// Nodes of the index, whose entries may change.
    nodes: Vec<u64>,
}

impl Record {
    fn digest(&self, file: &File) -> std::io::Result<[u8; 32]> {
        let mut hasher = blake3::Hasher::new();
        let mut without = self.extents.clone();
        for &node in &self.nodes {
            let bytes = node_with_changes_left_out(file, node, RANK).ok_or(ErrorKind::InvalidData)?;
            hasher.update(&bytes);
            without.push(Extent { begin: node, bytes: bytes.len() as u64 });
        }
        add_bytes(&mut hasher, file, self.bytes, &merged(without))?;
        Ok(*hasher.finalize().as_bytes())
    }

    /// Whether a chunk may lie at `extent` in a file of `length` bytes: behind what was created, or where chunks lay then.
    fn may_have(&self, extent: Extent, length: u64) -> bool {
        let is_in_file = extent.bytes > 0 && extent.begin.checked_add(extent.bytes).is_some_and(|end| end <= length);
        let is_in = |may: &Extent| {
            let end = if may.end() == self.bytes { u64::MAX } else { may.end() };
            may.begin <= extent.begin && extent.end() <= end
        };
        is_in_file && (extent.begin >= self.bytes || self.extents.iter().any(is_in))
    }

    fn encode(&self, digest: &[u8; 32]) -> Vec<u8> {
        let words = HEAD_WORDS + 2 * self.extents.len() + self.nodes.len();
        let mut encoded = Vec::with_capacity(8 * words);
        encoded.extend_from_slice(&MAGIC);
        encoded.extend_from_slice(&[0; 8]);
        let mut put = |word: u64| encoded.extend_from_slice(&word.to_le_bytes());
        put(words as u64);
        put(self.bytes);
        (0..4).for_each(|k| put(word(digest, 8 * k)));
        put(self.header);
        put(self.row_count as u64);
        put(self.extents.len() as u64);
        put(self.nodes.len() as u64);
        self.extents.iter().flat_map(|extent| [extent.begin, extent.bytes]).for_each(&mut put);
        self.nodes.iter().copied().for_each(put);
        let checksum = XxHash3_64::oneshot(&encoded);
        encoded[16..24].copy_from_slice(&checksum.to_le_bytes());
        encoded
    }

    /// The record and the digest in `encoded`, which begins with [`MAGIC`]; `None` if the checksum or a length is wrong.
    fn decode(encoded: &[u8]) -> Option<(Self, [u8; 32])> {
        let mut without_checksum = encoded.to_vec();
        without_checksum.get_mut(16..24)?.fill(0);
        if XxHash3_64::oneshot(&without_checksum) != word(encoded, 16) {
            return None;
        }
        let at = |number: usize| word(encoded, 8 * number);
        let count = |number: usize| usize::try_from(at(number)).ok();
        let (extent_count, node_count) = (count(11)?, count(12)?);
        let words = HEAD_WORDS.checked_add(extent_count.checked_mul(2)?)?.checked_add(node_count)?;
        if 8 * words != encoded.len() {
            return None;
        }
        let extents = (0..extent_count).map(|k| HEAD_WORDS + 2 * k);
        let record = Self {
            bytes: at(4),
            header: at(9),
            row_count: count(10)?,
            extents: extents.map(|k| Extent { begin: at(k), bytes: at(k + 1) }).collect(),
            nodes: (0..node_count).map(|k| at(HEAD_WORDS + 2 * extent_count + k)).collect(),
        };
        Some((record, *encoded.get(40..)?.first_chunk()?))
    }
}
