//! The head of a chunk: its header, the offset of each block, and a checksum of each block.
//!
//! The offsets are Blosc's. Blosc's decoders ignore a gap before the first block, and the checksums are stored there. So the
//! checksum of the head covers the whole chunk, and a reader of part of a chunk checks only its blocks.

use std::ops::Range;

use twox_hash::XxHash3_64;

use super::{HEADER_BYTES, STORED, WORD_BYTES, word};

/// Bytes of the checksum of a block, an XXH3 of 64 bits.
const SUM_BYTES: usize = 8;

/// The head of a chunk whose blocks have checksums.
#[derive(Debug, Clone, Copy)]
pub struct Head<'a> {
    bytes: &'a [u8],
    block_count: usize,
    block_bytes: usize,
    chunk_bytes: usize,
}

impl<'a> Head<'a> {
    /// The head of the chunk that begins with `beginning`; `None` if its blocks have no checksums, because packing gained
    /// nothing or because another program packed it.
    pub fn new(beginning: &'a [u8]) -> Option<Self> {
        let (row_bytes, block_bytes) = (word(beginning, 4)?, word(beginning, 8).filter(|&bytes| bytes > 0)?);
        let block_count = row_bytes.div_ceil(block_bytes);
        let head = Self {
            bytes: beginning.get(..length(block_count))?,
            block_count,
            block_bytes,
            chunk_bytes: word(beginning, 12)?,
        };
        let is_packed = beginning.get(2)? & STORED == 0 && block_count > 0;
        (is_packed && head.begin(0) == head.bytes.len()).then_some(head)
    }

    /// The checksum of the head, which is that of the chunk.
    pub fn checksum(&self) -> u64 {
        XxHash3_64::oneshot(self.bytes)
    }

    /// Bytes of the whole chunk.
    pub fn chunk_bytes(&self) -> usize {
        self.chunk_bytes
    }

    /// The blocks that hold the bytes `part` of the unpacked row.
    pub fn blocks(&self, part: &Range<usize>) -> Range<usize> {
        let end = part.end.div_ceil(self.block_bytes).min(self.block_count);
        (part.start / self.block_bytes).min(end)..end
    }

    /// All blocks.
    pub fn all(&self) -> Range<usize> {
        0..self.block_count
    }

    /// Where `blocks` lie in the chunk; within `0..chunk_bytes` even if the offsets are damaged.
    pub fn extent(&self, blocks: &Range<usize>) -> Range<usize> {
        let end = self.begin(blocks.end).min(self.chunk_bytes);
        self.begin(blocks.start).min(end)..end
    }

    /// Whether the checksums of `blocks` of `chunk` are valid.
    pub fn are_valid(&self, blocks: Range<usize>, chunk: &[u8]) -> bool {
        let is_valid = |block: usize| {
            let packed = chunk.get(self.begin(block)..self.begin(block + 1));
            let stored = self.bytes.get(sum_at(self.block_count, block)..).and_then(<[u8]>::first_chunk);
            packed.map(XxHash3_64::oneshot) == stored.map(|bytes| u64::from_le_bytes(*bytes))
        };
        chunk.len() == self.chunk_bytes && blocks.into_iter().all(is_valid)
    }

    /// Offset of `block` in the chunk; for the number of blocks, the end of the chunk.
    fn begin(&self, block: usize) -> usize {
        let offset = if block < self.block_count { word(self.bytes, HEADER_BYTES + WORD_BYTES * block) } else { None };
        offset.unwrap_or(self.chunk_bytes)
    }
}

/// Bytes of the head of a chunk of `block_count` blocks.
pub(super) fn length(block_count: usize) -> usize {
    HEADER_BYTES + (WORD_BYTES + SUM_BYTES) * block_count
}

/// Offset of the checksum of `block` in the head of a chunk of `block_count` blocks.
fn sum_at(block_count: usize, block: usize) -> usize {
    HEADER_BYTES + WORD_BYTES * block_count + SUM_BYTES * block
}

