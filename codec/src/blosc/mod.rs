//! Chunks as Blosc 1 writes them: a header, where each block begins, and blocks of bit planes, each packed by LZ4.
//!
//! Blosc's own code has the vectors that it was built for, not those of the machine, and cuts a block into its samples'
//! bytes, which hides that the planes of the high byte repeat the last one of the low byte. Here a block is short, so that
//! part of a chunk can be had alone, and whole. What either writes, both read.

mod head;

use std::ops::Range;

pub use head::Head;

use crate::lz4;
use crate::planes::{from_planes, to_planes};

/// Bytes that are packed on their own: 4096 samples of 16 bits, so that the beginning of a record can be had alone.
const BLOCK_BYTES: usize = 8192;

/// Bytes of the longest record: chunks count by whole numbers of 32 bits with a sign, also where blocks begin that do not pack.
pub const RECORD_BYTES_MAX: usize = 1 << 30;

/// Bytes before the places of the blocks.
const HEADER_BYTES: usize = 16;

/// Bytes of a place or a length.
const WORD_BYTES: usize = 4;

/// Version of the chunk, and of LZ4 in it.
const VERSIONS: [u8; 2] = [2, 1];

/// Bits of the header's third byte: bytes shuffled, samples as they are, bits shuffled, what no version has yet, blocks not
/// cut into bytes; LZ4.
const BYTES_SHUFFLED: u8 = 1;
const AS_IT_IS: u8 = 2;
const BITS_SHUFFLED: u8 = 4;
const UNKNOWN: u8 = 8;
const UNCUT: u8 = 16;
const LZ4: u8 = 1 << 5;
const COMPRESSOR: u8 = 7 << 5;

/// Fewer samples than this in a block are not cut into their bytes.
const CUT_LEAST: usize = 128;

/// Most bytes of a sample whose blocks are cut.
const CUT_BYTES_MOST: usize = 16;

/// Packs `samples` of `element_bytes` each into `packed`, whose old contents are lost; `planes` is room to work in.
///
/// With a [`Head`], unless nothing is gained by packing.
///
/// # Panics
/// If there are 2 GiB of samples or more.
pub(crate) fn pack(element_bytes: usize, samples: &[u8], planes: &mut Vec<u8>, packed: &mut Vec<u8>) {
    let block_count = samples.len().div_ceil(BLOCK_BYTES);
    let head_bytes = head::length(block_count);
    header(element_bytes, samples.len(), BITS_SHUFFLED | UNCUT | LZ4, packed);
    // Room for all at once: growing would copy what is there.
    packed.reserve(head_bytes + samples.len() + WORD_BYTES * block_count);
    packed.resize(head_bytes, 0);
    planes.resize(BLOCK_BYTES, 0);
    for (number, block) in samples.chunks(BLOCK_BYTES).enumerate() {
        let planes = &mut planes[..block.len()];
        to_planes(element_bytes, block, planes);
        let begin = packed.len();
        put(packed, HEADER_BYTES + WORD_BYTES * number, begin);
        packed.extend_from_slice(&[0; WORD_BYTES]);
        lz4::pack(planes, (planes.len() / (8 * element_bytes)).max(1), packed);
        // As in the library, what gains nothing stands as it is.
        if packed.len() - begin - WORD_BYTES >= planes.len() {
            packed.truncate(begin + WORD_BYTES);
            packed.extend_from_slice(planes);
        }
        let length = packed.len() - begin - WORD_BYTES;
        put(packed, begin, length);
        head::put_sum(packed, block_count, number, begin);
    }
    if packed.len() >= samples.len() + HEADER_BYTES {
        header(element_bytes, samples.len(), BITS_SHUFFLED | UNCUT | LZ4 | AS_IT_IS, packed);
        packed.extend_from_slice(samples);
    }
    let length = packed.len();
    put(packed, HEADER_BYTES - WORD_BYTES, length);
}

/// Begins `packed` anew with a header that does not yet have the chunk's length.
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

/// What a chunk says of itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chunk<'a> {
    packed: &'a [u8],
    element_bytes: usize,
    length: usize,
    block_bytes: usize,
    is_as_it_is: bool,
    is_cut: bool,
}

impl<'a> Chunk<'a> {
    /// The chunk that `packed` is; `None` where it is no chunk of Blosc's, is not as long as it says, or was packed in
    /// another way than here: not by LZ4, or without planes of bits.
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
            is_as_it_is: flags & AS_IT_IS != 0,
            is_cut: flags & UNCUT == 0,
        })
    }

    /// Unpacks the bytes in `parts` of the samples, in their order, and such around them as are packed with them, into their
    /// places in `samples`, which are all samples; whether that could be done. `planes` is room to work in.
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
        let given = self.packed.get(HEADER_BYTES..).filter(|given| given.len() == self.length);
        if self.is_as_it_is && given.is_none() {
            return false;
        }
        planes.resize(self.block_bytes, 0);
        // Blocks before this one are unpacked: two parts may lie in one.
        let mut next = 0;
        parts.into_iter().all(|part| match given.filter(|_| self.is_as_it_is) {
            Some(given) => {
                samples[part.clone()].copy_from_slice(&given[part]);
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

    /// Unpacks block `number`; `None` where it is damaged.
    fn block(&self, number: usize, block: &mut [u8], planes: &mut [u8]) -> Option<()> {
        let planes = &mut planes[..block.len()];
        let is_last = block.len() < self.block_bytes;
        let is_cut = self.is_cut
            && !is_last
            && self.element_bytes <= CUT_BYTES_MOST
            && self.block_bytes / self.element_bytes >= CUT_LEAST;
        let parts = if is_cut { self.element_bytes } else { 1 };
        let mut at = word(self.packed, HEADER_BYTES + WORD_BYTES * number)?;
        for part in planes.chunks_exact_mut(block.len() / parts) {
            let length = word(self.packed, at)?;
            let begin = at + WORD_BYTES;
            let given = self.packed.get(begin..begin.checked_add(length)?)?;
            if given.len() == part.len() {
                part.copy_from_slice(given);
            } else if !lz4::unpack(given, part) {
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
