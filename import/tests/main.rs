//! Recordings that Python's libraries write, imported; and damaged ones.

#![expect(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

mod damaged;
mod faults;
mod round_trips;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tapline_acquire::{Source as _, TapSet};
use tapline_store::OwnedSamples;
use tapline_wire::{CacheLine, Samples, TapHeader, cache_lines_for};
use tempfile::TempDir;

/// Taps of each case, and samples of a channel.
const TAP_COUNT: u32 = 3;
const SAMPLE_COUNT: usize = 200;

/// A folder with the recordings of all cases, as Python's libraries write them; `None` where there is none.
fn recordings() -> Option<TempDir> {
    let python = tapline_testing::python_with("h5py, nptdms, pyuff, scipy")?;
    let folder = TempDir::new().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recordings.py");
    let out = Command::new(python).arg(script).arg(folder.path()).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    Some(folder)
}

/// The recordings of a case.
fn files(case: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(case).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = entries.filter(|path| !path.ends_with("import.toml") && path.is_file()).collect();
    files.sort();
    files
}

/// The taps of a tap set, in their order.
fn taps_of(set: &Path) -> Vec<(TapHeader, OwnedSamples)> {
    let mut set = TapSet::open(set, 1).unwrap();
    let plan = set.plan().clone();
    let mut buffer = vec![CacheLine::default(); cache_lines_for(plan.recording.payload_bytes_max())];
    let tap = |row: u32| {
        let mut header = TapHeader::default();
        set.render(row, 0, &mut header, &mut buffer).unwrap();
        let samples = match Samples::view(&header, &buffer).unwrap() {
            Samples::I16(samples) => OwnedSamples::I16(samples.to_vec()),
            Samples::F32(samples) => OwnedSamples::F32(samples.to_vec()),
        };
        (header, samples)
    };
    (0..u32::try_from(plan.taps().len()).unwrap()).map(tap).collect()
}

/// Force and sound of tap `k` as `recordings.py` has them, one after the other.
fn counts(k: u32) -> Vec<i64> {
    let sample = |factor: i64, shift: i64| move |i| (factor * i + shift * i64::from(k)) % 65_536 - 32_768;
    let samples = 0..i64::try_from(SAMPLE_COUNT).unwrap();
    samples.clone().map(sample(7919, 31)).chain(samples.map(sample(104_729, 17))).collect()
}
