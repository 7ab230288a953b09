//! Nothing is lost when stages, stations or the line itself are killed during a scan.

use std::collections::BTreeMap;
use std::process::Child;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use tapline_store::Reader;
use tapline_wire::TapState;

use crate::sandbox::Sandbox;
use crate::sandbox::archives::{Contents, assert_same_casings, casings, finished, under_way};
use crate::sandbox::stages::{kill, signal, stage, stage_now};
use tapline_testing::program::Done;

/// Two stations, 2 shoulders of 40 locations each, twice: 164 taps per station.
const SCAN: &str = "
[scan]
stations = 2
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 2
locations = 40
confirm = false
";

/// A pace at which a run lasts some seconds, so that there is time to kill, even on a busy machine.
const TAPS_PER_S: f32 = 60.0;

fn paced(scan: &str, taps_per_s: f32) -> String {
    format!("{scan}\n[acquire]\ntaps_per_s = {taps_per_s:.1}\n")
}

/// A sandbox, and the casings of `scan` that an undisturbed run has made in it.
fn undisturbed(scan: &str) -> (Sandbox, BTreeMap<String, Contents>) {
    let sandbox = Sandbox::new();
    sandbox.write("quick.toml", scan);
    sandbox.run("run --config quick.toml --out quick").expect(0);
    let expected = casings(&sandbox.path("quick"));
    (sandbox, expected)
}

/// Checks that the finished files are complete, with the contents of an undisturbed run, and that nothing else is left.
fn assert_whole(sandbox: &Sandbox, out: &str, expected: &BTreeMap<String, Contents>) {
    for file in finished(&sandbox.path(out)).values() {
        sandbox.run(&format!("verify {}", file.display())).expect(0);
    }
    assert_same_casings(&casings(&sandbox.path(out)), expected);
    assert_eq!(under_way(&sandbox.path(out)), Vec::<std::path::PathBuf>::new());
    assert!(!sandbox.path(out).join("left").exists(), "a file was put aside");
    assert_eq!(sandbox.left(), Vec::<String>::new());
}

/// The process of the second station; on one core, one process has both stations.
fn second_acquire() -> &'static str {
    if std::thread::available_parallelism().unwrap().get() > 1 { "acquire-1" } else { "acquire-0" }
}

/// Waits until more than `count` taps of the paced run are settled, and returns how many are; `None` if they never are.
fn settled_beyond(sandbox: &Sandbox, count: u64) -> Option<u64> {
    let deadline = Instant::now() + Duration::from_secs(30);
    while Instant::now() < deadline {
        let status = sandbox.run("status --out paced --json");
        let status: serde_json::Value = serde_json::from_str(&status.out).unwrap_or_default();
        if let Some(settled) = status["settled_count"].as_u64().filter(|&settled| settled > count) {
            return Some(settled);
        }
    }
    None
}

/// Starts a paced run and waits until it is well under way.
fn start(sandbox: &Sandbox, taps_per_s: f32) -> Child {
    sandbox.write("paced.toml", &paced(SCAN, taps_per_s));
    let line = sandbox.start("run --config paced.toml --out paced --json");
    if settled_beyond(sandbox, 20).is_none() {
        signal(i32::try_from(line.id()).unwrap(), Signal::KILL);
        panic!("no taps have come: {:?}", finish(line));
    }
    line
}

fn finish(line: Child) -> Done {
    Done::from(line.wait_with_output().unwrap())
}

