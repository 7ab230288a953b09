//! Packs samples, damages the chunk and unpacks it. Undamaged samples come back exactly; a damaged chunk is refused or
//! unpacked within its bounds, and none that the checksum accepts gives other samples.
//!
//! `cargo +nightly fuzz run chunk`, in `codec`
#![no_main]

use std::ops::Range;

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use tapline_codec::{Codec, chunk_checksum, is_chunk_valid, pack, unpack, unpack_gzip};

/// What the fuzzer chooses.
#[derive(Debug, Arbitrary)]
struct Case {
    codec: u8,
    is_wide: bool,
    /// Repeated until it fills a row, so that the row can be packed.
    samples: Vec<u8>,
    repeats: u8,
    /// The part of the row to unpack.
    part: Range<u16>,
    /// Places and new values of damaged bytes.
    edits: Vec<(u32, u8)>,
    cut_bytes: u16,
    /// A chunk of any bytes.
    any: Vec<u8>,
}

fuzz_target!(|case: Case| {
    let codec = Codec::ALL[usize::from(case.codec) % Codec::ALL.len()];
    let element_bytes = if case.is_wide { 4 } else { 2 };
    let mut samples = case.samples.repeat(usize::from(case.repeats) + 1);
    samples.truncate(samples.len() / element_bytes * element_bytes);
    if samples.is_empty() {
        return;
    }
    let (mut planes, mut packed) = (Vec::new(), Vec::new());
    pack(codec, element_bytes, &samples, &mut planes, &mut packed);
    let checksum = chunk_checksum(codec, &packed);
    let unpacked = |chunk: &[u8], part: Range<usize>| {
        // Exactly as long as they must be, so that an access beyond is detected.
        let (chunk, mut back) = (chunk.to_vec().into_boxed_slice(), vec![7; samples.len()].into_boxed_slice());
        let is_valid = match codec {
            Codec::Gzip => unpack_gzip(element_bytes, &chunk, &mut back, &mut Vec::new()),
            _ => unpack(codec, &chunk, std::iter::once(part), &mut back, &mut Vec::new()),
        };
        is_valid.then_some(back)
    };
    let all = 0..samples.len();
    assert!(is_chunk_valid(codec, &packed, checksum));
    assert_eq!(unpacked(&packed, all.clone()).as_deref(), Some(&samples[..]));

    let mut ends = [case.part.start, case.part.end].map(|end| usize::from(end).min(samples.len()));
    ends.sort_unstable();
    let part = ends[0]..ends[1];
    let back = unpacked(&packed, part.clone()).expect("a part of what was packed");
    assert_eq!(back[part.clone()], samples[part.clone()]);

    let length = packed.len();
    for (at, byte) in &case.edits {
        packed[*at as usize % length] = *byte;
    }
    packed.truncate(length - usize::from(case.cut_bytes) % length);
    let back = unpacked(&packed, all.clone());
    if is_chunk_valid(codec, &packed, checksum) {
        assert_eq!(back.as_deref(), Some(&samples[..]), "a checksum accepts other samples");
    }
    for chunk in [&packed, &case.any] {
        unpacked(chunk, part.clone());
        unpacked(chunk, all.clone());
        is_chunk_valid(codec, chunk, checksum);
    }
});
