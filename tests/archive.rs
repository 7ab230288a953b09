//! What a whole simulated run leaves: an archive, its tables, and results that depend on nothing but their input.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::rig::{Rig, assert_same, bend, contents, csv_rows, table_bytes};

const SCAN: &str = "
[scan]
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 1
locations = 60

[[scan.tyre]]
serial = \"CRACKED\"
station = 1
crack = [{ shoulder = 2, first_location = 20, location_count = 5, depth_mm = 6.0, length_mm = 22.0 }]

[[scan.tyre]]
serial = \"SOUND\"
station = 2
";

fn rig() -> Rig {
    let rig = Rig::new();
    rig.write("scan.toml", SCAN);
    rig
}

#[test]
fn a_run_finds_the_crack_and_passes_the_sound_tyre() {
    let rig = rig();
    let summary = rig.run("run --config scan.toml --stations 2 --out run.h5 --json").json(0);
    assert_eq!(summary["archived"], 2 * 2 * 61);
    assert_eq!(summary["pace"]["gaps"], 0);
    let verdict = |tyre: &str, shoulder: u64| {
        let lines = summary["verdicts"].as_array().unwrap();
        let is_it = |line: &&serde_json::Value| line["tyre"] == tyre && line["shoulder"] == shoulder;
        lines.iter().find(is_it).unwrap()["verdict"].as_str().unwrap().to_owned()
    };
    assert_eq!(verdict("CRACKED", 2), "REJECT");
    for (tyre, shoulder) in [("CRACKED", 1), ("SOUND", 1), ("SOUND", 2)] {
        assert_eq!(verdict(tyre, shoulder), "PASS", "{tyre}/{shoulder}");
    }
    assert!(summary["auc"]["index"].as_f64().unwrap() > 0.99, "{summary}");

    let regions = csv_rows(&rig.run("export run.h5 regions").expect(0).out);
    assert_eq!(regions.len(), 1);
    let location = |column: &str| regions[0][column].parse::<u32>().unwrap();
    assert!(location("first_location") <= 20 && location("last_location") >= 24, "{regions:?}");
    assert_eq!((regions[0]["tyre"].as_str(), regions[0]["shoulder"].as_str()), ("CRACKED", "2"));

    let rows = csv_rows(&rig.run("export run.h5 discriminators --format csv").expect(0).out);
    assert_eq!(rows.len(), 244);
    assert!(rows.iter().all(|row| row["quality"].is_empty() && row["tau_s"].parse::<f64>().unwrap() > 5e-4));
    let ledger = csv_rows(&rig.run("export run.h5 ledger").expect(0).out);
    assert!(ledger.len() == 244 && ledger.iter().all(|row| row["state"] == "archived"));
    let header =
        |table: &str| rig.run(&format!("export run.h5 {table}")).expect(0).out.lines().next().unwrap().to_owned();
    assert_eq!(
        header("discriminators"),
        "station,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition,attempt,\
         f_max_n,tau_s,a_1_v_s,a_2_v_s,pr,p_f_v2_per_hz,e_f_v2,quality"
    );
    assert_eq!(header("damage"), "tyre,shoulder,location,angle_deg,damage_index,p_value");
    let report = rig.run("verify run.h5 --json").json(0);
    assert_eq!(report["is_whole"], true);
}

/// Law 6: the same input gives the same archive. Law 4: whatever the number of workers.
#[test]
fn results_depend_on_nothing_but_their_input() {
    let rig = rig();
    rig.run("run --config scan.toml --stations 2 --out a.h5").expect(0);
    rig.run("run --config scan.toml --stations 2 --out b.h5").expect(0);
    rig.write("workers.toml", &format!("{SCAN}\n[process]\nworkers = 5\n"));
    rig.run("run --config workers.toml --stations 2 --out c.h5").expect(0);
    let a = contents(&rig.path("a.h5"));
    assert!(a.taps.iter().all(Option::is_some));
    assert_same(&a, &contents(&rig.path("b.h5")));
    assert_same(&a, &contents(&rig.path("c.h5")));
}

