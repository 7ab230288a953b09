//! The program of the page for Dask, one of whose workers is killed.

use std::collections::BTreeSet;
use std::fs;
use std::process::{Command, Stdio};

use tapline_store::Reader;
use tapline_testing::documents::{docs, text};
use tapline_testing::python_with;
use tapline_testing::waiting::until;

use crate::cluster::{Process, signal};
use crate::sandbox::{CASINGS, Sandbox};

/// The page's block of Python.
fn program() -> String {
    let page = text(&docs("query.md"));
    let (_, rest) = page.split_once("```python\n").unwrap();
    rest.split_once("```").unwrap().0.to_owned()
}

/// The workers of the program with that process: those that Python spawned.
fn workers(parent: u32) -> Vec<u32> {
    let processes = fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    let is_worker = |process: &u32| {
        let read = |name| fs::read_to_string(format!("/proc/{process}/{name}")).unwrap_or_default();
        // The parent is the second field after the name in brackets.
        let status = read("stat");
        let of = status.rsplit_once(") ").and_then(|(_, rest)| rest.split(' ').nth(1)?.parse().ok());
        of == Some(parent) && read("cmdline").contains("spawn_main")
    };
    processes.filter(is_worker).collect()
}

/// Catches a page whose program does not run, and archives that are lost with a worker.
#[test]
fn the_program_of_the_page_survives_a_killed_worker() {
    let Some(python) = python_with("dask.distributed") else { return };
    let Some(sandbox) = Sandbox::new() else { return };
    sandbox.truncate_one();
    let folder = sandbox.slow_tapline(0.3).parent().unwrap().display().to_string();
    fs::write(sandbox.path("again.py"), program()).unwrap();
    let path = format!("{folder}:{}", std::env::var("PATH").unwrap());
    let output = fs::File::create(sandbox.path("printed")).unwrap();
    let mut command = Command::new(python);
    command.args(["again.py", "in"]).env("PATH", path).current_dir(sandbox.path("."));
    let mut job = Process::start(command.stdout(output).stderr(Stdio::null()));
    let results = || {
        let all = ["in/1", "in/2"].map(|day| sandbox.names(day).into_iter().map(move |name| format!("{day}/{name}")));
        let is_results = |name: &String| name.matches('.').count() == 2;
        all.into_iter().flatten().filter(is_results).collect::<BTreeSet<_>>()
    };
    until("two archives are judged", || results().len() >= 2);
    signal(workers(job.id())[0], "KILL");
    assert_eq!(job.end(), Some(0));
    let printed = fs::read_to_string(sandbox.path("printed")).unwrap();
    assert!(
        printed.contains("12 archives, 1 not judged") && printed.contains("it is shorter than it says"),
        "{printed}"
    );
    assert_eq!(results().len(), CASINGS);
    for name in results() {
        assert!(Reader::open(sandbox.path(&name)).unwrap().is_results(), "{name}");
    }
}
