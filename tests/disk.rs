//! Nothing is lost to a disk: it is full, read only, gone, slow, or the file on it is cut, moved or taken by another.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead as _, BufReader, ErrorKind};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, RecvTimeoutError, bounded};
use rustix::process::Signal;
use tapline_store::Reader;
use tapline_wire::TapState;

use crate::rig::{Contents, Done, Rig, assert_same_casings, casings, finished, signal, stage, under_way};

/// One station, 2 shoulders of 40 locations each: 82 taps, which unpacked take some 5 MB.
const SCAN: &str = "
[scan]
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 1
locations = 40
";

/// How long a line that is under way may take to say what it must: none of these tests is to hang where it ought to fail.
const PATIENCE: Duration = Duration::from_secs(60);

/// With a pace at which it lasts a second or more: what is done to the disk is done while it is under way.
fn paced() -> String {
    format!("{SCAN}\n[acquire]\ntaps_per_s = 60.0\n")
}

/// A small disk of its own, taken away when dropped.
struct Disk(PathBuf);

impl Disk {
    /// A disk of `size` in the folder `disk` of `rig`; `None`, with a notice, where none can be had.
    fn new(rig: &Rig, size: &str) -> Option<Self> {
        let disk = Self(rig.path("disk"));
        fs::create_dir(&disk.0).unwrap();
        let made = disk.mount(&format!("size={size}"), "tmpfs");
        if !made {
            tapline_testing::skip("no disk can be mounted here (it takes root)");
        }
        made.then_some(disk)
    }

    fn mount(&self, options: &str, what: &str) -> bool {
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", options, what]).arg(&self.0).stderr(Stdio::null());
        mount.status().is_ok_and(|status| status.success())
    }

    fn remount(&self, options: &str) {
        assert!(self.mount(&format!("remount,{options}"), "tmpfs"), "{options}");
    }

    /// Fills the disk but for `free_bytes`, with a file that can be removed.
    fn fill(&self, free_bytes: u64) -> PathBuf {
        let path = self.0.join("ballast");
        let disk = rustix::fs::statvfs(&self.0).unwrap();
        let bytes = disk.f_bavail * disk.f_frsize - free_bytes;
        match fs::write(&path, vec![1; usize::try_from(bytes).unwrap()]) {
            // The line has been quicker.
            Err(error) if error.kind() == ErrorKind::StorageFull => {}
            written => written.unwrap(),
        }
        path
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // What is still open there goes when it is closed.
        if let Err(error) = Command::new("umount").arg("-l").arg(&self.0).stderr(Stdio::null()).status() {
            eprintln!("{}: {error}", self.0.display());
        }
    }
}

/// A line that is running, and what it says.
struct Said {
    line: Option<Child>,
    lines: Receiver<String>,
    text: String,
}

impl Drop for Said {
    /// A test that fails leaves no line that waits for ever.
    fn drop(&mut self) {
        if let Some(mut line) = self.line.take() {
            line.kill().unwrap();
            line.wait().unwrap();
        }
    }
}

impl Said {
    fn start(rig: &Rig, arguments: &str) -> Self {
        let mut line = rig.start(arguments);
        let (said, (tell, lines)) = (BufReader::new(line.stderr.take().unwrap()).lines(), bounded(4096));
        let listen = move || said.map_while(Result::ok).try_for_each(|said| tell.send(said));
        std::thread::Builder::new().name("stderr".to_owned()).spawn(listen).unwrap();
        Self { line: Some(line), lines, text: String::new() }
    }

    fn line(&mut self) -> &mut Child {
        self.line.as_mut().unwrap()
    }

    fn interrupt(&mut self) {
        signal(self.line().id() as i32, Signal::INT);
    }

    /// Waits until the line says all of `words` in one line.
    fn wait_for(&mut self, words: &[&str]) {
        let since = Instant::now();
        loop {
            let Ok(said) = self.lines.recv_timeout(PATIENCE.saturating_sub(since.elapsed())) else {
                panic!("{words:?} was never said, but:\n{}", self.text)
            };
            self.text.push_str(&said);
            self.text.push('\n');
            if words.iter().all(|word| said.contains(word)) {
                eprintln!("{words:?} was said after {:.2} s", since.elapsed().as_secs_f64());
                return;
            }
        }
    }

