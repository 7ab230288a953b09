//! Chunks of Blosc 1: a header, the offsets of the blocks, and blocks of bit planes, each packed with LZ4.
//!
//! The C library uses the vector instructions that it was compiled for, not those of the machine, and packs each byte of the
//! samples separately, so that planes of the high byte cannot repeat the last plane of the low byte. Here a block is packed as
//! a whole, and is short, so that part of a chunk can be unpacked. Each unpacks what the other packs.

mod head;

use std::ops::Range;

pub use head::Head;

use crate::lz4;
use crate::planes::{from_planes, to_planes};

/// Bytes of a block: 4096 samples of 16 bits, so that the beginning of a record can be unpacked separately.
const BLOCK_BYTES: usize = 8192;

/// Bytes of the longest record: lengths and offsets in a chunk are signed numbers of 32 bits, also of blocks that do not pack.
pub const RECORD_BYTES_MAX: usize = 1 << 30;

/// Bytes of the header, before the offsets of the blocks.
const HEADER_BYTES: usize = 16;

/// Bytes of an offset or a length.
const WORD_BYTES: usize = 4;

/// Versions of the chunk format and of its LZ4.
const VERSIONS: [u8; 2] = [2, 1];

/// Flags in the third byte of the header: bytes shuffled, samples stored as they are, bits shuffled, a flag that no version
/// defines, blocks not split into the bytes of samples; the compressor.
const BYTES_SHUFFLED: u8 = 1;
const STORED: u8 = 2;
const BITS_SHUFFLED: u8 = 4;
const UNKNOWN: u8 = 8;
const UNSPLIT: u8 = 16;
const LZ4: u8 = 1 << 5;
const COMPRESSOR: u8 = 7 << 5;

/// Blocks of fewer samples are not split.
const SPLIT_SAMPLES_MIN: usize = 128;

/// Blocks of wider samples, in bytes, are not split.
const SPLIT_SAMPLE_BYTES_MAX: usize = 16;

/// Packs `samples` of `element_bytes` each into `packed`, whose old contents are lost; `planes` is a buffer for reuse.
///
/// The chunk has a [`Head`], unless packing gains nothing.
///
/// # Panics
/// If there are 2 GiB of samples or more.
pub(crate) fn pack(element_bytes: usize, samples: &[u8], planes: &mut Vec<u8>, packed: &mut Vec<u8>) {
    let block_count = samples.len().div_ceil(BLOCK_BYTES);
    let head_bytes = head::length(block_count);
    header(element_bytes, samples.len(), BITS_SHUFFLED | UNSPLIT | LZ4, packed);
    // Reserved at once: growing would copy.
    packed.reserve(head_bytes + samples.len() + WORD_BYTES * block_count);
    packed.resize(head_bytes, 0);
    planes.resize(BLOCK_BYTES, 0);
    for (number, block) in samples.chunks(BLOCK_BYTES).enumerate() {
        let planes = &mut planes[..block.len()];
        to_planes(element_bytes, block, planes);
        let begin = packed.len();
        put(packed, HEADER_BYTES + WORD_BYTES * number, begin);
        packed.extend_from_slice(&[0; WORD_BYTES]);
        match element_bytes {
            2 => lz4::pack(planes, (planes.len() / (8 * element_bytes)).max(1), packed),
            _ => lz4::pack_by_search(planes, packed),
        }
        // As in the library, a block that does not become shorter is stored as it is.
        let length = packed.len() - begin - WORD_BYTES;
        if length == 0 || length >= planes.len() {
            packed.truncate(begin + WORD_BYTES);
            packed.extend_from_slice(planes);
        }
        let length = packed.len() - begin - WORD_BYTES;
        put(packed, begin, length);
        head::put_sum(packed, block_count, number, begin);
    }
    if packed.len() >= samples.len() + HEADER_BYTES {
        header(element_bytes, samples.len(), BITS_SHUFFLED | UNSPLIT | LZ4 | STORED, packed);
        packed.extend_from_slice(samples);
    }
    let length = packed.len();
    put(packed, HEADER_BYTES - WORD_BYTES, length);
}

/// Replaces `packed` by a header, in which the length of the chunk is still 0.
fn header(element_bytes: usize, length: usize, flags: u8, packed: &mut Vec<u8>) {
    packed.clear();
    packed.extend_from_slice(&VERSIONS);
    packed.extend_from_slice(&[flags, element_bytes as u8]);
    packed.resize(HEADER_BYTES, 0);
    put(packed, 4, length);
    put(packed, 8, length.clamp(1, BLOCK_BYTES));
}

