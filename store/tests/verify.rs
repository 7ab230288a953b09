//! Verification finds what was bent on purpose, and nothing else.

use std::path::{Path, PathBuf};

use tapline_store::{Codec, Lineage, Problem, Reader, RunWriter, Writer, verify};
use tapline_wire::{SampleFormat, ScanState, TapState};

use crate::common::{CONFIG, header, plan, put, put_all, samples};

fn finished(folder: &tempfile::TempDir) -> PathBuf {
    let path = folder.path().join("run.h5");
    let mut writer = Writer::create(&path, &plan(SampleFormat::I16), CONFIG).unwrap();
    put_all(&mut writer).unwrap();
    writer.finish().unwrap();
    path
}

/// Catches a problem seen where there is none, and a run taken for complete that is not.
#[test]
fn a_whole_run_is_complete_and_a_part_is_not() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    let report = verify(&path).unwrap();
    assert!(report.is_complete(), "{report:?}");

    let part = folder.path().join("part.h5");
    let mut writer = Writer::create(&part, &plan(SampleFormat::I16), CONFIG).unwrap();
    put(&mut writer, 1).unwrap();
    writer.finish().unwrap();
    let report = verify(&part).unwrap();
    assert_eq!(report.problems, []);
    assert!(!report.is_complete());
}

/// Where the bytes of what an archive holds lie, and which plan row or scan each is of.
fn places(path: &Path) -> Vec<(usize, &'static str, usize)> {
    let file = hdf5::File::open(path).unwrap();
    let mut places = Vec::new();
    for name in ["taps/header", "discriminators", "ledger", "refusals", "scans", "damage"] {
        let table = file.dataset(name).unwrap();
        let start = table.offset().unwrap() as usize;
        let (bytes, rows) = (table.storage_size() as usize, table.shape()[0]);
        // Four locations a scan.
        let of = |at: usize| if name == "damage" { at * rows / bytes / 4 } else { at * rows / bytes };
        places.extend((0..bytes).map(|at| (start + at, name, of(at))));
    }
    let samples = file.dataset("taps/samples").unwrap();
    for k in 0..samples.num_chunks().unwrap() {
        let chunk = samples.chunk_info(k).unwrap();
        let start = chunk.addr as usize;
        places.extend((start..start + chunk.size as usize).map(|at| (at, "taps/samples", k)));
    }
    places
}

/// Catches a changed bit in samples, headers or results that is not found, or is looked for in the wrong place.
#[test]
fn every_flipped_bit_is_found_where_it_is() {
    let _guard = crate::common::beside_others();
    for codec in [Codec::Lz4, Codec::None] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        let mut writer = Writer::create(&path, &plan(SampleFormat::I16), Lineage { codec, ..CONFIG.into() }).unwrap();
        put_all(&mut writer).unwrap();
        writer.finish().unwrap();
        let whole = std::fs::read(&path).unwrap();
        // Another bit of another byte each time; the seal's own test tries all bits of a row.
        for (number, (at, name, row)) in places(&path).into_iter().step_by(13).enumerate() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << (number % 8);
            std::fs::write(&path, bytes).unwrap();
            let report = verify(&path).unwrap();
            let is_it = |problem: &Problem| match problem {
                Problem::Tap { plan_index, .. } => *plan_index as usize == row && !matches!(name, "scans" | "damage"),
                Problem::Scan { scan, .. } => *scan as usize == row && matches!(name, "scans" | "damage"),
                _ => false,
            };
            assert!(report.problems.iter().any(is_it), "{codec} {name} row {row}, byte {at}: {:?}", report.problems);
            assert!(!report.is_complete());
        }
    }
}

/// Catches a reader that gives what a checksum speaks against, and one that gives less than it could.
#[test]
fn what_is_damaged_is_not_given() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    let whole = std::fs::read(&path).unwrap();
    let first = |table: &str| places(&path).into_iter().find(|(_, name, row)| *name == table && *row == 1).unwrap().0;
    let bent = |table: &str| {
        let mut bytes = whole.clone();
        bytes[first(table) + 20] ^= 4;
        let path = folder.path().join(format!("{}.h5", table.replace('/', "-")));
        std::fs::write(&path, bytes).unwrap();
        Reader::open(&path).unwrap()
    };
    assert!(bent("taps/samples").tap(1).unwrap_err().to_string().contains("plan row 1"));
    let reader = bent("taps/header");
    assert!(reader.tap(1).unwrap_err().to_string().contains("plan row 1") && reader.tap(2).unwrap().is_some());
    assert!(bent("discriminators").discriminators().unwrap_err().to_string().contains("row 1"));
    assert!(bent("damage").judgements().is_err());
}

/// Catches a tap that is given up because a row of the ledger is torn, though all that was written before that row is whole,
/// one that is kept though it is not, and a row that a writer leaves torn.
#[test]
fn a_torn_ledger_is_mended() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    let whole = std::fs::read(&path).unwrap();
    let bend = |tables: &[&str]| {
        let mut bytes = whole.clone();
        for table in tables {
            let first = places(&path).into_iter().find(|(_, name, row)| name == table && *row == 1).unwrap().0;
            bytes[first + 8] ^= 4;
        }
        let path = folder.path().join("bent.h5");
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let bent = bend(&["ledger"]);
    assert!(!verify(&bent).unwrap().is_complete());
    let reader = Reader::open(&bent).unwrap();
    assert_eq!((reader.ledger().taps()[1], reader.attempt(1)), (TapState::Archived, Some(0)));
    assert!(reader.tap(1).unwrap().is_some());
    // Results are of the same taps, whether or not the row is mended meanwhile.
    let results = folder.path().join("results.h5");
    let lineage = Lineage { made_by: "other", ..CONFIG.into() };
    RunWriter::of_results(&results, &reader, lineage).unwrap().finish().unwrap();
    let raw_digest = reader.raw_digest().unwrap();
    assert_eq!(Reader::open(&results).unwrap().raw_digest().unwrap(), raw_digest);
    drop(reader);
    Writer::resume(&bent, &plan(SampleFormat::I16), CONFIG).unwrap().finish().unwrap();
    assert_eq!(Reader::open(&results).unwrap().raw_digest().unwrap(), raw_digest);
    let report = verify(&bent).unwrap();
    assert!(report.is_complete() && report.problems.is_empty(), "{report:?}");
    for other in ["taps/header", "discriminators"] {
        let reader = Reader::open(bend(&["ledger", other])).unwrap();
        assert_eq!(reader.ledger().taps()[1], TapState::Missing, "{other}");
    }
}

