//! Tests of the list of a tap set's casings.

use std::fs;

use tempfile::TempDir;

use super::*;
use crate::simulated::listed::tests::tap_of;
use crate::tap_set::tests::{HEADER, SCAN, refusals, write_wav};

/// Three casings of two shoulders with interleaved rows; every recording differs in samples and length.
fn rows() -> Vec<String> {
    let mut rows = Vec::new();
    for location in 0..3 {
        for (tyre, shoulder) in [("B", 1), ("A", 1), ("C", 2), ("B", 2), ("A", 2), ("C", 1)] {
            let file = format!("{tyre}{shoulder}{location}.wav");
            rows.push(format!("{file},{tyre},{shoulder},0,1.5,{location},{},0", f64::from(location) * 3.6));
        }
    }
    rows
}

pub(crate) fn set_of(dir: &Path, rows: &[String], scan: &str) {
    fs::create_dir_all(dir).unwrap();
    fs::write(dir.join("scan.toml"), scan).unwrap();
    fs::write(dir.join("taps.csv"), format!("{HEADER}{}\n", rows.join("\n"))).unwrap();
    for row in rows {
        let file = row.split(',').next().unwrap();
        let first: u32 = file.bytes().map(u32::from).sum();
        let samples: Vec<f32> = (0..2 * (4 + first % 5)).map(|k| (first + k) as f32).collect();
        write_wav(dir, file, 2, 40_960, 16, &samples);
    }
}

fn set(rows: &[String]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    set_of(dir.path(), rows, SCAN);
    fs::write(dir.path().join("truth.csv"), "tyre,shoulder,location,cracked\nA,2,1,1\nB,1,0,0\n").unwrap();
    dir
}

fn casings(list: &TapSetList) -> Vec<Casing> {
    let of_station = |station: u16| {
        let mut arrivals = list.arrivals(station);
        std::iter::from_fn(move || match arrivals.next().unwrap() {
            Arrival::Casing(casing) => Some(casing),
            Arrival::NotYet => panic!("a list waits for nothing"),
            Arrival::Ended => None,
        })
    };
    list.stations().into_iter().flat_map(of_station).collect()
}

/// Catches a tap that differs when its casing is read alone, a casing at two stations, and one that is left out.
#[test]
fn every_casing_has_the_taps_of_the_whole_set() {
    let dir = set(&rows());
    let mut whole = TapSet::open(dir.path(), 2).unwrap();
    let list = listed_tap_set(dir.path(), 2).unwrap();
    let listed: Vec<_> = list.listed().map(Result::unwrap).collect();
    let places: Vec<_> = listed.iter().map(|(name, station, _)| (name.as_str(), *station)).collect();
    assert_eq!(places, [("B", 1), ("A", 2), ("C", 1)]);
    let mut seen = 0;
    for mut casing in casings(&list) {
        let plan = casing.taps.plan().clone();
        assert!(listed.iter().any(|(name, _, of)| *name == casing.name && *of == plan));
        assert_eq!(plan.truth().len(), usize::from(casing.name != "C"));
        for (row, tap) in (0..).zip(plan.taps()) {
            let of_whole = whole.plan().taps().iter().position(|t| t == tap).unwrap();
            let want = tap_of(&mut whole, u32::try_from(of_whole).unwrap(), 0);
            assert_eq!(tap_of(&mut *casing.taps, row, 0), want, "{} row {row}", casing.name);
            seen += 1;
        }
    }
    assert_eq!(seen, whole.plan().taps().len());
    let limits = list.limits().unwrap();
    assert_eq!((limits.taps, limits.scans, limits.locations), (6, 2, 3));
    assert_eq!(limits.record_bytes, whole.plan().recording.payload_bytes_max());
}

/// Catches a plan that depends on the other casings of its set, and one that does not depend on its own recordings.
#[test]
fn a_casing_is_the_same_in_any_company() {
    let digest_of_a = |rows: &[String]| {
        let list = listed_tap_set(set(rows).path(), 1).unwrap();
        list.listed().map(Result::unwrap).find(|(name, ..)| name == "A").unwrap().2.digest()
    };
    let all = digest_of_a(&rows());
    let alone: Vec<String> = rows().into_iter().filter(|row| row.contains(",A,")).collect();
    assert_eq!(digest_of_a(&alone), all);
    let mut last: Vec<String> = rows().into_iter().filter(|row| !row.contains(",A,")).collect();
    last.extend(alone.iter().cloned());
    assert_eq!(digest_of_a(&last), all);
    let mut other = alone.clone();
    other[0] = other[0].replace("A10.wav", "longer.wav");
    assert_ne!(digest_of_a(&other), all);
}

/// Catches a slab that is split into its lines, and one without the name of its folder.
#[test]
fn a_slab_is_one_casing() {
    let dir = tempfile::tempdir().unwrap();
    let rows: Vec<String> = rows().into_iter().filter(|row| row.contains(",A,")).collect();
    let long = "x".repeat(100);
    for (folder, name) in [("slab 06", "slab 06"), (long.as_str(), "x")] {
        set_of(&dir.path().join(folder), &rows, &SCAN.replace("ring", "line"));
        let list = listed_tap_set(&dir.path().join(folder), 4).unwrap();
        assert_eq!((list.len(), list.stations()), (1, vec![1]));
        let casing = casings(&list).remove(0);
        assert!(casing.name.starts_with(name) && casing.name.len() <= 73, "{}", casing.name);
        assert_eq!(casing.taps.plan().scans().len(), 2);
    }
}

/// Catches a station of the list that is ignored, and a casing at two stations.
#[test]
fn stations_that_are_named_are_kept() {
    let dir = set(&rows());
    let header = HEADER.replace("repetition", "repetition,station");
    let named = |of_second: &str| {
        let edited = |(number, row): (usize, String)| match row {
            row if row.contains(",A,1,") => format!("{row},7"),
            row if number == 4 => format!("{row},{of_second}"),
            row => format!("{row},"),
        };
        let rows: Vec<String> = rows().into_iter().enumerate().map(edited).collect();
        fs::write(dir.path().join("taps.csv"), format!("{header}{}\n", rows.join("\n"))).unwrap();
        listed_tap_set(dir.path(), 2)
    };
    let places: Vec<_> = named("").unwrap().listed().map(|l| l.map(|l| (l.0, l.1)).unwrap()).collect();
    assert_eq!(places, [("B".to_owned(), 1), ("A".to_owned(), 7), ("C".to_owned(), 2)]);
    let error = named("8").unwrap_err().to_string();
    assert!(error.ends_with("taps.csv: tyre A is at station 7 (line 3) and at station 8 (line 6)"), "{error}");
}

/// Catches a casing without a usable recording that blocks the others.
#[test]
fn a_casing_without_recordings_is_refused_tap_by_tap() {
    let dir = set(&rows());
    for row in rows().iter().filter(|row| row.contains(",A,")) {
        fs::remove_file(dir.path().join(row.split(',').next().unwrap())).unwrap();
    }
    let list = listed_tap_set(dir.path(), 1).unwrap();
    let refused =
        (0..3).map(|number| refusals(&TapSet::from_casing(&list.set, &list.casings[number], 1).unwrap()).len());
    assert_eq!(refused.sum::<usize>(), 6);
    assert_eq!(casings(&list).len(), 3);
}
