//! A line that runs on: casings come to its stations one by one, from a watched folder, a rig, or made up.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, RecvTimeoutError, bounded};
use rustix::process::Signal;
use serde_json::Value;
use tapline_store::{Reader, verify};
use tapline_wire::TapState;

use crate::export_taps::as_from_a_tap_set;
use crate::rig::{Contents, Rig, assert_same, casings, contents, finished, signal, stage, under_way};

/// How long a line may take to do what it must: none of these tests is to hang where it ought to fail.
const PATIENCE: Duration = Duration::from_secs(60);

/// Casings that take 50 taps: 2 shoulders of 24 locations.
const SCAN: &str = "
[scan]
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 1
locations = 24
";

/// What a line has room for, where tap sets come.
const ROOM: &str = "[line]\ntaps_max = 200\nrecord_samples_max = 40000\nscans_max = 4\n";

/// A line, or a rig, that is running, and what it says.
struct Running {
    /// `None` once its end has been waited for.
    child: Option<Child>,
    said: Receiver<String>,
    log: Receiver<String>,
}

impl Drop for Running {
    /// A test that fails leaves no line that waits for ever; what it had to say is shown.
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            child.kill().unwrap();
            child.wait().unwrap();
            eprintln!("{}", self.log.try_iter().collect::<Vec<_>>().join("\n"));
        }
    }
}

impl Running {
    fn start(rig: &Rig, arguments: &str) -> Self {
        let mut child = rig.start(arguments);
        let said = lines_of(child.stdout.take().unwrap());
        let log = lines_of(child.stderr.take().unwrap());
        Self { child: Some(child), said, log }
    }

    fn child(&self) -> &Child {
        self.child.as_ref().unwrap()
    }

    fn line(&self) -> String {
        self.said.recv_timeout(PATIENCE).unwrap_or_else(|error| {
            panic!("it says nothing ({error}), but: {:#?}", self.log.try_iter().collect::<Vec<_>>())
        })
    }

    /// Waits for the verdict on a casing.
    fn verdict(&self) -> Value {
        let verdict: Value = serde_json::from_str(&self.line()).unwrap();
        assert_eq!(verdict["kind"], "verdict", "{verdict}");
        verdict
    }

    /// Waits for as many verdicts.
    fn verdicts(&self, count: usize) -> Vec<Value> {
        (0..count).map(|_| self.verdict()).collect()
    }

    fn signal(&self, which: Signal) {
        signal(i32::try_from(self.child().id()).unwrap(), which);
    }

    /// Waits for the end, which must be with `code`; what was said and not heard yet, and the log.
    fn finish(mut self, code: i32) -> (Vec<String>, String) {
        let (mut said, since) = (Vec::new(), Instant::now());
        loop {
            match self.said.recv_timeout(PATIENCE.saturating_sub(since.elapsed())) {
                Ok(line) => said.push(line),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => panic!("it does not end"),
            }
        }
        let status = self.child.take().unwrap().wait().unwrap();
        let log = self.log.iter().collect::<Vec<_>>().join("\n");
        assert_eq!(status.code(), Some(code), "{said:?}\n{log}");
        assert!(!log.contains("panicked"), "{log}");
        (said, log)
    }

    /// Ends it as Ctrl-C does.
    fn interrupt(self, code: i32) -> (Vec<String>, String) {
        self.signal(Signal::INT);
        self.finish(code)
    }
}

/// The lines that come from a pipe.
fn lines_of(pipe: impl std::io::Read + Send + 'static) -> Receiver<String> {
    let (tell, lines) = bounded(10_000);
    let listen = move || BufReader::new(pipe).lines().map_while(Result::ok).try_for_each(|line| tell.send(line));
    std::thread::Builder::new().name("pipe".to_owned()).spawn(listen).unwrap();
    lines
}

/// Waits until it is so.
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < PATIENCE, "never: {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn file_of(verdict: &Value) -> PathBuf {
    PathBuf::from(verdict["file"].as_str().unwrap())
}