/// Stages that are started by hand, in any order, are a line too.
#[test]
fn stages_run_alone() {
    let rig = rig();
    rig.run("run --config scan.toml --stations 2 --out whole.h5").expect(0);
    let name = format!("alone-{}", std::process::id());
    let common = format!("--config scan.toml --stations 2 --out alone.h5 --line {name}");
    let verbs = ["acquire --station 2", "fuse", "process", "acquire --station 1", "store"];
    let stages: Vec<_> = verbs.iter().map(|verb| rig.start(&format!("{verb} {common}"))).collect();
    for (verb, stage) in verbs.iter().zip(stages) {
        let done = crate::rig::Done::from(stage.wait_with_output().unwrap()).expect(0);
        let report: serde_json::Value = serde_json::from_str(&done.out).unwrap();
        assert_eq!(report["stage"], verb.split(' ').next().unwrap());
    }
    assert_same(&contents(&rig.path("alone.h5")), &contents(&rig.path("whole.h5")));
    assert!(tapline_wire::LineAddress::new(&name).clear().unwrap());
}

/// Catches a table that passes for whole though what a row says of a shoulder is torn, and rows that stay so for ever.
#[test]
fn torn_rows_are_told_and_mended() {
    let rig = rig();
    let run = "run --config scan.toml --stations 2 --out run.h5";
    rig.run(run).expect(0);
    let (whole, verdicts) = (contents(&rig.path("run.h5")), rig.run("export run.h5 verdicts").expect(0).out);
    let rows = |table: &str| fs::read(rig.path("run.h5")).unwrap()[table_bytes(&rig.path("run.h5"), table)].to_vec();
    // The first byte; how often a tap was taken; what names a tyre, and where its map begins.
    let [first_cell, retaken_count] =
        [("scans", "first_cell"), ("ledger", "retaken_count")].map(|of| column_at(&rig.path("run.h5"), of));
    let ledger = rig.run("export run.h5 ledger").expect(0).out;
    for (table, at) in [("ledger", 0), ("ledger", retaken_count), ("scans", 0), ("scans", 3), ("scans", first_cell)] {
        let before = rows(table);
        bend(&rig.path("run.h5"), table, at);
        let told = rig.run("export run.h5 verdicts").expect(3);
        assert!(told.err.contains("torn"), "{table}: {told:?}");
        // Nothing of a torn row is believed, nor goes into results.
        assert_eq!(rig.run("export run.h5 ledger").expect(3).out, ledger, "{table} at {at}");
        let results = rig.run("reprocess run.h5 --from-samples").expect(3).out;
        assert_eq!(rig.run(&format!("export {} ledger", results.trim())).expect(0).out, ledger, "{table} at {at}");
        assert_eq!(rig.run(&format!("export {} verdicts", results.trim())).expect(0).out, verdicts, "{table} at {at}");
        // Of results too.
        bend(&rig.path(results.trim()), table, at);
        rig.run(&format!("verify {}", results.trim())).expect(3);
        rig.run("reprocess run.h5 --from-samples").expect(3);
        rig.run(&format!("verify {}", results.trim())).expect(0);
        assert_eq!(rig.run(&format!("export {} ledger", results.trim())).expect(0).out, ledger, "{table} at {at}");
        assert_eq!(rig.run(&format!("export {} verdicts", results.trim())).expect(0).out, verdicts, "{table} at {at}");
        fs::remove_file(rig.path(results.trim())).unwrap();
        rig.run("export run.h5 taps --out taps").expect(3);
        fs::remove_dir_all(rig.path("taps")).unwrap();
        rig.run("report run.h5").expect(3);
        let refused = rig.run("reference run.h5 --out r.json").expect(1);
        assert!(refused.err.contains("torn"), "{table}: {refused:?}");
        rig.run("verify run.h5").expect(3);
        rig.run(run).expect(0);
        rig.run("verify run.h5").expect(0);
        assert_eq!(rig.run("export run.h5 verdicts").expect(0).out, verdicts, "{table}");
        assert_same(&contents(&rig.path("run.h5")), &whole);
        assert_eq!(rows(table), before, "{table} at {at}");
    }
}

/// Catches a tap that is lost to torn rows and never taken again, as its shoulder was judged, and a map that rests on it.
#[test]
fn what_torn_rows_lose_is_taken_again() {
    let rig = rig();
    let run = "run --config scan.toml --stations 2 --out run.h5";
    rig.run(run).expect(0);
    let whole = contents(&rig.path("run.h5"));
    for other in ["taps/header", "discriminators"] {
        for table in ["ledger", other] {
            let row_bytes = table_bytes(&rig.path("run.h5"), table).len() / whole.taps.len();
            bend(&rig.path("run.h5"), table, 5 * row_bytes);
        }
        let done = rig.run("explain run.h5").expect(3);
        assert!(done.err.contains("torn") && done.err.contains("counts as open"), "{other}: {done:?}");
        rig.run(run).expect(0);
        rig.run("verify run.h5").expect(0);
        assert_same(&contents(&rig.path("run.h5")), &whole);
    }
}