    /// Waits for the end; all that was said on standard error goes into the result.
    fn finish(mut self) -> Done {
        let since = Instant::now();
        loop {
            match self.lines.recv_timeout(PATIENCE.saturating_sub(since.elapsed())) {
                Ok(said) => self.text = format!("{}{said}\n", self.text),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => panic!("the line does not end; it said:\n{}", self.text),
            }
        }
        let mut done = Done::from(self.line.take().unwrap().wait_with_output().unwrap());
        done.err = std::mem::take(&mut self.text);
        assert!(!done.err.contains("panicked"), "{}", done.err);
        done
    }
}

fn undisturbed(rig: &Rig) -> BTreeMap<String, Contents> {
    rig.write("quick.toml", SCAN);
    rig.write("paced.toml", &paced());
    rig.run("run --config quick.toml --out quick").expect(0);
    casings(&rig.path("quick"))
}

/// Every file is whole and in its place, nothing else is left, and they hold what an undisturbed run's do.
fn assert_whole(rig: &Rig, expected: &BTreeMap<String, Contents>) {
    let out = rig.path("disk/run");
    for file in finished(&out).values() {
        rig.run(&format!("verify {}", file.display())).expect(0);
    }
    assert_same_casings(&casings(&out), expected);
    let open: Vec<_> = fs::read_dir(out.join("open")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(open.is_empty(), "{open:?}");
    let ours = |name: &str| name.ends_with(".h5") || ["open", "run.toml", "left"].contains(&name);
    let beside = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let beside: Vec<String> = beside.filter(|name| !ours(name)).collect();
    assert!(beside.is_empty(), "{beside:?}");
}

/// Starts a run into `disk/run` and waits until the first taps of its first casing are on the disk; the file under way.
fn start_on_disk(rig: &Rig) -> (Said, PathBuf) {
    let mut said = Said::start(rig, "run --config paced.toml --out disk/run --json");
    let open = rig.path("disk/run/open");
    let mut first_bytes = None;
    loop {
        assert_eq!(said.line().try_wait().unwrap(), None, "the line has ended");
        if open.is_dir()
            && let Some(file) = finished(&open).into_values().next()
            && let Ok(there) = fs::metadata(&file)
            && there.len() > *first_bytes.get_or_insert(there.len()) + 100_000
        {
            return (said, file);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Starts it and fills the disk; returns once that is said.
fn start_and_fill(rig: &Rig, disk: &Disk) -> (Said, PathBuf, PathBuf) {
    let (mut said, file) = start_on_disk(rig);
    let ballast = disk.fill(200_000);
    said.wait_for(&["ERROR", "disk/run/open/SIM-0001.", "No space left", "make room"]);
    (said, ballast, file)
}

/// Catches a tap that is lost, an archive that is left damaged, or a line that gives up when the disk is full for a while.
#[test]
fn a_full_disk_is_waited_out() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let Some(disk) = Disk::new(&rig, "64m") else { return };
    let (mut said, ballast, file) = start_and_fill(&rig, &disk);
    // Let go of, it is whole for whoever reads it meanwhile: 3 is of taps that are missing.
    rig.run(&format!("verify {}", file.display())).expect(3);
    fs::remove_file(ballast).unwrap();
    said.wait_for(&["WARN", "written again"]);
    let summary = said.finish().json(0);
    assert!(summary["pace"]["restarts"] == 0 && summary["is_whole"] == true, "{summary}");
    assert_whole(&rig, &expected);
}

/// Catches a cause that changes and is not told, and a read-only disk that ends the line or is written to.
#[test]
fn a_disk_that_becomes_read_only_is_waited_out() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let Some(disk) = Disk::new(&rig, "64m") else { return };
    let (mut said, _, _) = start_and_fill(&rig, &disk);
    // No file is open there to be written, or the system would refuse; and with room the archive would be written at once.
    disk.remount("ro");
    disk.remount("ro,size=128m");
    said.wait_for(&["ERROR", "disk/run/open/SIM-0001.", "Read-only", "mount that disk"]);
    disk.remount("rw");
    said.wait_for(&["WARN", "written again"]);
    said.finish().expect(0);
    assert_whole(&rig, &expected);
}

/// Catches a line on a full disk that cannot be ended, loses what was safe, or ends as if all were well.
#[test]
fn a_line_on_a_full_disk_is_ended_in_order() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let Some(disk) = Disk::new(&rig, "64m") else { return };
    let (mut said, ballast, file) = start_and_fill(&rig, &disk);
    said.interrupt();
    let done = said.finish();
    let summary = done.json(3);
    assert!(summary["unfinished"] == 1 && summary["is_whole"] == false, "{summary}");
    assert!(!done.err.contains("is killed"), "{done:#?}");
    rig.run(&format!("verify {}", file.display())).expect(3);
    let safe = Reader::open_unfinished(&file).unwrap().ledger().count(TapState::Archived);
    fs::remove_file(ballast).unwrap();
    let summary = rig.run("run --config paced.toml --out disk/run --json").json(0);
    assert_eq!(summary["pace"]["taps"], 82 - safe, "what was safe is gone on with: {summary}");
    assert_whole(&rig, &expected);
}

/// Catches a line that gives up, or never tries again, when a full disk has no room for the next of its files.
#[test]
fn a_full_disk_holds_up_the_next_file() {
    let rig = Rig::new();
    let tyres: String = (1..=3).map(|k| format!("[[scan.tyre]]\nserial = \"T{k}\"\n")).collect();
    rig.write("quick.toml", &format!("{SCAN}{tyres}"));
    rig.write("paced.toml", &format!("{SCAN}{tyres}[acquire]\ntaps_per_s = 60.0\n"));
    rig.run("run --config quick.toml --out quick").expect(0);
    let expected = casings(&rig.path("quick"));
    let Some(disk) = Disk::new(&rig, "64m") else { return };
    let mut said = Said::start(&rig, "run --config paced.toml --out disk/run --json");
    while !rig.path("disk/run/T1.h5").is_file() {
        assert_eq!(said.line().try_wait().unwrap(), None, "the line has ended");
        std::thread::sleep(Duration::from_millis(1));
    }
    let ballast = disk.fill(300_000);
    said.wait_for(&["ERROR", "disk/run/open/T2.", "No space left", "make room"]);
    fs::remove_file(ballast).unwrap();
    said.wait_for(&["WARN", "written again"]);
    assert_eq!(said.finish().json(0)["is_whole"], true);
    assert_eq!(expected.len(), 3);
    assert_whole(&rig, &expected);
}

/// Catches a `store` killed on a full disk that does not take up the wait where it was.
#[test]
fn store_is_killed_on_a_full_disk() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let Some(disk) = Disk::new(&rig, "64m") else { return };
    let (mut said, ballast, _) = start_and_fill(&rig, &disk);
    signal(stage(said.line(), "store"), Signal::KILL);
    said.wait_for(&["store", "was killed"]);
    said.wait_for(&["ERROR", "No space left"]);
    fs::remove_file(ballast).unwrap();
    said.finish().expect(0);
    assert_whole(&rig, &expected);
}

