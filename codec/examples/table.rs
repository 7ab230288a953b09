//! Prints the table of `docs/codec.md`: what each codec makes of simulated taps, and in what time, on one thread.
//!
//! `cargo run --release -p tapline-codec --example table`
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "an example that cannot go on has failed")]
#![expect(unsafe_code, reason = "the C library, with settings that the crate does not use")]

use std::ffi::CStr;
use std::time::Instant;

use blosc_src::{BLOSC_BITSHUFFLE, BLOSC_MAX_OVERHEAD, blosc_compress_ctx, blosc_decompress_ctx};
use tapline_acquire::{ScanConfig, SimulatedLine, Source};
use tapline_codec::{Codec, pack, unpack};
use tapline_wire::{Lane, TapHeader, bytes_of, lanes_for};

/// Bytes of a sample.
const SAMPLE_BYTES: usize = 2;

/// Times each codec is tried; the shortest counts.
const ROUNDS: usize = 5;

fn main() {
    let taps = taps();
    println!("| codec | ratio | pack, us a tap | unpack, us a tap |\n|---|---|---|---|");
    for codec in [Codec::Lz4, Codec::Zstd] {
        let mut planes = Vec::new();
        row(
            &format!("`{codec}`, as this crate packs it"),
            &taps,
            |tap, packed| pack(codec, SAMPLE_BYTES, tap, &mut planes, packed),
            |packed, tap| assert!(unpack(codec, packed, std::iter::once(0..tap.len()), tap, &mut Vec::new())),
        );
    }
    for (name, level, block_bytes) in
        [(c"lz4", 5, 0), (c"lz4", 9, 0), (c"lz4", 5, 8192), (c"zstd", 1, 0), (c"blosclz", 5, 0)]
    {
        let words = format!("c-blosc, {} level {level}, block {block_bytes}", name.to_str().unwrap());
        row(&words, &taps, |tap, packed| by_library(name, level, block_bytes, tap, packed), from_library);
    }
}

/// The samples of two hundred simulated taps.
fn taps() -> Vec<Vec<u8>> {
    let scan = ScanConfig { offsets_mm: vec![0.0], velocities_m_per_s: vec![1.85], ..ScanConfig::default() };
    let mut line = SimulatedLine::new(&scan, &tapline_model::SimulationConfig::default()).unwrap();
    let mut lanes = vec![Lane::default(); lanes_for(line.plan().recording.payload_bytes_max())];
    let mut of_row = |row| {
        let mut header = TapHeader::default();
        line.render(row, 0, &mut header, &mut lanes).unwrap();
        bytes_of(&lanes)[..header.payload_bytes()].to_vec()
    };
    (0..200).map(&mut of_row).collect()
}

fn row(
    name: &str,
    taps: &[Vec<u8>],
    mut pack: impl FnMut(&[u8], &mut Vec<u8>),
    mut unpack: impl FnMut(&[u8], &mut [u8]),
) {
    let (mut best_pack, mut best_unpack) = (f64::INFINITY, f64::INFINITY);
    let mut packed = vec![Vec::new(); taps.len()];
    let mut back = vec![0; taps[0].len()];
    let us_a_tap = |since: Instant| since.elapsed().as_secs_f64() * 1e6 / taps.len() as f64;
    for _ in 0..ROUNDS {
        let since = Instant::now();
        taps.iter().zip(&mut packed).for_each(|(tap, packed)| pack(tap, packed));
        best_pack = shorter(us_a_tap(since), best_pack);
        let since = Instant::now();
        packed.iter().for_each(|packed| unpack(packed, &mut back));
        best_unpack = shorter(us_a_tap(since), best_unpack);
    }
    assert_eq!(&back, taps.last().unwrap());
    let ratio = taps.iter().map(Vec::len).sum::<usize>() as f64 / packed.iter().map(Vec::len).sum::<usize>() as f64;
    println!("| {name} | {ratio:.2} | {best_pack:.1} | {best_unpack:.1} |");
}

fn shorter(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

fn by_library(name: &CStr, level: i32, block_bytes: usize, samples: &[u8], packed: &mut Vec<u8>) {
    packed.resize(samples.len() + BLOSC_MAX_OVERHEAD as usize, 0);
    // SAFETY: source and destination are valid for the lengths given and do not overlap; the name ends in NUL; the call keeps
    // no pointer.
    let length = unsafe {
        blosc_compress_ctx(
            level,
            BLOSC_BITSHUFFLE as i32,
            SAMPLE_BYTES,
            samples.len(),
            samples.as_ptr().cast(),
            packed.as_mut_ptr().cast(),
            packed.len(),
            name.as_ptr(),
            block_bytes,
            1,
        )
    };
    packed.truncate(usize::try_from(length).unwrap());
}

fn from_library(packed: &[u8], samples: &mut [u8]) {
    // SAFETY: the chunk is whole, as it was just packed; Blosc writes no further than it is told.
    let length = unsafe { blosc_decompress_ctx(packed.as_ptr().cast(), samples.as_mut_ptr().cast(), samples.len(), 1) };
    assert_eq!(usize::try_from(length).unwrap(), samples.len());
}