/// The finished files in all folders of days.
fn all_finished(out: &Path) -> Vec<String> {
    let days = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path());
    let is_day = |path: &PathBuf| path.is_dir() && path.file_name().unwrap().as_encoded_bytes()[0].is_ascii_digit();
    let mut names: Vec<String> = days.filter(is_day).flat_map(|day| finished(&day).into_keys()).collect();
    names.sort();
    names
}

/// Tap sets in the folder `sets`, and what a line must make of them: `A` is cracked, `B` sound.
fn tap_sets(rig: &Rig) -> BTreeMap<String, Contents> {
    let crack = "crack = [{ shoulder = 2, first_location = 10, location_count = 4, depth_mm = 6.0 }]";
    let tyres = format!("[[scan.tyre]]\nserial = \"A\"\n{crack}\n[[scan.tyre]]\nserial = \"B\"\n");
    rig.write("scan.toml", &format!("{SCAN}{tyres}"));
    rig.run("run --config scan.toml --out made").expect(0);
    fs::create_dir(rig.path("sets")).unwrap();
    for casing in ["A", "B"] {
        rig.run(&format!("export made/{casing}.h5 taps --out sets/{casing}")).expect(0);
    }
    casings(&rig.path("made")).into_iter().map(|(name, contents)| (name, as_from_a_tap_set(contents))).collect()
}

fn assert_made(verdict: &Value, made: &BTreeMap<String, Contents>) {
    let file = file_of(verdict);
    assert_same(&contents(&file), &made[verdict["casing"].as_str().unwrap()]);
    assert!(verify(&file).unwrap().is_complete());
}

/// Catches a verdict that waits for another casing, a file that cannot be opened while the line runs, a set that is left
/// where it was, and one that cannot be read and ends the line.
#[test]
fn tap_sets_that_are_moved_into_a_folder_are_judged() {
    let rig = Rig::new();
    let made = tap_sets(&rig);
    rig.write("plant.toml", &format!("{ROOM}[[station]]\nnumber = 1\nsource = \"folder\"\nfolder = \"inbox\"\n"));
    let line = Running::start(&rig, "line --config plant.toml --out out --json");
    until("the inbox is made", || rig.path("inbox/failed").is_dir());

    fs::rename(rig.path("sets/A"), rig.path("inbox/A")).unwrap();
    let moved = Instant::now();
    let first = line.verdict();
    eprintln!("the verdict came {:.2} s after the set", moved.elapsed().as_secs_f64());
    assert_eq!((&first["casing"], &first["verdict"], &first["station"]), (&"A".into(), &"REJECT".into(), &1.into()));
    assert_eq!((&first["archived"], &first["refused"], &first["missing"]), (&50.into(), &0.into(), &0.into()));
    assert_eq!(first["shoulders"][1]["verdict"], "REJECT", "{first}");
    assert_made(&first, &made);
    let file = file_of(&first);
    assert!(file.is_absolute() && file.parent().unwrap().parent() == Some(&rig.path("out")), "{file:?}");
    if let Some(python) = tapline_testing::python_with("hdf5plugin, h5py") {
        let script = "import hdf5plugin, h5py, sys\nprint((h5py.File(sys.argv[1])['plan']['grown_to'] > 0).sum())";
        let done = Command::new(python).args(["-c", script]).arg(&file).output().unwrap();
        assert_eq!(String::from_utf8_lossy(&done.stdout).trim(), "50", "{done:?}");
    }
    rig.run(&format!("export {} verdicts", file.display())).expect(0);
    until("the set is done", || rig.path("inbox/done/A/taps.csv").is_file() && !rig.path("inbox/A").exists());

    // What cannot be read is put aside with the reason, and another set comes all the same.
    fs::create_dir_all(rig.path("sets/bad")).unwrap();
    rig.write("sets/bad/scan.toml", "geometry = \"ring\"\n");
    rig.write("sets/bad/taps.csv", "file\n");
    fs::rename(rig.path("sets/bad"), rig.path("inbox/bad")).unwrap();
    until("the bad set is put aside", || rig.path("inbox/failed/bad/reason.txt").is_file());
    assert!(fs::read_to_string(rig.path("inbox/failed/bad/reason.txt")).unwrap().contains("scan.toml"));
    fs::rename(rig.path("sets/B"), rig.path("inbox/B")).unwrap();
    let second = line.verdict();
    assert_eq!((&second["casing"], &second["verdict"]), (&"B".into(), &"PASS".into()));
    assert_made(&second, &made);
    until("the set is done", || rig.path("inbox/done/B").is_dir());

    // The very same set once more is done already: its recordings were judged.
    let (said, log) = line.interrupt(0);
    assert!(said.is_empty() && log.contains("bad"), "{said:?} {log}");
    assert_eq!(all_finished(&rig.path("out")), ["A", "B"]);
    assert!(under_way(&rig.path("out")).is_empty() && rig.left().is_empty());
}

