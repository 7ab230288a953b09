//! Verification finds what was damaged on purpose, and nothing else.

use std::path::Path;

use tapline_store::{Codec, Error, Lineage, Problem, Reader, Writer, verify};
use tapline_wire::{Reasons, SampleFormat, ScanState, TapState, Verdict};

use crate::common::{CONFIG, finished, new_path, plan, put, put_all};
use crate::places::{chunk_bytes, table_bytes};

/// An archive in which all is, and which is not finished.
fn unfinished(path: &Path, codec: Codec) {
    let mut writer = Writer::create(path, &plan(SampleFormat::I16), 0, Lineage { codec, ..CONFIG.into() }).unwrap();
    put_all(&mut writer).unwrap();
    writer.settle().unwrap();
    writer.suspend().unwrap();
}

/// Catches a problem seen where there is none, and a run taken for complete that is not.
#[test]
fn a_whole_run_is_complete_and_a_part_is_not() {
    let (_here, path) = new_path();
    finished(&path, &plan(SampleFormat::I16), CONFIG);
    let report = verify(&path).unwrap();
    assert!(report.is_complete(), "{report:?}");

    let part = path.with_file_name("part.h5");
    let mut writer = Writer::create(&part, &plan(SampleFormat::I16), 0, CONFIG).unwrap();
    put(&mut writer, 1).unwrap();
    writer.finish().unwrap();
    let report = verify(&part).unwrap();
    assert_eq!(report.problems, []);
    assert!(!report.is_complete());
}

/// Catches a scan without a verdict that passes, and one that ended and is called open.
#[test]
fn a_scan_without_a_verdict_is_inspected_again() {
    let (_here, path) = new_path();
    let mut writer = Writer::create(&path, &plan(SampleFormat::I16), 0, CONFIG).unwrap();
    writer.end_scan(0).unwrap();
    writer.finish().unwrap();
    let reader = Reader::open(&path).unwrap();
    let verdicts = [0, 1].map(|scan| reader.verdict(scan, None));
    assert_eq!(verdicts, [Reasons::NO_INDEX, Reasons::NOT_ENDED].map(|reasons| (Verdict::ReInspect, reasons)));
}

/// Where the bytes of what an archive holds lie, and which plan row or scan each is of.
fn places(path: &Path) -> Vec<(usize, &'static str, usize)> {
    let file = hdf5::File::open(path).unwrap();
    let mut places = Vec::new();
    for name in ["taps/header", "discriminators", "ledger", "refusals", "scans", "damage"] {
        let (range, rows) = (table_bytes(&file, name), file.dataset(name).unwrap().shape()[0]);
        let (start, bytes) = (range.start, range.len());
        // Four locations per scan.
        let of = |at: usize| if name == "damage" { at * rows / bytes / 4 } else { at * rows / bytes };
        places.extend(range.map(|at| (at, name, of(at - start))));
    }
    for (k, chunk) in chunk_bytes(&file).into_iter().enumerate() {
        places.extend(chunk.map(|at| (at, "taps/samples", k)));
    }
    places
}

