//! A line, or one of its stages, is killed, and its work is continued.

use std::fs;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;
use tapline_store::verify;

use crate::line::{
    INBOX, ROOM, all_finished, archived, assert_like_undisturbed, assert_made, casing_under_way, file_of, slow_plant,
    tap_sets,
};
use crate::sandbox::archives::under_way;
use crate::sandbox::running::{Running, until};
use crate::sandbox::stages::{signal, stage};
use crate::sandbox::{Sandbox, short_scan};

/// Catches a casing that is lost, judged twice or begun again after the line was killed during it, and a status without the verdict of
/// an earlier line.
#[test]
fn a_killed_line_goes_on_with_what_was_under_way() {
    let sandbox = Sandbox::new();
    let made = tap_sets(&sandbox);
    sandbox.write("plant.toml", &format!("{ROOM}[acquire]\ntaps_per_s = 20.0\n{INBOX}"));
    for casing in ["A", "B"] {
        fs::create_dir_all(sandbox.path("inbox")).unwrap();
        fs::rename(sandbox.path("sets").join(casing), sandbox.path("inbox").join(casing)).unwrap();
    }
    let mut verdicts = Vec::new();
    // During the first casing, and during the second.
    for casing in ["A", "B"] {
        let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
        until("the casing is half tapped", || {
            verdicts.extend(line.lines_so_far());
            let under_way = casing_under_way(&sandbox);
            under_way["name"] == casing && under_way["archived"].as_u64().is_some_and(|count| count > 10 && count < 40)
        });
        verdicts.extend(line.kill());
        let open = under_way(&sandbox.path("out"));
        assert!(open.len() == 1 && open[0].file_name().unwrap().to_str().unwrap().starts_with(casing), "{open:?}");
    }
    let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    until("the sets are done", || sandbox.path("inbox/done/A").is_dir() && sandbox.path("inbox/done/B").is_dir());
    let mut status = Value::Null;
    until("both are shown", || {
        status = sandbox.run("status --out out --json").json(0);
        status["verdicts"].as_array().is_some_and(|shown| shown.len() == 2)
    });
    let done = line.interrupt().expect(0);
    verdicts.extend(done.out.lines().map(str::to_owned));
    let verdicts: Vec<Value> = verdicts.iter().map(|line| serde_json::from_str(line).unwrap()).collect();
    let shown: Vec<&Value> = status["verdicts"].as_array().unwrap().iter().map(|shown| &shown["file"]).collect();
    assert_eq!(shown, [&verdicts[1]["file"], &verdicts[0]["file"]], "{status}");
    let names: Vec<&str> = verdicts.iter().map(|verdict| verdict["casing"].as_str().unwrap()).collect();
    assert_eq!(names, ["A", "B"], "{}", done.err);
    verdicts.iter().for_each(|verdict| assert_made(verdict, &made));
    assert_eq!(all_finished(&sandbox.path("out")), ["A", "B"]);
    assert!(
        under_way(&sandbox.path("out")).is_empty() && !sandbox.path("out/left").exists() && sandbox.left().is_empty()
    );
}

/// Catches a casing that is judged by half of its taps for good, as its set was taken away, and what goes wrong without an alarm:
/// the set, a casing whose station is not in the configuration any more, and a file that an earlier line has put aside.
#[test]
fn a_set_that_comes_back_is_judged_in_full() {
    let sandbox = Sandbox::new();
    tap_sets(&sandbox);
    let plant = |number: u16| {
        let station = format!("[[station]]\nnumber = {number}\nsource = \"folder\"\nfolder = \"inbox\"\n");
        sandbox.write("plant.toml", &format!("{ROOM}[acquire]\ntaps_per_s = 40.0\n{station}"));
    };
    let start = || Running::start(&sandbox, "line --config plant.toml --out out --json");
    plant(1);
    fs::create_dir_all(sandbox.path("inbox")).unwrap();
    fs::rename(sandbox.path("sets/A"), sandbox.path("inbox/A")).unwrap();
    let line = start();
    until("the casing is half tapped", || casing_under_way(&sandbox)["archived"].as_u64().is_some_and(|n| n > 10));
    line.interrupt().expect(0);
    fs::rename(sandbox.path("inbox/A"), sandbox.path("away")).unwrap();
    // Without its station it stays.
    plant(2);
    fs::create_dir(sandbox.path("out/left")).unwrap();
    sandbox.write("out/left/Z.1.h5", "");
    let mut line = start();
    line.wait_for_log(&["casing A waits for station 1"]);
    until("both are alarms", || {
        let status = sandbox.run("status --out out --json").out;
        status.contains("casing A waits for station 1, which is not in the configuration")
            && status.contains("1 file that cannot be continued is in ")
    });
    let ended = line.interrupt().expect(0).err;
    assert!(ended.contains("casing A is not done: its station 1 is not in the configuration"), "{ended}");
    plant(1);
    let mut line = start();
    let half = line.verdict();
    assert!(half["verdict"] == "RE-INSPECT" && half["refused"].as_u64().unwrap() > 0, "{half}");
    until("the alarm", || {
        let status = sandbox.run("status --out out").expect(0).out;
        status.contains("ALARM") && status.contains("casing A was half tapped")
    });
    fs::rename(sandbox.path("away"), sandbox.path("inbox/A")).unwrap();
    let whole = line.verdict();
    assert!(whole["refused"] == 0 && whole["missing"] == 0, "{whole}");
    until("the set is done", || sandbox.path("inbox/done/A").is_dir());
    line.interrupt().expect(3);
    assert_eq!(all_finished(&sandbox.path("out")).len(), 2);
}