/// Starts a rig; the configuration of a line with its station.
fn rig_and_plant(rig: &Rig, script: &str, more: &str) -> Running {
    rig.write("rig.toml", script);
    let machine = Running::start(rig, "rig --listen 127.0.0.1:0 --config rig.toml");
    let address = machine.line().strip_prefix("listening at ").unwrap().to_owned();
    let station = format!("[[station]]\nnumber = 1\nsource = \"rig\"\nrig = \"{address}\"\n");
    rig.write("plant.toml", &format!("{SCAN}[simulation]\nsample_count = 4096\n{more}\n{station}"));
    machine
}

/// Of the rig's report a number.
fn reported(report: &str, what: &str) -> usize {
    let (_, rest) = report.split_once(&format!("{what}: ")).unwrap();
    rest.split([',', ' ']).next().unwrap().parse().unwrap()
}

/// Catches a serial that cannot be read or came before and holds up the line or replaces a file, and taps that are lost or
/// made twice where the rig was switched off in the middle of each casing.
#[test]
fn a_rig_that_is_switched_off_and_on_loses_nothing() {
    let rig = Rig::new();
    let script = "casings = 4\nserials = [\"R-1\", \"?\", \"R-1\", \"R 2\"]\nswitched_off = 1.0\noff_s = [0.05, 0.2]\n";
    let machine = rig_and_plant(&rig, script, "");
    // Nobody knows whether a casing without a serial is the same as before: it counts as two.
    let line = Running::start(&rig, "line --config plant.toml --out out --json --casings 5");
    let verdicts = line.verdicts(5);
    line.finish(0);
    let (report, _) = machine.interrupt(0);
    assert_eq!(reported(&report[0], "switched_off"), 4, "{report:?}");
    let names: Vec<&str> = verdicts.iter().map(|verdict| verdict["casing"].as_str().unwrap()).collect();
    assert!(names[1..3].iter().all(|name| name.starts_with("unknown-1-")) && names[1] != names[2], "{names:?}");
    assert_eq!([names[0], names[3], names[4]], ["R-1", "R-1", "R 2"]);
    for (k, verdict) in verdicts.iter().enumerate() {
        if k == 1 {
            assert!(verdict["refused"] != 0 && verdict["verdict"] == "RE-INSPECT", "{verdict}");
            continue;
        }
        assert_eq!(
            (&verdict["archived"], &verdict["refused"], &verdict["missing"]),
            (&50.into(), &0.into(), &0.into())
        );
        assert!(verify(file_of(verdict)).unwrap().is_complete(), "{verdict}");
    }
    let mut expected = vec!["R%202", "R-1", "R-1.2", names[1], names[2]];
    expected.sort_unstable();
    assert_eq!(all_finished(&rig.path("out")), expected);
    assert_ne!(file_of(&verdicts[0]), file_of(&verdicts[3]));
    // Every casing is known at the rig to be done, or the next line would tap it again.
    assert_eq!(reported(&report[0], "closed"), 4, "{report:?}");
}

