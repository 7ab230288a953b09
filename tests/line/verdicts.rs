//! What happens with a verdict: it is printed, and a command of the plant is run.

use std::collections::BTreeSet;
use std::fs;
use std::io::{PipeReader, PipeWriter, Write as _, pipe};

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::line::{all_finished, slow_plant};
use crate::sandbox::Sandbox;
use crate::sandbox::running::{Running, lines_of, until};
use crate::sandbox::stages::{kill, signal, stage};

/// Catches a command that is run twice for a casing, or not at all, or without its data; and a command that fails and
/// ends something.
#[test]
fn a_command_is_run_at_each_verdict() {
    let sandbox = Sandbox::new();
    let ran = sandbox.path("ran.txt");
    let command = format!(
        "read -r line; echo \"$TAPLINE_CASING $TAPLINE_VERDICT $TAPLINE_STATION $TAPLINE_FILE $line\" >> {}; printf sorted >&2; exit 1",
        ran.display()
    );
    slow_plant(&sandbox, 2, 50.0, &format!("[line]\non_verdict = '''{command}'''\n"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 4");
    let verdicts = line.verdicts(4);
    let done = line.finish().expect(0);
    assert!(done.err.contains("on_verdict failed"), "{done:?}");
    assert!(done.err.lines().any(|line| line.ends_with("sorted")), "what a command says is logged: {done:?}");
    let passed = fs::read_to_string(ran).unwrap();
    assert_eq!(passed.lines().count(), 4, "{passed}");
    for (passed, verdict) in passed.lines().zip(&verdicts) {
        let mut words = passed.splitn(5, ' ');
        for key in ["casing", "verdict", "station", "file"] {
            assert_eq!(words.next().unwrap(), verdict[key].to_string().trim_matches('"'), "{passed}");
        }
        assert_eq!(serde_json::from_str::<Value>(words.next().unwrap()).unwrap(), *verdict);
    }
}

/// Catches a command that cannot run and is noticed only when the first verdict is lost to it.
#[test]
fn a_command_that_is_not_there_is_refused() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 1, 200.0, "[line]\non_verdict = \"/no/such/sort-casing now\"\n");
    for command in ["line --config plant.toml --out out", "config --check plant.toml"] {
        let done = sandbox.run(command).expect(1);
        assert!(done.err.contains("/no/such/sort-casing is not a program on this machine"), "{done:?}");
    }
}

/// Catches a run that takes the casings under way on a line for its own, and a line on the results of a run.
#[test]
fn a_line_and_a_run_do_not_share_a_folder() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 1, 1000.0, "");
    sandbox.run("line --config plant.toml --out line --casings 2").expect(0);
    sandbox.run("run --config plant.toml --stations 1 --out listed").expect(0);
    for (command, what) in [
        ("run --config plant.toml --stations 1 --out line", "line is the folder of a `tapline line`"),
        ("line --config plant.toml --out listed", "listed is the folder of a `tapline run`"),
    ] {
        let done = sandbox.run(command).expect(1);
        assert!(done.err.contains(what), "{done:?}");
    }
}

/// Catches a command that fails and that the status of the line says nothing of.
#[test]
fn a_command_that_fails_is_an_alarm() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 1, 200.0, "[line]\non_verdict = \"cat > /dev/null; false\"\n");
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    line.verdicts(2);
    until("the alarm", || sandbox.run("status --out out --json").out.contains("on_verdict failed"));
    line.interrupt().expect(0);
}

/// Catches a line that ends because nobody reads its verdicts any more, and verdicts that are lost then.
#[test]
fn a_line_whose_reader_has_gone_goes_on() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 2, 200.0, "");
    let mut child = sandbox.start("line --config plant.toml --out out --json");
    drop(child.stdout.take());
    let log = lines_of(child.stderr.take().unwrap());
    until("all casings have their files", || {
        sandbox.path("out").is_dir() && all_finished(&sandbox.path("out")).len() == 4
    });
    until("the alarm", || sandbox.run("status --out out --json").out.contains("could not be printed"));
    signal(i32::try_from(child.id()).unwrap(), Signal::INT);
    let ended = child.wait().unwrap();
    assert_eq!(ended.code(), Some(3), "{:#?}", log.iter().collect::<Vec<_>>());
    // With nobody there again it runs like before, and ends when it is asked to.
    let mut child = sandbox.start("line --config plant.toml --out out --json");
    drop(child.stdout.take());
    until("the line runs", || sandbox.run("status --out out --json").code == Some(0));
    signal(i32::try_from(child.id()).unwrap(), Signal::INT);
    assert_eq!(child.wait().unwrap().code(), Some(3));
    // The next start prints what nobody has read.
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let of = |verdict: &Value| verdict["casing"].as_str().unwrap().to_owned();
    let printed: BTreeSet<String> = line.verdicts(4).iter().map(of).collect();
    assert_eq!(printed.into_iter().collect::<Vec<_>>(), ["S1-1", "S1-2", "S2-1", "S2-2"]);
    line.interrupt();
}

/// Catches a line, or its command, that waits until somebody reads what it prints or logs, and verdicts that are lost then.
#[test]
fn a_line_goes_on_while_nobody_reads() {
    let sandbox = Sandbox::new();
    let ran = sandbox.path("ran.txt");
    let command = format!("yes sorted | head -n 6000 >&2; echo $TAPLINE_ID >> {}", ran.display());
    slow_plant(&sandbox, 2, 200.0, &format!("[line]\non_verdict = '''{command}'''\n"));
    let [(unread, out), (unread_log, log)] = [full_pipe(), full_pipe()];
    let arguments = "line --config plant.toml --out out --json -vv";
    let mut child = sandbox.command(arguments).stdout(out).stderr(log).spawn().unwrap();
    until("the line runs", || sandbox.run("status --out out --json").code == Some(0));
    kill(stage(&child, "fuse"), "fuse");
    until("all casings have their files", || all_finished(&sandbox.path("out")).len() == 4);
    until("the command is run", || fs::read_to_string(&ran).is_ok_and(|text| text.lines().count() == 4));
    let waiting = json!({ "name": "stdout", "waiting": 4, "trouble": null });
    until("they wait to be printed", || sandbox.run("status --out out --json").json(0)["receivers"][1] == waiting);
    // Four times 6000 lines were too many for the queue of the log.
    let (log, mut count) = (lines_of(unread_log), 0);
    until("the log says what was dropped", || {
        let counts = log.try_iter().filter_map(|line| line.split_once("dropped: ")?.1.parse::<u64>().ok());
        count += counts.sum::<u64>();
        count > 0
    });
    assert!((16_000..24_000).contains(&count), "{count}");
    signal(i32::try_from(child.id()).unwrap(), Signal::INT);
    assert_eq!(child.wait().unwrap().code(), Some(3));
    drop(unread);
    slow_plant(&sandbox, 2, 200.0, "");
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let ids: BTreeSet<String> = line.verdicts(4).iter().map(|verdict| verdict["id"].to_string()).collect();
    assert_eq!(ids.len(), 4, "{ids:?}");
    line.interrupt().expect(0);
}

/// A pipe into which nothing more goes.
fn full_pipe() -> (PipeReader, PipeWriter) {
    let (read, mut write) = pipe().unwrap();
    let flags = fcntl_getfl(&write).unwrap();
    fcntl_setfl(&write, flags | OFlags::NONBLOCK).unwrap();
    for line in [[b'\n'; 4096].as_slice(), b"\n"] {
        while write.write(line).is_ok() {}
    }
    fcntl_setfl(&write, flags).unwrap();
    (read, write)
}
