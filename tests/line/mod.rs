//! `tapline line`: casings come to its stations one by one, from a watched folder, from a rig, or simulated.

mod calibrate;
mod capture;
mod endurance;
mod page;
mod restarts;
mod rig;
mod second_readings;
mod stations;
mod status;
mod verdicts;
mod wires;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tapline_store::verify;

use crate::archives::export_taps::as_from_a_tap_set;
use crate::sandbox::archives::{Contents, assert_same, casings, contents, finished};
use crate::sandbox::running::Running;
use crate::sandbox::{Sandbox, short_scan};

/// Limits of a line that takes tap sets.
const ROOM: &str = "[line]\ntaps_max = 200\nrecord_samples_max = 40000\nscans_max = 4\n";

/// A station that watches the folder `inbox`.
const INBOX: &str = "[[station]]\nnumber = 1\nsource = \"folder\"\nfolder = \"inbox\"\n";

fn file_of(verdict: &Value) -> PathBuf {
    PathBuf::from(verdict["file"].as_str().unwrap())
}

/// The casing at the first station, by the status of the line on `out`; null if there is none.
fn casing_under_way(sandbox: &Sandbox) -> Value {
    wires::status(sandbox)["stations"][0]["casing"].clone()
}

/// Number of archived taps of that casing.
fn archived(sandbox: &Sandbox) -> u64 {
    casing_under_way(sandbox)["archived"].as_u64().unwrap_or(0)
}

/// A simulated rig that plays `script`, and its address.
fn start_rig(sandbox: &Sandbox, script: &str) -> (Running, String) {
    sandbox.write("rig.toml", script);
    let mut rig = Running::start(sandbox, "rig --listen 127.0.0.1:0 --config rig.toml");
    let address = rig.line().strip_prefix("listening at ").unwrap().to_owned();
    (rig, address)
}

/// A number in the rig's report.
fn reported(report: &str, what: &str) -> usize {
    let (_, rest) = report.split_once(&format!("{what} ")).unwrap();
    rest.split(|c: char| !c.is_ascii_digit()).next().unwrap().parse().unwrap()
}

/// The finished files in all folders of days.
fn all_finished(out: &Path) -> Vec<String> {
    let days = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path());
    let is_day = |path: &PathBuf| path.is_dir() && path.file_name().unwrap().as_encoded_bytes()[0].is_ascii_digit();
    let mut names: Vec<String> = days.filter(is_day).flat_map(|day| finished(&day).into_keys()).collect();
    names.sort();
    names
}

/// Tap sets in the folder `sets`, and the expected archives: `A` is cracked, `B` is sound.
fn tap_sets(sandbox: &Sandbox) -> BTreeMap<String, Contents> {
    let crack = "crack = [{ shoulder = 2, first_location = 10, location_count = 4, depth_mm = 6.0 }]";
    let tyres = format!("[[scan.tyre]]\nserial = \"A\"\n{crack}\n[[scan.tyre]]\nserial = \"B\"\n");
    sandbox.write("scan.toml", &format!("{}{tyres}", short_scan(24)));
    sandbox.run("run --config scan.toml --out made").expect(0);
    fs::create_dir(sandbox.path("sets")).unwrap();
    for casing in ["A", "B"] {
        sandbox.run(&format!("export made/{casing}.h5 taps --out sets/{casing}")).expect(0);
    }
    casings(&sandbox.path("made")).into_iter().map(|(name, contents)| (name, as_from_a_tap_set(contents))).collect()
}

fn assert_made(verdict: &Value, made: &BTreeMap<String, Contents>) {
    let file = file_of(verdict);
    assert_same(&contents(&file), &made[verdict["casing"].as_str().unwrap()]);
    assert!(verify(&file).unwrap().is_complete());
}

/// Two stations, with casings of 50 taps.
pub(crate) fn slow_plant(sandbox: &Sandbox, casings_each: u32, taps_per_s: f64, more: &str) {
    let station = |n: u32| format!("[[station]]\nnumber = {n}\nsource = \"simulated\"\ncasings = {casings_each}\n");
    let head =
        format!("{}[simulation]\nsample_count = 4096\n[acquire]\ntaps_per_s = {taps_per_s}\n{more}\n", short_scan(24));
    sandbox.write("plant.toml", &format!("{head}{}{}", station(1), station(2)));
}

/// Checks that the line on `out`, with those verdicts, has left the casings that a line on `alone` makes of the same
/// [`slow_plant`] undisturbed; its pace, which changes no content, is a fast one.
fn assert_like_undisturbed(sandbox: &Sandbox, verdicts: &[Value], out: &str) {
    let plant = fs::read_to_string(sandbox.path("plant.toml")).unwrap();
    let fast = plant.lines().map(|line| if line.starts_with("taps_per_s") { "taps_per_s = 1000" } else { line });
    sandbox.write("alone.toml", &fast.collect::<Vec<_>>().join("\n"));
    let count = verdicts.len();
    let mut line = Running::start(sandbox, &format!("line --config alone.toml --out alone --json --casings {count}"));
    line.verdicts(count);
    line.finish().expect(0);
    for file in verdicts.iter().map(file_of) {
        let there = sandbox.path("alone").join(file.strip_prefix(sandbox.path(out)).unwrap());
        assert_same(&contents(&file), &contents(&there));
    }
    assert_eq!(all_finished(&sandbox.path(out)), all_finished(&sandbox.path("alone")));
}
