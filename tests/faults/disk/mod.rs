//! No disk fault loses a tap: the disk is full, read-only, gone or slow, or the file on it is truncated, moved or
//! replaced.

mod files;
mod full;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use crate::sandbox::archives::{Contents, assert_same_casings, casings, finished, names};
use crate::sandbox::running::Running;
use crate::sandbox::{Sandbox, short_scan};

/// A casing of 82 taps.
fn quick() -> String {
    short_scan(40)
}

/// The same scan at a pace that takes at least a second, so that the disk can be changed meanwhile.
fn paced() -> String {
    format!("{}[acquire]\ntaps_per_s = 60.0\n", quick())
}

/// A sandbox with both scans, and the casings that an undisturbed run makes.
fn undisturbed() -> (Sandbox, BTreeMap<String, Contents>) {
    let sandbox = Sandbox::new();
    sandbox.write("quick.toml", &quick());
    sandbox.write("paced.toml", &paced());
    sandbox.run("run --config quick.toml --out quick").expect(0);
    let expected = casings(&sandbox.path("quick"));
    (sandbox, expected)
}

/// Checks that every file is complete and in its place, that nothing else is left, and that the contents are those of
/// an undisturbed run.
fn assert_whole(sandbox: &Sandbox, expected: &BTreeMap<String, Contents>) {
    let out = sandbox.path("disk/run");
    for file in finished(&out).values() {
        sandbox.run(&format!("verify {}", file.display())).expect(0);
    }
    assert_same_casings(&casings(&out), expected);
    assert_eq!(names(&out.join("open")), [""; 0]);
    let ours = |name: &str| name.ends_with(".h5") || ["open", "run.toml", "left"].contains(&name);
    let beside: Vec<String> = names(&out).into_iter().filter(|name| !ours(name)).collect();
    assert!(beside.is_empty(), "{beside:?}");
}

/// Starts a run into `disk/run`, and waits until the first taps of its first casing are on the disk; returns the file
/// under way.
fn start_on_disk(sandbox: &Sandbox) -> (Running, PathBuf) {
    let mut line = Running::start(sandbox, "run --config paced.toml --out disk/run --json");
    let open = sandbox.path("disk/run/open");
    let mut first_bytes = None;
    loop {
        line.assert_runs();
        if open.is_dir()
            && let Some(file) = finished(&open).into_values().next()
            && let Ok(there) = fs::metadata(&file)
            && there.len() > *first_bytes.get_or_insert(there.len()) + 100_000
        {
            return (line, file);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}
