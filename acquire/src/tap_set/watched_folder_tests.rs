//! Tests of the watched folder.

use tempfile::TempDir;

use super::*;
use crate::tap_set::listed::tests::set_of;
use crate::tap_set::tests::{HEADER, SCAN};

fn watched() -> (TempDir, FolderArrivals) {
    let dir = tempfile::tempdir().unwrap();
    let folder = FolderArrivals::open(&dir.path().join("inbox"), 3).unwrap();
    (dir, folder)
}

/// Makes a set of `tyres` with one tap each and moves it into the folder.
fn deliver(dir: &TempDir, name: &str, tyres: &[&str]) {
    let rows: Vec<String> = tyres.iter().map(|tyre| format!("{tyre}.wav,{tyre},1,0,1.5,0,0,0")).collect();
    set_of(&dir.path().join("made"), &rows, SCAN);
    fs::rename(dir.path().join("made"), dir.path().join("inbox").join(name)).unwrap();
}

fn next(folder: &mut FolderArrivals) -> Option<String> {
    match folder.next().unwrap() {
        Arrival::Casing(casing) => {
            assert_eq!(casing.taps.plan().stations(), [3], "at the station of the folder");
            Some(casing.name)
        }
        Arrival::NotYet => None,
        Arrival::Ended => panic!("a watched folder never ends"),
    }
}

/// The next casing, of a set that must be found unchanged first.
fn wait_for(folder: &mut FolderArrivals) -> String {
    let since = Instant::now();
    loop {
        if let Some(name) = next(folder) {
            return name;
        }
        assert!(since.elapsed() < Duration::from_secs(30), "no casing; {}", folder.waits_for());
        sleep(Duration::from_millis(50));
    }
}

fn close(folder: &mut FolderArrivals, name: &str) {
    folder.ended(name, &CasingEnd::Closed { file: "x.h5".into(), was_there: false });
}

fn names_in(dir: &TempDir, folder: &str) -> Vec<String> {
    let entries = fs::read_dir(dir.path().join("inbox").join(folder)).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Catches two lines that share the sets of one folder.
#[test]
fn a_folder_has_one_line() {
    let (dir, folder) = watched();
    let inbox = dir.path().join("inbox");
    let refused = FolderArrivals::open(&inbox, 4).unwrap_err();
    assert!(std::error::Error::source(&refused).unwrap().to_string().contains("another line watches it"), "{refused}");
    drop(folder);
    FolderArrivals::open(&inbox, 4).unwrap();
}

/// Catches sets in the wrong order, casings left out, a set that is moved before all of its casings are done, and files that nobody says
/// are in no set.
#[test]
fn sets_come_in_order_and_are_put_aside() {
    let (dir, mut folder) = watched();
    assert_eq!(next(&mut folder), None);
    assert!(folder.waits_for().starts_with("a tap set in ") && folder.waits_for().ends_with("inbox"));
    fs::write(dir.path().join("inbox/taps.csv"), "").unwrap();
    assert_eq!(next(&mut folder), None);
    assert!(folder.waits_for().ends_with("inbox: 1 file there is in no folder of its own"), "{}", folder.waits_for());
    deliver(&dir, "b", &["B1"]);
    deliver(&dir, "a", &["A1", "A2"]);
    deliver(&dir, ".hidden", &["H"]);
    assert_eq!(next(&mut folder).as_deref(), Some("A1"));
    assert_eq!(next(&mut folder).as_deref(), Some("A2"));
    close(&mut folder, "A2");
    assert_eq!(names_in(&dir, "done"), [""; 0], "A1 is open still");
    assert_eq!(next(&mut folder).as_deref(), Some("B1"));
    close(&mut folder, "A1");
    assert_eq!(names_in(&dir, "done"), ["a"]);
    assert_eq!(names_in(&dir, "done/a"), ["A1.wav", "A2.wav", "scan.toml", "taps.csv"]);
    close(&mut folder, "B1");
    deliver(&dir, "a", &["A1"]);
    assert_eq!(next(&mut folder).as_deref(), Some("A1"), "a serial may come again");
    close(&mut folder, "A1");
    assert_eq!((names_in(&dir, "done"), next(&mut folder)), (["a", "a.2", "b"].map(str::to_owned).to_vec(), None));
}

/// Catches a set that is begun again without end because the folder for finished or for bad ones was removed.
#[test]
fn folders_that_were_removed_are_made_again() {
    let (dir, mut folder) = watched();
    deliver(&dir, "a", &["A"]);
    deliver(&dir, "b", &["B"]);
    fs::write(dir.path().join("inbox/b/scan.toml"), "geometry = 3").unwrap();
    assert_eq!(next(&mut folder).as_deref(), Some("A"));
    for folder in ["done", "failed"] {
        fs::remove_dir_all(dir.path().join("inbox").join(folder)).unwrap();
    }
    close(&mut folder, "A");
    assert_eq!(next(&mut folder), None);
    assert_eq!((names_in(&dir, "done"), names_in(&dir, "failed")), (vec!["a".to_owned()], vec!["b".to_owned()]));
}

/// Catches a station that waits for ever for somebody to write into a pipe that lies in the place of a recording.
#[test]
fn a_pipe_is_no_recording() {
    let (dir, mut folder) = watched();
    let set = dir.path().join("inbox/a");
    let rows = [0, 1].map(|location| format!("{location}.wav,A,1,0,1.5,{location},{location},0"));
    set_of(&set, &rows, SCAN);
    let recording = set.join("1.wav");
    fs::remove_file(&recording).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&recording).status().unwrap().success());
    assert_eq!(next(&mut folder).as_deref(), Some("A"));
}