/// Catches a casing that was taken away half done and is passed, waited for, or in the way of the next.
#[test]
fn a_casing_that_is_taken_away_is_inspected_again() {
    let rig = Rig::new();
    let machine = rig_and_plant(&rig, "casings = 6\nremoved = 0.5\nseed = 4\n", "");
    let line = Running::start(&rig, "line --config plant.toml --out out --json --casings 6");
    let verdicts = line.verdicts(6);
    line.finish(0);
    let (report, _) = machine.interrupt(0);
    let removed = reported(&report[0], "removed");
    assert!((1..6).contains(&removed), "{report:?}");
    let (cut, whole): (Vec<_>, Vec<_>) = verdicts.iter().partition(|verdict| verdict["refused"] != 0);
    assert_eq!(cut.len(), removed, "{report:?}");
    for verdict in cut {
        assert_eq!(verdict["verdict"], "RE-INSPECT", "{verdict}");
        assert_eq!(verdict["archived"].as_u64().unwrap() + verdict["refused"].as_u64().unwrap(), 50, "{verdict}");
        let shoulders = verdict["shoulders"].as_array().unwrap();
        assert!(shoulders.iter().any(|s| s["reasons"].as_str().unwrap().contains("taps_refused")), "{verdict}");
        let reader = Reader::open(file_of(verdict)).unwrap();
        let refusals = reader.refusals().unwrap();
        assert_eq!(refusals.len(), reader.ledger().count(TapState::Refused));
        assert!(refusals.iter().all(|refusal| !refusal.reason.is_empty()), "{refusals:?}");
    }
    for verdict in whole {
        assert_eq!(verdict["archived"], 50, "{verdict}");
    }
    let names: Vec<String> = (1..=6).map(|k| format!("RIG-{k}")).collect();
    assert_eq!(all_finished(&rig.path("out")), names);
}

/// Two stations that take 50 taps for a casing.
fn slow_plant(rig: &Rig, casings_each: u32, taps_per_s: f64, more: &str) {
    let station = |n: u32| format!("[[station]]\nnumber = {n}\nsource = \"simulated\"\ncasings = {casings_each}\n");
    let head = format!("{SCAN}[simulation]\nsample_count = 4096\n[acquire]\ntaps_per_s = {taps_per_s}\n{more}\n");
    rig.write("plant.toml", &format!("{head}{}{}", station(1), station(2)));
}

/// Catches a status that is none, or of another line; and one who looks on, or is frozen looking on, and is waited for.
#[test]
fn who_looks_on_changes_nothing() {
    let rig = Rig::new();
    slow_plant(&rig, 2, 20.0, "");
    let start = |out: &str| Running::start(&rig, &format!("line --config plant.toml --out {out} --json --casings 4"));
    let alone = start("alone");
    alone.verdicts(4);
    alone.finish(0);
    let refused = rig.run("status --out alone --json").expect(1);
    assert!(refused.err.contains("no line runs on alone"), "{refused:?}");

    let line = start("watched");
    stage(line.child(), "acquire-0");
    let mut frozen = rig.start("status --out watched --follow --json");
    let mut shown = BufReader::new(frozen.stdout.take().unwrap()).lines();
    let first: Value = serde_json::from_str(&shown.next().unwrap().unwrap()).unwrap();
    assert_eq!(first["pid"], line.child().id());
    signal(i32::try_from(frozen.id()).unwrap(), Signal::STOP);
    let mut statuses: Vec<Value> = Vec::new();
    let mut verdicts = Vec::new();
    while verdicts.len() < 4 {
        if let Ok(said) = line.said.recv_timeout(Duration::from_millis(150)) {
            verdicts.push(serde_json::from_str::<Value>(&said).unwrap());
        } else if verdicts.len() < 3 {
            statuses.push(rig.run("status --out watched --json").json(0));
        }
    }
    line.finish(0);
    signal(i32::try_from(frozen.id()).unwrap(), Signal::CONT);
    let done = frozen.wait_with_output().unwrap();
    assert!(done.status.success(), "{done:?}");

    assert!(statuses.len() >= 4, "{}", statuses.len());
    let counts = |status: &Value| -> Vec<(String, u64, u64)> {
        let stations = status["stations"].as_array().unwrap().iter().filter(|station| !station["casing"].is_null());
        let of = |casing: &Value| {
            let number = |key: &str| casing[key].as_u64().unwrap();
            (casing["name"].as_str().unwrap().to_owned(), number("planned"), number("archived"))
        };
        stations.map(|station| of(&station["casing"])).collect()
    };
    let seen: Vec<_> = statuses.iter().flat_map(counts).collect();
    assert!(
        seen.iter().all(|(name, planned, archived)| name.starts_with('S') && *planned == 50 && archived <= planned)
    );
    assert!(seen.iter().any(|&(_, _, archived)| archived > 0 && archived < 50), "{seen:?}");
    let last = statuses.last().unwrap();
    assert_eq!(last["stations"].as_array().unwrap().len(), 2, "{last}");
    assert!(last["taps_per_s"].as_f64().unwrap() > 0.0 && last["alarms"].as_array().unwrap().is_empty(), "{last}");
    assert!(statuses.iter().any(|status| !status["verdicts"].as_array().unwrap().is_empty()));
    for status in &statuses {
        let stages = status["stages"].as_array().unwrap();
        assert!(stages.len() >= 4 && stages.iter().all(|stage| stage["restarts"] == 0), "{status}");
        assert_eq!((&status["lost_count"], &status["is_held"]), (&0.into(), &false.into()));
    }
    let alone = rig.path("alone");
    for verdict in &verdicts {
        let file = file_of(verdict);
        let there = alone.join(file.strip_prefix(rig.path("watched")).unwrap());
        assert_same(&contents(&file), &contents(&there));
    }
    assert_eq!(all_finished(&rig.path("watched")), all_finished(&alone));
}

