//! Archives and results in object storage: the same answers and bytes as from folders.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Stdio;

use crate::bucket::Bucket;
use crate::cluster::{Cluster, Process};
use crate::sandbox::{CASINGS, Sandbox, TRUNCATED, committed, contents, tapline};
use tapline_testing::program::Done;
use tapline_testing::waiting::until;

const ARCHIVES: &str = "s3://plant/2025";

const TABLES: [&str; 6] = ["taps", "discriminators", "damage", "regions", "verdicts", "casings"];

/// A sandbox whose archives are in the bucket too.
fn prepared() -> Option<(Sandbox, Bucket)> {
    let mut sandbox = Sandbox::new()?;
    let bucket = Bucket::start(&mut sandbox)?;
    let done = sandbox.run(&["copy", "in", "--to", ARCHIVES]).expect(0);
    assert!(done.err.contains("11 of 11 archives copied to s3://plant/2025, 0 were there"), "{}", done.err);
    Some((sandbox, bucket))
}

/// Catches archives that are altered on their way, overwritten, or copied though they are not whole.
#[test]
fn whole_archives_are_copied_once_and_come_back_as_they_were() {
    let Some((sandbox, bucket)) = prepared() else { return };
    let inside = contents(&sandbox.path("in"));
    assert!(contents(&bucket.download(&sandbox, "2025", "downloaded")) == inside);

    // A second time nothing is done; one that was cut off does not go, nor over another that is there.
    sandbox.truncate_one();
    bucket.put(&sandbox, &format!("in/{TRUNCATED}"), "2025/1/SIM-0001.h5");
    let again = sandbox.run(&["copy", "in", "--to", ARCHIVES]).expect(3);
    assert!(again.err.contains("0 of 12 archives copied to s3://plant/2025, 10 were there, 2 failed"), "{}", again.err);
    assert!(
        again.err.contains("another file is at s3://plant/2025/1/SIM-0001.h5; it is not overwritten"),
        "{}",
        again.err
    );
    assert!(
        again.err.contains(&format!("{TRUNCATED}: ")) && again.err.contains("it is shorter than it says"),
        "{}",
        again.err
    );
    assert_eq!(bucket.keys("2025").len(), CASINGS);

    let back = sandbox.run(&["copy", ARCHIVES, "--to", "back"]).expect(3);
    assert!(
        back.err.contains("1/SIM-0001.h5: ") && back.err.contains("10 of 11 archives copied to back"),
        "{}",
        back.err
    );
    let mut expected = inside;
    expected.retain(|path, _| !path.ends_with("SIM-0001.h5"));
    assert!(contents(&sandbox.path("back")) == expected);
    let mode = |path: &str| sandbox.path(path).metadata().unwrap().permissions().mode();
    assert_eq!(mode("back/2/SIM-0006.h5"), mode("in/2/SIM-0006.h5"), "who may read it");
}

/// Catches a fault of the host that is taken for one of the archive, and committed for good.
#[test]
fn what_is_wrong_with_the_host_is_not_committed() {
    let Some((sandbox, bucket)) = prepared() else { return };
    for says in ["kill -9 $$", "echo 'tapline: cannot write: No space left on device' >&2; exit 1"] {
        let program = sandbox.path("faulty");
        fs::write(&program, format!("#!/bin/sh\n{says}\n")).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        for (of, out) in [(ARCHIVES, "s3://plant/again"), ("in", "again")] {
            let mut command = sandbox.command(&["reprocess", of, "--out", out]);
            let done = Done::from(command.env("TAPLINE", &program).output().unwrap()).expect(1);
            assert!(done.err.contains("nothing is committed") && !done.err.contains("panicked"), "{}", done.err);
        }
    }
    assert!(bucket.keys("again").is_empty() && sandbox.names("again") == [".lock"]);
}

/// Catches rows that are lost, or read from another object, and a bad object that ends a question.
#[test]
fn a_bucket_answers_like_a_folder() {
    let Some((sandbox, bucket)) = prepared() else { return };
    let cluster = Cluster::start(&sandbox, &tapline().unwrap());
    for table in TABLES {
        let sql = format!("SELECT * FROM {table}");
        let local = sandbox.ask(&sql, "local", &[]);
        for engine in ["local", &cluster.engine] {
            assert_eq!(local, sandbox.ask_of(ARCHIVES, &sql, engine, &["--files-per-task", "3"]), "{table} {engine}");
        }
    }
    sandbox.truncate_one();
    bucket.put(&sandbox, &format!("in/{TRUNCATED}"), &format!("2025/{TRUNCATED}"));
    let bad = sandbox.ask_of(ARCHIVES, "SELECT file, error FROM verdicts WHERE status = 'error'", &cluster.engine, &[]);
    assert_eq!(bad.len(), 2);
    let of_bucket = format!("{TRUNCATED},s3://plant/2025/{TRUNCATED} ");
    assert!(
        bad[1].replace('"', "").starts_with(&of_bucket) && bad[1].contains("it is shorter than it says"),
        "{bad:?}"
    );
}