/// Catches a tap that is lost, a result that changes, and a stage that is not started again, or is twice, when one stage or two at
/// once are killed, or ended by another process, such as a service manager, while all else works.
#[test]
fn stages_are_killed_and_ended_alone_and_by_twos() {
    let (sandbox, expected) = undisturbed(SCAN);
    // Slower than the others: after each kill some taps must come before the next.
    let line = start(&sandbox, TAPS_PER_S / 2.0);
    // Sources first, while they have taps to send.
    let groups: [(Signal, &[&str]); 8] = [
        (Signal::KILL, &["acquire-0"]),
        (Signal::KILL, &["fuse", second_acquire()]),
        (Signal::TERM, &["fuse", second_acquire()]),
        (Signal::KILL, &["process"]),
        (Signal::KILL, &["fuse"]),
        (Signal::KILL, &["store"]),
        (Signal::TERM, &["process", "store"]),
        (Signal::KILL, &["store", "process"]),
    ];
    let mut settled = 0;
    for (with, victims) in groups {
        settled = settled_beyond(&sandbox, settled + 10)
            .unwrap_or_else(|| panic!("after {settled} no taps come before {with:?} to {victims:?}"));
        let pids: Vec<i32> = victims.iter().map(|words| stage(&line, words)).collect();
        eprintln!("{with:?} to {victims:?} after {settled} taps");
        for pid in pids {
            signal(pid, with);
        }
    }
    let done = finish(line);
    let summary = done.json(0);
    assert_eq!(summary["is_complete"], true, "{done:?}");
    assert_eq!(summary["pace"]["restarts"], 12, "{done:?}");
    assert_whole(&sandbox, "paced", &expected);
}

/// A stage that is killed when nearly everything is sent does not delay the end.
#[test]
fn stages_are_killed_at_the_end() {
    /// Taps of a station: half as many locations as in the other runs, twice around 2 shoulders, and closing taps.
    const TAPS_A_STATION: f32 = 84.0;
    let scan = SCAN.replace("locations = 40", "locations = 20");
    let (sandbox, expected) = undisturbed(&scan);
    sandbox.write("paced.toml", &paced(&scan, TAPS_PER_S));
    for (words, when) in [("process", 0.9), ("fuse", 0.97), ("store", 0.99), ("acquire-0", 1.0), ("fuse", 1.0)] {
        let line = sandbox.start("run --config paced.toml --out paced --json");
        let pid = stage(&line, words);
        std::thread::sleep(Duration::from_secs_f32(when * TAPS_A_STATION / TAPS_PER_S));
        kill(pid, words);
        finish(line).expect(0);
        assert_whole(&sandbox, "paced", &expected);
        std::fs::remove_dir_all(sandbox.path("paced")).unwrap();
    }
}

/// Killed while the line starts, before anything is connected.
#[test]
fn stages_are_killed_at_the_start() {
    let (sandbox, expected) = undisturbed(SCAN);
    sandbox.write("paced.toml", &paced(SCAN, 2.0 * TAPS_PER_S));
    for delay_ms in [0, 10, 25, 50, 100] {
        let line = sandbox.start("run --config paced.toml --out paced");
        for words in ["store", "process"] {
            let pid = stage(&line, words);
            std::thread::sleep(Duration::from_millis(delay_ms));
            signal(pid, Signal::KILL);
        }
        finish(line).expect(0);
        assert_whole(&sandbox, "paced", &expected);
        std::fs::remove_dir_all(sandbox.path("paced")).unwrap();
    }
}

/// A line that is killed while it starts leaves no stage behind that would hold its archive.
#[test]
fn a_line_killed_at_its_start_leaves_no_one() {
    let (sandbox, expected) = undisturbed(SCAN);
    for delay_ms in [5, 15, 30, 60, 120, 250] {
        sandbox.write("paced.toml", &paced(SCAN, TAPS_PER_S));
        let mut line = sandbox.start("run --config paced.toml --out paced");
        std::thread::sleep(Duration::from_millis(delay_ms));
        line.kill().unwrap();
        line.wait().unwrap();
    }
    sandbox.run("run --config paced.toml --out paced").expect(0);
    assert_whole(&sandbox, "paced", &expected);
}