/// Catches a command that is run twice for a casing, or not, or without what it is to know; and one that fails and ends
/// something.
#[test]
fn a_command_is_run_at_each_verdict() {
    let rig = Rig::new();
    let ran = rig.path("ran.txt");
    let command = format!(
        "read -r line; echo \"$TAPLINE_CASING $TAPLINE_VERDICT $TAPLINE_STATION $TAPLINE_FILE $line\" >> {}; exit 1",
        ran.display()
    );
    slow_plant(&rig, 2, 50.0, &format!("[line]\non_verdict = '''{command}'''\n"));
    let line = Running::start(&rig, "line --config plant.toml --out out --json --casings 4");
    let verdicts = line.verdicts(4);
    let (_, log) = line.finish(0);
    assert!(log.contains("on_verdict failed"), "{log}");
    let told = fs::read_to_string(ran).unwrap();
    assert_eq!(told.lines().count(), 4, "{told}");
    for (told, verdict) in told.lines().zip(&verdicts) {
        let mut words = told.splitn(5, ' ');
        for key in ["casing", "verdict", "station", "file"] {
            assert_eq!(words.next().unwrap(), verdict[key].to_string().trim_matches('"'), "{told}");
        }
        assert_eq!(serde_json::from_str::<Value>(words.next().unwrap()).unwrap(), *verdict);
    }
}

