//! The line waits while a disk is full or read-only.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use rustix::process::Signal;
use tapline_store::Reader;
use tapline_testing::disk::Disk;
use tapline_wire::TapState;

use crate::faults::disk::{assert_whole, quick, start_on_disk, undisturbed};
use crate::sandbox::Sandbox;
use crate::sandbox::archives::{casings, finished};
use crate::sandbox::running::Running;
use crate::sandbox::stages::{signal, stage};

/// Starts the run and fills the disk; returns when that is logged.
fn start_and_fill(sandbox: &Sandbox, disk: &Disk) -> (Running, PathBuf, PathBuf) {
    let (mut line, file) = start_on_disk(sandbox);
    let ballast = disk.fill(200_000);
    line.wait_for_log(&["ERROR", "disk/run/open/SIM-0001.", "No space left", "make room"]);
    (line, ballast, file)
}

/// Catches a tap that is lost, an archive that stays damaged, and a line that gives up when the disk is full for a
/// while.
#[test]
fn a_line_waits_for_room_on_a_full_disk() {
    let (sandbox, expected) = undisturbed();
    let Some(disk) = Disk::at(&sandbox.path("disk"), "64m") else { return };
    let (mut line, ballast, file) = start_and_fill(&sandbox, &disk);
    // The file is closed meanwhile, so that others can read it; exit code 3 is for the missing taps.
    sandbox.run(&format!("verify {}", file.display())).expect(3);
    fs::remove_file(ballast).unwrap();
    line.wait_for_log(&["WARN", "written again"]);
    let summary = line.finish().json(0);
    assert!(summary["pace"]["restarts"] == 0 && summary["is_complete"] == true, "{summary}");
    assert_whole(&sandbox, &expected);
}

/// Catches a change of cause that is not logged, and a read-only disk that ends the line or is written to.
#[test]
fn a_line_waits_for_a_read_only_disk() {
    let (sandbox, expected) = undisturbed();
    let Some(disk) = Disk::at(&sandbox.path("disk"), "64m") else { return };
    let (mut line, _, _) = start_and_fill(&sandbox, &disk);
    // No file is open for writing there, or the system would refuse; and if there were room, the archive would be
    // written at once.
    disk.remount("ro");
    disk.remount("ro,size=128m");
    line.wait_for_log(&["ERROR", "disk/run/open/SIM-0001.", "Read-only", "mount that disk"]);
    disk.remount("rw");
    line.wait_for_log(&["WARN", "written again"]);
    line.finish().expect(0);
    assert_whole(&sandbox, &expected);
}

/// Catches a line on a full disk that cannot be stopped, loses what was safe, or reports success.
#[test]
fn a_line_on_a_full_disk_ends_in_order() {
    let (sandbox, expected) = undisturbed();
    let Some(disk) = Disk::at(&sandbox.path("disk"), "64m") else { return };
    let (line, ballast, file) = start_and_fill(&sandbox, &disk);
    let done = line.interrupt();
    let summary = done.json(3);
    assert!(summary["unfinished"] == 1 && summary["is_complete"] == false, "{summary}");
    assert!(!done.err.contains("is killed"), "{done:#?}");
    sandbox.run(&format!("verify {}", file.display())).expect(3);
    let safe = Reader::open_unfinished(&file).unwrap().ledger().count(TapState::Archived);
    fs::remove_file(ballast).unwrap();
    let summary = sandbox.run("run --config paced.toml --out disk/run --json").json(0);
    assert_eq!(summary["pace"]["taps"], 82 - safe, "what was safe is gone on with: {summary}");
    assert_whole(&sandbox, &expected);
}

/// Waits until the status of the line shows a trouble that has `text`, or none.
fn wait_for_trouble(sandbox: &Sandbox, line: &mut Running, text: Option<&str>) {
    loop {
        line.assert_runs();
        let status = sandbox.run("status --out disk/run --json").json(0);
        let troubles = status["troubles"].as_array().unwrap();
        if text.map_or(troubles.is_empty(), |text| troubles.iter().any(|trouble| trouble.to_string().contains(text))) {
            return;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Catches a line that gives up, or never tries again, if a full disk has no room for its next file, and a status that does not
/// say so.
#[test]
fn a_full_disk_holds_up_the_next_file() {
    let sandbox = Sandbox::new();
    let tyres: String = (1..=3).map(|k| format!("[[scan.tyre]]\nserial = \"T{k}\"\n")).collect();
    sandbox.write("quick.toml", &format!("{}{tyres}", quick()));
    sandbox.write("paced.toml", &format!("{}{tyres}[acquire]\ntaps_per_s = 60.0\n", quick()));
    sandbox.run("run --config quick.toml --out quick").expect(0);
    let expected = casings(&sandbox.path("quick"));
    let Some(disk) = Disk::at(&sandbox.path("disk"), "64m") else { return };
    let mut line = Running::start(&sandbox, "run --config paced.toml --out disk/run --json");
    while !sandbox.path("disk/run/T1.h5").is_file() {
        line.assert_runs();
        std::thread::sleep(Duration::from_millis(1));
    }
    let ballast = disk.fill(300_000);
    line.wait_for_log(&["ERROR", "disk/run/open/T2.", "No space left", "make room"]);
    wait_for_trouble(&sandbox, &mut line, Some("No space left"));
    fs::remove_file(ballast).unwrap();
    wait_for_trouble(&sandbox, &mut line, None);
    assert_eq!(line.finish().json(0)["is_complete"], true);
    assert_eq!(expected.len(), 3);
    assert_whole(&sandbox, &expected);
}

/// Catches a `store` that is killed on a full disk and does not continue to wait.
#[test]
fn store_is_killed_on_a_full_disk() {
    let (sandbox, expected) = undisturbed();
    let Some(disk) = Disk::at(&sandbox.path("disk"), "64m") else { return };
    let (mut line, ballast, _) = start_and_fill(&sandbox, &disk);
    signal(stage(line.child(), "store"), Signal::KILL);
    line.wait_for_log(&["store", "was killed"]);
    line.wait_for_log(&["ERROR", "No space left"]);
    fs::remove_file(ballast).unwrap();
    line.finish().expect(0);
    assert_whole(&sandbox, &expected);
}

/// Catches a casing that cannot be begun and is not reported clearly, or that is half begun and left there.
#[test]
fn places_where_no_archive_can_begin() {
    let (sandbox, expected) = undisturbed();
    let Some(disk) = Disk::at(&sandbox.path("disk"), "16m") else { return };
    let ballast = disk.fill(60_000);
    let mut line = Running::start(&sandbox, "run --config paced.toml --out disk/run --json");
    line.wait_for_log(&["ERROR", "disk/run/open/SIM-0001.", "No space left", "make room"]);
    assert!(finished(&sandbox.path("disk/run")).is_empty());
    fs::remove_file(ballast).unwrap();
    assert_eq!(line.finish().json(0)["pace"]["restarts"], 0);
    assert_whole(&sandbox, &expected);
    fs::remove_dir_all(sandbox.path("disk/run")).unwrap();
    disk.remount("ro");
    let done = sandbox.run("run --config paced.toml --out disk/run").expect(1);
    assert!(done.err.contains("disk/run") && done.err.contains("Read-only"), "{done:#?}");
}