/// Catches a set that belongs to another user and is taken for one whose tables are still to come.
#[test]
fn a_set_that_may_not_be_read_is_an_alarm() {
    let (dir, mut folder) = watched();
    deliver(&dir, "a", &["A"]);
    // A link to itself cannot be followed, not even by root, whom permissions do not keep out.
    let set = dir.path().join("inbox/a");
    fs::remove_file(set.join("scan.toml")).unwrap();
    std::os::unix::fs::symlink("scan.toml", set.join("scan.toml")).unwrap();
    assert_eq!(next(&mut folder), None);
    assert_eq!(next(&mut folder), None);
    assert!(folder.waits_for().starts_with("the tap set ") && folder.waits_for().contains("inbox/a: "));
    let messages = folder.take_messages();
    let [(RecordKind::Refusal, refusal)] = &messages[..] else { panic!("{messages:?}") };
    assert!(refusal.starts_with("tap set a cannot be read: "), "{refusal}");
    assert!(folder.is_blind(), "a half-judged casing of it is not gone");
}

/// Catches a folder that cannot be watched, and a message that does not name it.
#[test]
fn a_file_is_no_folder_to_watch() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("inbox");
    fs::write(&file, "").unwrap();
    let error = FolderArrivals::open(&file, 3).unwrap_err().to_string();
    assert!(
        error.starts_with("station 3 cannot watch its folder: ") && error.contains("inbox cannot be made: File exists"),
        "{error}"
    );
}

