//! Existing files stay, unless `--force` is given; and an interrupted verb leaves nothing half-written.

use std::fs;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::command_line::scanned;
use crate::sandbox::running::PATIENCE;
use crate::sandbox::stages::signal;

/// Catches an output that is overwritten without having been asked for, and an error that does not name it.
#[test]
fn nothing_is_overwritten_unless_it_is_asked_for() {
    let sandbox = scanned(1);
    for (command, out) in [
        ("export x verdicts --out v.csv", "v.csv"),
        ("reference x --shoulder SIM-0002/1 --shoulder SIM-0002/2 --out r.json", "r.json"),
        ("report x --out pages", "pages"),
        ("calibrate state --channel force --full-scale-v 5 --sensitivity-mv 22.5 --out k.toml", "k.toml"),
        ("man manual", "manual"),
    ] {
        sandbox.run(command).expect(0);
        let before = content(&sandbox.path(out));
        let refused = sandbox.run(command).expect(1);
        assert!(refused.err.contains(out) && refused.err.contains("--force"), "{command}: {refused:?}");
        assert_eq!(content(&sandbox.path(out)), before, "{command}");
        sandbox.run(&format!("{command} --force")).expect(0);
    }
    // Archives and tap sets are never replaced.
    sandbox.run("export x taps --out taps").expect(0);
    assert!(sandbox.run("export x taps --out taps").expect(1).err.contains("taps"));
    sandbox.run("repack x --codec zstd --out y").expect(0);
    let before = content(&sandbox.path("y"));
    // The same copies are there already; those by another codec are others.
    assert!(sandbox.run("repack x --codec zstd --out y").expect(0).err.contains("SIM-0001.h5 is there already"));
    assert!(sandbox.run("repack x --codec lz4 --out y").expect(1).err.contains("y/SIM-0001.h5"));
    assert_eq!(content(&sandbox.path("y")), before);
    assert!(sandbox.run("export x taps --out taps --force").expect(1).err.contains("new or empty"));
}

/// The names and texts of the files at `path`, or of the one that is there.
fn content(path: &Path) -> Vec<(String, Vec<u8>)> {
    let files = if path.is_dir() {
        fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect()
    } else {
        vec![path.to_owned()]
    };
    let mut files: Vec<_> = files.iter().map(|p| (p.display().to_string(), fs::read(p).unwrap())).collect();
    files.sort();
    files
}

/// Catches a draft that stays when a verb is asked to end. Each verb that writes is ended later and later, twice
/// as late each time, until it ends by itself before the signal comes.
#[test]
fn nothing_half_written_stays_after_a_signal() {
    let sandbox = scanned(8);
    for command in [
        "export x discriminators --out v.csv", "export x taps --out taps", "export x taps --format mat --out mats",
        "repack x --codec gzip --out y", "report x --out pages", "reference x --labelled --out r.json",
        "reprocess x --from-samples --jobs 1",
    ] {
        let (mut ended, mut wait) = (0, Duration::from_millis(2));
        let since = Instant::now();
        loop {
            let child = sandbox.start(command);
            std::thread::sleep(wait);
            signal(i32::try_from(child.id()).unwrap(), Signal::TERM);
            let status = child.wait_with_output().unwrap();
            let drafts = drafts(&sandbox.path("."));
            assert!(drafts.is_empty(), "{command} after {wait:?}: {drafts:?}");
            match status.status.signal() {
                Some(number) => assert_eq!(number, Signal::TERM.as_raw(), "{command}"),
                None => {
                    assert_eq!(status.status.code(), Some(0), "{command}: {}", String::from_utf8_lossy(&status.stderr));
                    break;
                }
            }
            ended += 1;
            wait *= 2;
            for out in ["taps", "mats", "pages", "y"] {
                drop(fs::remove_dir_all(sandbox.path(out)));
            }
            for out in ["v.csv", "r.json"] {
                drop(fs::remove_file(sandbox.path(out)));
            }
            assert!(since.elapsed() < 2 * PATIENCE, "{command} does not end");
        }
        assert!(ended > 2, "{command} was ended {ended} times");
    }
    sandbox.run("verify x").expect(0);
}

/// Files and folders below `folder` that are drafts.
fn drafts(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.extension().is_some_and(|ending| ending == "new") {
            found.push(path.display().to_string());
        } else if path.is_dir() {
            found.extend(drafts(&path));
        }
    }
    found
}
