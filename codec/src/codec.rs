//! The codecs: samples as they are, or packed with a registered filter of HDF5.
#![expect(unsafe_code, reason = "Blosc is a C library")]

use std::ffi::CStr;
use std::fmt;
use std::io::{Read as _, Write as _};
use std::ops::Range;

use blosc_src::{BLOSC_BITSHUFFLE, BLOSC_MAX_OVERHEAD, blosc_compress_ctx, blosc_decompress_ctx};
use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use serde::{Deserialize, Serialize};

use crate::blosc::{self, Chunk};

/// Bytes of a block that Zstandard packs.
const ZSTD_BLOCK_BYTES: usize = 8192;

/// What packs the samples of an archive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Codec {
    /// Nothing: every HDF5 reader reads it without a filter.
    None,
    /// Blosc (filter 32001), bits shuffled, LZ4: as fast as a disk.
    #[default]
    Lz4,
    /// Blosc (filter 32001), bits shuffled, Zstandard: smaller and slower.
    Zstd,
    /// Deflate (filter 1), bytes shuffled: every HDF5 reader reads it. Slow; for archives that are repacked.
    Gzip,
}

impl Codec {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::None, Self::Lz4, Self::Zstd, Self::Gzip];

    /// Its name in configurations, on the command line and in archives.
    pub fn name(self) -> &'static str {
        ["none", "lz4", "zstd", "gzip"][self as usize]
    }

    /// The codec of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|codec| codec.name() == name)
    }

    /// Whether a running line can use it: Deflate is too slow.
    pub fn is_for_lines(self) -> bool {
        matches!(self, Self::None | Self::Lz4 | Self::Zstd)
    }

    /// The level of the filter as noted in the file. [`pack`] uses it except for LZ4, for which it has no levels.
    pub fn level(self) -> u8 {
        match self {
            Self::Lz4 => 5,
            Self::Zstd => 1,
            Self::Gzip => 4,
            Self::None => 0,
        }
    }

    /// Name of the compressor within Blosc; `None` if the codec is not Blosc.
    pub fn blosc(self) -> Option<&'static CStr> {
        match self {
            Self::Lz4 => Some(c"lz4"),
            Self::Zstd => Some(c"zstd"),
            Self::None | Self::Gzip => None,
        }
    }
}

impl fmt::Display for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Packs `samples` of `element_bytes` each into `packed`, whose old contents are lost, in the format of the filter of `codec`;
/// the same input gives the same bytes. Without a codec, the samples are copied. `planes` is a buffer for reuse.
///
/// # Panics
/// If Blosc needs more than its documented maximum of bytes, which is a bug.
pub fn pack(codec: Codec, element_bytes: usize, samples: &[u8], planes: &mut Vec<u8>, packed: &mut Vec<u8>) {
    match codec {
        Codec::Lz4 => blosc::pack(element_bytes, samples, planes, packed),
        Codec::Zstd => pack_by_library((c"zstd", codec.level()), element_bytes, ZSTD_BLOCK_BYTES, samples, packed),
        Codec::Gzip => {
            // All first bytes, then all second ones.
            planes.clear();
            planes.extend((0..element_bytes).flat_map(|byte| samples.iter().skip(byte).step_by(element_bytes)));
            packed.clear();
            let mut encoder = ZlibEncoder::new(packed, Compression::new(codec.level().into()));
            let written = encoder.write_all(planes).and_then(|()| encoder.finish().map(drop));
            written.expect("a vector takes all that is written");
        }
        Codec::None => {
            packed.clear();
            packed.extend_from_slice(samples);
        }
    }
}

/// A row of `row_bytes` zeros, packed for `codec` in as few bytes as possible: the chunk of a row without a tap.
pub fn placeholder(codec: Codec, element_bytes: usize, row_bytes: usize) -> Vec<u8> {
    let mut packed = Vec::new();
    match codec.blosc() {
        // A chunk names its compressor, so that it need not be that of the codec.
        Some(_) => pack_by_library((c"zstd", 1), element_bytes, row_bytes, &vec![0; row_bytes], &mut packed),
        None => packed.resize(row_bytes, 0),
    }
    packed
}