/// Catches a casing that is begun where it cannot be without a clear word, or half begun and left there.
#[test]
fn places_where_no_archive_can_begin() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let Some(disk) = Disk::new(&rig, "16m") else { return };
    let ballast = disk.fill(60_000);
    let mut said = Said::start(&rig, "run --config paced.toml --out disk/run --json");
    said.wait_for(&["ERROR", "disk/run/open/SIM-0001.", "No space left", "make room"]);
    assert!(finished(&rig.path("disk/run")).is_empty());
    fs::remove_file(ballast).unwrap();
    assert_eq!(said.finish().json(0)["pace"]["restarts"], 0);
    assert_whole(&rig, &expected);
    fs::remove_dir_all(rig.path("disk/run")).unwrap();
    disk.remount("ro");
    let done = rig.run("run --config paced.toml --out disk/run").expect(1);
    assert!(done.err.contains("disk/run") && done.err.contains("Read-only"), "{done:#?}");
}

/// Catches taps that are lost with a file that someone removes while it is written, or removes with its folder.
#[test]
fn a_removed_archive_is_put_back() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    for is_folder in [false, true] {
        fs::create_dir(rig.path("disk")).unwrap();
        let (mut said, file) = start_on_disk(&rig);
        if is_folder {
            fs::remove_dir_all(rig.path("disk")).unwrap();
            said.wait_for(&["ERROR", "disk/run/open/SIM-0001.", "was removed"]);
            fs::create_dir_all(rig.path("disk/run/open")).unwrap();
        } else {
            fs::remove_file(file).unwrap();
            said.wait_for(&["ERROR", "disk/run/open/SIM-0001.", "was removed"]);
        }
        said.wait_for(&["WARN", "written again"]);
        said.finish().expect(0);
        assert_whole(&rig, &expected);
        fs::remove_dir_all(rig.path("disk")).unwrap();
    }
}

/// Catches a line that ends well although its file is gone for good.
#[test]
fn a_line_ended_without_its_archive_has_failed() {
    let rig = Rig::new();
    rig.write("paced.toml", &paced());
    fs::create_dir(rig.path("disk")).unwrap();
    let (mut said, _) = start_on_disk(&rig);
    fs::remove_dir_all(rig.path("disk")).unwrap();
    said.wait_for(&["ERROR", "disk/run/open/SIM-0001.", "was removed"]);
    said.interrupt();
    let done = said.finish().expect(1);
    assert!(done.err.contains("disk/run"), "{done:#?}");
}

