//! Sources of casings: a watched folder, and a rig.

use std::fs;
use std::time::{Duration, Instant};

use serde_json::Value;
use tapline_store::{Reader, verify};
use tapline_wire::TapState;

use crate::line::wires::status;
use crate::line::{
    INBOX, ROOM, all_finished, archived, assert_made, casing_under_way, file_of, reported, start_rig, tap_sets,
};
use crate::sandbox::archives::under_way;
use crate::sandbox::running::{Running, until};
use crate::sandbox::{Sandbox, short_scan};

/// Catches a verdict that waits for another casing, a file that cannot be opened while the line runs, a set that stays
/// where it was, and a line that ends because a set cannot be read.
#[test]
fn tap_sets_that_are_moved_into_a_folder_are_judged() {
    let sandbox = Sandbox::new();
    let made = tap_sets(&sandbox);
    sandbox.write("plant.toml", &format!("{ROOM}{INBOX}"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    until("the inbox is made", || sandbox.path("inbox/failed").is_dir());

    fs::rename(sandbox.path("sets/A"), sandbox.path("inbox/A")).unwrap();
    let moved = Instant::now();
    let first = line.verdict();
    eprintln!("the verdict came {:.2} s after the set", moved.elapsed().as_secs_f64());
    assert_eq!((&first["casing"], &first["verdict"], &first["station"]), (&"A".into(), &"REJECT".into(), &1.into()));
    assert_eq!((&first["archived"], &first["refused"], &first["missing"]), (&50.into(), &0.into(), &0.into()));
    assert_eq!(first["shoulders"][1]["verdict"], "REJECT", "{first}");
    assert_made(&first, &made);
    let file = file_of(&first);
    assert!(file.is_absolute() && file.parent().unwrap().parent() == Some(&sandbox.path("out")), "{file:?}");
    if let Some(python) = tapline_testing::python_with("hdf5plugin, h5py") {
        let script = "import hdf5plugin, h5py, sys\nprint((h5py.File(sys.argv[1])['plan']['grown_to'] > 0).sum())";
        assert_eq!(sandbox.python(&python, script, &[file.to_str().unwrap()]).trim(), "50");
    }
    sandbox.run(&format!("export {} verdicts", file.display())).expect(0);
    until("the set is done", || sandbox.path("inbox/done/A/taps.csv").is_file() && !sandbox.path("inbox/A").exists());

    // A set that cannot be read is put aside with the reason, and the next one is still taken.
    fs::create_dir_all(sandbox.path("sets/bad")).unwrap();
    sandbox.write("sets/bad/scan.toml", "geometry = \"ring\"\n");
    sandbox.write("sets/bad/taps.csv", "file\n");
    fs::rename(sandbox.path("sets/bad"), sandbox.path("inbox/bad")).unwrap();
    until("the bad set is put aside", || sandbox.path("inbox/failed/bad/reason.txt").is_file());
    assert!(fs::read_to_string(sandbox.path("inbox/failed/bad/reason.txt")).unwrap().contains("scan.toml"));
    // The same set again is the same alarm again, which pushes out no other.
    let alarms = || -> Vec<Value> {
        let all = status(&sandbox)["alarms"].as_array().cloned().unwrap_or_default();
        all.into_iter().filter(|alarm| alarm["text"].as_str().unwrap().contains("tap set bad")).collect()
    };
    until("it is an alarm", || alarms().len() == 1);
    let before = alarms();
    fs::rename(sandbox.path("inbox/failed/bad"), sandbox.path("inbox/bad")).unwrap();
    until("it is an alarm again", || alarms().first().is_some_and(|alarm| *alarm != before[0]));
    assert_eq!(alarms().len(), 1, "{:?}", alarms());
    fs::rename(sandbox.path("sets/B"), sandbox.path("inbox/B")).unwrap();
    let second = line.verdict();
    assert_eq!((&second["casing"], &second["verdict"]), (&"B".into(), &"PASS".into()));
    assert_made(&second, &made);
    until("the set is done", || sandbox.path("inbox/done/B").is_dir());

    // The same set again is done already: its recordings were judged.
    fs::rename(sandbox.path("inbox/done/B"), sandbox.path("inbox/B-again")).unwrap();
    until("the set is done again", || sandbox.path("inbox/done/B-again").is_dir());
    let done = line.interrupt().expect(3);
    assert!(done.out.is_empty() && done.err.contains("the line has ended: 2 casings judged\n"), "{done:?}");
    assert!(done.err.contains("left out: station 1: tap set bad cannot be used: "), "{done:?}");
    let said = done.err.lines().find(|line| line.contains("is not judged twice")).unwrap_or_else(|| panic!("{done:?}"));
    assert!(said.contains("WARN") && said.contains("casing B of the tap set") && said.contains("B-again"), "{said}");
    assert_eq!(all_finished(&sandbox.path("out")), ["A", "B"]);
    assert!(under_way(&sandbox.path("out")).is_empty() && sandbox.left().is_empty());
}

/// Catches a rejected casing whose serial comes again, on another casing, without a word, also after the line was started anew.
#[test]
fn the_serial_of_a_rejected_casing_is_an_alarm_when_it_comes_again() {
    let sandbox = Sandbox::new();
    tap_sets(&sandbox);
    sandbox.run("export made/B.h5 taps --out sets/C").expect(0);
    for (set, left_out) in [("B", 0), ("C", 1)] {
        let list = sandbox.path(&format!("sets/{set}/taps.csv"));
        let rows = fs::read_to_string(&list).unwrap().replace(",B,", ",A,");
        let rows: Vec<&str> = rows.lines().collect();
        fs::write(list, rows[..rows.len() - left_out].join("\n")).unwrap();
    }
    sandbox.write("plant.toml", &format!("{ROOM}{INBOX}"));
    // The casing that is rejected is neither the first nor the last of its serial.
    for (set, verdict, alarm_count) in [("B", "PASS", 0), ("A", "REJECT", 0), ("C", "PASS", 1)] {
        let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
        until("the inbox is made", || sandbox.path("inbox/failed").is_dir());
        fs::rename(sandbox.path("sets").join(set), sandbox.path("inbox").join(set)).unwrap();
        let judged = line.verdict();
        assert_eq!((&judged["casing"], &judged["verdict"]), (&"A".into(), &verdict.into()));
        let words = "station 1: A was judged REJECT at station 1 today: is this the same casing?";
        until("the verdict is shown, with the alarm", || {
            let status = status(&sandbox);
            let is_shown = status["closed_count"] == 1;
            is_shown && status["alarms"].to_string().matches(words).count() == alarm_count
        });
        line.interrupt().expect(0);
    }
    assert_eq!(all_finished(&sandbox.path("out")), ["A", "A.2", "A.3"]);
}

/// Starts a rig, and writes the configuration of a line with its station.
fn rig_and_plant(sandbox: &Sandbox, script: &str, more: &str) -> Running {
    let (machine, address) = start_rig(sandbox, script);
    let station = format!("[[station]]\nnumber = 1\nsource = \"rig\"\nrig = \"{address}\"\n");
    sandbox.write("plant.toml", &format!("{}[simulation]\nsample_count = 4096\n{more}\n{station}", short_scan(24)));
    machine
}

/// Catches a serial that is unreadable or repeated and blocks the line or replaces a file, and taps that are lost or
/// made twice because the rig was switched off during each casing.
#[test]
fn a_rig_that_is_switched_off_and_on_loses_nothing() {
    let sandbox = Sandbox::new();
    let script = "casings = 4\nserials = [\"R-1\", \"?\", \"R-1\", \"R 2\"]\nswitched_off = 1.0\noff_s = [0.05, 0.2]\n";
    let machine = rig_and_plant(&sandbox, script, "");
    // Nobody knows whether a casing without a serial is the same as before, so it counts as another.
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 5");
    let verdicts = line.verdicts(5);
    line.finish().expect(3);
    let report = machine.interrupt().expect(0).out;
    assert_eq!(reported(&report, "switched off"), 4, "{report:?}");
    let names: Vec<&str> = verdicts.iter().map(|verdict| verdict["casing"].as_str().unwrap()).collect();
    assert!(names[1..3].iter().all(|name| name.starts_with("unknown-1-")) && names[1] != names[2], "{names:?}");
    assert_eq!([names[0], names[3], names[4]], ["R-1", "R-1", "R 2"]);
    for (k, verdict) in verdicts.iter().enumerate() {
        if k == 1 {
            assert!(verdict["refused"] != 0 && verdict["verdict"] != "PASS", "{verdict}");
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
    assert_eq!(all_finished(&sandbox.path("out")), expected);
    assert_ne!(file_of(&verdicts[0]), file_of(&verdicts[3]));
    // The rig knows that every casing is done; otherwise the next line would tap it again.
    assert_eq!(reported(&report, "closed"), 4, "{report:?}");
}

/// Catches a casing that was taken away before its last tap and passes, is waited for, or blocks the next.
#[test]
fn a_casing_that_is_taken_away_is_inspected_again() {
    let sandbox = Sandbox::new();
    let machine = rig_and_plant(&sandbox, "casings = 6\nremoved = 0.5\nseed = 4\n", "");
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 6");
    let verdicts = line.verdicts(6);
    line.finish().expect(3);
    let report = machine.interrupt().expect(0).out;
    let removed = reported(&report, "removed");
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
    assert_eq!(all_finished(&sandbox.path("out")), names);
}

/// Catches a casing that is given up because its rig came back later than `store`, one that is never judged because
/// its rig came back without it, and one that is continued after a time in which it may have been turned.
#[test]
fn a_rig_that_is_late_after_a_restart_goes_on() {
    for (comes_back, is_late) in [(true, false), (false, false), (true, true)] {
        let sandbox = Sandbox::new();
        let machine = rig_and_plant(&sandbox, "casings = 1\n", "[acquire]\ntaps_per_s = 40.0\n");
        let plant = fs::read_to_string(sandbox.path("plant.toml")).unwrap();
        let patience_s = [if comes_back { 30 } else { 2 }, 5][usize::from(is_late)];
        sandbox.write("plant.toml", &format!("{plant}rig_patience_s = {patience_s}\n"));
        let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
        until("the casing is half tapped", || archived(&sandbox) > 10);
        line.kill();
        drop(machine);
        if is_late {
            // A start without the rig does not make the last tap younger.
            let early = Running::start(&sandbox, "line --config plant.toml --out out --json");
            until("the station knows what is under way", || !casing_under_way(&sandbox).is_null());
            early.kill();
            std::thread::sleep(Duration::from_secs(patience_s));
        }
        let address = plant.split("rig = \"").nth(1).unwrap().split('"').next().unwrap();
        let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
        until("the station knows what is under way", || !casing_under_way(&sandbox).is_null());
        if comes_back {
            sandbox.write("rig.toml", "casings = 1\n");
            let again = Running::start(&sandbox, &format!("rig --listen {address} --config rig.toml"));
            let verdict = line.verdict();
            let is_whole = (&verdict["archived"], &verdict["refused"]) == (&50.into(), &0.into());
            assert_eq!(is_whole, !is_late, "{verdict}");
            if is_late {
                assert_ne!(verdict["verdict"], "PASS", "{verdict}");
                until("the alarm", || {
                    let alarms = sandbox.run("status --out out --json").json(0)["alarms"].to_string();
                    alarms.contains("RIG-1: its scan was interrupted for ")
                });
            }
            line.interrupt().expect(if is_late { 3 } else { 0 });
            drop(again);
        } else {
            let verdict = line.verdict();
            // By whatever taps came, of 24 locations and by itself, it may even be rejected.
            assert_ne!(verdict["verdict"], "PASS", "{verdict}");
            assert!(verdict["refused"] != 0 && verdict["missing"] == 0, "{verdict}");
            line.interrupt().expect(3);
        }
        assert_eq!(all_finished(&sandbox.path("out")), ["RIG-1"]);
    }
}

/// Catches a casing that cannot be judged and is called damaged by `verify`, waits for ever, or is judged before all has come.
#[test]
fn a_casing_that_cannot_be_judged_is_whole() {
    let sandbox = Sandbox::new();
    drop(tap_sets(&sandbox));
    sandbox.run("reference made/B.h5 --out sound.json").expect(0);
    let taps = fs::read_to_string(sandbox.path("sets/A/taps.csv")).unwrap();
    assert!(taps.contains(",A,1,0,"), "{taps}");
    // Tapped elsewhere, and one recording is no recording.
    let bad = taps.lines().nth(3).unwrap().split(',').next().unwrap().to_owned();
    sandbox.write(&format!("sets/A/{bad}"), "RIFF");
    sandbox.write("sets/A/taps.csv", &taps.replace(",A,1,0,", ",A,1,5,").replace(",A,2,0,", ",A,2,5,"));
    sandbox.write("plant.toml", &format!("{ROOM}{INBOX}"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --reference sound.json");
    until("the inbox is made", || sandbox.path("inbox/failed").is_dir());
    fs::rename(sandbox.path("sets/A"), sandbox.path("inbox/A")).unwrap();
    let verdict = line.verdict();
    assert_eq!(
        (&verdict["verdict"], &verdict["archived"], &verdict["refused"]),
        (&"RE-INSPECT".into(), &49.into(), &1.into())
    );
    assert_eq!(verdict["shoulders"][0]["reasons"], "not_comparable", "{verdict}");
    let verified = verify(file_of(&verdict)).unwrap();
    assert!(verified.is_complete(), "{verified:?}");
    drop(line.interrupt());
}

/// Catches a dead microphone without an alarm: all taps are made again and again, and the casing stands still. And an alarm that
/// comes only when the scan is through, or stays although the microphone is heard again.
#[test]
fn a_microphone_that_is_dead_for_many_taps_is_an_alarm_while_they_are_made() {
    let sandbox = Sandbox::new();
    let fault = "[[simulation.fault]]\nkind = \"dead_sound\"\nfraction = 0.8\n";
    let station = "[[station]]\nnumber = 1\nsource = \"simulated\"\ncasings = 1\n";
    // A scan of a shoulder takes 50 s.
    let head = "[acquire]\ntaps_per_s = 3.0\n[scan]\nlocations = 150\n[simulation]\nsample_count = 4096\n";
    sandbox.write("plant.toml", &format!("{head}{fault}{station}"));
    let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    until("it is over", || {
        let alarms = status(&sandbox)["alarms"].as_array().cloned().unwrap_or_default();
        let over = "over: station 1: the last 5 taps had no usable record and are taken again: look at the microphone";
        alarms.iter().any(|alarm| alarm["text"].as_str().unwrap().starts_with(over))
    });
    // When the first turn is through, four in five of its 150 taps are taken again.
    let retaken = casing_under_way(&sandbox)["retaken"].as_u64().unwrap();
    assert!(retaken < 75, "the turn was through: {retaken}");
    line.interrupt().expect(0);
}
