//! Nothing is lost: stages, stations and the line itself are killed in the middle of a scan.

use std::process::Child;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::rig::{Contents, Done, Rig, assert_same, contents, signal, stage};

/// Two stations, 2 shoulders of 40 locations each, twice: 164 taps a station.
const SCAN: &str = "
[scan]
stations = 2
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 2
locations = 40
";
const TAPS_A_STATION: f32 = 164.0;

/// A pace at which a run lasts some seconds: there is time to kill, also on a busy machine.
const TAPS_PER_S: f32 = 60.0;

fn paced() -> String {
    format!("{SCAN}\n[acquire]\ntaps_per_s = {TAPS_PER_S:.1}\n")
}

fn undisturbed(rig: &Rig) -> Contents {
    rig.write("quick.toml", SCAN);
    rig.run("run --config quick.toml --out quick.h5").expect(0);
    contents(&rig.path("quick.h5"))
}

/// Starts a paced run and waits until it is well under way.
fn start(rig: &Rig) -> Child {
    rig.write("paced.toml", &paced());
    let line = rig.start("run --config paced.toml --out paced.h5 --json");
    stage(&line, "acquire --station 2");
    std::thread::sleep(Duration::from_millis(600));
    line
}

fn finish(line: Child) -> Done {
    Done::from(line.wait_with_output().unwrap())
}

fn kill_and_compare(victims: &[&str]) {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let line = start(&rig);
    let pids: Vec<i32> = victims.iter().map(|words| stage(&line, words)).collect();
    for pid in pids {
        signal(pid, Signal::KILL);
    }
    let summary = finish(line).json(0);
    assert_eq!(summary["is_whole"], true);
    assert_eq!(summary["pace"]["restarts"], victims.len());
    assert_same(&contents(&rig.path("paced.h5")), &expected);
    assert_eq!(rig.left_by("paced.h5"), Vec::<String>::new());
    rig.run("verify paced.h5").expect(0);
}

#[test]
fn process_is_killed() {
    kill_and_compare(&["process"]);
}

#[test]
fn fuse_is_killed() {
    kill_and_compare(&["fuse"]);
}

#[test]
fn store_is_killed() {
    kill_and_compare(&["store"]);
}

#[test]
fn a_station_is_killed() {
    kill_and_compare(&["acquire --station 1"]);
}

#[test]
fn store_and_process_are_killed_at_once() {
    kill_and_compare(&["store", "process"]);
}

#[test]
fn fuse_and_a_station_are_killed_at_once() {
    kill_and_compare(&["fuse", "acquire --station 2"]);
}

/// Each stage again and again, at moments that differ from run to run.
#[test]
fn every_stage_is_killed_in_one_run() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let line = start(&rig);
    for words in ["process", "store", "fuse", "acquire --station 1", "store", "process"] {
        signal(stage(&line, words), Signal::KILL);
        std::thread::sleep(Duration::from_millis(u64::from(std::process::id() % 7) * 30));
    }
    finish(line).expect(0);
    assert_same(&contents(&rig.path("paced.h5")), &expected);
    assert_eq!(rig.left_by("paced.h5"), Vec::<String>::new());
    rig.run("verify paced.h5").expect(0);
}

/// Killed when all is sent or nearly so, a stage must not hold up the end.
#[test]
fn stages_are_killed_at_the_end() {
    for (words, when) in
        [("process", 0.9), ("fuse", 0.97), ("store", 0.99), ("acquire --station 1", 1.0), ("fuse", 1.0)]
    {
        let rig = Rig::new();
        rig.write("paced.toml", &paced());
        let line = rig.start("run --config paced.toml --out paced.h5 --json");
        let pid = stage(&line, words);
        std::thread::sleep(Duration::from_secs_f32(when * TAPS_A_STATION / TAPS_PER_S));
        if let Err(error) = rustix::process::kill_process(rustix::process::Pid::from_raw(pid).unwrap(), Signal::KILL) {
            eprintln!("{words} was gone already: {error}");
        }
        finish(line).expect(0);
        rig.run("verify paced.h5").expect(0);
        assert_eq!(rig.left_by("paced.h5"), Vec::<String>::new());
    }
}

/// A stage that someone tells to end, as a service manager might, is as good as killed: the line starts it again.
#[test]
fn stages_that_are_told_to_end_are_started_again() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let line = start(&rig);
    for words in ["process", "store", "fuse", "acquire --station 2"] {
        signal(stage(&line, words), Signal::TERM);
        std::thread::sleep(Duration::from_millis(150));
    }
    finish(line).expect(0);
    assert_same(&contents(&rig.path("paced.h5")), &expected);
}

/// Killed while the line starts, before anything is connected.
#[test]
fn stages_are_killed_at_the_start() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    for delay_ms in [0, 10, 25, 50, 100] {
        rig.write("paced.toml", &paced());
        let line = rig.start("run --config paced.toml --out paced.h5");
        for words in ["store", "process"] {
            let pid = stage(&line, words);
            std::thread::sleep(Duration::from_millis(delay_ms));
            signal(pid, Signal::KILL);
        }
        finish(line).expect(0);
        assert_same(&contents(&rig.path("paced.h5")), &expected);
        std::fs::remove_file(rig.path("paced.h5")).unwrap();
    }
}