/// Catches a file that is moved away, or another file in its place, and goes on in the dark.
#[test]
fn a_moved_or_replaced_archive_is_waited_for() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    fs::create_dir(rig.path("disk")).unwrap();
    let (mut said, file) = start_on_disk(&rig);
    let name = file.file_name().unwrap().to_str().unwrap();
    let moved = rig.path("elsewhere/run/open").join(name);
    fs::rename(rig.path("disk"), rig.path("elsewhere")).unwrap();
    said.wait_for(&["ERROR", &format!("{name} was moved"), &format!("elsewhere/run/open/{name}"), "move it back"]);
    fs::create_dir_all(rig.path("disk/run/open")).unwrap();
    fs::write(&file, "another").unwrap();
    said.wait_for(&["ERROR", &format!("{name} is another file"), &format!("elsewhere/run/open/{name}")]);
    assert_eq!(fs::read_to_string(&file).unwrap(), "another");
    fs::rename(moved, &file).unwrap();
    said.wait_for(&["WARN", "written again"]);
    said.finish().expect(0);
    assert_whole(&rig, &expected);
}

/// Catches a file that is cut while it is written and written on, or gone on with afterwards; also one that has grown again
/// by the time that is looked.
#[test]
fn a_cut_archive_is_not_gone_on_with() {
    for has_grown_again in [false, true] {
        let rig = Rig::new();
        let expected = undisturbed(&rig);
        fs::create_dir(rig.path("disk")).unwrap();
        let (mut said, path) = start_on_disk(&rig);
        // Taps that are safe are missed whatever the length says.
        std::thread::sleep(Duration::from_millis(if has_grown_again { 300 } else { 0 }));
        let file = OpenOptions::new().write(true).open(&path).unwrap();
        let bytes = file.metadata().unwrap().len();
        file.set_len(20_000).unwrap();
        if has_grown_again {
            file.set_len(2 * bytes).unwrap();
        }
        // By its length, or, where that tells nothing, by what is missing in it.
        said.wait_for(&["ERROR", "disk/run/open/SIM-0001.", "the line waits"]);
        said.interrupt();
        said.finish().expect(1);
        for (verb, codes) in [("verify", [1, 3]), ("report", [1, 1])] {
            let done = rig.run(&format!("{verb} {}", path.display()));
            assert!(done.code.is_some_and(|code| codes.contains(&code)), "{done:#?}");
            assert!(done.err.contains("SIM-0001.") || done.out.contains("NOT WHOLE"), "{done:#?}");
        }
        // The next run puts it aside, says so, and taps the casing anew.
        let done = rig.run("run --config paced.toml --out disk/run").expect(0);
        assert!(done.err.contains("put aside") && done.err.contains("disk/run/left/SIM-0001."), "{done:#?}");
        assert_eq!(finished(&rig.path("disk/run/left")).len(), 1);
        assert_whole(&rig, &expected);
    }
}

/// Catches a line that drops taps, or says nothing, while `store` hangs as on a disk that does not answer.
#[test]
fn a_store_that_hangs_is_told_of_and_waited_for() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    fs::create_dir(rig.path("disk")).unwrap();
    let (mut said, _) = start_on_disk(&rig);
    let store = stage(said.line(), "store");
    signal(store, Signal::STOP);
    said.wait_for(&["ERROR", "store does not answer", "the line waits"]);
    signal(store, Signal::CONT);
    said.wait_for(&["WARN", "store answers again"]);
    let summary = said.finish().json(0);
    assert_eq!(summary["pace"]["restarts"], 0);
    assert_whole(&rig, &expected);
}

/// Catches a second writer that gets at a file past the line's own lock.
#[test]
fn a_second_program_on_the_file_is_refused_by_name() {
    let rig = Rig::new();
    let expected = undisturbed(&rig);
    let (mut said, path) = start_on_disk(&rig);
    said.interrupt();
    said.finish().expect(3);
    assert_eq!(under_way(&rig.path("disk/run")), [path.as_path()]);
    let file = File::open(&path).unwrap();
    file.lock().unwrap();
    let done = rig.run("run --config paced.toml --out disk/run").expect(1);
    assert!(done.err.contains("SIM-0001.") && done.err.contains("is in use"), "{done:#?}");
    file.unlock().unwrap();
    rig.run("run --config paced.toml --out disk/run").expect(0);
    assert_whole(&rig, &expected);
}
