//! Planes of bits as a block of LZ4.
//!
//! 16-bit converter counts repeat at only two distances: a plane of high bits repeats the plane before it, because both
//! are the sign, and where there is silence every byte of a plane repeats the byte before. [`pack`] compares there and nowhere
//! else, which packs as well as LZ4's own search in a fraction of the time. Floating-point samples also repeat elsewhere:
//! [`pack_by_search`] is LZ4's search. Any LZ4 decoder unpacks either.
#![expect(unsafe_code, reason = "the search and the decoder are a C library")]

use std::ffi::c_int;

use lz4_sys::{LZ4_compress_default, LZ4_decompress_safe};

/// Bytes compared at a time, which is also the shortest match that is looked for.
const STEP: usize = 16;

/// Steps without a match after which only every fourth is compared; a match is then extended backwards over skipped steps.
const PATIENCE: usize = 8;

/// Last bytes of a block, which must be literals. A match must not begin in the last 12 bytes either; none of at least [`STEP`]
/// bytes can.
const LITERALS_LAST: usize = 5;
const _: () = assert!(STEP + LITERALS_LAST >= 12, "a match may begin too late");

/// The shortest match of LZ4, which is encoded as length 0.
const MATCH_LEAST: usize = 4;

/// The largest length that half a byte holds; the rest follows in more bytes.
const HALF_BYTE: usize = 15;

/// Appends `planes` as LZ4's own search packs them to `packed`; appends nothing if they do not become shorter.
pub(crate) fn pack_by_search(planes: &[u8], packed: &mut Vec<u8>) {
    let begin = packed.len();
    packed.resize(begin + planes.len(), 0);
    let length = match c_int::try_from(planes.len()) {
        // SAFETY: source and destination are valid for the length given and do not overlap; the call writes no further and keeps
        // no pointer.
        Ok(bytes) => unsafe {
            LZ4_compress_default(planes.as_ptr().cast(), packed[begin..].as_mut_ptr().cast(), bytes, bytes)
        },
        Err(_) => 0,
    };
    packed.truncate(begin + usize::try_from(length).unwrap_or(0));
}

/// Appends `planes` of `plane_bytes` each to `packed`.
pub(crate) fn pack(planes: &[u8], plane_bytes: usize, packed: &mut Vec<u8>) {
    let (mut written, mut at, mut misses) = (0, 1, 0);
    let end = planes.len().saturating_sub(LITERALS_LAST);
    while at + STEP <= end {
        let Some(distance) = [plane_bytes, 1].into_iter().find(|&distance| repeats(planes, at, distance)) else {
            misses += 1;
            at += if misses > PATIENCE { 4 * STEP } else { STEP };
            continue;
        };
        misses = 0;
        let begin = repeats_from(planes, at, distance, written);
        at = repeats_to(planes, at + STEP, distance);
        sequence(&planes[written..begin], distance, at - begin, packed);
        written = at;
    }
    let literals = &planes[written..];
    packed.push(half_byte(literals.len()) << 4);
    length(literals.len(), packed);
    packed.extend_from_slice(literals);
}

/// Whether the [`STEP`] bytes from `at` on equal those `distance` before.
#[inline]
fn repeats(planes: &[u8], at: usize, distance: usize) -> bool {
    at >= distance && planes[at..at + STEP] == planes[at - distance..at - distance + STEP]
}

/// First of the bytes up to `at` that equal those `distance` before; at least `first`.
fn repeats_from(planes: &[u8], at: usize, distance: usize, first: usize) -> usize {
    let same = (first.max(distance)..at).rev().take_while(|&k| planes[k] == planes[k - distance]);
    at - same.count()
}

/// First of the bytes from `at` on that differs from that `distance` before.
fn repeats_to(planes: &[u8], mut at: usize, distance: usize) -> usize {
    let end = planes.len() - LITERALS_LAST;
    while at + STEP <= end && repeats(planes, at, distance) {
        at += STEP;
    }
    at + (at..end).take_while(|&k| planes[k] == planes[k - distance]).count()
}

/// Appends a sequence: `literals`, and a match of `match_length` bytes at `distance`.
fn sequence(literals: &[u8], distance: usize, match_length: usize, packed: &mut Vec<u8>) {
    let more = match_length - MATCH_LEAST;
    packed.push(half_byte(literals.len()) << 4 | half_byte(more));
    length(literals.len(), packed);
    packed.extend_from_slice(literals);
    // A block is short enough for distances of two bytes.
    let [low, high, ..] = distance.to_le_bytes();
    packed.extend_from_slice(&[low, high]);
    length(more, packed);
}

