//! Jobs of `reprocess`: the same bytes on every engine, and one result however often they are run.

use std::fs;
use std::process::Stdio;

use tapline_testing::program::Done;

use crate::cluster::{Cluster, Process};
use crate::sandbox::{CASINGS, Sandbox, TRUNCATED, committed, contents, tapline};

/// Catches results or a commit file that depend on the engine, on partitions, or on the order in which tasks end.
#[test]
fn a_job_leaves_the_same_bytes_on_every_engine() {
    let Some(sandbox) = Sandbox::new() else { return };
    sandbox.truncate_one();
    let cluster = Cluster::start(&sandbox, &tapline().unwrap());
    let job = ["reprocess", "in", "--from-samples", "--out"];
    let run = |more: &[&str]| sandbox.run(&[&job[..], more].concat()).expect(3);
    let done = run(&["local"]);
    assert!(done.err.contains(TRUNCATED) && done.err.contains("11 of 12 archives judged again"), "{}", done.err);
    run(&["cluster", "--engine", &cluster.engine, "--files-per-task", "2"]);
    let (local, remote) = (sandbox.only_job("local"), sandbox.only_job("cluster"));
    assert_eq!(local.file_name(), remote.file_name());
    let files = contents(&local);
    // Results, links to archives, and the commit file.
    assert_eq!(files.len(), CASINGS + CASINGS + 1 + 1);
    assert!(files == contents(&remote));

    let committed = committed(&local);
    assert_eq!(committed.rows.len(), CASINGS + 1);
    let [failed] = committed.failed().collect::<Vec<_>>()[..] else { panic!("{committed:?}") };
    let error = failed.error.as_deref().unwrap();
    assert!(error.contains("it is shorter than it says") && !error.contains(".work-"), "{error}");

    // The results stand in for their archives, wherever they are asked about.
    let sql = "SELECT count(DISTINCT file) FROM verdicts WHERE status = 'ok'";
    let folder = local.display().to_string();
    let asked = sandbox.run(&["sql", sql, &folder, "--results", "--format", "csv"]).expect(0);
    assert_eq!(asked.out.lines().last(), Some("11"));

    // Once more, on the other engine: nothing is done, and nothing changes.
    let before = contents(&sandbox.path("local"));
    let again = run(&["local", "--engine", &cluster.engine]);
    assert!(again.err.contains("was committed before"), "{}", again.err);
    assert!(!run(&["local", "--quiet"]).err.contains("was committed before"));
    assert!(before == contents(&sandbox.path("local")));
}

/// Catches a process for each archive, which learns the reference every time, and results that are lost with an archive that has none or
/// whose name another one has too.
#[test]
fn one_process_judges_the_archives_of_a_task() {
    let Some(sandbox) = Sandbox::new() else { return };
    sandbox.truncate_one();
    fs::copy(sandbox.path("in/2/SIM-0011.h5"), sandbox.path("in/1/SIM-0011.h5")).unwrap();
    let counted = sandbox.counting_tapline(0);
    let mut command = sandbox.command(&["reprocess", "in", "--out", "out", "--files-per-task", "13"]);
    Done::from(command.env("TAPLINE", &counted).output().unwrap()).expect(3);
    // One for all, and one that says what is wrong with the archive that was cut off.
    assert_eq!(fs::read_to_string(sandbox.path("runs")).unwrap(), "run\nrun\n");
    let committed = committed(&sandbox.only_job("out"));
    assert_eq!(committed.rows.len(), CASINGS + 2);
    assert_eq!(committed.failed().map(|row| row.file.as_str()).collect::<Vec<_>>(), [TRUNCATED]);
}

/// Catches a job that has failed and goes on with archives that are not there any more.
#[test]
fn a_job_that_has_failed_ends_soon() {
    let Some(sandbox) = Sandbox::new() else { return };
    // The process with the first archive is killed while another one works on the rest.
    let program = sandbox.tapline_after(&format!(
        "echo run >> '{}'; case \"$*\" in *SIM-0001*) sleep 1; kill -9 $$;; esac; sleep 2",
        sandbox.path("runs").display()
    ));
    let mut command = sandbox.command(&["reprocess", "in", "--out", "out", "--files-per-task", "6"]);
    let done = Done::from(command.env("TAPLINE", &program).output().unwrap()).expect(1);
    assert!(done.err.contains("signal: 9") && done.err.contains("nothing is committed"), "{}", done.err);
    // None for each archive that is gone with the job.
    assert!(fs::read_to_string(sandbox.path("runs")).unwrap().lines().count() <= 2);
}

/// Catches two clients that get in each other's way, or leave two results.
#[test]
fn two_runs_of_one_job_at_a_time_leave_one_result() {
    let Some(sandbox) = Sandbox::new() else { return };
    let slow = sandbox.slow_tapline(0.1);
    let start = || {
        let mut command = sandbox.command(&["reprocess", "in", "--out", "out"]);
        Process::start(command.env("TAPLINE", &slow).stdout(Stdio::null()).stderr(Stdio::null()))
    };
    let mut both = [start(), start()];
    assert_eq!(both.each_mut().map(Process::end), [Some(0), Some(0)]);
    assert_eq!(committed(&sandbox.only_job("out")).rows.len(), CASINGS);
}

#[test]
fn what_no_job_can_do_is_said_before_it_begins() {
    let Some(sandbox) = Sandbox::new() else { return };
    let refusal = |arguments: &[&str]| sandbox.run(&[&["reprocess", "in", "--out"], arguments].concat()).expect(1).err;
    assert!(refusal(&["in/out"]).contains("--out in/out lies in in"));
    assert!(refusal(&["out", "--config", "no.toml"]).contains("cannot read no.toml"));
    // What no archive can be judged with is reported with its line, and leaves no job.
    fs::write(sandbox.path("slip.toml"), "[fuse]\nindx = 1\n").unwrap();
    let err = refusal(&["out", "--config", "slip.toml"]);
    for words in ["none of 11 archives can be judged, and nothing is committed", "line 2", "did you mean \"index\"?"] {
        assert!(err.contains(words), "{words} is not in {err}");
    }
    let mut command = sandbox.command(&["reprocess", "in", "--out", "out"]);
    let done = Done::from(command.env("TAPLINE", "no-tapline").output().unwrap()).expect(1);
    assert!(done.err.contains("the program no-tapline is not there: set TAPLINE"), "{}", done.err);
    // An executor with another build of tapline would give other results.
    let cluster = Cluster::start(&sandbox, &sandbox.slow_tapline(0.0));
    let err = refusal(&["out", "--engine", &cluster.engine]);
    assert!(err.contains("every host needs the same build of tapline"), "{err}");
    assert_eq!(sandbox.names("out"), [".lock"]);
}
