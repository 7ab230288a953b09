//! Random bytes for the readers: noise, and valid files with a few changes, which get further.

use std::cell::Cell;
use std::io::Cursor;
use std::path::{Component, Path};

use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};
use tapline_testing::mutated::mutated;
use tapline_wire::{CacheLine, Geometry, SampleFormat, bytes_of, cache_lines_for, f32_of_mut};

use crate::Error;
use crate::config::text;
use crate::tap_set::{scan_toml, taps_csv, truth_csv, wav};

/// Cases per reader.
const CASES: u32 = 3000;

/// Gives `check` the same [`CASES`] inputs every time; it returns whether the input was accepted. Accepted and refused
/// inputs must both be frequent; otherwise the inputs test nothing.
fn fuzz(seeds: Vec<Vec<u8>>, check: impl Fn(&[u8]) -> Result<bool, TestCaseError>) {
    let config = ProptestConfig { cases: CASES, failure_persistence: None, ..ProptestConfig::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let accepted = Cell::new(0);
    let outcome = runner.run(&mutated(seeds), |bytes| {
        accepted.set(accepted.get() + u32::from(check(&bytes)?));
        Ok(())
    });
    outcome.unwrap();
    assert!((CASES / 20..CASES * 19 / 20).contains(&accepted.get()), "{} of {CASES} accepted", accepted.get());
}

/// Decodes and parses bytes, as opening a set does.
fn parsed<T>(bytes: &[u8], parse: impl Fn(&Path, &str) -> Result<T, Error>) -> Option<T> {
    let file = Path::new("fuzzed");
    let text = text::decode(file, bytes.to_vec()).ok()?;
    parse(file, &text).map_err(|error| assert!(!error.to_string().is_empty())).ok()
}

fn wav(format: u16, channels: u16, samples: &[u8]) -> Vec<u8> {
    let bits: u16 = if format == 1 { 16 } else { 32 };
    let block = channels * bits / 8;
    let mut bytes = b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0".to_vec();
    for number in [format, channels] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(40_960_u32.to_le_bytes());
    bytes.extend((40_960 * u32::from(block)).to_le_bytes());
    bytes.extend(block.to_le_bytes());
    bytes.extend(bits.to_le_bytes());
    bytes.extend(b"LIST\x05\0\0\0abcde\0data");
    bytes.extend(u32::try_from(samples.len()).unwrap().to_le_bytes());
    bytes.extend(samples);
    bytes
}

/// Catches a panic or a wrong length of the WAV reader, and a float sample that is not a number and is accepted. What
/// is accepted must equal the bytes of its data chunk, and lie within the file.
#[test]
fn any_wav() {
    let floats: Vec<u8> = (0..24_u8).flat_map(|i| (f32::from(i) / 7.0).to_le_bytes()).collect();
    let seeds = vec![
        wav(1, 1, &[7; 60]),
        wav(1, 2, &(0..=199).collect::<Vec<u8>>()),
        wav(3, 1, &floats),
        wav(3, 3, &floats),
        wav(3, 2, &[floats, f32::NAN.to_le_bytes().to_vec(), vec![0; 4]].concat()),
    ];
    fuzz(seeds, |bytes| {
        let Ok(header) = wav::read_header(Cursor::new(bytes), bytes.len() as u64) else { return Ok(false) };
        let length = header.sample_count as usize * usize::from(header.channel_count) * header.format.bytes();
        prop_assert!(length > 0 && length <= bytes.len(), "{:?} of {} bytes", header, bytes.len());
        let mut buffer = vec![CacheLine::default(); cache_lines_for(length)];
        if header.read_samples(Cursor::new(bytes), &mut Vec::new(), &mut buffer).is_err() {
            return Ok(false);
        }
        if header.format == SampleFormat::F32 {
            prop_assert!(f32_of_mut(&mut buffer)[..length / 4].iter().all(|x| x.is_finite()));
        }
        // The samples are somewhere in the file as they were read, channel after channel or interleaved.
        let (size, channels) = (header.format.bytes(), usize::from(header.channel_count));
        let planar = &bytes_of(&buffer)[..length];
        let plane = length / channels;
        let frames: Vec<u8> = (0..plane / size)
            .flat_map(|k| (0..channels).flat_map(move |c| (0..size).map(move |b| c * plane + k * size + b)))
            .map(|place| planar[place])
            .collect();
        prop_assert!(bytes.windows(length).any(|w| w == frames), "samples that are not in the file");
        Ok(true)
    });
}

/// Catches a panic of the list's reader, and a row that later code cannot handle: numbers must be finite, paths must
/// stay in the folder, locations must be in bounds, and no tap may come twice.
#[test]
fn any_taps_csv() {
    let header = "file,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition\n";
    let ring: String = (0..=10).map(|k| format!("a/{k}.wav,T1,1,5.0,1.85,{k},{},1\n", 36 * k)).collect();
    let line: String = (0..8).map(|k| format!("{k}.wav,\"T \"\"2\",7,,,{k},,\n")).collect();
    let seeds = vec![format!("{header}{ring}").into_bytes(), format!("\u{feff}{header}{line}").into_bytes()];
    for geometry in [Geometry::Ring, Geometry::Line] {
        fuzz(seeds.clone(), |bytes| {
            let Some(rows) = parsed(bytes, |file, text| taps_csv::parse(file, text, geometry)) else {
                return Ok(false);
            };
            prop_assert!(!rows.is_empty());
            for (number, row) in rows.iter().enumerate() {
                let id = row.tap.id;
                let numbers = [row.tap.angle_deg, row.velocity_measured_m_per_s, id.offset_mm(), id.velocity_m_per_s()];
                prop_assert!(numbers.into_iter().flatten().all(f64::is_finite), "{:?}", row);
                prop_assert!(row.tap.angle_deg.is_none_or(|a| (0.0..=360.0).contains(&a)), "{:?}", row);
                prop_assert!(id.location <= taps_csv::LOCATION_MAX + 1, "{:?}", row);
                let inside = |c| matches!(c, Component::Normal(_) | Component::CurDir);
                prop_assert!(!row.file.contains('\0') && Path::new(&row.file).components().all(inside), "{:?}", row);
                prop_assert!(rows[..number].iter().all(|other| other.tap.id != id), "twice: {:?}", row);
            }
            Ok(true)
        });
    }
}

/// Catches a panic of the reader of `truth.csv`, and a location out of bounds.
#[test]
fn any_truth_csv() {
    let rows: String =
        (0..20).map(|k| format!("T1,{},{k},{}\n", 1 + k % 2, ["0", "1", "true", "false"][k % 4])).collect();
    fuzz(vec![format!("tyre,shoulder,location,cracked\n{rows}").into_bytes()], |bytes| {
        let Some(truth) = parsed(bytes, truth_csv::parse) else { return Ok(false) };
        prop_assert!(truth.keys().all(|&(_, shoulder, location)| shoulder > 0 && location <= taps_csv::LOCATION_MAX));
        Ok(true)
    });
}

/// Catches a panic of the reader of `scan.toml`, and a number that would divide by zero or overflow later.
#[test]
fn any_scan_toml() {
    let full = "geometry = \"ring\"\nchannels = [\"force\", \"sound\"]\nsample_rate_hz = 40960.0\npre_trigger_samples = 512\n\
        force_full_scale_n = 222.0\nsound_full_scale_v = 1.0\nmicrophone_distance_m = 0.1\nsound_unit = \"V\" # a remark\n";
    let least = "geometry = 'line'\nchannels = ['sound']\nsample_rate_hz = 44_100\npre_trigger_samples = 0\n";
    fuzz(vec![full.into(), least.into()], |bytes| {
        let Some(scan) = parsed(bytes, scan_toml::parse) else { return Ok(false) };
        prop_assert!((1.0..=5e8).contains(&scan.sample_rate_hz), "{:?}", scan);
        for (full_scale, _) in [scan.force_full_scale, scan.sound_full_scale].into_iter().flatten() {
            prop_assert!(full_scale > 0.0 && full_scale <= 1e12, "{:?}", scan);
        }
        prop_assert!((0.0..=1e3).contains(&scan.microphone_distance_m), "{:?}", scan);
        prop_assert!((1..=2).contains(&scan.channels.len()), "{:?}", scan);
        Ok(true)
    });
}
