//! Planes of bits as a block of LZ4, found where they repeat by construction: the plane before, and the byte before.
//!
//! What LZ4 looks for anywhere, in a table of what it has met, planes have at two distances alone: those of high bits repeat
//! the sign's, and where nothing sounds all of their bytes are the same. Looking there and nowhere else packs as well, in a
//! fraction of the time; what comes of it is read by whatever reads LZ4.
#![expect(unsafe_code, reason = "unpacking is done by a library of C")]

use std::ffi::c_int;

use lz4_sys::LZ4_decompress_safe;

/// Bytes that are compared at a time, and so the shortest match that is looked for.
const STEP: usize = 16;

/// Steps without a match after which only every fourth is looked at: what was passed over is taken in backwards.
const PATIENCE: usize = 8;

/// The last bytes of a block, in which no match may begin; the very last are literals.
const NO_MATCH: usize = 12;
const LITERALS_LAST: usize = 5;

/// The shortest match there is, which is written as length 0.
const MATCH_LEAST: usize = 4;

/// What half a byte can say of a length; more is said in bytes behind.
const HALF_BYTE: usize = 15;

/// Appends `planes` of `plane_bytes` each to `packed`.
pub(crate) fn pack(planes: &[u8], plane_bytes: usize, packed: &mut Vec<u8>) {
    let (mut written, mut at, mut misses) = (0, 1, 0);
    let end = planes.len().saturating_sub(NO_MATCH);
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

/// Whether the [`STEP`] bytes from `at` on are those `distance` before.
#[inline]
fn repeats(planes: &[u8], at: usize, distance: usize) -> bool {
    at >= distance && planes[at..at + STEP] == planes[at - distance..at - distance + STEP]
}

/// Where the bytes before `at` begin to be those `distance` before, not before `first`.
fn repeats_from(planes: &[u8], at: usize, distance: usize, first: usize) -> usize {
    let same = (first.max(distance)..at).rev().take_while(|&k| planes[k] == planes[k - distance]);
    at - same.count()
}

/// Where the bytes from `at` on cease to be those `distance` before.
fn repeats_to(planes: &[u8], mut at: usize, distance: usize) -> usize {
    let end = planes.len() - LITERALS_LAST;
    while at + STEP <= end && repeats(planes, at, distance) {
        at += STEP;
    }
    at + (at..end).take_while(|&k| planes[k] == planes[k - distance]).count()
}

/// Appends `literals` and a match of `match_length` bytes `distance` before.
fn sequence(literals: &[u8], distance: usize, match_length: usize, packed: &mut Vec<u8>) {
    let more = match_length - MATCH_LEAST;
    packed.push(half_byte(literals.len()) << 4 | half_byte(more));
    length(literals.len(), packed);
    packed.extend_from_slice(literals);
    // A block is shorter than what two bytes count.
    let [low, high, ..] = distance.to_le_bytes();
    packed.extend_from_slice(&[low, high]);
    length(more, packed);
}

fn half_byte(length: usize) -> u8 {
    length.min(HALF_BYTE) as u8
}

/// Appends what half a byte could not say of `length`.
fn length(length: usize, packed: &mut Vec<u8>) {
    if let Some(mut rest) = length.checked_sub(HALF_BYTE) {
        while rest >= 255 {
            packed.push(255);
            rest -= 255;
        }
        packed.push(rest as u8);
    }
}

/// Unpacks a block of LZ4 into `unpacked`, all of it; whether it was that long.
#[must_use]
pub(crate) fn unpack(packed: &[u8], unpacked: &mut [u8]) -> bool {
    let (Ok(from), Ok(to)) = (c_int::try_from(packed.len()), c_int::try_from(unpacked.len())) else { return false };
    // SAFETY: both are valid for the lengths given, and do not overlap; the call reads and writes no further, whatever the
    // packed bytes say, and keeps no pointer.
    unsafe { LZ4_decompress_safe(packed.as_ptr().cast(), unpacked.as_mut_ptr().cast(), from, to) == to }
}
