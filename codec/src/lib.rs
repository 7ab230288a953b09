//! Packs the samples of a tap, and unpacks all or part of them.
//!
//! [`pack`] writes chunks of Blosc 1 with shuffled bits, so every reader of HDF5 that has filter 32001 unpacks them. LZ4 of
//! 16-bit samples is packed by this crate, which is faster than the C library (`docs/codec.md` has the figures); the C library
//! packs Zstandard, and is the oracle of the tests; Deflate is flate2's.
//!
//! - `codec`: which codecs there are, and [`pack`] and [`unpack`] for each
//! - `blosc`: the container: a [`Head`] with a checksum of each block, and the blocks
//! - `planes`: samples as planes of bits, so that equal high bits of neighbours lie together
//! - `lz4`: a block of planes, packed
//! - `checksum`: the checksum of a packed chunk
//!
//! ```
//! use tapline_codec::{Codec, pack, unpack};
//!
//! let samples: Vec<u8> = (0..4096_u16).flat_map(|k| (k / 16).to_le_bytes()).collect();
//! let (mut planes, mut packed) = (Vec::new(), Vec::new());
//! pack(Codec::Lz4, 2, &samples, &mut planes, &mut packed);
//! assert!(packed.len() < samples.len() / 2);
//!
//! let mut unpacked = vec![0; samples.len()];
//! assert!(unpack(Codec::Lz4, &packed, std::iter::once(0..samples.len()), &mut unpacked, &mut planes));
//! assert_eq!(unpacked, samples);
//! ```

mod blosc;
mod checksum;
mod codec;
mod lz4;
mod planes;

pub use blosc::{Head, RECORD_BYTES_MAX};
pub use checksum::{chunk_checksum, head_of, is_chunk_valid};
pub use codec::{Codec, pack, placeholder, unpack, unpack_gzip};
