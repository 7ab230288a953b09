//! The checksum of a packed chunk, which is checked at every reading: it costs a tenth of a cryptographic one.

use twox_hash::XxHash3_64;

use crate::blosc::Head;
use crate::codec::Codec;

/// The checksum of `stored`, the packed bytes of a tap: that of its [`Head`], in which are those of its blocks, or where it
/// has none, of all of it.
pub fn chunk_checksum(codec: Codec, stored: &[u8]) -> u64 {
    head_of(codec, stored).map_or_else(|| XxHash3_64::oneshot(stored), |head| head.checksum())
}

/// Whether `stored`, which `codec` packed, is what it was when its checksum was `said`.
pub fn is_chunk_valid(codec: Codec, stored: &[u8], said: u64) -> bool {
    let are_blocks_valid = || head_of(codec, stored).is_none_or(|head| head.are_valid(head.all(), stored));
    chunk_checksum(codec, stored) == said && are_blocks_valid()
}

/// The head of the chunk that begins with `stored`, where chunks of `codec` have one.
pub fn head_of(codec: Codec, stored: &[u8]) -> Option<Head<'_>> {
    // What other codecs make of samples is not theirs to choose, and may look like anything.
    Some(stored).filter(|_| codec == Codec::Lz4).and_then(Head::new)
}
