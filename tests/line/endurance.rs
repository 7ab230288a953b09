//! Resources of a line that runs for months.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Child;

use crate::line::file_of;
use crate::sandbox::Sandbox;
use crate::sandbox::archives::names;
use crate::sandbox::running::Running;

/// Resources of a stage.
#[derive(Debug, Clone, Copy, Default)]
struct Takes {
    resident_kb: usize,
    descriptors: usize,
    threads: usize,
}

/// Resources of each process of the line, by name, and the line's files in shared memory.
fn taken(line: &Child) -> (BTreeMap<String, Takes>, BTreeSet<String>) {
    let children = fs::read_to_string(format!("/proc/{0}/task/{0}/children", line.id())).unwrap();
    let pids = children.split_whitespace().map(|pid| pid.parse().unwrap()).chain([line.id()]);
    let of = |pid: u32| {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
        let number = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key)).unwrap();
            line.trim().trim_end_matches(" kB").parse().unwrap()
        };
        let command = fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap();
        let name = command.split('\0').next().unwrap().rsplit('/').next().unwrap().to_owned();
        let descriptors = fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count();
        (name, Takes { resident_kb: number("VmRSS:"), descriptors, threads: number("Threads:") })
    };
    let taken: BTreeMap<String, Takes> = pids.map(of).collect();
    // The names of a line's shared memory begin with the name of its folder, which every stage is given.
    let maps = fs::read_to_string(format!("/proc/{}/maps", line.id())).unwrap();
    let name = maps.lines().find_map(|line| line.split_once("/dev/shm/").map(|(_, name)| name.to_owned())).unwrap();
    let prefix: String = name.splitn(3, '_').take(2).collect::<Vec<_>>().join("_");
    (taken, names(Path::new("/dev/shm")).into_iter().filter(|file| file.starts_with(&prefix)).collect())
}

/// Catches anything that grows with the number of casings: memory, file descriptors, threads, shared memory.
#[test]
fn two_hundred_casings_leave_no_trace() {
    /// Normal variation of resident memory, in kB: a casing's taps, discriminators and file, and the allocator.
    const WAVERS_KB: usize = 3_000;
    let sandbox = Sandbox::new();
    let station = |n: u32| format!("[[station]]\nnumber = {n}\nsource = \"simulated\"\n");
    let scan = "[scan]\nlocations = 6\nshoulders = 1\nconfirm = false\n";
    sandbox.write("plant.toml", &format!("{scan}[simulation]\nsample_count = 1024\n{}{}", station(1), station(2)));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 200");
    let mut verdicts = line.verdicts(60);
    let (before, shared_before) = taken(line.child());
    verdicts.extend(line.verdicts(130));
    let (after, shared_after) = taken(line.child());
    verdicts.extend(line.verdicts(10));
    let done = line.finish().expect(0);
    let more: Vec<&str> = done.out.lines().collect();
    // Casings that were under way at the end may have been closed too.
    assert!(more.len() <= 4, "{more:?}");
    let files: BTreeSet<PathBuf> = verdicts.iter().map(file_of).collect();
    assert_eq!(files.len(), 200);
    assert!(verdicts.iter().all(|verdict| verdict["archived"] == 7), "{:?}", verdicts[0]);
    assert!(before.len() >= 5 && before.keys().eq(after.keys()), "{before:?} {after:?}");
    for (name, was) in &before {
        let is = after[name];
        eprintln!("{name}: {was:?}, and 130 casings later {is:?}");
        assert!(is.resident_kb <= was.resident_kb + WAVERS_KB, "{name}: {was:?} {is:?}");
        // A file may be opened or closed just then.
        assert!(is.descriptors <= was.descriptors + 8, "{name}: {was:?} {is:?}");
        assert!(is.threads <= was.threads + 1, "{name}: {was:?} {is:?}");
    }
    assert_eq!(shared_before, shared_after);
    assert!(shared_before.len() > 4, "{shared_before:?}");
    assert!(sandbox.left().is_empty());
}