/// A stage that keeps dying without progress ends the line, with its name and the reason.
#[test]
fn a_stage_that_dies_again_and_again_ends_the_line() {
    let sandbox = Sandbox::new();
    sandbox.write("paced.toml", &paced(SCAN, TAPS_PER_S));
    let mut line = sandbox.start("run --config paced.toml --out paced");
    let deadline = Instant::now() + Duration::from_secs(60);
    while line.try_wait().unwrap().is_none() && Instant::now() < deadline {
        if let Some(pid) = stage_now(&line, "store") {
            kill(pid, "store");
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(line.try_wait().unwrap().is_some(), "it goes on for ever");
    let done = finish(line).expect(1);
    assert!(done.err.contains("store was killed by signal 9, 10 times"), "{done:?}");
    assert_eq!(sandbox.left(), Vec::<String>::new());
}

/// Four tyres at each of two stations, one after the other: stages and the line itself are killed repeatedly, while
/// casings are opened, tapped, judged and closed.
#[test]
fn everyone_is_killed_while_casings_come_and_go() {
    let tyres: String =
        (0..8).map(|k| format!("[[scan.tyre]]\nserial = \"T{k}\"\nstation = {}\n", k % 2 + 1)).collect();
    let scan = format!(
        "[scan]\nstations = 2\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.85]\nrepetitions = 1\nlocations = 14\n{tyres}\
         [simulation]\nsample_count = 4096\n[[simulation.fault]]\nkind = \"double_hit\"\nfraction = 0.1\n"
    );
    let (sandbox, expected) = undisturbed(&scan);
    assert_eq!(expected.len(), 8);
    sandbox.write("paced.toml", &paced(&scan, 40.0));
    // The moments differ in every run of the tests; they are printed.
    let mut state = u64::from(std::process::id()) << 20 ^ tapline_wire::now_ns() as u64;
    let mut dice = |end: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % end
    };
    let mut is_ended = false;
    for round in 0..4 {
        let mut line = sandbox.start("run --config paced.toml --out paced --json");
        for _ in 0..4 {
            std::thread::sleep(Duration::from_millis(50 + dice(350)));
            if line.try_wait().unwrap().is_some() {
                is_ended = true;
                break;
            }
            let victim = ["process", "fuse", "store", "acquire-0"][dice(4) as usize];
            let Some(pid) = stage_now(&line, victim) else { continue };
            eprintln!("round {round}: {victim} is killed");
            kill(pid, victim);
        }
        if is_ended {
            break;
        }
        line.kill().unwrap();
        line.wait().unwrap();
    }
    // Pace, codec and comments affect no result: what is under way is continued.
    let later = "[acquire]\ntaps_per_s = 400.0\n[store]\ncodec = \"zstd\"\n";
    sandbox.write("later.toml", &format!("# later\n{scan}\n{later}"));
    sandbox.run("run --config later.toml --out paced").expect(0);
    assert_whole(&sandbox, "paced", &expected);
    sandbox.run("export paced taps --out set").expect(0);
}

/// Catches a message that is lost with its sender: `store` is killed just when a finished file is renamed.
#[test]
fn store_is_killed_as_files_are_finished() {
    let tyres: String = (0..6).map(|k| format!("[[scan.tyre]]\nserial = \"T{k}\"\n")).collect();
    let scan = format!(
        "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.85]\nrepetitions = 1\nlocations = 10\n{tyres}\
         [simulation]\nsample_count = 4096\n"
    );
    let (sandbox, expected) = undisturbed(&scan);
    let mut line = sandbox.start("run --config quick.toml --out killed --json");
    let deadline = Instant::now() + Duration::from_secs(60);
    let mut killed = 0;
    while line.try_wait().unwrap().is_none() {
        if Instant::now() > deadline {
            line.kill().unwrap();
            panic!("it hangs: {:?}", Done::from(line.wait_with_output().unwrap()));
        }
        let there = if sandbox.path("killed").is_dir() { finished(&sandbox.path("killed")).len() } else { 0 };
        if there > killed {
            killed = there;
            if let Some(pid) = stage_now(&line, "store") {
                kill(pid, "store");
            }
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    assert_eq!(finish(line).json(0)["is_complete"], true);
    assert_whole(&sandbox, "killed", &expected);
}

/// Ctrl-C drains: everything sent is archived, the exit code is that of missing taps, and the same command continues
/// the run.
#[test]
fn an_interrupted_run_is_resumed() {
    let (sandbox, expected) = undisturbed(SCAN);
    let line = start(&sandbox, TAPS_PER_S);
    signal(line.id() as i32, Signal::INT);
    let summary = finish(line).json(3);
    assert_eq!((&summary["casings"], &summary["unfinished"]), (&2.into(), &2.into()), "{summary}");
    let open = under_way(&sandbox.path("paced"));
    let archived = open.iter().map(|file| Reader::open_unfinished(file).unwrap().ledger().count(TapState::Archived));
    let archived = archived.sum::<usize>() as u64;
    assert!(open.len() == 2 && (1..328).contains(&archived), "{archived} taps in {open:?}");
    assert_eq!(summary["pace"]["sent"].as_u64().unwrap(), archived, "everything sent is archived");
    for shoulder in summary["verdicts"].as_array().unwrap() {
        assert_ne!(shoulder["verdict"], "PASS", "no end, no PASS");
    }
    assert_eq!(sandbox.left(), Vec::<String>::new());

    let resumed = sandbox.run("run --config paced.toml --out paced --json");
    let summary = resumed.json(0);
    assert_eq!(summary["pace"]["taps"].as_u64().unwrap(), 328 - archived, "only what was missing is taken");
    let there = |name: &str| {
        let line = resumed.err.lines().find_map(|line| line.strip_prefix(&format!("casing {name} was begun before: ")));
        line.and_then(|line| line.strip_suffix(" of 164 taps are done")?.parse::<u64>().ok()).unwrap_or(0)
    };
    assert_eq!(there("SIM-0001") + there("SIM-0002"), archived, "{}", resumed.err);
    assert_whole(&sandbox, "paced", &expected);

    let again = sandbox.run("run --config paced.toml --out paced --json").json(0);
    assert_eq!(again["pace"]["taps"], 0, "nothing is left to do");
}

/// The line itself is killed: its stages end with it, and the next run clears up and continues.
#[test]
fn a_killed_line_is_resumed() {
    let (sandbox, expected) = undisturbed(SCAN);
    let mut line = start(&sandbox, TAPS_PER_S);
    let stages: Vec<i32> = ["store", "fuse", "process", "acquire-0"].map(|words| stage(&line, words)).into();
    line.kill().unwrap();
    let deadline = Instant::now() + Duration::from_secs(20);
    let is_alive = |pid: &i32| std::fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|s| !s.contains(") Z "));
    while stages.iter().any(is_alive) {
        assert!(Instant::now() < deadline, "a stage outlives its line");
        std::thread::sleep(Duration::from_millis(20));
    }
    let said = line.wait_with_output().unwrap().stderr;
    assert!(!String::from_utf8_lossy(&said).contains("standard output"), "a stage complains that its line is gone");
    sandbox.run("run --config paced.toml --out paced").expect(0);
    assert_whole(&sandbox, "paced", &expected);
}

/// Two lines must not write one folder.
#[test]
fn a_second_line_on_the_same_folder_is_refused() {
    let sandbox = Sandbox::new();
    let line = start(&sandbox, TAPS_PER_S);
    let second = sandbox.run("run --config paced.toml --out paced").expect(1);
    assert!(second.err.contains("another line (process ") && second.err.contains("paced"), "{second:?}");
    finish(line).expect(0);
}

/// If results cannot be written, the line ends at once with an error and leaves nothing.
#[test]
fn a_folder_that_cannot_be_is_named() {
    let sandbox = Sandbox::new();
    sandbox.write("quick.toml", SCAN);
    sandbox.write("file", "mine");
    for out in ["file", "file/folder", "/proc/no/such/folder"] {
        let done = sandbox.run(&format!("run --config quick.toml --out {out}")).expect(1);
        assert!(done.err.contains(out), "{done:?}");
    }
    assert_eq!(std::fs::read_to_string(sandbox.path("file")).unwrap(), "mine");
    assert_eq!(sandbox.left(), Vec::<String>::new());
}

/// Too little shared memory is an error before the first tap, not a SIGBUS later.
#[test]
fn too_little_shared_memory_is_an_error_at_the_start() {
    if tapline_wire::shm::free_bytes().unwrap() > 40_000_000_000 {
        tapline_testing::skip("this machine has room for a line of 20000 stations");
        return;
    }
    let sandbox = Sandbox::new();
    sandbox.write(
        "wide.toml",
        "[scan]\nstations = 20000\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.0]\nrepetitions = 1\nlocations = 1\n\
         [simulation]\nsample_count = 65536\n",
    );
    let done = sandbox.run("run --config wide.toml --out wide").expect(1);
    assert!(done.err.contains("/dev/shm") && done.err.contains("MB"), "{done:?}");
    assert!(finished(&sandbox.path("wide")).is_empty() && under_way(&sandbox.path("wide")).is_empty());
}