/// Catches parts that never change and are under no seal.
#[test]
fn what_never_changes_is_sealed() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    let whole = std::fs::read(&path).unwrap();
    let file = hdf5::File::open(&path).unwrap();
    let mut at: Vec<usize> = ["plan", "truth"]
        .into_iter()
        .flat_map(|name| {
            let table = file.dataset(name).unwrap();
            let start = table.offset().unwrap() as usize;
            (start..start + table.storage_size() as usize).step_by(11)
        })
        .collect();
    drop(file);
    let text = CONFIG.as_bytes();
    at.push(whole.windows(text.len()).position(|window| window == text).unwrap() + 3);
    for at in at {
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        std::fs::write(&path, bytes).unwrap();
        let error = verify(&path).unwrap_err();
        assert!(matches!(error, tapline_store::Error::Damaged { .. }), "byte {at}: {error}");
    }
}

/// Catches a key that stands in an archive and is not that of its results.
#[test]
fn the_key_is_that_of_the_results() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    let key = Reader::open(&path).unwrap().lineage_key().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(64).position(|window| window == key.as_bytes()).unwrap();
    bytes[at + 7] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let problems = verify(&path).unwrap().problems;
    assert!(matches!(&problems[..], [Problem::Key { computed, .. }] if *computed == key), "{problems:?}");
}

/// Catches a column that is named otherwise, whose values would be whatever lay in memory.
#[test]
fn a_renamed_column_is_refused() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    let whole = std::fs::read(&path).unwrap();
    for name in ["retaken_count", "lost_at", "refused_count", "tap_time_ns", "is_closing"] {
        let mut bytes = whole.clone();
        let name_bytes = format!("{name}\0");
        let at = bytes.windows(name_bytes.len()).position(|window| window == name_bytes.as_bytes()).unwrap();
        bytes[at] ^= 1;
        std::fs::write(&path, bytes).unwrap();
        let error = verify(&path).unwrap_err();
        assert!(matches!(error, tapline_store::Error::Damaged { .. }), "{name}: {error}");
        assert!(Reader::open(&path).is_err() && Writer::resume(&path, &plan(SampleFormat::I16), CONFIG).is_err());
    }
}

/// Catches a resumed line that judges from values that were altered, and records over taps that it cannot vouch for.
#[test]
fn what_was_altered_is_not_gone_on_with() {
    let _guard = crate::common::beside_others();
    for table in ["taps/header", "discriminators"] {
        let folder = tempfile::tempdir().unwrap();
        let path = finished(&folder);
        let (at, ..) = places(&path).into_iter().find(|(_, name, row)| *name == table && *row == 3).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[at + 17] ^= 2;
        std::fs::write(&path, bytes).unwrap();
        let error = Writer::resume(&path, &plan(SampleFormat::I16), CONFIG).unwrap_err().to_string();
        assert!(error.contains("row 3") && error.contains(table), "{error}");
    }
}

/// Catches results that are said to be altered where they are of what was there before a tap was lost.
#[test]
fn a_lost_tap_is_no_contradiction() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    let of = |name| places(&path).into_iter().find(|&(_, table, _)| table == name).unwrap().0;
    let torn = ["ledger", "taps/header"].map(of);
    let mut bytes = std::fs::read(&path).unwrap();
    torn.iter().for_each(|&at| bytes[at] ^= 1);
    std::fs::write(&path, bytes).unwrap();
    // Its samples come again, and then the run is ended.
    let plan = plan(SampleFormat::I16);
    let mut writer = Writer::resume(&path, &plan, CONFIG).unwrap();
    let header = header(&plan, 0, 32);
    writer.put_tap(&header, &samples(&header)).unwrap();
    writer.finish().unwrap();
    let report = verify(&path).unwrap();
    assert_eq!((&report.problems[..], report.missing_count, report.is_judged()), (&[][..], 1, false));
}

/// Catches rows that say how taps and scans stand and stay torn though a writer went on with them, or are sealed as they are.
#[test]
fn a_writer_mends_torn_rows() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    let of = |name| places(&path).into_iter().find(|&(_, table, _)| table == name).unwrap().0;
    let (ledger, scans) = (of("ledger"), of("scans"));
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[ledger] ^= 1;
    bytes[scans] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    assert_eq!(Reader::open(&path).unwrap().torn_row_count(), 2);
    Writer::resume(&path, &plan(SampleFormat::I16), CONFIG).unwrap().finish().unwrap();
    let reader = Reader::open(&path).unwrap();
    assert_eq!((reader.torn_row_count(), reader.ledger().scans()[0]), (0, ScanState::Ended));
    let report = verify(&path).unwrap();
    assert!(report.problems.is_empty() && report.missing_count == 0 && !report.is_judged(), "{report:?}");
}
