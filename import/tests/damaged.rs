//! Damaged files: no panic, no hang, and no more memory than the file is worth.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use tapline_import::import;
use tapline_testing::noise::Noise;
use tempfile::TempDir;

use crate::{files, recordings};

/// Longest time for one small file; a hang would take for ever.
const PATIENCE: Duration = Duration::from_secs(20);

/// Cases whose first file is damaged: at least one of each format and layout.
const CASES: [&str; 13] = [
    "wav16", "wav24", "wav_float", "csv", "hdf5_files", "hdf5_groups", "mat5_int16", "mat7_int16", "mat5_structs",
    "uff58", "uff58b", "tdms_groups", "tdms_layouts",
];

/// Imports a case with `bytes` in place of its first recording; the error, if there is one.
fn import_damaged(case: &Path, damaged: &Path, bytes: &[u8]) -> Result<(), String> {
    fs::write(damaged, bytes).unwrap();
    let set = TempDir::new().unwrap();
    let began = Instant::now();
    let done = import(&[damaged.to_owned()], &case.join("import.toml"), &set.path().join("set"), |_, _| ());
    check(damaged, began, done)
}

/// The error of an import, which must have come in time, name the file and be short.
#[expect(clippy::panic_in_result_fn, reason = "the error is what is tested")]
fn check<T>(damaged: &Path, began: Instant, done: tapline_import::Result<T>) -> Result<(), String> {
    assert!(began.elapsed() < PATIENCE, "{}: it took {:?}", damaged.display(), began.elapsed());
    let Err(error) = done else { return Ok(()) };
    let (error, name) = (error.to_string(), damaged.file_name().unwrap().to_string_lossy());
    assert!(error.contains(&*name) || error.contains("taps.csv"), "{error:?} does not name {name}");
    assert!(error.len() < 4000, "an error of {} bytes", error.len());
    Err(error)
}

/// The first recording of a case, alone in a folder with its configuration.
fn alone(folder: &Path, case: &str) -> (PathBuf, PathBuf) {
    let (from, to) = (folder.join(case), folder.join(format!("{case}.damaged")));
    let recordings = files(&from);
    let first = recordings.iter().find(|file| !file.ends_with("taps.csv")).unwrap();
    fs::create_dir(&to).unwrap();
    fs::copy(from.join("import.toml"), to.join("import.toml")).unwrap();
    if let Ok(table) = fs::read_to_string(from.join("taps.csv")) {
        // The table of one file.
        let name = first.file_name().unwrap().to_string_lossy().into_owned();
        let rows: Vec<&str> =
            table.lines().enumerate().filter(|(k, l)| *k == 0 || l.contains(&name)).map(|(_, l)| l).collect();
        fs::write(to.join("taps.csv"), rows.join("\n")).unwrap();
    }
    let damaged = to.join(first.file_name().unwrap());
    fs::copy(first, &damaged).unwrap();
    (to, damaged)
}

/// Catches a file that ends early and is taken for whole, at every fortieth of its length and near its ends.
#[test]
fn truncated_files_are_refused() {
    let Some(folder) = recordings() else { return };
    for case in CASES {
        let (folder, damaged) = alone(folder.path(), case);
        let whole = fs::read(&damaged).unwrap();
        import_damaged(&folder, &damaged, &whole).unwrap_or_else(|error| panic!("{case}, whole: {error}"));
        let lengths = (0..40).map(|k| k * whole.len() / 40).chain([1, 4, 12, 127, 129, 500]);
        for length in lengths.filter(|&length| length < whole.len()) {
            let done = import_damaged(&folder, &damaged, &whole[..length]);
            // A table of text, and a list of variables, may end at any line.
            let may_end = ["csv", "mat5", "tdms"].iter().any(|kind| case.starts_with(kind));
            assert!(done.is_err() || may_end, "{case}: {length} of {} bytes are taken for whole", whole.len());
        }
    }
}

