//! A line that lacks a resource ends at once with one error; with the amount that the error asks for, it runs.

use std::fs;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::sandbox::{Sandbox, short_scan};
use tapline_testing::program::Done;

/// Time within which a line that cannot start must end.
const AT_ONCE: Duration = Duration::from_secs(10);

fn limited(sandbox: &Sandbox, limit: &str, out: &str) -> Command {
    sandbox.write("scan.toml", &format!("{}[acquire]\ntaps_per_s = 20.0\n", short_scan(24)));
    let line = sandbox.command(&format!("run --config scan.toml --stations 2 --out {out}"));
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("ulimit {limit} && exec \"$0\" \"$@\"")]).arg(line.get_program()).args(line.get_args());
    for (name, value) in line.get_envs() {
        if let Some(value) = value {
            shell.env(name, value);
        }
    }
    shell.current_dir(line.get_current_dir().unwrap()).process_group(0);
    shell.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    shell
}

/// Waits for the end of the process, and kills it if it does not end.
fn finish(mut child: Child, patience: Duration) -> Done {
    let since = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if since.elapsed() > patience {
            child.kill().unwrap();
            panic!("it hangs: {:?}", Done::from(child.wait_with_output().unwrap()));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Done::from(child.wait_with_output().unwrap())
}

/// The amount that the error says is needed, after `what`: in `12 of 34 needed`, 34.
fn needed<'a>(done: &'a Done, what: &str) -> &'a str {
    assert!(done.code == Some(1) && done.err.lines().count() == 1, "{done:?}");
    let (_, said) = done.err.split_once(what).unwrap_or_else(|| panic!("{what:?} is not said: {done:?}"));
    said.split_once(" of ").unwrap().1.split([' ', ';']).next().unwrap()
}

/// Catches limits of open files at which a line hangs without an error, and an error that asks for too little.
#[test]
fn too_few_descriptors_are_an_error_that_asks_for_enough() {
    let sandbox = Sandbox::new();
    let mut enough = String::new();
    for few in [40, 64, 72] {
        let done = finish(limited(&sandbox, &format!("-n {few}"), "few").spawn().unwrap(), AT_ONCE);
        enough = needed(&done, "open files of a process: ").to_owned();
    }
    let line = limited(&sandbox, &format!("-n {enough}"), "enough").spawn().unwrap();
    let (mut most, since) = (0, Instant::now());
    while since.elapsed() < Duration::from_secs(2) {
        most = most.max(processes_of(&line).into_iter().filter_map(descriptors).max().unwrap_or(0));
        std::thread::sleep(Duration::from_millis(10));
    }
    finish(line, Duration::from_secs(60)).expect(0);
    let enough: usize = enough.parse().unwrap();
    eprintln!("of {enough} descriptors {most} were used");
    assert!((8..enough).contains(&most), "{most} of {enough}");
}

/// The processes of the line and its stages.
fn processes_of(line: &Child) -> Vec<u32> {
    let children = fs::read_to_string(format!("/proc/{0}/task/{0}/children", line.id())).unwrap_or_default();
    children.split_whitespace().filter_map(|pid| pid.parse().ok()).chain([line.id()]).collect()
}

fn descriptors(pid: u32) -> Option<usize> {
    Some(fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count())
}

/// Catches a stage that cannot be identified in a list of processes.
#[test]
fn processes_are_named_after_their_stages() {
    let sandbox = Sandbox::new();
    let line = limited(&sandbox, "-c 0", "named").spawn().unwrap();
    let mut names = Vec::new();
    let since = Instant::now();
    while names.len() < 6 && since.elapsed() < AT_ONCE {
        std::thread::sleep(Duration::from_millis(20));
        let comm = |pid| fs::read_to_string(format!("/proc/{pid}/comm")).ok().map(|name| name.trim().to_owned());
        names = processes_of(&line).into_iter().filter_map(comm).filter(|name| name.starts_with("tapline")).collect();
    }
    names.sort_unstable();
    let expected = ["acquire", "acquire", "fuse", "line", "process", "store"].map(|stage| format!("tapline-{stage}"));
    let stage = crate::sandbox::stages::stage(&line, "store");
    let command = fs::read_to_string(format!("/proc/{stage}/cmdline")).unwrap();
    assert!(command.starts_with("tapline-store\0stage\0store\0"), "{command}");
    assert_eq!(fs::read_link(format!("/proc/{stage}/cwd")).unwrap(), std::path::Path::new("/"));
    finish(line, Duration::from_secs(60)).expect(0);
    assert_eq!(names, expected);
}