/// A line that is killed while it starts leaves no stage behind that would hold its archive.
#[test]
fn a_line_killed_at_its_start_leaves_no_one() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    for delay_ms in [5, 15, 30, 60, 120, 250] {
        rig.write("paced.toml", &paced());
        let mut line = rig.start("run --config paced.toml --out paced.h5");
        std::thread::sleep(Duration::from_millis(delay_ms));
        line.kill().unwrap();
        line.wait().unwrap();
    }
    rig.run("run --config paced.toml --out paced.h5").expect(0);
    assert_same(&contents(&rig.path("paced.h5")), &expected);
    assert_eq!(rig.left_by("paced.h5"), Vec::<String>::new());
}

/// A stage that dies again and again without getting anywhere ends the line, with its name and the reason.
#[test]
fn a_stage_that_dies_again_and_again_ends_the_line() {
    let rig = Rig::new();
    rig.write("quick.toml", SCAN);
    let program = env!("CARGO_BIN_EXE_tapline");
    // No file may grow beyond 64 KiB: the system kills whoever tries, which here is `store`.
    let done = std::process::Command::new("sh")
        .args(["-c", &format!("ulimit -f 128; exec {program} run --config quick.toml --out quick.h5 --reference self")])
        .current_dir(rig.path(""))
        .output()
        .unwrap();
    let done = Done::from(done).expect(1);
    assert!(done.err.contains("store"), "{done:?}");
    assert_eq!(rig.left_by("quick.h5"), Vec::<String>::new());
}

/// Ctrl-C drains: everything sent is archived, the exit code says that taps are missing, and the same command goes on.
#[test]
fn an_interrupted_run_is_resumed() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let line = start(&rig);
    signal(line.id() as i32, Signal::INT);
    let summary = finish(line).json(3);
    let archived = summary["archived"].as_u64().unwrap();
    assert!(archived > 0 && summary["missing"].as_u64().unwrap() > 0, "{summary}");
    assert_eq!(summary["pace"]["sent"].as_u64().unwrap(), archived, "everything sent is archived");
    for shoulder in summary["verdicts"].as_array().unwrap() {
        assert_ne!(shoulder["verdict"], "PASS", "no end, no PASS");
    }
    assert_eq!(rig.left_by("paced.h5"), Vec::<String>::new());
    rig.run("verify paced.h5").expect(3);

    let summary = rig.run("run --config paced.toml --out paced.h5 --json").json(0);
    assert_eq!(summary["pace"]["taps"].as_u64().unwrap(), 328 - archived, "only what was missing is taken");
    assert_same(&contents(&rig.path("paced.h5")), &expected);

    let again = rig.run("run --config paced.toml --out paced.h5 --json").json(0);
    assert_eq!(again["pace"]["taps"], 0, "nothing is left to do");
}

/// The line itself is killed: its stages end with it, and the next run clears what is left and goes on.
#[test]
fn a_killed_line_is_resumed() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let mut line = start(&rig);
    let stages: Vec<i32> = ["store", "fuse", "process", "acquire --station 1"].map(|words| stage(&line, words)).into();
    line.kill().unwrap();
    line.wait().unwrap();
    let deadline = Instant::now() + Duration::from_secs(20);
    let is_alive = |pid: &i32| std::fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|s| !s.contains(") Z "));
    while stages.iter().any(is_alive) {
        assert!(Instant::now() < deadline, "a stage outlives its line");
        std::thread::sleep(Duration::from_millis(20));
    }
    rig.run("run --config paced.toml --out paced.h5").expect(0);
    assert_same(&contents(&rig.path("paced.h5")), &expected);
    assert_eq!(rig.left_by("paced.h5"), Vec::<String>::new());
}

/// Two lines must not write one archive.
#[test]
fn a_second_line_on_the_same_archive_is_refused() {
    let rig = Rig::new();
    let line = start(&rig);
    let second = rig.run("run --config paced.toml --out paced.h5").expect(1);
    assert!(second.err.contains("another line is writing paced.h5"), "{second:?}");
    finish(line).expect(0);
}

/// Where an archive cannot be, the line says so at once and leaves nothing behind.
#[test]
fn a_folder_that_is_not_there_is_named() {
    let rig = Rig::new();
    rig.write("quick.toml", SCAN);
    let done = rig.run("run --config quick.toml --out no/such/folder/x.h5").expect(1);
    assert!(done.err.contains("no/such/folder"), "{done:?}");
    assert_eq!(rig.left_by("no/such/folder/x.h5"), Vec::<String>::new());
}

/// More shared memory than there is: said before the first tap, not by SIGBUS after it.
#[test]
fn too_little_shared_memory_is_said_at_the_start() {
    if tapline_wire::room::free_bytes().unwrap() > 100_000_000_000 {
        eprintln!("skipped: this machine has room for a line of 20000 stations");
        return;
    }
    let rig = Rig::new();
    rig.write(
        "wide.toml",
        "[scan]\nstations = 20000\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.0]\nrepetitions = 1\nlocations = 1\n",
    );
    let done = rig.run("run --config wide.toml --out wide.h5").expect(1);
    assert!(done.err.contains("/dev/shm") && done.err.contains("MB"), "{done:?}");
    assert!(!rig.path("wide.h5").exists());
}
