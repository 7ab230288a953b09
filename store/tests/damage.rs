//! Damaged files, finished and not: each is refused, or read as far as its checksums are valid.

use std::path::Path;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_store::{Codec, Lineage, ReadBuffer, Reader, Writer, verify};
use tapline_wire::SampleFormat;

use crate::common::{CONFIG, new_path, plan, put_all};

/// How many files are damaged; 200 when it is not set.
const FILES: &str = "TAPLINE_STORE_TEST_DAMAGED";

/// Flips, zeroed runs, runs of noise and cuts.
fn damage(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let at = random.random_range(0..bytes.len());
    let run = random.random_range(1..2048).min(bytes.len() - at);
    match random.random_range(0..5) {
        0 => bytes[at] ^= 1 << random.random_range(0..8),
        1 => (0..random.random_range(1..20)).for_each(|_| {
            let at = random.random_range(0..bytes.len());
            bytes[at] = random.random();
        }),
        2 => bytes[at..at + run].fill(0),
        3 => random.fill(&mut bytes[at..at + run]),
        _ => bytes.truncate(at),
    }
}

fn write(path: &Path, codec: Codec, is_finished: bool) -> Vec<u8> {
    let mut writer = Writer::create(path, &plan(SampleFormat::I16), 14, Lineage { codec, ..CONFIG.into() }).unwrap();
    put_all(&mut writer).unwrap();
    writer.settle().unwrap();
    if is_finished {
        writer.finish().unwrap()
    } else {
        writer.suspend().unwrap()
    }
    std::fs::read(path).unwrap()
}

/// Catches a damaged file that ends the process, takes for ever, or is taken for valid.
#[test]
fn a_damaged_file_is_noticed() {
    let (_here, path) = new_path();
    let mut whole = Vec::new();
    for codec in [Codec::Lz4, Codec::None] {
        for is_finished in [true, false] {
            whole.push((is_finished, write(&path, codec, is_finished)));
            std::fs::remove_file(&path).unwrap();
        }
    }
    let mut random = ChaCha8Rng::seed_from_u64(16);
    let count = std::env::var(FILES).map_or(200, |count| count.parse().unwrap());
    for number in 0..count {
        let (is_finished, whole) = &whole[number % whole.len()];
        let mut bytes = whole.clone();
        damage(&mut bytes, &mut random);
        if bytes == *whole {
            continue;
        }
        std::fs::write(&path, &bytes).unwrap();
        let report = verify(&path);
        assert!(!report.is_ok_and(|report| report.is_complete()), "file {number} is damaged and verified");
        if let Ok(reader) = Reader::open(&path) {
            let (taps, mut room) = (reader.taps().unwrap(), ReadBuffer::default());
            assert!((0..10).any(|row| taps.read(row, &mut room).is_err()), "file {number} is damaged and read");
        }
        if let Ok(reader) = Reader::open_unfinished(&path) {
            (0..10).for_each(|row| drop(reader.tap(row)));
            drop((reader.discriminators(), reader.judgements(), reader.refusals(), reader.raw_digest()));
        }
        // What a line continues becomes complete, or is refused.
        if let Ok(mut writer) = Writer::resume(&path, CONFIG)
            && put_all(&mut writer).is_ok()
            && writer.finish().is_ok()
        {
            let report = verify(&path).unwrap();
            assert!(!is_finished || report.is_finished);
        }
        std::fs::remove_file(&path).unwrap();
    }
}

/// Catches a file whose structure leads nowhere and that counts as a failing disk: a line would wait for that disk for ever.
#[test]
fn a_structure_that_leads_nowhere_is_damage() {
    let (_here, path) = new_path();
    let whole = write(&path, Codec::Lz4, false);
    let record = whole.windows(14).position(|bytes| bytes == b"tapline struct").unwrap();
    let word = |at: usize| u64::from_le_bytes(whole[at..at + 8].try_into().unwrap()) as usize;
    let mut of_node = whole.clone();
    of_node[word(record + 104 + 16 * word(record + 88)) + 7] ^= 0x80;
    for bytes in [whole[..record + 100].to_vec(), of_node] {
        std::fs::write(&path, bytes).unwrap();
        let error = Writer::resume(&path, CONFIG).unwrap_err();
        assert!(!error.is_recoverable() && error.to_string().contains("structure"), "{error}");
    }
}
