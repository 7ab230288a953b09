//! The checksum of a packed chunk. It is checked at every read, and costs a tenth of a cryptographic hash.

use twox_hash::XxHash3_64;

use crate::blosc::Head;
use crate::codec::Codec;

/// The checksum of `stored`, the packed chunk of a tap: of its [`Head`], which contains those of the blocks, or of the whole
/// chunk if it has no head.
pub fn chunk_checksum(codec: Codec, stored: &[u8]) -> u64 {
    head_of(codec, stored).map_or_else(|| XxHash3_64::oneshot(stored), |head| head.checksum())
}

/// Whether `checksum` is that of `stored`, which `codec` packed.
pub fn is_chunk_valid(codec: Codec, stored: &[u8], checksum: u64) -> bool {
    let are_blocks_valid = || head_of(codec, stored).is_none_or(|head| head.are_valid(head.all(), stored));
    chunk_checksum(codec, stored) == checksum && are_blocks_valid()
}

/// The head of the chunk that begins with `stored`; `None` if it has none.
pub fn head_of(codec: Codec, stored: &[u8]) -> Option<Head<'_>> {
    // Chunks of other codecs may resemble anything.
    Some(stored).filter(|_| codec == Codec::Lz4).and_then(Head::new)
}
