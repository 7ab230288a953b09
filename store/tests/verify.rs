//! Verification finds what was bent on purpose, and nothing else.

use std::path::{Path, PathBuf};

use ndarray::arr1;
use tapline_store::{Problem, Writer, verify};
use tapline_wire::SampleFormat;

use crate::common::{CONFIG, plan, put, put_all};

fn finished(folder: &tempfile::TempDir) -> PathBuf {
    let path = folder.path().join("run.h5");
    let mut writer = Writer::create(&path, &plan(SampleFormat::I16), CONFIG).unwrap();
    put_all(&mut writer).unwrap();
    writer.finish().unwrap();
    path
}

#[repr(C)]
#[derive(Clone, Copy, hdf5::H5Type)]
struct State {
    state: u16,
}

#[repr(C)]
#[derive(Clone, Copy, hdf5::H5Type)]
struct PlanIndex {
    plan_index: u32,
}

#[repr(C)]
#[derive(Clone, Copy, hdf5::H5Type)]
struct ScanNumber {
    scan: u32,
}

#[repr(C)]
#[derive(Clone, Copy, hdf5::H5Type)]
struct Tau {
    tau_s: f64,
}

fn bend<T: hdf5::H5Type + Clone>(path: &Path, table: &str, row: usize, value: T) {
    let file = hdf5::File::open_rw(path).unwrap();
    file.dataset(table).unwrap().write_slice(&arr1(&[value]), row..row + 1).unwrap();
}

fn problems(path: &Path) -> Vec<String> {
    verify(path).unwrap().problems.iter().map(ToString::to_string).collect()
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

/// Catches contradictions that verification would not see.
#[test]
fn contradictions_are_named() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    bend(&path, "taps/header", 2, PlanIndex { plan_index: u32::MAX });
    bend(&path, "discriminators", 3, PlanIndex { plan_index: 4 });
    bend(&path, "discriminators", 6, Tau { tau_s: f64::INFINITY });
    bend(&path, "damage", 1, ScanNumber { scan: 1 });
    let found = problems(&path);
    assert_eq!(found.len(), 4, "{found:?}");
    assert!(found[0].contains("plan row 2") && found[0].contains("header"), "{found:?}");
    assert!(found[1].contains("plan row 3") && found[1].contains("discriminators"), "{found:?}");
    assert!(found[2].contains("plan row 6") && found[2].contains("inf"), "{found:?}");
    assert!(found[3].contains("scan 0") && found[3].contains("location 1"), "{found:?}");

    bend(&path, "ledger", 5, State { state: 0 });
    let report = verify(&path).unwrap();
    let miscount = |p: &Problem| matches!(p, Problem::Scan { scan: 1, what } if what.contains("received"));
    assert!(report.problems.iter().any(miscount), "{:?}", report.problems);
    bend(&path, "ledger", 5, State { state: 7 });
    assert!(problems(&path).iter().any(|p| p.contains("state is 7")));
    assert!(tapline_store::Reader::open(&path).unwrap_err().to_string().contains("row 5"));
}

/// Catches a plan that was changed under its digest.
#[test]
fn a_changed_plan_is_noticed() {
    let _guard = crate::common::beside_others();
    #[repr(C)]
    #[derive(Clone, Copy, hdf5::H5Type)]
    struct Location {
        location: u32,
    }
    let folder = tempfile::tempdir().unwrap();
    let path = finished(&folder);
    bend(&path, "plan", 0, Location { location: 77 });
    let error = verify(&path).unwrap_err();
    assert!(error.to_string().contains("digest"), "{error}");
}