/// Catches a bad set that stops the station, is tried again, or is moved without its reason; and an incomplete set that
/// is begun.
#[test]
fn bad_sets_are_put_aside_and_half_ones_waited_for() {
    let (dir, mut folder) = watched();
    let inbox = dir.path().join("inbox");
    deliver(&dir, "a", &["A"]);
    fs::write(inbox.join("a/scan.toml"), "geometry = 3").unwrap();
    fs::create_dir(inbox.join("b")).unwrap();
    fs::write(inbox.join("b/taps.csv"), "file\n").unwrap();
    fs::write(inbox.join("file"), "").unwrap();
    std::os::unix::fs::symlink("/", inbox.join("c")).unwrap();
    deliver(&dir, "d", &["D"]);
    assert_eq!(next(&mut folder).as_deref(), Some("D"));
    assert_eq!(names_in(&dir, "failed"), ["a"]);
    let reason = fs::read_to_string(inbox.join("failed/a").join(REASON)).unwrap();
    assert!(reason.starts_with("scan.toml: missing field `channels`"), "{reason}");
    close(&mut folder, "D");
    assert_eq!(next(&mut folder), None);
    assert!(folder.waits_for().starts_with("scan.toml in ") && folder.waits_for().ends_with("inbox/b"));
    for name in ["e", "f"] {
        fs::create_dir(inbox.join(name)).unwrap();
    }
    assert_eq!(next(&mut folder), None);
    assert!(folder.waits_for().ends_with("inbox/b; 2 other sets are incomplete too"), "{}", folder.waits_for());
    for name in ["b", "e", "f"] {
        fs::remove_dir_all(inbox.join(name)).unwrap();
    }
    assert_eq!(next(&mut folder), None);
    deliver(&dir, "b", &["B"]);
    fs::create_dir(inbox.join("away")).unwrap();
    assert_eq!(next(&mut folder).as_deref(), Some("B"));
    folder.ended("B", &CasingEnd::Refused { reason: "too large".to_owned() });
    assert_eq!(names_in(&dir, "failed"), ["a", "b"]);
    assert_eq!(fs::read_to_string(inbox.join("failed/b").join(REASON)).unwrap(), "B: too large\n");
    set_of(&inbox.join("g"), &["../away/X.wav,X,1,0,1.5,0,0,0".to_owned()], SCAN);
    fs::remove_dir_all(inbox.join("away")).unwrap();
    assert_eq!(next(&mut folder), None, "a recording elsewhere is not waited for");
    assert!(fs::read_to_string(inbox.join("failed/g").join(REASON)).unwrap().contains("without '..'"));
}

/// Catches a set that is judged while it is copied: its recordings that are still to come would all be refused, and one that is half
/// written. And one that waits for the recording of a refused tap, and one that comes as a whole and is looked at twice.
#[test]
fn a_set_that_is_copied_is_waited_for() {
    let (dir, mut folder) = watched();
    let (made, set) = (dir.path().join("made"), dir.path().join("inbox/a"));
    let rows: Vec<String> = (0..3).map(|k| format!("A-{k}.wav,A,1,0,1.5,{k},{k},0,")).collect();
    set_of(&made, &rows, SCAN);
    let header = HEADER.replace("repetition", "repetition,refused");
    let list = format!("{header}{}\nA-3.wav,A,1,0,1.5,3,3,0,no wire\n", rows.join("\n"));
    fs::create_dir(&set).unwrap();
    fs::copy(made.join("scan.toml"), set.join("scan.toml")).unwrap();
    fs::write(set.join("taps.csv"), list).unwrap();
    assert_eq!(next(&mut folder), None);
    assert!(folder.waits_for().starts_with("A-0.wav and 2 more recordings in "), "{}", folder.waits_for());
    assert!(folder.waits_for().ends_with("inbox/a"), "{}", folder.waits_for());
    for file in ["A-2.wav", "A-0.wav"] {
        fs::copy(made.join(file), set.join(file)).unwrap();
    }
    until(&mut folder, |waits_for| waits_for.starts_with("A-1.wav in "));
    // It is there, and grows.
    let whole = fs::read(made.join("A-1.wav")).unwrap();
    fs::write(set.join("A-1.wav"), &whole[..50]).unwrap();
    until(&mut folder, |waits_for| waits_for.ends_with("inbox/a, which is still being written"));
    fs::write(set.join("A-1.wav"), &whole).unwrap();
    deliver(&dir, "b", &["B"]);
    assert_eq!(next(&mut folder).as_deref(), Some("B"), "it waits for nothing, and not behind another");
    assert_eq!(wait_for(&mut folder), "A");
    assert_eq!(folder.take_messages(), []);
}

