//! A file under way that is removed, moved, truncated or replaced, and a disk that hangs.

use std::fs::{self, File, OpenOptions};
use std::os::unix::fs::symlink;
use std::time::Duration;

use rustix::process::Signal;

use crate::faults::disk::{assert_whole, paced, start_on_disk, undisturbed};
use crate::sandbox::Sandbox;
use crate::sandbox::archives::{finished, under_way};
use crate::sandbox::stages::{signal, stage};

/// Catches taps that are lost with a file that someone removes while it is written, alone or with its folder.
#[test]
fn a_removed_archive_is_written_again() {
    let (sandbox, expected) = undisturbed();
    for is_folder in [false, true] {
        let (mut line, file) = start_on_disk(&sandbox);
        if is_folder {
            fs::remove_dir_all(sandbox.path("disk")).unwrap();
            line.wait_for_log(&["ERROR", "disk/run/open/SIM-0001.", "was removed"]);
            fs::create_dir_all(sandbox.path("disk/run/open")).unwrap();
        } else {
            fs::remove_file(file).unwrap();
            line.wait_for_log(&["ERROR", "disk/run/open/SIM-0001.", "was removed"]);
        }
        line.wait_for_log(&["WARN", "written again"]);
        line.finish().expect(0);
        assert_whole(&sandbox, &expected);
        fs::remove_dir_all(sandbox.path("disk")).unwrap();
    }
}

/// Catches a line that reports success although its file is gone.
#[test]
fn a_line_ended_without_its_archive_has_failed() {
    let sandbox = Sandbox::new();
    sandbox.write("paced.toml", &paced());
    let (mut line, _) = start_on_disk(&sandbox);
    fs::remove_dir_all(sandbox.path("disk")).unwrap();
    line.wait_for_log(&["ERROR", "disk/run/open/SIM-0001.", "was removed"]);
    let done = line.interrupt().expect(1);
    assert!(done.err.contains("disk/run"), "{done:#?}");
}

/// Catches a file that is moved away, or replaced by another, without a report.
#[test]
fn a_moved_or_replaced_archive_is_waited_for() {
    let (sandbox, expected) = undisturbed();
    let (mut line, file) = start_on_disk(&sandbox);
    let name = file.file_name().unwrap().to_str().unwrap();
    let moved = sandbox.path("elsewhere/run/open").join(name);
    fs::rename(sandbox.path("disk"), sandbox.path("elsewhere")).unwrap();
    line.wait_for_log(&["ERROR", &format!("{name} was moved"), &format!("elsewhere/run/open/{name}"), "move it back"]);
    fs::create_dir_all(sandbox.path("disk/run/open")).unwrap();
    fs::write(&file, "another").unwrap();
    line.wait_for_log(&["ERROR", &format!("{name} is another file"), &format!("elsewhere/run/open/{name}")]);
    assert_eq!(fs::read_to_string(&file).unwrap(), "another");
    fs::rename(moved, &file).unwrap();
    line.wait_for_log(&["WARN", "written again"]);
    line.finish().expect(0);
    assert_whole(&sandbox, &expected);
}

/// Catches a truncated file that is written to, or continued by the next run; also if it has its old length again when
/// it is examined.
#[test]
fn a_line_does_not_continue_a_cut_archive() {
    for has_grown_again in [false, true] {
        let (sandbox, expected) = undisturbed();
        let (mut line, path) = start_on_disk(&sandbox);
        // After a while some taps are archived, and their loss is noticed whatever the length is.
        std::thread::sleep(Duration::from_millis(if has_grown_again { 300 } else { 0 }));
        let file = OpenOptions::new().write(true).open(&path).unwrap();
        let bytes = file.metadata().unwrap().len();
        file.set_len(20_000).unwrap();
        if has_grown_again {
            file.set_len(2 * bytes).unwrap();
        }
        // It is noticed by its length, or by what is missing in it.
        line.wait_for_log(&["ERROR", "disk/run/open/SIM-0001.", "the line waits"]);
        line.interrupt().expect(1);
        for (verb, codes) in [("verify", [1, 3]), ("report", [1, 1])] {
            let done = sandbox.run(&format!("{verb} {}", path.display()));
            assert!(done.code.is_some_and(|code| codes.contains(&code)), "{done:#?}");
            let is_said = ["UNREADABLE", "DAMAGED", "INCOMPLETE"].iter().any(|state| done.out.contains(state));
            assert!(done.err.contains("SIM-0001.") || is_said, "{done:#?}");
        }
        // The next run puts it aside, logs that, and makes all taps of the casing again.
        let done = sandbox.run("run --config paced.toml --out disk/run").expect(0);
        assert!(done.err.contains("put aside") && done.err.contains("disk/run/left/SIM-0001."), "{done:#?}");
        assert_eq!(finished(&sandbox.path("disk/run/left")).len(), 1);
        assert_whole(&sandbox, &expected);
    }
}

/// Catches a line that starts `store` for ever because a sector of a file under way cannot be read.
#[test]
fn a_line_does_not_continue_an_archive_that_cannot_be_read() {
    let (sandbox, expected) = undisturbed();
    let (line, path) = start_on_disk(&sandbox);
    line.interrupt().expect(3);
    // Its beginning cannot be read: the system says EIO, as of a bad sector.
    fs::remove_file(&path).unwrap();
    symlink("/proc/self/mem", &path).unwrap();
    let done = sandbox.run("run --config paced.toml --out disk/run").expect(0);
    assert!(done.err.contains("Input/output error") && done.err.contains("disk/run/left/SIM-0001."), "{done:#?}");
    assert_whole(&sandbox, &expected);
}

/// Catches a line that loses taps, or reports nothing, while `store` hangs as on a disk that does not respond.
#[test]
fn a_store_that_hangs_is_reported_and_waited_for() {
    let (sandbox, expected) = undisturbed();
    let (mut line, _) = start_on_disk(&sandbox);
    let store = stage(line.child(), "store");
    signal(store, Signal::STOP);
    line.wait_for_log(&["ERROR", "store does not answer", "the line waits"]);
    signal(store, Signal::CONT);
    line.wait_for_log(&["WARN", "store answers again"]);
    let summary = line.finish().json(0);
    assert_eq!(summary["pace"]["restarts"], 0);
    assert_whole(&sandbox, &expected);
}

/// Catches a second writer that opens a file in spite of the line's lock.
#[test]
fn a_second_program_on_the_file_is_refused_by_name() {
    let (sandbox, expected) = undisturbed();
    let (line, path) = start_on_disk(&sandbox);
    line.interrupt().expect(3);
    assert_eq!(under_way(&sandbox.path("disk/run")), [path.as_path()]);
    let file = File::open(&path).unwrap();
    file.lock().unwrap();
    let done = sandbox.run("run --config paced.toml --out disk/run").expect(1);
    assert!(done.err.contains("SIM-0001.") && done.err.contains("is in use"), "{done:#?}");
    file.unlock().unwrap();
    sandbox.run("run --config paced.toml --out disk/run").expect(0);
    assert_whole(&sandbox, &expected);
}