/// Catches a casing that is lost, judged twice or begun anew after the line was killed in the middle of it.
#[test]
fn a_killed_line_goes_on_with_what_was_under_way() {
    let rig = Rig::new();
    let made = tap_sets(&rig);
    let station = "[[station]]\nnumber = 1\nsource = \"folder\"\nfolder = \"inbox\"\n";
    rig.write("plant.toml", &format!("{ROOM}[acquire]\ntaps_per_s = 40.0\n{station}"));
    for casing in ["A", "B"] {
        fs::create_dir_all(rig.path("inbox")).unwrap();
        fs::rename(rig.path("sets").join(casing), rig.path("inbox").join(casing)).unwrap();
    }
    let mut verdicts = Vec::new();
    let mut archived = 0;
    // In the middle of the first, and of the second.
    for casing in ["A", "B"] {
        let line = Running::start(&rig, "line --config plant.toml --out out --json");
        until("the casing is half tapped", || {
            verdicts.extend(line.said.try_iter().map(|said| serde_json::from_str::<Value>(&said).unwrap()));
            let status = rig.run("status --out out --json");
            let status: Value = serde_json::from_str(status.out.trim()).unwrap_or_default();
            let of = &status["stations"][0]["casing"];
            archived = of["archived"].as_u64().unwrap_or(0);
            of["name"] == casing && archived > 10 && archived < 40
        });
        line.signal(Signal::KILL);
        // Whatever was said, is heard.
        verdicts.extend(line.said.iter().map(|said| serde_json::from_str::<Value>(&said).unwrap()));
        drop(line);
        let open = under_way(&rig.path("out"));
        assert!(open.len() == 1 && open[0].file_name().unwrap().to_str().unwrap().starts_with(casing), "{open:?}");
    }
    let line = Running::start(&rig, "line --config plant.toml --out out --json");
    until("the sets are done", || rig.path("inbox/done/A").is_dir() && rig.path("inbox/done/B").is_dir());
    let (said, log) = line.interrupt(0);
    verdicts.extend(said.iter().map(|said| serde_json::from_str::<Value>(said).unwrap()));
    let names: Vec<&str> = verdicts.iter().map(|verdict| verdict["casing"].as_str().unwrap()).collect();
    assert_eq!(names, ["A", "B"], "{log}");
    verdicts.iter().for_each(|verdict| assert_made(verdict, &made));
    assert_eq!(all_finished(&rig.path("out")), ["A", "B"]);
    assert!(under_way(&rig.path("out")).is_empty() && !rig.path("out/left").exists() && rig.left().is_empty());
}

/// Catches a stage whose death a line does not outlive, or that costs a tap of the casings under way.
#[test]
fn stages_are_killed_while_casings_come() {
    let rig = Rig::new();
    slow_plant(&rig, 3, 50.0, "");
    let start = |out: &str| Running::start(&rig, &format!("line --config plant.toml --out {out} --json --casings 6"));
    let line = start("undisturbed");
    line.verdicts(6);
    line.finish(0);
    let line = start("killed");
    for victim in ["process", "store", "fuse", "acquire-0", "store"] {
        std::thread::sleep(Duration::from_millis(400));
        signal(stage(line.child(), victim), Signal::KILL);
    }
    let verdicts = line.verdicts(6);
    let (said, _) = line.finish(0);
    assert!(said.is_empty(), "{said:?}");
    for verdict in &verdicts {
        let file = file_of(verdict);
        let there = rig.path("undisturbed").join(file.strip_prefix(rig.path("killed")).unwrap());
        assert_same(&contents(&file), &contents(&there));
    }
    assert_eq!(all_finished(&rig.path("killed")), all_finished(&rig.path("undisturbed")));
    assert!(under_way(&rig.path("killed")).is_empty() && rig.left().is_empty());
}

/// What a stage takes.
#[derive(Debug, Clone, Copy, Default)]
struct Takes {
    resident_kb: usize,
    descriptors: usize,
    threads: usize,
}

/// What each process of the line takes, by its name, and the line's files in shared memory.
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
    // Names of a line's shared memory begin with that of its folder, which every stage is given.
    let maps = fs::read_to_string(format!("/proc/{}/maps", line.id())).unwrap();
    let name = maps.lines().find_map(|line| line.split_once("/dev/shm/").map(|(_, name)| name.to_owned())).unwrap();
    let prefix: String = name.splitn(3, '_').take(2).collect::<Vec<_>>().join("_");
    let files = fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    (taken, files.filter(|file| file.starts_with(&prefix)).collect())
}

