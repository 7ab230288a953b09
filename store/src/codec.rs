//! How samples lie in a chunk: as they are, or packed by a filter that other readers of HDF5 know by its number.
#![expect(unsafe_code, reason = "the codec is a library of C")]

use std::ffi::CStr;
use std::fmt;

use blosc_src::{BLOSC_BITSHUFFLE, BLOSC_MAX_OVERHEAD, blosc_compress_ctx, blosc_decompress_ctx};
use serde::{Deserialize, Serialize};

/// Bytes that are packed on their own, so that a part of a record can be unpacked alone: 4096 samples of 16 bits.
const BLOCK_BYTES: usize = 8192;

/// What packs the samples of an archive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Codec {
    /// Nothing: every HDF5 reader reads it without a filter.
    None,
    /// Blosc (filter 32001), bits shuffled, LZ4: as fast as a disk.
    #[default]
    Lz4,
    /// Blosc (filter 32001), bits shuffled, Zstandard: a little smaller, slower.
    Zstd,
    /// LZF (filter 32000), bytes shuffled: what h5py reads by itself. For archives that are packed again.
    Lzf,
    /// Deflate (filter 1), bytes shuffled: what every HDF5 reader reads. Slow; for archives that are packed again.
    Gzip,
}

impl Codec {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::None, Self::Lz4, Self::Zstd, Self::Lzf, Self::Gzip];

    /// Its name in configurations, on the command line and in archives.
    pub fn name(self) -> &'static str {
        ["none", "lz4", "zstd", "lzf", "gzip"][self as usize]
    }

    /// The codec of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|codec| codec.name() == name)
    }

    /// Whether a running line can pack by it: the others are packed by the HDF5 library alone, one record after another.
    pub fn is_for_lines(self) -> bool {
        matches!(self, Self::None | Self::Lz4 | Self::Zstd)
    }

    /// How hard it packs, where it has levels: what the file says of its filter, and what [`pack`] does.
    pub(crate) fn level(self) -> u8 {
        match self {
            Self::Lz4 => 5,
            Self::Zstd => 1,
            Self::Gzip => 4,
            Self::None | Self::Lzf => 0,
        }
    }

    /// Compressor within Blosc; `None` where it is not Blosc's.
    pub(crate) fn blosc(self) -> Option<&'static CStr> {
        match self {
            Self::Lz4 => Some(c"lz4"),
            Self::Zstd => Some(c"zstd"),
            Self::None | Self::Lzf | Self::Gzip => None,
        }
    }
}

impl fmt::Display for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Packs `samples` of `element_bytes` each into `packed`, whose old contents are lost, as the filter of `codec` does; the
/// same input gives the same bytes. Those of a codec that is not Blosc's are left as they are.
///
/// # Panics
/// If Blosc finds no room in what it says is enough: a bug.
pub(crate) fn pack(codec: Codec, element_bytes: usize, samples: &[u8], packed: &mut Vec<u8>) {
    match codec.blosc() {
        Some(compressor) => pack_blocks((compressor, codec.level()), element_bytes, BLOCK_BYTES, samples, packed),
        None => {
            packed.clear();
            packed.extend_from_slice(samples);
        }
    }
}

/// A row of `row_bytes` zeros as the filter of `codec` unpacks it, in as few bytes as can be: what stands where no tap is.
pub(crate) fn placeholder(codec: Codec, element_bytes: usize, row_bytes: usize) -> Vec<u8> {
    let mut packed = Vec::new();
    match codec.blosc() {
        // Which compressor packed a chunk stands in the chunk.
        Some(_) => pack_blocks((c"zstd", 1), element_bytes, row_bytes, &vec![0; row_bytes], &mut packed),
        None => packed.resize(row_bytes, 0),
    }
    packed
}

fn pack_blocks(
    (compressor, level): (&CStr, u8),
    element_bytes: usize,
    block_bytes: usize,
    samples: &[u8],
    packed: &mut Vec<u8>,
) {
    // What was in it is written over: only what it lacks is filled.
    packed.resize(samples.len() + BLOSC_MAX_OVERHEAD as usize, 0);
    let shuffle = i32::try_from(BLOSC_BITSHUFFLE).unwrap_or(0);
    // SAFETY: source and destination are valid for the lengths given and do not overlap; the name ends in NUL; the
    // call with a context of its own keeps no state and no pointer.
    let length = unsafe {
        blosc_compress_ctx(
            level.into(),
            shuffle,
            element_bytes,
            samples.len(),
            samples.as_ptr().cast(),
            packed.as_mut_ptr().cast(),
            packed.len(),
            compressor.as_ptr(),
            block_bytes,
            1,
        )
    };
    let length = usize::try_from(length).unwrap_or(0);
    assert!(length > 0 || samples.is_empty(), "Blosc packed {} bytes into none", samples.len());
    packed.truncate(length);
}

/// Unpacks what [`pack`] packed into `samples`, all of it; whether it was that, and as long as `samples`.
#[must_use]
pub(crate) fn unpack(codec: Codec, packed: &[u8], samples: &mut [u8]) -> bool {
    if codec.blosc().is_none() {
        let is_whole = packed.len() == samples.len();
        if is_whole {
            samples.copy_from_slice(packed);
        }
        return is_whole;
    }
    if !is_blosc_of(packed, samples.len()) {
        return false;
    }
    // SAFETY: the source is as long as its own header says (checked above), the destination as long as is given; they do
    // not overlap; Blosc writes no further than it is told, whatever the packed bytes say.
    let length = unsafe { blosc_decompress_ctx(packed.as_ptr().cast(), samples.as_mut_ptr().cast(), samples.len(), 1) };
    usize::try_from(length).is_ok_and(|length| length == samples.len())
}

/// Whether `packed` has Blosc's header, which says that it unpacks to `length` bytes and is as long as it is.
fn is_blosc_of(packed: &[u8], length: usize) -> bool {
    let word = |at: usize| packed.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    word(4) == Some(length) && word(12) == Some(packed.len())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Catches samples that do not come back, bytes that change from call to call, and a packing that outgrows its room.
        #[test]
        fn what_is_packed_comes_back(samples in prop::collection::vec(any::<u8>(), 1..40_000), quiet in any::<bool>()) {
            let samples: Vec<u8> = samples.into_iter().map(|byte| if quiet { byte & 1 } else { byte }).collect();
            for codec in [Codec::None, Codec::Lz4, Codec::Zstd] {
                let (mut packed, mut again, mut back) = (Vec::new(), Vec::new(), vec![7; samples.len()]);
                pack(codec, 2, &samples, &mut packed);
                pack(codec, 2, &samples, &mut again);
                prop_assert!(packed == again && unpack(codec, &packed, &mut back) && back == samples, "{}", codec);
            }
        }

        /// Catches a reader that trusts damaged bytes: it says no or gives other samples, and never more than asked for.
        #[test]
        fn damaged_bytes_do_no_harm(at in 0_usize..100_000, flip in 1_u8.., cut in 0_usize..9000) {
            let samples: Vec<u8> = (0..9000_u32).map(|k| (k / 50) as u8).collect();
            for codec in [Codec::Lz4, Codec::Zstd] {
                let mut packed = Vec::new();
                pack(codec, 2, &samples, &mut packed);
                let length = packed.len();
                packed[at % length] ^= flip;
                let mut back = vec![0; samples.len()];
                let _is_known = unpack(codec, &packed, &mut back);
                prop_assert!(!unpack(codec, &packed[..cut % length], &mut back));
            }
        }
    }
}