/// Catches a changed bit in samples, headers or results that is not found, or is looked for in the wrong place.
#[test]
fn every_flipped_bit_is_found_where_it_is() {
    for codec in [Codec::Lz4, Codec::None] {
        let (_here, path) = new_path();
        unfinished(&path, codec);
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

/// Catches a byte of a finished archive that may change unseen: but for samples, which their taps' checksums cover, none is read
/// before the seal is checked.
#[test]
fn what_is_damaged_is_not_opened() {
    let (_here, path) = new_path();
    finished(&path, &plan(SampleFormat::I16), CONFIG);
    let whole = std::fs::read(&path).unwrap();
    let samples: Vec<usize> =
        places(&path).into_iter().filter(|(_, name, _)| *name == "taps/samples").map(|(at, ..)| at).collect();
    let bent = path.with_file_name("bent.h5");
    for at in (0..whole.len()).step_by(211) {
        let mut bytes = whole.clone();
        bytes[at] ^= 16;
        std::fs::write(&bent, &bytes).unwrap();
        let opened = Reader::open(&bent);
        if samples.contains(&at) {
            let reader = opened.unwrap();
            assert!((0..10).any(|row| reader.tap(row).is_err()), "byte {at}");
        } else {
            let Err(error) = opened else { panic!("{at} is opened") };
            assert!(
                matches!(
                    error,
                    Error::Damaged { .. }
                        | Error::NotHdf5 { .. }
                        | Error::NotAnArchive { .. }
                        | Error::NotFinished { .. }
                ),
                "{at}: {error}"
            );
        }
        assert!(verify(&bent).map_or(true, |report| !report.is_complete()), "byte {at}");
    }
    let report = verify(&path).unwrap();
    assert!(report.is_complete() && report.is_finished);
}

/// Catches an archive that is not finished and is taken for one that is, or is continued after it was finished.
#[test]
fn what_is_finished_is_distinguished_from_what_is_not() {
    let (_here, path) = new_path();
    unfinished(&path, Codec::Lz4);
    assert!(matches!(Reader::open(&path), Err(Error::NotFinished { .. })));
    assert!(!Reader::open_unfinished(&path).unwrap().is_finished() && !verify(&path).unwrap().is_complete());
    let named = path.with_file_name("done/A.h5");
    let writer = Writer::resume(&path, CONFIG).unwrap();
    assert!(writer.is_complete());
    let finishing = writer.finish_at(&named).unwrap();
    assert!(finishing.complete().is_err() && path.exists(), "there is no folder");
    std::fs::create_dir(named.parent().unwrap()).unwrap();
    finishing.complete().unwrap();
    finishing.complete().unwrap();
    assert!(!path.exists() && Reader::open(&named).unwrap().is_finished() && verify(&named).unwrap().is_complete());
    assert!(matches!(Writer::resume(&named, CONFIG), Err(Error::Finished { .. })));
    unfinished(&path, Codec::Lz4);
    let second = Writer::resume(&path, CONFIG).unwrap().finish_at(&named).unwrap();
    assert!(matches!(second.complete(), Err(Error::Exists { .. })) && path.exists());
}

/// Catches a row that is not what was written and is believed, or that keeps its tap or scan from being done again.
#[test]
fn a_corrupt_row_is_a_missing_tap() {
    let (_here, path) = new_path();
    for table in ["ledger", "taps/header", "discriminators", "scans"] {
        unfinished(&path, Codec::Lz4);
        let (at, ..) = places(&path).into_iter().find(|&(_, name, row)| name == table && row == 1).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[at + 8] ^= 4;
        std::fs::write(&path, bytes).unwrap();
        let mut writer = Writer::resume(&path, CONFIG).unwrap();
        let expected = if table == "scans" { TapState::Archived } else { TapState::Missing };
        assert_eq!(writer.ledger().taps()[1], expected, "{table}");
        assert_eq!(writer.ledger().scans()[usize::from(table == "scans")], ScanState::Open, "{table}");
        put_all(&mut writer).unwrap();
        writer.finish().unwrap();
        let report = verify(&path).unwrap();
        assert!(report.is_complete(), "{table}: {report:?}");
        std::fs::remove_file(&path).unwrap();
    }
}

/// Catches a change of what never changes in an archive that is still written: none is continued, and none is read.
#[test]
fn a_changed_structure_is_refused() {
    let (_here, path) = new_path();
    for codec in [Codec::Lz4, Codec::None] {
        unfinished(&path, codec);
        let whole = std::fs::read(&path).unwrap();
        let may_change: std::collections::BTreeSet<usize> = places(&path).into_iter().map(|(at, ..)| at).collect();
        let (mut refused, mut others) = (0, 0);
        for at in (0..whole.len()).filter(|at| !may_change.contains(at)).step_by(7) {
            let mut bytes = whole.clone();
            bytes[at] ^= 32;
            std::fs::write(&path, &bytes).unwrap();
            match (Writer::resume(&path, CONFIG).map(drop), Reader::open_unfinished(&path).map(drop)) {
                (Err(_), Err(_)) => refused += 1,
                _ => others += 1,
            }
        }
        assert!(refused > 20 * others, "{refused} {others}");
        std::fs::remove_file(&path).unwrap();
    }
}
