//! The status of a running line.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;

use crate::line::{assert_like_undisturbed, slow_plant};
use crate::sandbox::Sandbox;
use crate::sandbox::archives::names;
use crate::sandbox::running::Running;
use crate::sandbox::stages::{signal, stage};

/// Catches a status that is missing, or of another line, and a line that waits for a viewer, running or frozen; and files that stay
/// because one still looks on when the line ends.
#[test]
fn who_looks_on_changes_nothing() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 3, 20.0, "");
    let line = Running::start(&sandbox, "line --config plant.toml --out watched --json --casings 6");
    stage(line.child(), "acquire-0");
    let mut frozen = sandbox.start("status --out watched --follow --json");
    let mut shown = BufReader::new(frozen.stdout.take().unwrap()).lines();
    let first: Value = serde_json::from_str(&shown.next().unwrap().unwrap()).unwrap();
    assert_eq!(first["pid"], line.child().id());
    let entry: toml::Table = toml::from_str(&fs::read_to_string(sandbox.path("watched/.line")).unwrap()).unwrap();
    let place = PathBuf::from(entry["folder"].as_str().unwrap());
    assert!(place.exists());
    signal(i32::try_from(frozen.id()).unwrap(), Signal::STOP);
    let mut statuses: Vec<Value> = Vec::new();
    let mut verdicts = Vec::new();
    while verdicts.len() < 6 {
        if let Some(said) = line.line_within(Duration::from_millis(150)) {
            verdicts.push(serde_json::from_str::<Value>(&said).unwrap());
        } else if verdicts.len() < 3 {
            // The last three casings take far longer than an answer: the line does not end under the question.
            statuses.push(sandbox.run("status --out watched --json").json(0));
        }
    }
    line.finish().expect(0);
    assert!(!place.exists());
    let prefix = place.file_name().unwrap().to_str().unwrap().replace('-', "_");
    let left = names(Path::new("/dev/shm")).into_iter().filter(|name| name.starts_with(&prefix));
    assert_eq!(left.collect::<Vec<_>>(), [""; 0]);
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
        assert_eq!((&status["lost_count"], &status["held_by"]), (&0.into(), &Value::Null));
    }
    assert_like_undisturbed(&sandbox, &verdicts, "watched");
    let refused = sandbox.run("status --out alone --json").expect(1);
    assert!(refused.err.contains("no line runs on alone"), "{refused:?}");
}

/// Catches a line that hangs and looks well to somebody who follows it.
#[test]
fn a_line_that_hangs_is_said_to() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 1, 20.0, "");
    let line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    stage(line.child(), "acquire-0");
    let mut follower = Running::start(&sandbox, "status --out out --follow");
    assert!(follower.line().starts_with("Line on "));
    line.signal(Signal::STOP);
    let words = "TROUBLE nothing from the line since 20";
    while !follower.line().starts_with(words) {}
    assert!(sandbox.run("status --out out").expect(0).out.contains(words));
    line.signal(Signal::CONT);
    line.interrupt().expect(0);
    follower.finish().expect(0);
}
