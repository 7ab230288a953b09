//! Blocks of packed samples: readable whole and in their beginning, each proved by itself.

use std::ops::Range;
use std::path::Path;

use tapline_store::{Error, ReadBuffer, Reader, Writer, verify};
use tapline_wire::{Discriminators, Geometry, Plan, Recording, SampleFormat, TapHeader, Truth};

use crate::common::{CONFIG, header, new_path, plan};
use crate::places::chunk_bytes;

/// Samples a channel of taps that have several blocks, of 8 KiB each.
const LONG_SAMPLE_COUNT: u32 = 6000;

fn long_plan() -> Plan {
    let short = plan(SampleFormat::I16);
    let recording = Recording { sample_count_max: LONG_SAMPLE_COUNT, ..short.recording.clone() };
    Plan::new(Geometry::Ring, recording, short.taps()[..2].to_vec(), Truth::new()).unwrap()
}

/// The counts of plan row `row` of the long plan, `[channel][sample]`: little in a wide range, so that they pack.
fn long_counts(row: u32) -> Vec<i16> {
    let length = i32::try_from(LONG_SAMPLE_COUNT).unwrap();
    let count = |channel: i32, k: i32| (k * k / (7 + channel) % 23 - 11) * if k < 900 { 90 } else { 1 };
    (0..2)
        .flat_map(|channel| (0..length).map(move |k| i16::try_from(count(channel, k)).unwrap() + row as i16))
        .collect()
}

fn long_header(row: u32) -> TapHeader {
    let plan = long_plan();
    header(&plan, row, LONG_SAMPLE_COUNT)
}

fn write_blocks(path: &Path) {
    let mut writer = Writer::create(path, &long_plan(), 0, CONFIG).unwrap();
    for row in 0..2 {
        let samples: Vec<u8> = long_counts(row).into_iter().flat_map(i16::to_ne_bytes).collect();
        writer.put_tap(&long_header(row), &samples).unwrap();
        let id = long_header(row).id;
        writer.put_discriminators(&Discriminators { id, plan_index: row, ..Discriminators::default() }).unwrap();
    }
    writer.finish().unwrap();
}

/// Catches blocks that are looked for in the wrong place, for whole records and for beginnings.
#[test]
fn blocks_come_back() {
    let (_here, path) = new_path();
    write_blocks(&path);
    {
        let (taps, mut room) = (Reader::open(&path).unwrap().taps().unwrap(), ReadBuffer::default());
        for row in 0..2 {
            let counts = long_counts(row);
            let whole: Vec<u8> = counts.iter().copied().flat_map(i16::to_le_bytes).collect();
            assert_eq!(taps.read(row, &mut room).unwrap().unwrap().1.as_bytes(), whole);
            for used in [1, 4000, 4096, 4097, 6000] {
                // A buffer that has nothing, so that nothing of an earlier reading is taken for this one.
                let mut empty = ReadBuffer::default();
                let (header, samples) = taps.read_beginning(row, |_| used, &mut empty).unwrap().unwrap();
                let channels = counts.chunks_exact(LONG_SAMPLE_COUNT as usize);
                let expected: Vec<u8> =
                    channels.flat_map(|of_one| &of_one[..used as usize]).flat_map(|x| x.to_le_bytes()).collect();
                assert_eq!((header.sample_count, samples.as_bytes()), (used, &expected[..]));
                // One that has the other tap.
                taps.read(1 - row, &mut room).unwrap().unwrap();
                let (_, samples) = taps.read_beginning(row, |_| used, &mut room).unwrap().unwrap();
                assert_eq!(samples.as_bytes(), expected);
            }
        }
        let problems = verify(&path).unwrap().problems;
        assert!(!problems.iter().any(|problem| problem.to_string().contains("samples")), "{problems:?}");
    }
}

/// Catches a writer whose chunks have not the heads that the layout promises.
#[test]
fn what_is_written_today_has_heads() {
    let (_here, path) = new_path();
    write_blocks(&path);
    let samples = hdf5::File::open(&path).unwrap().dataset("taps/samples").unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for k in 0..2 {
        let head = samples.chunk_info(k).unwrap().addr as usize;
        let first = u32::from_le_bytes(*bytes[head + 16..].first_chunk().unwrap());
        assert_eq!(first, 16 + 12 * 3, "the first of three blocks begins behind their checksums");
    }
}

/// Catches a beginning that is not given because of what lies behind it, and one that is given though it, or what says where
/// it lies, was changed.
#[test]
fn a_beginning_is_proved_by_itself() {
    let (_here, path) = new_path();
    let good = path.with_file_name("good.h5");
    write_blocks(&good);
    let whole = std::fs::read(&good).unwrap();
    let Range { start: first, end } = chunk_bytes(&hdf5::File::open(&good).unwrap()).remove(1);
    let begins: [usize; 3] = std::array::from_fn(|block| {
        let word = whole[first + 16 + 4 * block..].first_chunk().unwrap();
        first + u32::from_le_bytes(*word) as usize
    });
    assert_eq!(begins[0] - first, 16 + 12 * 3, "the second tap has three blocks");
    // The beginning of the force is in the first, that of the sound in the second.
    for at in (first..end).step_by(7).chain([first, begins[0], begins[1], begins[2] - 1, begins[2], end - 1]) {
        let mut bent = whole.clone();
        bent[at] ^= 0x10;
        std::fs::write(&path, &bent).unwrap();
        let (taps, mut room) = (Reader::open(&path).unwrap().taps().unwrap(), ReadBuffer::default());
        let is_damaged = |result: Result<_, Error>| match result {
            Ok(_) => false,
            Err(Error::Damaged { what, .. }) => what.contains("plan row 1"),
            Err(error) => panic!("{error}"),
        };
        assert!(is_damaged(taps.read(1, &mut room).map(|_| ())), "{at}");
        let is_behind = at >= begins[2];
        assert_eq!(is_damaged(taps.read_beginning(1, |_| 100, &mut room).map(|_| ())), !is_behind, "{at}");
        assert!(taps.read(0, &mut room).is_ok(), "another tap");
    }
}