fn put(packed: &mut [u8], at: usize, value: usize) {
    let value = i32::try_from(value).unwrap_or_else(|_| panic!("{value} bytes do not fit a chunk"));
    packed[at..at + WORD_BYTES].copy_from_slice(&value.to_le_bytes());
}

/// A chunk whose header is read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chunk<'a> {
    packed: &'a [u8],
    element_bytes: usize,
    length: usize,
    block_bytes: usize,
    is_stored: bool,
    is_split: bool,
}

impl<'a> Chunk<'a> {
    /// The chunk `packed`; `None` if it is not a Blosc chunk of its own length, or was not packed by LZ4 with shuffled bits.
    pub(crate) fn new(packed: &'a [u8]) -> Option<Self> {
        let &[version, of_lz4, flags, element_bytes, ..] = packed else { return None };
        let (length, block_bytes) = (word(packed, 4)?, word(packed, 8)?);
        let is_ours = [version, of_lz4] == VERSIONS
            && flags & COMPRESSOR == LZ4
            && flags & (BYTES_SHUFFLED | BITS_SHUFFLED | UNKNOWN) == BITS_SHUFFLED
            && (1..=length.max(1)).contains(&block_bytes)
            && [length, block_bytes].iter().all(|bytes| bytes.is_multiple_of(element_bytes.into()))
            && word(packed, 12)? == packed.len();
        is_ours.then_some(Self {
            packed,
            element_bytes: element_bytes.into(),
            length,
            block_bytes,
            is_stored: flags & STORED != 0,
            is_split: flags & UNSPLIT == 0,
        })
    }

    /// Unpacks the blocks that hold `parts` of the samples, which are ascending, to their offsets in `samples`, which are all
    /// samples; false if the chunk is corrupt. `planes` is a buffer for reuse.
    #[must_use]
    pub(crate) fn unpack(
        &self,
        parts: impl IntoIterator<Item = Range<usize>>,
        samples: &mut [u8],
        planes: &mut Vec<u8>,
    ) -> bool {
        if samples.len() != self.length {
            return false;
        }
        let stored = self.packed.get(HEADER_BYTES..).filter(|stored| stored.len() == self.length);
        if self.is_stored && stored.is_none() {
            return false;
        }
        planes.resize(self.block_bytes, 0);
        // Blocks before this one are unpacked already: two parts may lie in one block.
        let mut next = 0;
        parts.into_iter().all(|part| match stored.filter(|_| self.is_stored) {
            Some(stored) => {
                samples[part.clone()].copy_from_slice(&stored[part]);
                true
            }
            None => {
                let first = (part.start / self.block_bytes).max(next);
                next = part.end.div_ceil(self.block_bytes).max(next);
                let mut blocks = samples.chunks_mut(self.block_bytes).enumerate().take(next).skip(first);
                blocks.all(|(number, block)| self.block(number, block, planes).is_some())
            }
        })
    }

    /// Unpacks block `number`; `None` if it is corrupt.
    fn block(&self, number: usize, block: &mut [u8], planes: &mut [u8]) -> Option<()> {
        let planes = &mut planes[..block.len()];
        let is_last = block.len() < self.block_bytes;
        let is_split = self.is_split
            && !is_last
            && self.element_bytes <= SPLIT_SAMPLE_BYTES_MAX
            && self.block_bytes / self.element_bytes >= SPLIT_SAMPLES_MIN;
        let parts = if is_split { self.element_bytes } else { 1 };
        let mut at = word(self.packed, HEADER_BYTES + WORD_BYTES * number)?;
        for part in planes.chunks_exact_mut(block.len() / parts) {
            let length = word(self.packed, at)?;
            let begin = at + WORD_BYTES;
            let packed = self.packed.get(begin..begin.checked_add(length)?)?;
            if packed.len() == part.len() {
                part.copy_from_slice(packed);
            } else if !lz4::unpack(packed, part) {
                return None;
            }
            at = begin + length;
        }
        from_planes(self.element_bytes, planes, block);
        Some(())
    }
}

fn word(packed: &[u8], at: usize) -> Option<usize> {
    let bytes = packed.get(at..)?.first_chunk()?;
    usize::try_from(u32::from_le_bytes(*bytes)).ok()
}