fn half_byte(length: usize) -> u8 {
    length.min(HALF_BYTE) as u8
}

/// Appends what half a byte does not hold of `length`.
fn length(length: usize, packed: &mut Vec<u8>) {
    if let Some(mut rest) = length.checked_sub(HALF_BYTE) {
        while rest >= 255 {
            packed.push(255);
            rest -= 255;
        }
        packed.push(rest as u8);
    }
}

/// Unpacks a block of LZ4 into `unpacked`; false unless it fills `unpacked`.
#[must_use]
pub(crate) fn unpack(packed: &[u8], unpacked: &mut [u8]) -> bool {
    let (Ok(from), Ok(to)) = (c_int::try_from(packed.len()), c_int::try_from(unpacked.len())) else { return false };
    // SAFETY: both are valid for the lengths given and do not overlap; the call reads and writes no further, whatever the
    // packed bytes are, and keeps no pointer.
    unsafe { LZ4_decompress_safe(packed.as_ptr().cast(), unpacked.as_mut_ptr().cast(), from, to) == to }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A slow decoder written after the description of LZ4. It also checks the rules on the end of a block: the last match begins
    /// at least 12 bytes before the end, and the last 5 bytes are literals.
    fn slow(packed: &[u8], length: usize) -> Vec<u8> {
        let (mut bytes, mut unpacked) = (packed.iter().copied(), Vec::new());
        loop {
            let token = bytes.next().unwrap();
            let literals = long(token >> 4, &mut bytes);
            unpacked.extend(bytes.by_ref().take(literals));
            let Some(low) = bytes.next() else {
                assert!(token & 15 == 0 && (literals >= 5 || unpacked.len() == literals), "ends within a match");
                return unpacked;
            };
            let distance = usize::from(u16::from_le_bytes([low, bytes.next().unwrap()]));
            assert!((1..=unpacked.len()).contains(&distance), "{distance} before {}", unpacked.len());
            assert!(unpacked.len() + 12 <= length, "a match begins at {} of {length}", unpacked.len());
            for _ in 0..long(token & 15, &mut bytes) + 4 {
                unpacked.push(unpacked[unpacked.len() - distance]);
            }
            assert!(unpacked.len() + 5 <= length, "a match ends at {} of {length}", unpacked.len());
        }
    }

    /// The length that begins with `half` a byte and goes on in `bytes`.
    fn long(half: u8, bytes: &mut impl Iterator<Item = u8>) -> usize {
        let mut length = usize::from(half);
        let mut more = half == 15;
        while more {
            let byte = bytes.next().unwrap();
            length += usize::from(byte);
            more = byte == 255;
        }
        length
    }

    fn check(planes: &[u8], plane_bytes: usize) {
        let (mut packed, mut unpacked) = (vec![7], vec![9; planes.len()]);
        pack(planes, plane_bytes, &mut packed);
        assert_eq!(packed[0], 7, "it is appended");
        assert_eq!(slow(&packed[1..], planes.len()), planes, "{plane_bytes}");
        assert!(unpack(&packed[1..], &mut unpacked) || planes.is_empty());
        assert_eq!(unpacked, planes);
    }

    /// Catches a match that extends into the last bytes or begins among them: blocks of every length that repeat to the end.
    #[test]
    fn a_block_ends_as_it_must() {
        for length in 0..400 {
            for noise in 0..20 {
                let planes: Vec<u8> = (0..length).map(|k| if k < noise { (k * k) as u8 } else { 3 }).collect();
                check(&planes, 16);
                let planes: Vec<u8> = (0..length).map(|k| (k % 24 * (k % 24) % 251) as u8).collect();
                check(&planes, 24);
            }
        }
    }

    proptest! {
        /// Catches a wrong length or distance, and bytes lost between matches.
        #[test]
        fn what_is_packed_is_what_lz4_says(
            runs in prop::collection::vec((0..3_u8, 1..400_usize, any::<bool>()), 0..40),
            plane_bytes in 1..200_usize,
            seed: u32,
        ) {
            let (mut planes, mut state) = (Vec::new(), seed);
            for (byte, length, is_noise) in runs {
                for _ in 0..length {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let before = planes.len().checked_sub(plane_bytes).map_or(byte, |at: usize| planes[at]);
                    planes.push(if is_noise { (state >> 24) as u8 } else if byte == 2 { before } else { byte });
                }
            }
            check(&planes, plane_bytes);
        }
    }
}
