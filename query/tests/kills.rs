//! Processes that are killed in the middle of a job.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use tapline_testing::program::Done;
use tapline_testing::waiting::until;

use crate::cluster::{Cluster, Process};
use crate::sandbox::{CASINGS, Sandbox, committed, contents};

/// Seconds that an archive takes: long enough to kill something meanwhile.
pub(crate) const SLEEP_S: f64 = 0.3;

/// Begins the job on the cluster.
pub(crate) fn begin(sandbox: &Sandbox, cluster: &Cluster, tapline: &Path, out: &str) -> Process {
    let arguments =
        ["reprocess", "in", "--out", out, "--from-samples", "--files-per-task", "1", "--engine", &cluster.engine];
    let mut command = sandbox.command(&arguments);
    let errors = fs::File::create(sandbox.path("errors")).unwrap();
    Process::start(command.env("TAPLINE", tapline).stdout(Stdio::null()).stderr(errors))
}

/// Waits until so many archives are judged, but not all.
pub(crate) fn wait_for_results(sandbox: &Sandbox, out: &str, count: usize) {
    let is_result = |path: &&std::path::PathBuf| path.extension().is_some_and(|e| e == "h5");
    let staged = || {
        let is_there = sandbox.path(out).is_dir() && sandbox.names(out).iter().any(|name| name.starts_with(".staging"));
        if is_there { contents_or_none(&sandbox.path(out)).iter().filter(is_result).count() } else { 0 }
    };
    until(&format!("{count} archives are judged"), || staged() >= count);
}

/// Names of the plain files below `folder/.staging-*/files`, which come and go meanwhile.
fn contents_or_none(folder: &Path) -> Vec<std::path::PathBuf> {
    let inside = |folder: &Path| -> Vec<_> {
        fs::read_dir(folder).map_or_else(|_| Vec::new(), |all| all.filter_map(|e| Some(e.ok()?.path())).collect())
    };
    let staged = inside(folder).into_iter().filter(|path| path.join("files").is_dir());
    staged.flat_map(|path| inside(&path.join("files"))).flat_map(|day| inside(&day)).collect()
}

/// Catches results that are lost with the host that made them, and an executor that comes back and spoils what is committed.
#[test]
fn a_job_survives_executors_that_are_killed_or_do_not_answer() {
    let Some(sandbox) = Sandbox::new() else { return };
    let slow = sandbox.slow_tapline(SLEEP_S);
    let mut cluster = Cluster::start(&sandbox, &slow);
    let mut whole = begin(&sandbox, &cluster, &slow, "whole");
    assert_eq!(whole.end(), Some(0));
    let expected = contents(&sandbox.only_job("whole"));
    // While its tasks run: the rows of one that is lost after its last task cannot be fetched, and the job ends with an error.
    for (out, percent) in [("quarter", 25), ("half", 50), ("most", 65)] {
        let mut job = begin(&sandbox, &cluster, &slow, out);
        wait_for_results(&sandbox, out, CASINGS * percent / 100);
        cluster.executors[0].signal("KILL");
        assert_eq!(job.end(), Some(0), "{out}: {}", fs::read_to_string(sandbox.path("errors")).unwrap());
        assert!(contents(&sandbox.only_job(out)) == expected, "{out}");
        cluster.executors.remove(0);
        cluster.add_executor(&sandbox, &slow);
    }
    let mut job = begin(&sandbox, &cluster, &slow, "stopped");
    wait_for_results(&sandbox, "stopped", CASINGS / 3);
    cluster.executors[0].signal("STOP");
    assert_eq!(job.end(), Some(0), "{}", fs::read_to_string(sandbox.path("errors")).unwrap());
    cluster.executors[0].signal("CONT");
    std::thread::sleep(std::time::Duration::from_secs(1));
    assert!(contents(&sandbox.only_job("stopped")) == expected);
}

/// Catches an executor that is taken for lost while it works on one archive for a long time, and a job of which nothing is heard.
#[test]
fn an_archive_may_take_longer_than_a_silent_executor_is_waited_for() {
    let Some(sandbox) = Sandbox::new() else { return };
    fs::create_dir(sandbox.path("one")).unwrap();
    std::os::unix::fs::symlink(sandbox.path("in/1/SIM-0001.h5"), sandbox.path("one/SIM-0001.h5")).unwrap();
    // Progress is printed every ten seconds.
    let counted = sandbox.counting_tapline(12);
    let cluster = Cluster::start(&sandbox, &counted);
    let mut command = sandbox.command(&["reprocess", "one", "--out", "out", "--engine", &cluster.engine]);
    let done = Done::from(command.env("TAPLINE", &counted).output().unwrap()).expect(0);
    assert!(done.err.contains("0 of 1 archives"), "{}", done.err);
    assert_eq!(fs::read_to_string(sandbox.path("runs")).unwrap(), "run\n");
}

/// Catches a client that waits for ever, and half a job that is taken for a whole one.
#[test]
fn a_killed_scheduler_leaves_an_error_and_nothing_committed() {
    let Some(sandbox) = Sandbox::new() else { return };
    let slow = sandbox.slow_tapline(SLEEP_S);
    let mut cluster = Cluster::start(&sandbox, &slow);
    let mut job = begin(&sandbox, &cluster, &slow, "out");
    wait_for_results(&sandbox, "out", 3);
    cluster.restart_scheduler(&sandbox);
    assert_eq!(job.end(), Some(1));
    let errors = fs::read_to_string(sandbox.path("errors")).unwrap();
    assert!(errors.contains(&format!("failed on {}; nothing is committed", cluster.engine)), "{errors}");
    assert_eq!(sandbox.names("out"), [".lock"]);

    // The executors find the new scheduler, and the job is done from the beginning.
    let mut job = begin(&sandbox, &cluster, &slow, "out");
    assert_eq!(job.end(), Some(0), "{}", fs::read_to_string(sandbox.path("errors")).unwrap());
    assert_eq!(committed(&sandbox.only_job("out")).rows.len(), CASINGS);

    // A client that is killed leaves its staging folder, and the next one removes it.
    let mut job = begin(&sandbox, &cluster, &slow, "killed");
    wait_for_results(&sandbox, "killed", 1);
    job.signal("KILL");
    job.end();
    assert!(sandbox.names("killed").iter().any(|name| name.starts_with(".staging-")));
    assert_eq!(begin(&sandbox, &cluster, &slow, "killed").end(), Some(0));
    sandbox.only_job("killed");
}