/// Asks for casings, of which none comes, until the folder `waits_for` that.
fn until(folder: &mut FolderArrivals, waits_for: impl Fn(&str) -> bool) {
    let since = Instant::now();
    while !waits_for(&folder.waits_for()) {
        assert!(since.elapsed() < Duration::from_secs(30), "{}", folder.waits_for());
        assert_eq!(next(folder), None);
        sleep(Duration::from_millis(50));
    }
}

/// Catches a set whose last file never comes, and of which nobody hears; an alarm that comes at once, or again and again, or that is
/// never over; and a list that a terminal would obey.
#[test]
fn a_set_that_stays_incomplete_is_an_alarm() {
    let (dir, mut folder) = watched();
    let look = |folder: &mut FolderArrivals, age: Duration| {
        for half in folder.half.values_mut() {
            half.looked_at = half.looked_at.checked_sub(LOOK_AT_LEAST).unwrap();
            half.since = half.since.checked_sub(age).unwrap();
        }
        (next(folder), folder.take_messages())
    };
    deliver(&dir, "a", &["A", "B"]);
    let recording = dir.path().join("inbox/a/B.wav");
    let away = dir.path().join("B.wav");
    fs::rename(&recording, &away).unwrap();
    fs::create_dir(dir.path().join("inbox/b")).unwrap();
    let list = format!("{HEADER}\"\u{1b}[31m\nX.wav\",B,1,0,1.5,0,0,0\n");
    fs::write(dir.path().join("inbox/b/taps.csv"), list).unwrap();
    fs::write(dir.path().join("inbox/b/scan.toml"), SCAN).unwrap();
    assert_eq!(look(&mut folder, Duration::ZERO), (None, vec![]));
    let alarm = |text: &str| (RecordKind::Alarm, text.to_owned());
    let both = "tap set a is not judged: it waits for B.wav; another set waits too";
    assert_eq!(look(&mut folder, ALARM_AFTER), (None, vec![alarm(both)]));
    assert_eq!(look(&mut folder, ALARM_AFTER), (None, vec![]));
    fs::rename(dir.path().join("inbox/a"), dir.path().join("a")).unwrap();
    let last = "tap set b is not judged: it waits for \\u{1b}[31m\\nX.wav";
    assert_eq!(look(&mut folder, ALARM_AFTER), (None, vec![alarm(&format!("{OVER}{both}")), alarm(last)]));
    fs::remove_dir_all(dir.path().join("inbox/b")).unwrap();
    fs::rename(dir.path().join("a"), dir.path().join("inbox/a")).unwrap();
    assert_eq!(look(&mut folder, Duration::ZERO), (None, vec![alarm(&format!("{OVER}{last}"))]));
    fs::rename(&away, &recording).unwrap();
    assert_eq!(look(&mut folder, Duration::ZERO), (None, vec![]), "it has changed");
    assert_eq!(look(&mut folder, Duration::ZERO), (Some("A".to_owned()), vec![]));
}

/// Catches sets that an earlier line has put aside, and that nobody hears of again; and an alarm where there are none.
#[test]
fn sets_that_failed_before_are_an_alarm_at_the_start() {
    let (dir, mut folder) = watched();
    assert_eq!(folder.take_messages(), []);
    drop(folder);
    let inbox = dir.path().join("inbox");
    for (name, want) in
        [("a", "1 tap set is in *: its reason.txt says why"), ("b", "2 tap sets are in *: reason.txt in each says why")]
    {
        fs::create_dir(inbox.join("failed").join(name)).unwrap();
        let want = want.replace('*', &inbox.join("failed").display().to_string());
        let mut folder = FolderArrivals::open(&inbox, 3).unwrap();
        assert_eq!(folder.take_messages(), [(RecordKind::Alarm, want.clone())]);
        assert_eq!((next(&mut folder), folder.take_messages()), (None, vec![]));
        if name == "b" {
            // Somebody has looked after them.
            ["a", "b"].iter().for_each(|set| fs::remove_dir(inbox.join("failed").join(set)).unwrap());
            let over = (RecordKind::Alarm, format!("{OVER}{want}"));
            assert_eq!((next(&mut folder), folder.take_messages()), (None, vec![over]));
        }
    }
}