/// Catches results that differ with where they lie, and a job that counts before it is committed, or that a pause of the server ends.
#[test]
fn a_job_in_a_bucket_leaves_what_it_leaves_in_a_folder() {
    let Some((sandbox, bucket)) = prepared() else { return };
    let slow = sandbox.slow_tapline(0.3);
    let cluster = Cluster::start(&sandbox, &slow);
    let mut command = sandbox.command(&["reprocess", "in", "--from-samples", "--out", "local"]);
    Done::from(command.env("TAPLINE", &slow).output().unwrap()).expect(0);
    // Without links to the archives, and the commit file, which names the job.
    let results = |folder: &Path| {
        let mut all = contents(folder);
        all.retain(|path, _| !inside_of(&sandbox, path) && !path.starts_with("_committed.json"));
        all
    };
    let expected = results(&sandbox.only_job("local"));
    assert_eq!(expected.len(), CASINGS);

    let begin = |out: &str| {
        let arguments = ["reprocess", ARCHIVES, "--from-samples", "--out", out, "--files-per-task", "1", "--engine"];
        let mut command = sandbox.command(&[&arguments[..], &[&cluster.engine]].concat());
        let errors = fs::File::create(sandbox.path("errors")).unwrap();
        Process::start(command.env("TAPLINE", &slow).stdout(Stdio::null()).stderr(errors))
    };
    let wait_for = |out: &str, count: usize| {
        until(&format!("{count} archives are judged"), || bucket.keys(out).len() >= count);
    };
    // A client that is killed leaves results that do not count.
    let killed = begin("s3://plant/killed");
    wait_for("killed", 2);
    killed.signal("KILL");
    let sql = "SELECT count(DISTINCT file) FROM verdicts";
    let asked = sandbox.run(&["sql", sql, "s3://plant/killed", "--results"]).expect(1);
    assert!(asked.err.contains("s3://plant/killed has no results of tapline reprocess"), "{}", asked.err);

    // The server answers nobody for two seconds.
    let mut job = begin("s3://plant/again");
    wait_for("again", CASINGS / 2);
    bucket.server.signal("STOP");
    std::thread::sleep(std::time::Duration::from_secs(2));
    bucket.server.signal("CONT");
    assert_eq!(job.end(), Some(0), "{}", fs::read_to_string(sandbox.path("errors")).unwrap());
    let job = bucket.keys("again")[0].split('/').nth(1).unwrap().to_owned();
    let downloaded = bucket.download(&sandbox, &format!("again/{job}"), "again");
    let mut found = results(&downloaded);
    assert!(found.remove(Path::new("_archives.json")).is_some() && found == expected);
    assert_eq!(committed(&downloaded).rows, committed(&sandbox.only_job("local")).rows);

    // Once more: it is there already, and stays. What a killed client left is gone over and then counts.
    let again = |out: &str| {
        let mut command = sandbox.command(&["reprocess", ARCHIVES, "--from-samples", "--out", out]);
        Done::from(command.env("TAPLINE", &slow).output().unwrap()).expect(0).err
    };
    assert!(again("s3://plant/again").contains("was committed before"));
    assert!(again("s3://plant/killed").contains("the job is committed: 11 of 11"));
    let asked = sandbox.ask_of("s3://plant/killed", sql, "local", &["--results"]);
    assert_eq!(asked[1], CASINGS.to_string());
    let asked = sandbox.ask_of("s3://plant/again", sql, "local", &["--results"]);
    assert_eq!(asked[1], CASINGS.to_string());
    let folders = [sandbox.only_job("local").display().to_string(), format!("s3://plant/again/{job}")];
    for table in TABLES {
        let [local, of_bucket] = folders
            .each_ref()
            .map(|place| sandbox.ask_of(place, &format!("SELECT * FROM {table}"), "local", &["--results"]));
        let other = local.iter().zip(&of_bucket).find(|(one, other)| one != other);
        assert!(local.len() > 1 && local == of_bucket, "{table}: {other:?}");
    }
}