/// Catches whatever grows with the number of casings: memory, descriptors, threads, shared memory.
#[test]
fn two_hundred_casings_leave_no_trace() {
    /// What resident memory may waver by, in kB: a casing's taps, discriminators and file, and the allocator's habits.
    const WAVERS_KB: usize = 3_000;
    let rig = Rig::new();
    let station = |n: u32| format!("[[station]]\nnumber = {n}\nsource = \"simulated\"\n");
    let scan =
        "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.85]\nrepetitions = 1\nlocations = 6\nshoulders = 1\n";
    rig.write("plant.toml", &format!("{scan}[simulation]\nsample_count = 1024\n{}{}", station(1), station(2)));
    let line = Running::start(&rig, "line --config plant.toml --out out --json --casings 200");
    let mut verdicts = line.verdicts(60);
    let (before, shared_before) = taken(line.child());
    verdicts.extend(line.verdicts(130));
    let (after, shared_after) = taken(line.child());
    verdicts.extend(line.verdicts(10));
    let (more, _) = line.finish(0);
    // Those that were under way at the end may have been closed too.
    assert!(more.len() <= 4, "{more:?}");
    let files: BTreeSet<PathBuf> = verdicts.iter().map(file_of).collect();
    assert_eq!(files.len(), 200);
    assert!(verdicts.iter().all(|verdict| verdict["archived"] == 7), "{:?}", verdicts[0]);
    assert!(before.len() >= 5 && before.keys().eq(after.keys()), "{before:?} {after:?}");
    for (name, was) in &before {
        let is = after[name];
        eprintln!("{name}: {was:?}, and 130 casings later {is:?}");
        assert!(is.resident_kb <= was.resident_kb + WAVERS_KB, "{name}: {was:?} {is:?}");
        // A file that is being opened or closed just then.
        assert!(is.descriptors <= was.descriptors + 8, "{name}: {was:?} {is:?}");
        assert!(is.threads <= was.threads + 1, "{name}: {was:?} {is:?}");
    }
    assert_eq!(shared_before, shared_after);
    assert!(shared_before.len() > 4, "{shared_before:?}");
    assert!(rig.left().is_empty());
}

/// Catches files under way that are put aside because of a comment, a hook or a station that was added since.
#[test]
fn a_line_goes_on_after_its_configuration_was_edited() {
    let rig = Rig::new();
    slow_plant(&rig, 1, 40.0, "");
    let line = Running::start(&rig, "line --config plant.toml --out out --json");
    until("a casing is half tapped", || {
        let status = rig.run("status --out out --json");
        let status: Value = serde_json::from_str(status.out.trim()).unwrap_or_default();
        status["stations"][0]["casing"]["archived"].as_u64().is_some_and(|archived| archived > 10)
    });
    line.interrupt(0);
    assert_eq!(under_way(&rig.path("out")).len(), 2);
    let text = fs::read_to_string(rig.path("plant.toml")).unwrap();
    rig.write("plant.toml", &format!("# Monday\n{text}\n[line]\non_verdict = \"true\"\n"));
    let line = Running::start(&rig, "line --config plant.toml --out out --json --casings 2");
    for verdict in line.verdicts(2) {
        assert_eq!((&verdict["archived"], &verdict["missing"]), (&50.into(), &0.into()), "{verdict}");
    }
    line.finish(0);
    assert!(under_way(&rig.path("out")).is_empty() && !rig.path("out/left").exists());
}

/// Catches a line that ends because nobody hears its verdicts any more.
#[test]
fn a_line_whose_reader_has_gone_goes_on() {
    let rig = Rig::new();
    slow_plant(&rig, 2, 200.0, "");
    let mut child = rig.start("line --config plant.toml --out out --json");
    drop(child.stdout.take());
    let log = lines_of(child.stderr.take().unwrap());
    until("all casings have their files", || rig.path("out").is_dir() && all_finished(&rig.path("out")).len() == 4);
    let status = rig.run("status --out out --json").json(0);
    assert!(status["alarms"].to_string().contains("could not be printed"), "{status}");
    signal(i32::try_from(child.id()).unwrap(), Signal::INT);
    let ended = child.wait().unwrap();
    assert!(ended.success(), "{:#?}", log.iter().collect::<Vec<_>>());
}