fn pack_by_library(
    (compressor, level): (&CStr, u8),
    element_bytes: usize,
    block_bytes: usize,
    samples: &[u8],
    packed: &mut Vec<u8>,
) {
    // Old contents are overwritten, so that only new bytes are filled.
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

/// Unpacks `parts` of the samples, in ascending order, from `packed`, which [`pack`] or the filter of `codec` packed;
/// bytes around them may be unpacked too. They go to their offsets in `samples`, which holds all samples. Returns false
/// if `packed` is corrupt, is Deflate ([`unpack_gzip`]), or its samples are not as long as `samples`. `planes` is a buffer for reuse.
#[must_use]
pub fn unpack(
    codec: Codec,
    packed: &[u8],
    parts: impl IntoIterator<Item = Range<usize>>,
    samples: &mut [u8],
    planes: &mut Vec<u8>,
) -> bool {
    if codec.blosc().is_none() {
        let is_valid = codec == Codec::None && packed.len() == samples.len();
        if is_valid {
            parts.into_iter().for_each(|part| samples[part.clone()].copy_from_slice(&packed[part]));
        }
        return is_valid;
    }
    if let Some(chunk) = Chunk::new(packed) {
        return chunk.unpack(parts, samples, planes);
    }
    if !is_blosc_of(packed, samples.len()) {
        return false;
    }
    unpack_by_library(packed, samples)
}

/// Unpacks samples of `element_bytes` each, which [`Codec::Gzip`] packed as `packed`; as [`unpack`], but all of them.
#[must_use]
pub fn unpack_gzip(element_bytes: usize, packed: &[u8], samples: &mut [u8], planes: &mut Vec<u8>) -> bool {
    planes.clear();
    // One byte more would show that there are too many.
    let unpacked = ZlibDecoder::new(packed).take(samples.len() as u64 + 1).read_to_end(planes);
    let is_valid = unpacked.is_ok_and(|count| count == samples.len());
    if is_valid {
        let count = samples.len() / element_bytes;
        for (place, byte) in planes.iter().enumerate() {
            samples[place % count * element_bytes + place / count] = *byte;
        }
    }
    is_valid
}

/// Unpacks a chunk that [is Blosc](is_blosc_of) of the length of `samples`.
fn unpack_by_library(packed: &[u8], samples: &mut [u8]) -> bool {
    // SAFETY: the source is as long as its header says, which was checked, and the destination as long as is given; they do not
    // overlap; Blosc writes no further than that length, whatever the packed bytes are.
    let length = unsafe { blosc_decompress_ctx(packed.as_ptr().cast(), samples.as_mut_ptr().cast(), samples.len(), 1) };
    usize::try_from(length).is_ok_and(|length| length == samples.len())
}

/// Whether `packed` has a Blosc header with its own length and with `length` unpacked bytes.
fn is_blosc_of(packed: &[u8], length: usize) -> bool {
    let word = |at: usize| packed.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    word(4) == Some(length) && word(12) == Some(packed.len())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tapline_testing::noise::Noise;

    use super::*;

    /// All samples, unpacked by [`unpack`].
    fn unpacked(codec: Codec, packed: &[u8], length: usize) -> Option<Vec<u8>> {
        let mut samples = vec![7; length];
        let is_valid = match codec {
            Codec::Gzip => unpack_gzip(2, packed, &mut samples, &mut Vec::new()),
            _ => unpack(codec, packed, std::iter::once(0..length), &mut samples, &mut Vec::new()),
        };
        is_valid.then_some(samples)
    }

    /// All samples, unpacked by the C library.
    fn unpacked_by_library(packed: &[u8], length: usize) -> Option<Vec<u8>> {
        let mut samples = vec![7; length];
        (is_blosc_of(packed, length) && unpack_by_library(packed, &mut samples)).then_some(samples)
    }

    fn packed(codec: Codec, element_bytes: usize, samples: &[u8]) -> Vec<u8> {
        let mut packed = vec![3; 5];
        pack(codec, element_bytes, samples, &mut Vec::new(), &mut packed);
        packed
    }

    /// Records that pack well, very well and not at all: in a small part of their range, silent after a while, and noise.
    fn record(samples: Vec<u8>, kind: u8) -> Vec<u8> {
        let count = samples.len();
        let tamed = |(k, byte): (usize, u8)| match kind {
            0 => byte,
            1 => byte & 1,
            // A sound of 16 bits that falls silent: the high byte is the sign.
            2 if k % 2 == 1 => 255 * u8::from(samples_sign(k)),
            _ if k > count / 3 => 0,
            _ => byte,
        };
        samples.into_iter().enumerate().map(tamed).collect()
    }

    fn samples_sign(k: usize) -> bool {
        (k / 2).wrapping_mul(2_654_435_761) >> 7 & 1 == 1
    }

    proptest! {
        /// Catches samples that change, chunks that differ from call to call, chunks that the library's filter does not read, and
        /// its chunks that are not read here: of every size of block, split into bytes or not.
        #[test]
        fn what_is_packed_comes_back(
            samples in prop::collection::vec(any::<u8>(), 4..40_000),
            kind in 0..4_u8,
            element_bytes in prop::sample::select(vec![2_usize, 4]),
            block_bytes in 128..20_000_usize,
        ) {
            let whole = samples.len() / element_bytes * element_bytes;
            let samples = record(samples[..whole].to_vec(), kind);
            for codec in [Codec::None, Codec::Lz4, Codec::Zstd] {
                let there = packed(codec, element_bytes, &samples);
                prop_assert!(there == packed(codec, element_bytes, &samples), "{codec}: other bytes");
                prop_assert!(unpacked(codec, &there, whole).as_ref() == Some(&samples), "{codec}");
                let by_library = codec.blosc().map(|_| unpacked_by_library(&there, whole));
                prop_assert!(by_library.is_none_or(|back| back.as_ref() == Some(&samples)), "{codec}, by the library");
            }
            let (there, mut back) = (packed(Codec::Gzip, element_bytes, &samples), vec![7; whole]);
            prop_assert!(unpack_gzip(element_bytes, &there, &mut back, &mut Vec::new()) && back == samples);
            for (compressor, level) in [(c"lz4", 5), (c"lz4", 0), (c"lz4hc", 9), (c"blosclz", 5), (c"zstd", 1)] {
                let mut there = Vec::new();
                pack_by_library((compressor, level), element_bytes, block_bytes, &samples, &mut there);
                prop_assert!(unpacked(Codec::Lz4, &there, whole).as_ref() == Some(&samples), "{compressor:?} {level}");
            }
        }

        /// Catches a part at a wrong offset, and blocks that are unpacked though no part lies in them.
        #[test]
        fn parts_come_back_alone(
            samples in prop::collection::vec(any::<u8>(), 2..40_000),
            ends in any::<[prop::sample::Index; 4]>(),
            kind in 0..4_u8,
        ) {
            let samples = record(samples[..samples.len() / 2 * 2].to_vec(), kind);
            let mut ends = ends.map(|end| end.index(samples.len() + 1));
            ends.sort_unstable();
            let parts = [ends[0]..ends[1], ends[2]..ends[3]];
            for codec in [Codec::None, Codec::Lz4] {
                let there = packed(codec, 2, &samples);
                let mut back = vec![7; samples.len()];
                prop_assert!(unpack(codec, &there, parts.clone(), &mut back, &mut Vec::new()));
                for part in parts.clone() {
                    prop_assert!(back[part.clone()] == samples[part], "{}", codec);
                }
                let is_near = |k: usize| parts.iter().any(|part| k + 8192 > part.start && k < part.end + 8192);
                prop_assert!((0..back.len()).all(|k| is_near(k) || back[k] == 7), "{}", codec);
            }
        }

        /// Catches a reader that trusts damaged bytes: it refuses them or returns other samples, and never panics.
        #[test]
        fn damaged_bytes_do_no_harm(at in 0_usize..100_000, flip in 1_u8.., cut in 0_usize..20_000, head in any::<[u8; 16]>()) {
            let samples: Vec<u8> = (0..20_000_u32).map(|k| (k / 50) as u8).collect();
            for codec in [Codec::Lz4, Codec::Zstd, Codec::Gzip] {
                let mut there = packed(codec, 2, &samples);
                let length = there.len();
                there[at % length] ^= flip;
                let _is_known = unpacked(codec, &there, samples.len());
                prop_assert!(unpacked(codec, &there[..cut % length], samples.len()).is_none());
                // Any header, except for the lengths that are checked before the library is called.
                let lengths = [4..8, 12..16].map(|place| there[place].to_vec());
                there[..16].copy_from_slice(&head);
                there[4..8].copy_from_slice(&lengths[0]);
                there[12..16].copy_from_slice(&lengths[1]);
                let _is_known = unpacked(codec, &there, samples.len());
            }
        }
    }

    /// Catches blocks beyond the first that are not found: chunks of the library of 64 KiB and more, split into the bytes of
    /// samples except for a short last block.
    #[test]
    fn blocks_of_the_library_come_back() {
        for (element_bytes, count) in [(2, 65_536), (2, 131_072), (2, 150_000), (4, 65_536), (4, 200_004), (4, 300_000)]
        {
            let samples = record((0..count as u32).map(|k| (k.wrapping_mul(k) >> 7) as u8).collect(), 2);
            for (compressor, level) in [(c"lz4", 5), (c"lz4hc", 1)] {
                let mut there = Vec::new();
                pack_by_library((compressor, level), element_bytes, 8192, &samples, &mut there);
                assert!(Chunk::new(&there).is_some(), "left to the library: {element_bytes} {count}");
                assert!(unpacked(Codec::Lz4, &there, count).as_ref() == Some(&samples), "{element_bytes} {count}");
                let (mut back, part) = (vec![7; count], count - 9000..count - 5);
                assert!(unpack(Codec::Lz4, &there, std::iter::once(part.clone()), &mut back, &mut Vec::new()));
                assert!(back[part.clone()] == samples[part], "{element_bytes} {count}");
            }
        }
    }

    /// Catches a packing that is worse than LZ4's own search: a record like a tap's, in noise of 4 bits.
    #[test]
    fn planes_pack_as_well_as_a_search() {
        let mut noise = Noise(1);
        let mut noise = || (noise.bits() >> 28) as i16 - 8;
        let sound = |k: usize| (9000.0 * (-(k as f64) / 900.0).exp() * (k as f64 * 0.3).sin()) as i16;
        let samples: Vec<u8> = (0..16_384).flat_map(|k| (sound(k) + noise()).to_le_bytes()).collect();
        let mut searched = Vec::new();
        pack_by_library((c"lz4", 5), 2, ZSTD_BLOCK_BYTES, &samples, &mut searched);
        let ours = packed(Codec::Lz4, 2, &samples);
        assert!(ours.len() < searched.len() && 2 * ours.len() < samples.len(), "{} {}", ours.len(), searched.len());
    }
}