/// Catches a set that is put aside as refused while it is judged, because a later one has a casing of the same name that is too large.
#[test]
fn the_casing_that_came_last_is_the_refused_one() {
    let (dir, mut folder) = watched();
    deliver(&dir, "1", &["A"]);
    deliver(&dir, "2", &["A"]);
    assert_eq!((next(&mut folder).as_deref(), next(&mut folder).as_deref()), (Some("A"), Some("A")));
    folder.ended("A", &CasingEnd::Refused { reason: "too large".to_owned() });
    close(&mut folder, "A");
    assert_eq!((names_in(&dir, "done"), names_in(&dir, "failed")), (vec!["1".to_owned()], vec!["2".to_owned()]));
}

/// Catches a restarted line that leaves out a set, or repeats casings that were done.
#[test]
fn half_done_sets_are_found_again() {
    let (dir, mut folder) = watched();
    deliver(&dir, "a", &["A1", "A2", "A3"]);
    assert_eq!(next(&mut folder).as_deref(), Some("A1"));
    assert_eq!(next(&mut folder).as_deref(), Some("A2"));
    close(&mut folder, "A1");
    drop(folder);
    let again = || FolderArrivals::open(&dir.path().join("inbox"), 3).unwrap();
    let mut folder = again();
    assert_eq!(next(&mut folder).as_deref(), Some("A2"));
    assert_eq!(next(&mut folder).as_deref(), Some("A3"));
    close(&mut folder, "A2");
    // The line ends between the closing of the last casing and the move of the set.
    note_closed(&dir.path().join("inbox/a"), "A3").unwrap();
    drop(folder);
    assert_eq!((next(&mut again()), names_in(&dir, "done")), (None, vec!["a".to_owned()]));
    assert_eq!(names_in(&dir, "done/a").len(), 5, "nothing but the set");
}

/// Catches a station that waits for ever for a stranger's pipe in the place of its notes.
#[test]
fn a_pipe_holds_no_notes() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join(CLOSED);
    rustix::fs::mknodat(CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
    assert!(note_closed(folder.path(), "A").is_err());
    let _reader = OpenOptions::new().read(true).custom_flags(file_flags()).open(&pipe).unwrap();
    assert!(note_closed(folder.path(), "A").is_err(), "somebody reads it");
    assert!(closed_casings(folder.path()).is_empty());
}

/// Catches a line that ends because the folder vanishes, and a write through a stranger's link.
#[test]
fn a_folder_that_is_gone_is_waited_for() {
    let (dir, mut folder) = watched();
    let (inbox, away) = (dir.path().join("inbox"), dir.path().join("away"));
    fs::rename(&inbox, &away).unwrap();
    assert_eq!(next(&mut folder), None);
    assert!(folder.waits_for().contains("No such file"), "{}", folder.waits_for());
    assert!(folder.is_blind(), "half-judged casings are not gone");
    fs::rename(&away, &inbox).unwrap();
    assert!(next(&mut folder).is_none() && !folder.is_blind());
    deliver(&dir, "a", &["A", "B"]);
    let target = dir.path().join("target");
    std::os::unix::fs::symlink(&target, inbox.join("a").join(CLOSED)).unwrap();
    assert_eq!(next(&mut folder).as_deref(), Some("A"));
    close(&mut folder, "A");
    assert!(!target.exists());
}
