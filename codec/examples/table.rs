//! Prints the tables of `docs/codec.md`: ratio and speed of each codec on simulated and on recorded taps, on one
//! thread.
//!
//! `cargo run --release -p tapline-codec --example table -- FOLDERS-OF-TAP-SETS`
//!
//! The samples stay in `target/codec`, for `codec/examples/c_blosc2.py`, which prints the same of c-blosc2.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "an example that cannot continue has failed")]
#![expect(unsafe_code, reason = "the C library, with settings that the crate does not use")]

use std::ffi::CStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use blosc_src::{BLOSC_BITSHUFFLE, BLOSC_MAX_OVERHEAD, blosc_compress_ctx, blosc_decompress_ctx};
use tapline_acquire::{ScanConfig, SimulatedLine, Source, TapSet};
use tapline_codec::{Codec, pack, unpack};
use tapline_wire::{CacheLine, TapHeader, bytes_of, cache_lines_for};

/// Taps of each set.
const TAPS_MAX: u32 = 200;

/// How often each tap is packed and unpacked; the shortest time counts, to exclude the effect of other programs.
const ROUNDS: usize = 20;

/// Taps of one source.
struct TapsOf {
    name: String,
    /// Bytes of a sample.
    sample_bytes: usize,
    taps: Vec<Vec<u8>>,
}

fn main() {
    let scan = ScanConfig { repetitions: 2, ..ScanConfig::default() };
    // Records of 0.4 s: 64 KiB.
    let simulation = tapline_model::SimulationConfig { sample_count: 16_384, ..Default::default() };
    let mut line = SimulatedLine::new(&scan, &simulation).unwrap();
    print_table(&taps_of("simulated", &mut line));
    for folder in std::env::args_os().skip(1).map(PathBuf::from) {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        print_table(&taps_of(&name, &mut TapSet::open(&folder, 1).unwrap()));
    }
}

fn taps_of(name: &str, source: &mut impl Source) -> TapsOf {
    let recording = source.plan().recording.clone();
    let tap_count = u32::try_from(source.plan().taps().len()).unwrap().min(TAPS_MAX);
    let mut buffer = vec![CacheLine::default(); cache_lines_for(recording.payload_bytes_max())];
    let mut tap = |row| {
        let mut header = TapHeader::default();
        source.render(row, 0, &mut header, &mut buffer).unwrap();
        bytes_of(&buffer)[..header.payload_bytes()].to_vec()
    };
    let taps = (0..tap_count).map(&mut tap).collect();
    TapsOf { name: name.to_owned(), sample_bytes: recording.sample_format.bytes(), taps }
}

fn print_table(taps: &TapsOf) {
    let &TapsOf { ref name, sample_bytes, taps: ref all } = taps;
    write_samples(taps);
    println!("\n{name}: {} taps of {} samples of {sample_bytes} bytes\n", all.len(), all[0].len() / sample_bytes);
    println!("| codec | ratio | pack, us per tap | unpack, us per tap |\n|---|---|---|---|");
    for codec in [Codec::Lz4, Codec::Zstd] {
        let (mut planes, mut planes_back) = (Vec::new(), Vec::new());
        row(
            &format!("`{codec}`, as this crate packs it"),
            all,
            |tap, packed| pack(codec, sample_bytes, tap, &mut planes, packed),
            |packed, tap| assert!(unpack(codec, packed, std::iter::once(0..tap.len()), tap, &mut planes_back)),
        );
    }
    for (codec, level, block_bytes) in
        [(c"lz4", 5, 0), (c"lz4", 9, 0), (c"lz4", 5, 8192), (c"zstd", 1, 0), (c"blosclz", 5, 0)]
    {
        let words = format!("c-blosc, {} level {level}, block {block_bytes}", codec.to_str().unwrap());
        let pack = |tap: &[u8], packed: &mut Vec<u8>| by_library(codec, level, sample_bytes, block_bytes, tap, packed);
        row(&words, all, pack, from_library);
    }
}

/// Writes the taps to `target/codec/NAME.SAMPLE_BYTES.TAP_BYTES`, one after the other.
fn write_samples(taps: &TapsOf) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/codec");
    fs::create_dir_all(&folder).unwrap();
    let name = format!("{}.{}.{}", taps.name, taps.sample_bytes, taps.taps[0].len());
    fs::write(folder.join(name), taps.taps.concat()).unwrap();
}

fn row(
    name: &str,
    taps: &[Vec<u8>],
    mut pack: impl FnMut(&[u8], &mut Vec<u8>),
    mut unpack: impl FnMut(&[u8], &mut [u8]),
) {
    let mut packed = vec![Vec::new(); taps.len()];
    let mut back = vec![0; taps[0].len()];
    let mut shortest = vec![[Duration::MAX; 2]; taps.len()];
    for _ in 0..ROUNDS {
        for ((tap, packed), [pack_time, unpack_time]) in taps.iter().zip(&mut packed).zip(&mut shortest) {
            let since = Instant::now();
            pack(tap, packed);
            *pack_time = since.elapsed().min(*pack_time);
            let since = Instant::now();
            unpack(packed, &mut back);
            *unpack_time = since.elapsed().min(*unpack_time);
            assert_eq!(&back, tap);
        }
    }
    let us_a_tap = |which: usize| {
        shortest.iter().map(|times| times[which]).sum::<Duration>().as_secs_f64() * 1e6 / taps.len() as f64
    };
    let ratio = taps.iter().map(Vec::len).sum::<usize>() as f64 / packed.iter().map(Vec::len).sum::<usize>() as f64;
    println!("| {name} | {ratio:.2} | {:.1} | {:.1} |", us_a_tap(0), us_a_tap(1));
}

fn by_library(codec: &CStr, level: i32, sample_bytes: usize, block_bytes: usize, samples: &[u8], packed: &mut Vec<u8>) {
    packed.resize(samples.len() + BLOSC_MAX_OVERHEAD as usize, 0);
    // SAFETY: source and destination are valid for the lengths given and do not overlap; the name ends in NUL; the call keeps
    // no pointer.
    let length = unsafe {
        blosc_compress_ctx(
            level,
            BLOSC_BITSHUFFLE as i32,
            sample_bytes,
            samples.len(),
            samples.as_ptr().cast(),
            packed.as_mut_ptr().cast(),
            packed.len(),
            codec.as_ptr(),
            block_bytes,
            1,
        )
    };
    packed.truncate(usize::try_from(length).unwrap());
}

fn from_library(packed: &[u8], samples: &mut [u8]) {
    // SAFETY: the chunk was just packed and is complete; Blosc writes no further than the length given.
    let length = unsafe { blosc_decompress_ctx(packed.as_ptr().cast(), samples.as_mut_ptr().cast(), samples.len(), 1) };
    assert_eq!(usize::try_from(length).unwrap(), samples.len());
}
