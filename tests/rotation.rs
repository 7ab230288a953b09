//! A run that takes several files: every verb takes its folder as it takes one file.

use std::fs;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use rustix::process::Signal;
use tapline_store::{Lost, Reader};

use crate::rig::{Rig, assert_same, bend, contents, signal, stage, table_bytes};

/// Three tyres at two stations, of some 2 MB each.
const SCAN: &str = "
[scan]
locations = 40
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 1
tyre = [{ serial = \"A\" }, { serial = \"B\" }, { serial = \"C\" }]
[fuse]
reference = \"self\"
";

fn files(rig: &Rig, folder: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(rig.path(folder)).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = entries.filter(|path| path.is_file()).collect();
    files.sort();
    files
}

/// Catches a verb that does not take a folder, and a run in several files that is another than the same run in one.
#[test]
fn every_verb_takes_the_folder_of_a_run() {
    let rig = Rig::new();
    rig.write("one.toml", SCAN);
    rig.write("many.toml", &format!("{SCAN}\n[store]\nrotate_after_mb = 2\n"));
    rig.run("run --config one.toml --stations 2 --out one.h5").expect(0);
    rig.run("run --config many.toml --stations 2 --out many/").expect(0);
    let parts = files(&rig, "many");
    assert!(parts.len() > 1, "{parts:?}");
    let expected = contents(&rig.path("one.h5"));
    assert_same(&contents(&rig.path("many")), &expected);
    for part in &parts {
        rig.run(&format!("verify {}", part.display())).expect(0);
    }
    let done = rig.run("verify many").expect(0);
    assert!(done.out.contains("whole: 246 archived, 0 refused, 0 missing; all scans judged"), "{done:#?}");
    let done = rig.run(&format!("verify {}", parts[0].display())).expect(0);
    assert!(done.out.contains("in later files of the run"), "{done:#?}");
    for table in ["verdicts", "regions", "damage", "discriminators", "ledger"] {
        let of = |archive: &str| rig.run(&format!("export {archive} {table}")).expect(0).out;
        assert_eq!(of("one.h5"), of("many"), "{table}");
    }
    rig.run("report many").expect(0);
    assert!(rig.path("many-report/shift.html").is_file());
    rig.run("explain many").expect(0);
    rig.run("repack many --codec gzip --out packed").expect(0);
    assert_same(&contents(&rig.path("packed")), &expected);
    let results = rig.run("reprocess many --from-samples --jobs 2").expect(0).out;
    assert_same(&contents(&rig.path(results.trim())), &expected);
    assert_eq!(files(&rig, results.trim()).len(), parts.len());
    rig.run(&format!("verify {}", results.trim())).expect(0);
    // A torn row of a file that is done is mended, as one of the last is, and is no fault of the disk.
    for (table, row_count) in [("ledger", 246), ("scans", 6)] {
        let row_bytes = table_bytes(&parts[0], table).len() / row_count;
        // The last is left to a later file.
        for (part, row) in [(&parts[0], 0), (&parts[1], 0), (&parts[0], row_count - 1)] {
            bend(part, table, row * row_bytes);
            rig.run("verify many").expect(3);
            rig.run("export many verdicts").expect(3);
            let done = rig.run("run --config many.toml --stations 2 --out many").expect(0);
            assert!(done.err.contains("torn") && !done.err.contains("let go"), "{table}: {done:#?}");
            rig.run("verify many").expect(0);
        }
    }
    assert_same(&contents(&rig.path("many")), &expected);
    // Nothing is left to do; and the two shapes are not taken for one another.
    rig.run("run --config many.toml --stations 2 --out many").expect(0);
    let done = rig.run("run --config one.toml --stations 2 --out many").expect(1);
    assert!(done.err.contains("many is not the folder of a run") && done.err.contains("rotate_after_mb"), "{done:#?}");
    let done = rig.run("run --config many.toml --stations 2 --out one.h5").expect(1);
    assert!(done.err.contains("one.h5") && done.err.contains("it is a file"), "{done:#?}");
}

/// Catches files that are never full by their age, a scan that is cut in two, and a killed `store` that begins one anew.
#[test]
fn a_file_that_is_old_takes_no_new_scan_whoever_is_killed() {
    let rig = Rig::new();
    let paced = format!("{SCAN}\n[acquire]\ntaps_per_s = 80.0\n");
    rig.write("one.toml", &paced);
    rig.write("many.toml", &format!("{paced}\n[store]\nrotate_after_s = 1\n"));
    rig.run("run --config one.toml --out one.h5").expect(0);
    let mut line = rig.start("run --config many.toml --out many --json");
    for number in 1..=3 {
        let next = rig.path(&format!("many/many.000{number}.h5"));
        while !next.is_file() {
            assert_eq!(line.try_wait().unwrap(), None, "the line has ended without file {number}");
            sleep(Duration::from_millis(5));
        }
        signal(stage(&line, "store"), Signal::KILL);
    }
    let done = crate::rig::Done::from(line.wait_with_output().unwrap()).expect(0);
    assert!(!done.err.contains("panicked"), "{done:#?}");
    assert_same(&contents(&rig.path("many")), &contents(&rig.path("one.h5")));
    rig.run("verify many").expect(0);
    for part in files(&rig, "many") {
        let reader = Reader::open(&part).unwrap();
        for scan in reader.plan().scans() {
            let is_later = |&row: &u32| reader.lost_at(row) == Some(Lost::LaterFile);
            let later = scan.taps.iter().filter(|row| is_later(row)).count();
            assert!(later == 0 || later == scan.taps.len(), "a scan of {} is cut in two", part.display());
        }
    }
}