/// Writes the checksum of block `block` of `block_count`, which goes from `begin` to the end of `chunk`.
pub(super) fn put_sum(chunk: &mut [u8], block_count: usize, block: usize, begin: usize) {
    let sum = XxHash3_64::oneshot(&chunk[begin..]);
    chunk[sum_at(block_count, block)..][..SUM_BYTES].copy_from_slice(&sum.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tapline_testing::noise::Noise;

    use super::*;
    use crate::checksum::{chunk_checksum, head_of, is_chunk_valid};
    use crate::codec::Codec;

    /// A chunk of three blocks, the last one short.
    fn chunk() -> Vec<u8> {
        let samples: Vec<u8> = (0..20_000_u32).map(|k| (k / 70) as u8).collect();
        let mut chunk = Vec::new();
        super::super::pack(2, &samples, &mut Vec::new(), &mut chunk);
        chunk
    }

    /// Catches a bit that no checksum covers, and a checksum that covers another block than its own.
    #[test]
    fn every_bit_is_covered() {
        let mut chunk = chunk();
        let checksum = chunk_checksum(Codec::Lz4, &chunk);
        assert!(is_chunk_valid(Codec::Lz4, &chunk, checksum));
        let head_bytes = length(3);
        let ends = [0, 1, 2, 3].map(|block| Head::new(&chunk).unwrap().begin(block));
        assert_eq!((ends[0], ends[3]), (head_bytes, chunk.len()));
        for bit in 0..8 * chunk.len() {
            chunk[bit / 8] ^= 1 << (bit % 8);
            assert!(!is_chunk_valid(Codec::Lz4, &chunk, checksum), "bit {bit}");
            if bit / 8 >= head_bytes {
                let head = Head::new(&chunk).unwrap();
                assert_eq!(head.checksum(), checksum);
                for block in 0..3 {
                    let is_in_it = (ends[block]..ends[block + 1]).contains(&(bit / 8));
                    assert_eq!(head.are_valid(block..block + 1, &chunk), !is_in_it, "bit {bit}, block {block}");
                }
            }
            chunk[bit / 8] ^= 1 << (bit % 8);
        }
        assert!(!is_chunk_valid(Codec::Lz4, &chunk[..chunk.len() - 1], checksum));
        chunk.push(0);
        assert!(!is_chunk_valid(Codec::Lz4, &chunk, checksum), "bytes behind the last block are not covered");
    }

    /// Catches a part whose blocks are not all found, and blocks that do not exist.
    #[test]
    fn a_part_has_its_blocks() {
        let chunk = chunk();
        let head = Head::new(&chunk).unwrap();
        assert_eq!(head.all(), 0..3);
        assert_eq!(head.extent(&head.all()), length(3)..chunk.len());
        assert_eq!(head.extent(&(1..2)), head.begin(1)..head.begin(2));
        for (part, blocks) in [
            (0..1, 0..1),
            (0..8192, 0..1),
            (0..8193, 0..2),
            (8191..8192, 0..1),
            (8192..16_384, 1..2),
            (8191..20_000, 0..3),
            (16_384..20_000, 2..3),
            (20_000..90_000, 2..3),
            (90_000..90_001, 3..3),
        ] {
            assert_eq!(head.blocks(&part), blocks, "{part:?}");
        }
    }

    proptest! {
        /// Catches a reader that trusts damaged lengths and offsets: any bytes are a head or none, and most of these are a head.
        #[test]
        fn any_bytes_are_a_head_or_none(
            mut bytes in prop::collection::vec(any::<u8>(), 260..300),
            row_bytes in 0..40_u32,
            block_bytes in 0..5_u32,
            begins in prop::collection::vec(0..320_u32, 20),
        ) {
            let count = row_bytes.div_ceil(block_bytes.max(1));
            let sizes = [row_bytes, block_bytes, 300, 16 + 12 * count];
            for (place, word) in bytes[4..].chunks_exact_mut(4).zip(sizes.into_iter().chain(begins)) {
                place.copy_from_slice(&word.to_le_bytes());
            }
            let head = Head::new(&bytes);
            let is_there = count > 0 && length(count as usize) <= bytes.len();
            prop_assert_eq!(head.is_some(), bytes[2] & STORED == 0 && block_bytes > 0 && is_there);
            if let Some(head) = head {
                prop_assert!(!head.are_valid(head.all(), &bytes));
                prop_assert!(head.blocks(&(0..usize::MAX)) == head.all());
                for block in head.all() {
                    let extent = head.extent(&(block..block + 1));
                    prop_assert!(extent.start <= extent.end && extent.end <= 300);
                }
            }
        }
    }

    /// Catches a chunk of another kind that is taken for one with a head.
    #[test]
    fn other_chunks_have_no_head() {
        let mut packed = Vec::new();
        let mut noise = Noise(1);
        let noise: Vec<u8> = (0..20_000).map(|_| (noise.bits() >> 24) as u8).collect();
        super::super::pack(2, &noise, &mut Vec::new(), &mut packed);
        assert!(Head::new(&packed).is_none(), "it gained nothing");
        assert!(Head::new(&[]).is_none());
        let chunk = chunk();
        assert!(head_of(Codec::Zstd, &chunk).is_none());
        assert_eq!(chunk_checksum(Codec::None, &chunk), XxHash3_64::oneshot(&chunk));
    }
}