/// Whether there is an archive of that name.
fn inside_of(sandbox: &Sandbox, path: &Path) -> bool {
    sandbox.path("in").join(path).exists()
}

/// Catches two clients of one job that both commit it.
#[test]
fn of_two_clients_one_commits() {
    let Some((sandbox, bucket)) = prepared() else { return };
    let slow = sandbox.slow_tapline(0.1);
    let start = |errors: &str| {
        let mut command = sandbox.command(&["reprocess", ARCHIVES, "--out", "s3://plant/again"]);
        let errors = fs::File::create(sandbox.path(errors)).unwrap();
        Process::start(command.env("TAPLINE", &slow).stdout(Stdio::null()).stderr(errors))
    };
    let mut both = [start("first"), start("second")];
    assert_eq!(both.each_mut().map(Process::end), [Some(0), Some(0)]);
    let said = ["first", "second"].map(|name| fs::read_to_string(sandbox.path(name)).unwrap());
    let committed = said.iter().filter(|said| said.contains("the job is committed")).count();
    assert_eq!(committed, 1, "{said:?}");
    assert_eq!(bucket.keys("again").len(), CASINGS + 2);
}

#[test]
fn what_cannot_be_had_of_a_bucket_is_said() {
    let Some((sandbox, _bucket)) = prepared() else { return };
    let refusal = |arguments: &[&str]| sandbox.run(arguments).expect(1).err;
    let err = refusal(&["sql", "SELECT 1", "s3://nobody/2025"]);
    assert!(err.contains("cannot read s3://nobody/2025") && err.contains("NoSuchBucket"), "{err}");
    let err = refusal(&["sql", "SELECT 1", "s3://plant/1999"]);
    assert!(err.contains("s3://plant/1999 has no finished archive"), "{err}");
    let err = refusal(&["reprocess", ARCHIVES, "--out", "s3://plant/2025/again"]);
    assert!(err.contains("whose archives are judged"), "{err}");
    let err = refusal(&["reprocess", ARCHIVES, "--out", "again"]);
    assert!(err.contains("give --out s3://BUCKET/FOLDER"), "{err}");
    let err = refusal(&["copy", ARCHIVES, "--to", "s3://plant/2025/copy"]);
    assert!(err.contains("would be copied into itself"), "{err}");
    let err = refusal(&["reprocess", "in", "--out", "s3://plant/again"]);
    assert!(err.contains("copy the archives into the bucket first"), "{err}");
    for (name, value, why) in [
        ("AWS_ALLOW_HTTP", "false", "is not encrypted: use https://, or set AWS_ALLOW_HTTP=true"),
        ("AWS_ENDPOINT_URL", "127.0.0.1:9", "AWS_ENDPOINT_URL is \"127.0.0.1:9\"; it must begin with https://"),
        ("AWS_ENDPOINT_URL", "http://127.0.0.1:9", "cannot read s3://plant/2025"),
    ] {
        for first in [&["sql", "SELECT 1", ARCHIVES][..], &["copy", "in", "--to", ARCHIVES]] {
            let done = Done::from(sandbox.command(first).env(name, value).output().unwrap()).expect(1);
            assert!(done.err.contains(why) && done.err.lines().count() == 1, "{}", done.err);
        }
    }
}

/// Catches results of another archive than the job is named after.
#[test]
fn an_archive_that_is_replaced_meanwhile_ends_its_job() {
    let Some((sandbox, bucket)) = prepared() else { return };
    // Four are fetched at a time, and this one with the last.
    let slow = sandbox.slow_tapline(2.0);
    let mut command = sandbox.command(&["reprocess", ARCHIVES, "--out", "s3://plant/again", "--files-per-task", "11"]);
    let errors = fs::File::create(sandbox.path("errors")).unwrap();
    let mut job = Process::start(command.env("TAPLINE", &slow).stdout(Stdio::null()).stderr(errors));
    until("an archive is judged", || !bucket.keys("again").is_empty());
    bucket.put(&sandbox, "in/1/SIM-0001.h5", "2025/2/SIM-0011.h5");
    assert_eq!(job.end(), Some(1));
    let said = fs::read_to_string(sandbox.path("errors")).unwrap();
    assert!(said.contains("s3://plant/2025/2/SIM-0011.h5 was replaced by another object"), "{said}");
    assert!(!bucket.keys("again").iter().any(|key| key.ends_with("_committed.json")));
}