/// Catches a stage whose death ends the line, or costs a tap of the casings under way.
#[test]
fn stages_are_killed_while_casings_come() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 3, 50.0, "");
    let mut line = Running::start(&sandbox, "line --config plant.toml --out killed --json --casings 6");
    for victim in ["process", "store", "fuse", "acquire-0", "store"] {
        std::thread::sleep(Duration::from_millis(400));
        signal(stage(line.child(), victim), Signal::KILL);
    }
    let verdicts = line.verdicts(6);
    let done = line.finish().expect(0);
    assert!(done.out.is_empty(), "{done:?}");
    assert_like_undisturbed(&sandbox, &verdicts, "killed");
    assert!(under_way(&sandbox.path("killed")).is_empty() && sandbox.left().is_empty());
}

/// Catches files under way that are put aside because a comment, a hook or a station was added since.
#[test]
fn a_line_goes_on_after_its_configuration_was_edited() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 1, 40.0, "");
    let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    until("a casing is half tapped", || archived(&sandbox) > 10);
    line.interrupt().expect(0);
    assert_eq!(under_way(&sandbox.path("out")).len(), 2);
    let text = fs::read_to_string(sandbox.path("plant.toml")).unwrap();
    sandbox.write("plant.toml", &format!("# Monday\n{text}\n[line]\non_verdict = \"true\"\n"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 2");
    for verdict in line.verdicts(2) {
        assert_eq!((&verdict["archived"], &verdict["missing"]), (&50.into(), &0.into()), "{verdict}");
    }
    line.finish().expect(0);
    assert!(under_way(&sandbox.path("out")).is_empty() && !sandbox.path("out/left").exists());
}

/// Catches a casing that was half tapped with other options and vanishes without a word.
#[test]
fn a_casing_that_cannot_go_on_is_an_alarm() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 1, 40.0, "");
    let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    until("a casing is half tapped", || archived(&sandbox) > 10);
    line.kill();
    let text = fs::read_to_string(sandbox.path("plant.toml")).unwrap();
    sandbox.write("plant.toml", &format!("{text}[fuse]\nre_inspect_rate = 0.03\n"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    line.wait_for_log(&["ERROR", "must be tapped again", "its taps so far are put aside as "]);
    until("the alarm", || {
        sandbox.run("status --out out --json").json(0)["alarms"].to_string().contains("must be tapped again")
    });
    line.interrupt().expect(0);
    assert!(sandbox.path("out/left").exists());
}

/// Catches archived taps that a disk has lost and that are not taken again. The file under way is replaced by an
/// earlier state, as after a power cut of its disk.
#[test]
fn taps_that_a_disk_has_lost_are_taken_again() {
    let sandbox = Sandbox::new();
    sandbox.write("plant.toml", &format!("{}[simulation]\nsample_count = 4096\n[acquire]\ntaps_per_s = 20.0\n[[station]]\nnumber = 1\nsource = \"simulated\"\ncasings = 1\n", short_scan(24)));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 1");
    let open = || under_way(&sandbox.path("out"))[0].clone();
    until("some taps are archived", || archived(&sandbox) > 5);
    fs::copy(open(), sandbox.path("before.h5")).unwrap();
    // The first shoulder has 25 taps.
    until("the second shoulder is begun", || archived(&sandbox) > 28);
    line.signal(Signal::STOP);
    signal(stage(line.child(), "store"), Signal::KILL);
    std::thread::sleep(Duration::from_millis(100));
    fs::copy(sandbox.path("before.h5"), open()).unwrap();
    line.signal(Signal::CONT);
    let verdict = line.verdict();
    assert_eq!((&verdict["archived"], &verdict["missing"]), (&50.into(), &0.into()), "{verdict}");
    line.finish().expect(0);
    assert!(verify(file_of(&verdict)).unwrap().is_complete());
}
