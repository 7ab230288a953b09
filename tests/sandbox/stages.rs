//! The stages of a running line: their processes, and signals to them.

use std::fs;
use std::process::Child;
use std::time::{Duration, Instant};

use rustix::process::Signal;

/// The process of the stage `name` (`store`, `acquire-0`) of the line `parent`; waits for it.
pub(crate) fn stage(parent: &Child, name: &str) -> i32 {
    let deadline = Instant::now() + Duration::from_secs(10);
    while Instant::now() < deadline {
        if let Some(pid) = stage_now(parent, name) {
            return pid;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no stage {name:?}");
}

/// The process of the stage `name` of the line `parent`, if it exists now.
pub(crate) fn stage_now(parent: &Child, name: &str) -> Option<i32> {
    fs::read_dir("/proc").unwrap().flatten().find_map(|entry| {
        let pid: i32 = entry.file_name().to_str()?.parse().ok()?;
        let stat = fs::read_to_string(entry.path().join("stat")).ok()?;
        let parent_pid: u32 = stat.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse().ok()?;
        let line = fs::read_to_string(entry.path().join("cmdline")).ok()?.replace('\0', " ");
        let arguments = line.split_once(' ')?.1;
        (parent_pid == parent.id() && arguments.starts_with(&format!("stage {name} "))).then_some(pid)
    })
}

/// Kills the process `pid` of the stage `name`, which may have ended by itself.
pub(crate) fn kill(pid: i32, name: &str) {
    if let Err(error) = rustix::process::kill_process(rustix::process::Pid::from_raw(pid).unwrap(), Signal::KILL) {
        eprintln!("{name} was gone already: {error}");
    }
}

/// Sends `signal` to a process, which must exist.
pub(crate) fn signal(pid: i32, signal: Signal) {
    rustix::process::kill_process(rustix::process::Pid::from_raw(pid).unwrap(), signal).unwrap();
}
