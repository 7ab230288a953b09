//! What the tests of several crates share, and what to do where a machine lacks something that a test needs.
//!
//! A test that cannot be run on this machine prints why and passes; with `TAPLINE_REQUIRE_ALL=1`, as in `.ci/run`, it fails.

pub mod disk;
pub mod documents;
pub mod mutated;
pub mod network;
pub mod noise;
pub mod program;
pub mod waiting;

use std::env;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Prints that a test, or a part of it, cannot be run here, and why.
///
/// # Panics
/// If `TAPLINE_REQUIRE_ALL` is 1.
pub fn skip(why: &str) {
    assert!(env::var_os("TAPLINE_REQUIRE_ALL").is_none_or(|all| all != "1"), "not skipped, as all is required: {why}");
    eprintln!("skipped: {why}");
}

/// The file or folder `name` of the shared test data; `None`, and a skip, where it is not there.
///
/// The data are in the folder `data` of `../shared`, or of the folder that `TAPLINE_SHARED` names; with the
/// value `none` this machine has none, which is no failure.
pub fn shared(name: &str) -> Option<PathBuf> {
    let folder = env::var_os("TAPLINE_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    let path = folder.join("data").join(name);
    if path.exists() {
        return Some(path);
    }
    match folder.as_os_str() == "none" {
        true => eprintln!("skipped: no shared data here, by TAPLINE_SHARED"),
        false => skip(&format!("{} is not here (set TAPLINE_SHARED)", path.display())),
    }
    None
}

/// A Python that has `modules`; `None`, and a skip, where there is none.
///
/// It is the program that `TAPLINE_PYTHON` names, or else `python3`.
pub fn python_with(modules: &str) -> Option<OsString> {
    python_that(&format!("import {modules}"))
}

/// A Python in which the lines of `does` end without an error; otherwise as [`python_with`].
pub fn python_that(does: &str) -> Option<OsString> {
    let named = env::var_os("TAPLINE_PYTHON").into_iter();
    let can =
        |python: &OsString| Command::new(python).args(["-c", does]).output().is_ok_and(|out| out.status.success());
    let found = named.chain(["python3", "/usr/bin/python3"].map(OsString::from)).find(can);
    if found.is_none() {
        skip(&format!("no Python here can do this (set TAPLINE_PYTHON; tests/python.txt has what it takes): {does}"));
    }
    found
}