/// Catches a panic, a hang, and memory without bound at flipped bits and numbers that are too large.
///
/// HDF5 is not among them: libhdf5 1.10 writes beyond its memory for about one in some thousand of such files, and that ends the
/// process, or not, by chance. `docs/import.md` says so.
#[test]
fn flipped_bits_do_no_harm() {
    let Some(folder) = recordings() else { return };
    let mut noise = Noise(20_260_101);
    let mut below = |bound: usize| usize::try_from((u64::from(noise.bits()) * bound as u64) >> 32).unwrap();
    for case in CASES.into_iter().filter(|case| !case.starts_with("hdf5")) {
        let (folder, damaged) = alone(folder.path(), case);
        let whole = fs::read(&damaged).unwrap();
        let mut refused = 0;
        for round in 0..150 {
            let mut bytes = whole.clone();
            for _ in 0..=below(3) {
                // Headers are at the beginning.
                let range = if round % 2 == 0 { bytes.len().min(600) } else { bytes.len() };
                let at = below(range);
                match below(3) {
                    0 => bytes[at] ^= 1 << below(8),
                    1 => bytes[at] = 0xff,
                    _ => bytes[at..].iter_mut().take(4).for_each(|byte| *byte = 0xff),
                }
            }
            refused += usize::from(import_damaged(&folder, &damaged, &bytes).is_err());
        }
        assert!(refused > 0, "{case}: no damage was found");
        eprintln!("{case}: {refused} of 150 damaged files were refused");
    }
    let most = peak_memory_bytes();
    assert!(most < 1 << 30, "at most {most} bytes of memory were in use");
}

/// Most memory that this process has had.
fn peak_memory_bytes() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() * 1024
}

/// Catches a header that is believed: 10^12 samples in a small file are refused, by their number.
#[test]
fn headers_that_promise_too_much_are_refused() {
    let Some(python) = tapline_testing::python_with("h5py, numpy") else { return };
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    let config = "name = \"{location}.{_}\"\nsample_rate_hz = 51200\npre_trigger_samples = 1\n\
                  channels = { force = \"force\" }\ntap = { tyre = \"A\", shoulder = 1 }\n";
    fs::write(path("import.toml"), config).unwrap();
    // HDF5: chunks that were never written take no room.
    let script = "import h5py, sys\nf = h5py.File(sys.argv[1], 'w')\nf.create_dataset('force', (10**12,), 'i2', chunks=(1000,))\n";
    let out = std::process::Command::new(python).args(["-c", script]).arg(path("0.h5")).output().unwrap();
    assert!(out.status.success());
    // TDMS: a segment of 10^12 samples that is not ended.
    let text = |text: &str| [&u32::try_from(text.len()).unwrap().to_le_bytes(), text.as_bytes()].concat();
    let index = [20_u32, 2, 1].map(u32::to_le_bytes).concat();
    let about =
        [&1_u32.to_le_bytes()[..], &text("/'g'/'force'"), &index, &1_000_000_000_000_u64.to_le_bytes(), &[0; 4]]
            .concat();
    let offsets = [u64::MAX, about.len() as u64].map(u64::to_le_bytes).concat();
    let lead_in = [&b"TDSm"[..], &14_u32.to_le_bytes(), &4713_u32.to_le_bytes(), &offsets].concat();
    fs::write(path("0.tdms"), [lead_in, about, vec![0; 100]].concat()).unwrap();
    // UFF: so many values in a line of text.
    fs::write(path("0.uff"), crate::faults::uff("force", 2_000_000_000)).unwrap();
    for (file, want) in [
        ("0.h5", "1000000000000 samples per channel; at most"),
        ("0.tdms", "are promised"),
        ("0.uff", "2000000000 samples per channel; at most"),
    ] {
        let error = import(&[path(file)], &path("import.toml"), &path("set"), |_, _| ()).unwrap_err().to_string();
        assert!(error.contains(file) && error.contains(want), "{error:?} lacks {want:?}");
    }
}