/// Byte of a table's row at which a column begins.
fn column_at(archive: &Path, (table, column): (&str, &str)) -> usize {
    let file = hdf5::File::open(archive).unwrap();
    let row = file.dataset(table).unwrap().dtype().unwrap().to_descriptor().unwrap();
    let hdf5::types::TypeDescriptor::Compound(row) = row else { panic!("{table} is no table") };
    row.fields.iter().find(|field| field.name == column).unwrap().offset
}

/// Catches a scan that a log which cannot be written ends: a pipe whose reader has gone, or a full disk.
#[test]
fn a_log_that_is_full_ends_nothing() {
    let rig = rig();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let (_, broken) = std::io::pipe().unwrap();
    for (name, log) in [("full", Stdio::from(full)), ("broken", Stdio::from(broken))] {
        // Errors are logged too, with their causes, where all is.
        let mut run = rig.command(&format!("run --config scan.toml --stations 2 --out {name}.h5"));
        let done = run.env("TAPLINE_LOG", "trace").stderr(log).output().unwrap();
        assert_eq!(done.status.code(), Some(0), "{name}");
        rig.run(&format!("verify {name}.h5")).expect(0);
    }
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    assert_eq!(rig.command("verify gone.h5").stderr(full).output().unwrap().status.code(), Some(1));
}

/// A finished archive is not taken for another scan's.
#[test]
fn another_plan_or_configuration_is_refused() {
    let rig = rig();
    rig.run("run --config scan.toml --stations 2 --out run.h5").expect(0);
    rig.write("other.toml", &SCAN.replace("locations = 60", "locations = 61"));
    let done = rig.run("run --config other.toml --stations 2 --out run.h5").expect(1);
    assert!(done.err.contains("run.h5") && done.err.contains("scan plan"), "{done:?}");
    // Same taps, but what is judged would not be what was asked for.
    rig.write("other.toml", &format!("{SCAN}\n[fuse]\nz_clip = 9.0\n"));
    let done = rig.run("run --config other.toml --stations 2 --out run.h5").expect(1);
    assert!(done.err.contains("configuration") && done.err.contains("--out"), "{done:?}");
    rig.write("other.toml", &SCAN.replace("depth_mm = 6.0", "depth_mm = 7.0"));
    rig.run("run --config other.toml --stations 2 --out run.h5").expect(1);
}

/// The README's snippet, run as it stands there, by a Python that has h5py.
#[test]
fn the_readme_snippet_reads_an_archive() {
    let Some(python) = ["python3", "/usr/bin/python3"].into_iter().find(|python| {
        Command::new(python)
            .args(["-c", "import sys, h5py; sys.exit(not h5py.h5z.filter_avail(32001))"])
            .output()
            .is_ok_and(|done| done.status.success())
    }) else {
        eprintln!("skipped: no Python with h5py here (make setup installs one)");
        return;
    };
    let readme = include_str!("../README.md");
    let snippet = readme.split("```python\n").nth(1).unwrap().split("```").next().unwrap();
    let rig = rig();
    rig.run("run --config scan.toml --stations 2 --out simulated.h5").expect(0);
    rig.write("snippet.py", snippet);
    let done = Command::new(python).arg("snippet.py").current_dir(rig.path("")).output().unwrap();
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let rows = csv_rows(&rig.run("export simulated.h5 discriminators").expect(0).out);
    assert!(said.contains(&rows[0]["pr"]), "the first tap's PR {} is not in:\n{said}", rows[0]["pr"]);
}

/// Catches a check that goes round for ever in a damaged structure, as the library then does: a length in its heap of texts.
#[test]
fn a_structure_that_goes_round_is_told() {
    let rig = Rig::new();
    let mut bytes = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/store/tests/fixtures/layout-4.h5")).unwrap();
    bytes[2465] ^= 8;
    // The limit counts what lies beside it, and beside that: nothing does here.
    fs::create_dir_all(rig.path("alone/there")).unwrap();
    fs::write(rig.path("alone/there/round.h5"), bytes).unwrap();
    for arguments in ["verify alone/there/round.h5", "verify alone/there/round.h5 --json"] {
        let done = rig.run(arguments).expect(3);
        assert!(done.out.contains("its structure is damaged"), "{done:?}");
    }
}