/// Catches a casing that is given up because its rig was slower to come back than `store`; and one that nobody judges
/// because its rig came back without it.
#[test]
fn a_rig_that_is_late_after_a_restart_goes_on() {
    for comes_back in [true, false] {
        let rig = Rig::new();
        let machine = rig_and_plant(&rig, "casings = 1\n", "[acquire]\ntaps_per_s = 40.0\n");
        let plant = fs::read_to_string(rig.path("plant.toml")).unwrap();
        rig.write("plant.toml", &format!("{plant}rig_patience_s = 2.0\n"));
        let line = Running::start(&rig, "line --config plant.toml --out out --json");
        until("the casing is half tapped", || {
            let status = rig.run("status --out out --json");
            let status: Value = serde_json::from_str(status.out.trim()).unwrap_or_default();
            status["stations"][0]["casing"]["archived"].as_u64().is_some_and(|archived| archived > 10)
        });
        line.signal(Signal::KILL);
        drop(line);
        drop(machine);
        let address = plant.split("rig = \"").nth(1).unwrap().split('"').next().unwrap();
        let line = Running::start(&rig, "line --config plant.toml --out out --json");
        until("the station knows what is under way", || {
            let status = rig.run("status --out out --json");
            let status: Value = serde_json::from_str(status.out.trim()).unwrap_or_default();
            !status["stations"][0]["casing"].is_null()
        });
        if comes_back {
            rig.write("rig.toml", "casings = 1\n");
            let again = Running::start(&rig, &format!("rig --listen {address} --config rig.toml"));
            let verdict = line.verdict();
            assert_eq!((&verdict["archived"], &verdict["refused"]), (&50.into(), &0.into()), "{verdict}");
            line.interrupt(0);
            drop(again);
        } else {
            let verdict = line.verdict();
            assert_eq!(verdict["verdict"], "RE-INSPECT", "{verdict}");
            assert!(verdict["refused"] != 0 && verdict["missing"] == 0, "{verdict}");
            line.interrupt(0);
        }
        assert_eq!(all_finished(&rig.path("out")), ["RIG-1"]);
    }
}

/// Catches a command that hangs, with what it has started, and keeps the line from ending; and a line that is silent about it.
#[test]
fn a_command_that_fails_is_an_alarm() {
    let rig = Rig::new();
    slow_plant(&rig, 1, 200.0, "[line]\non_verdict = \"cat > /dev/null; false\"\n");
    let line = Running::start(&rig, "line --config plant.toml --out out --json");
    line.verdicts(2);
    until("the alarm", || rig.run("status --out out --json").out.contains("on_verdict failed"));
    line.interrupt(0);
}

/// Catches taps that a failed disk has lost after they were archived, and that nobody takes again: the file under way is put
/// back to what it was a while before, as by a power cut of its disk.
#[test]
fn taps_that_a_disk_has_lost_are_taken_again() {
    let rig = Rig::new();
    rig.write("plant.toml", &format!("{SCAN}[simulation]\nsample_count = 4096\n[acquire]\ntaps_per_s = 20.0\n[[station]]\nnumber = 1\nsource = \"simulated\"\ncasings = 1\n"));
    let line = Running::start(&rig, "line --config plant.toml --out out --json --casings 1");
    let archived = || -> u64 {
        let status = rig.run("status --out out --json");
        let status: Value = serde_json::from_str(status.out.trim()).unwrap_or_default();
        status["stations"][0]["casing"]["archived"].as_u64().unwrap_or(0)
    };
    let open = || under_way(&rig.path("out"))[0].clone();
    until("some taps are archived", || archived() > 5);
    fs::copy(open(), rig.path("before.h5")).unwrap();
    // The first shoulder has 25.
    until("the second shoulder is begun", || archived() > 28);
    line.signal(Signal::STOP);
    signal(stage(line.child(), "store"), Signal::KILL);
    std::thread::sleep(Duration::from_millis(100));
    fs::copy(rig.path("before.h5"), open()).unwrap();
    line.signal(Signal::CONT);
    let verdict = line.verdict();
    assert_eq!((&verdict["archived"], &verdict["missing"]), (&50.into(), &0.into()), "{verdict}");
    line.finish(0);
    assert!(verify(file_of(&verdict)).unwrap().is_complete());
}
