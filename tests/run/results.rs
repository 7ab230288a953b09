//! The results of a whole simulated run: an archive, its tables, and values that depend only on its input.

use std::collections::BTreeMap;
use std::fs;
use std::process::Stdio;

use tapline_store::Reader;

use crate::sandbox::Sandbox;
use crate::sandbox::archives::{Contents, assert_same_casings, bend, casings, finished, table_bytes};
use tapline_testing::documents::csv_rows;

/// On one sound shoulder in fifty something stands out; on none with this seed.
const SCAN: &str = "
[scan]
seed = 2
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 1
locations = 60
confirm = false

[[scan.tyre]]
serial = \"CRACKED\"
station = 1
crack = [{ shoulder = 2, first_location = 20, location_count = 5, depth_mm = 6.0, length_mm = 22.0 }]

[[scan.tyre]]
serial = \"SOUND\"
station = 2
";

fn scanned() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.write("scan.toml", SCAN);
    sandbox
}

/// Catches a place outside the strongest arc, next to whose strength it is printed: here a weaker region has
/// as great an index.
#[test]
fn the_place_of_a_verdict_is_in_its_strongest_region() {
    let sandbox = Sandbox::new();
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/demo.toml");
    let summary = sandbox.run(&format!("run --config {config} --stations 1 --out run --json")).json(0);
    let verdict = &summary["verdicts"][0];
    let reader = Reader::open(sandbox.path("run/SIM-0001.h5")).unwrap();
    let (judgement, cells) = reader.judgements().unwrap().remove(0).unwrap();
    let place = cells.iter().find(|cell| u64::from(cell.location) == verdict["peak_location"]).unwrap();
    assert!(verdict["regions"].as_u64().unwrap() > 1 && place.region > 0, "{verdict}");
    assert_eq!(place.region_index.to_bits(), judgement.strongest_arc.to_bits(), "{verdict}");
}

/// Catches a run that by default makes other taps than one turn at the belt edge and a second reading, and progress beyond its end.
#[test]
fn a_run_taps_once_around_and_what_stands_out_again() {
    let sandbox = Sandbox::new();
    sandbox.write("slow.toml", "[acquire]\ntaps_per_s = 21.0\n");
    let done = sandbox.run("run --config slow.toml --out run --json");
    let summary = done.json(0);
    assert!(done.err.contains("scanning 202 taps, plus second readings;"), "{}", done.err);
    let made = summary["archived"].as_u64().unwrap();
    assert_eq!(summary["verdicts"][0]["verdict"], "REJECT");
    let reader = Reader::open(sandbox.path("run/SIM-0001.h5")).unwrap();
    assert_eq!((reader.plan().begun().taps().len(), reader.plan().taps().len() as u64), (202, made));
    assert!(made > 202 + 24, "{made}");
    let shown = done.err.lines().filter(|line| line.contains(" taps/s, ")).map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        (words[0].parse::<u64>().unwrap(), words[2].parse::<u64>().unwrap())
    });
    let shown: Vec<_> = shown.collect();
    assert!(!shown.is_empty() && shown.iter().all(|(done, total)| done <= total && *total <= made), "{shown:?}");
}

#[test]
fn a_run_finds_the_crack_and_passes_the_sound_tyre() {
    let sandbox = scanned();
    let summary = sandbox.run("run --config scan.toml --stations 2 --out run --json").json(0);
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

    assert_eq!(finished(&sandbox.path("run")).into_keys().collect::<Vec<_>>(), ["CRACKED", "SOUND"]);
    let table = |casing: &str, table: &str| sandbox.run(&format!("export run/{casing}.h5 {table}")).expect(0).out;

    let regions = csv_rows(&table("CRACKED", "regions"));
    assert_eq!(regions.len(), 1);
    let location = |column: &str| regions[0][column].parse::<u32>().unwrap();
    assert!(location("first_location") <= 20 && location("last_location") >= 24, "{regions:?}");
    assert_eq!((regions[0]["tyre"].as_str(), regions[0]["shoulder"].as_str()), ("CRACKED", "2"));
    assert!(csv_rows(&table("SOUND", "regions")).is_empty());

    for casing in ["CRACKED", "SOUND"] {
        let rows = csv_rows(&table(casing, "discriminators --format csv"));
        assert_eq!(rows.len(), 122);
        assert!(rows.iter().all(|row| row["quality"].is_empty() && row["tau_s"].parse::<f64>().unwrap() > 5e-4));
        assert!(rows.iter().all(|row| row["tyre"] == casing));
        let ledger = csv_rows(&table(casing, "ledger"));
        assert!(ledger.len() == 122 && ledger.iter().all(|row| row["state"] == "archived"));
        let header = |what: &str| table(casing, what).lines().next().unwrap().to_owned();
        assert_eq!(
            header("discriminators"),
            "station,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition,attempt,purpose,tap_utc,\
             velocity_measured_m_per_s,f_max,tau_s,a_1,a_2,pr,p_f,e_f,centroid_hz,quality,force_unit,sound_unit"
        );
        assert_eq!(header("damage"), "tyre,shoulder,location,angle_deg,damage_index,first_index,p_value");
        let report = sandbox.run(&format!("verify run/{casing}.h5 --json")).json(0);
        assert_eq!(report["is_complete"], true);
    }
}

#[test]
fn a_flag_on_every_tap_is_named_on_the_verdict() {
    // Catches a PASS that says nothing of what is wrong with all of its taps, and one that does not say what that is.
    let sandbox = Sandbox::new();
    let scan = "[scan]\nseed = 2\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.85]\nrepetitions = 1\nlocations = 60\n";
    let tyre = "[[scan.tyre]]\nserial = \"SOUND\"\nstation = 1\n";
    sandbox.write("scan.toml", &format!("{scan}{tyre}[process.quality]\nsnr_min = 1e6\n"));
    let summary = sandbox.run("run --config scan.toml --out run --json").json(0);
    let verdict = &summary["verdicts"][0];
    assert_eq!(verdict["verdict"], "PASS", "{verdict}");
    assert!(verdict["reasons"].as_str().unwrap().split('|').any(|reason| reason == "flagged"), "{verdict}");
    assert_eq!(verdict["flags"], serde_json::json!({ "low_snr": 1.0 }));
    let printed = sandbox.run("run --config scan.toml --out printed").expect(0).out;
    let printed = printed.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(printed.contains("flagged: low_snr on 100 % of the taps"), "{printed}");
}

/// The contents without the place and time of the taps.
fn anywhere(mut casings: BTreeMap<String, Contents>) -> BTreeMap<String, Contents> {
    for casing in casings.values_mut() {
        for (header, _) in casing.taps.iter_mut().flatten() {
            (header.id.station, header.tap_time_ns) = (0, 0);
        }
        for found in casing.discriminators.iter_mut().flatten() {
            *found = found.replace("TapId(station 2 ", "TapId(station 1 ");
        }
    }
    casings
}

/// Catches a casing that depends on others: its file is the same whichever casing came before it, wherever it was
/// tapped, and however many others there are.
#[test]
fn a_casing_does_not_depend_on_the_others() {
    let sandbox = Sandbox::new();
    let tyre = |serial: &str, station: u16, crack: &str| {
        format!("[[scan.tyre]]\nserial = \"{serial}\"\nstation = {station}\n{crack}\n")
    };
    let crack = "crack = [{ shoulder = 1, first_location = 3, location_count = 4, depth_mm = 6.0 }]";
    let scan = |name: &str, tyres: &[String]| {
        let head =
            "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.85]\nrepetitions = 1\nlocations = 20\nstations = 2\n";
        sandbox.write("scan.toml", &format!("{head}{}[simulation]\nsample_count = 4096\n", tyres.concat()));
        sandbox.run(&format!("run --config scan.toml --out {name}")).expect(0);
        anywhere(casings(&sandbox.path(name)))
    };
    let apart = scan("apart", &[tyre("A", 1, crack), tyre("B", 2, ""), tyre("C", 1, "")]);
    let after = scan("after", &[tyre("C", 2, ""), tyre("B", 2, ""), tyre("A", 2, crack)]);
    let alone = scan("alone", &[tyre("A", 2, crack)]);
    assert_same_casings(&apart, &after);
    assert_same_casings(&alone, &apart.into_iter().filter(|(name, _)| name == "A").collect());
}

/// Catches a changed row of any table that passes for the original.
#[test]
fn altered_rows_are_reported() {
    let sandbox = scanned();
    sandbox.run("run --config scan.toml --stations 2 --out run").expect(0);
    let of = |file: &str, table: &str| sandbox.run(&format!("export {file} {table}"));
    let tables = ["verdicts", "ledger", "damage", "discriminators"];
    let whole = tables.map(|table| of("run/CRACKED.h5", table).expect(0).out);
    let tables_there = ["plan", "ledger", "scans", "taps/header", "discriminators", "damage"];
    for table in tables_there {
        let bytes = table_bytes(&sandbox.path("run/CRACKED.h5"), table).len();
        for at in [0, bytes / 2, bytes - 1] {
            fs::copy(sandbox.path("run/CRACKED.h5"), sandbox.path("bent.h5")).unwrap();
            bend(&sandbox.path("bent.h5"), table, at);
            let done = sandbox.run("verify bent.h5");
            assert!(matches!(done.code, Some(1 | 3)), "byte {at} of {table}: {done:?}");
            for (table, whole) in tables.iter().zip(&whole) {
                let done = of("bent.h5", table);
                assert!(
                    done.code.is_some_and(|code| code != 0) || done.out == *whole,
                    "byte {at} of {table}: {done:?}"
                );
            }
        }
    }
}

/// Catches a scan that ends because the log cannot be written: a pipe whose reader has gone, or a full disk.
#[test]
fn a_log_that_is_full_ends_nothing() {
    let sandbox = scanned();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let (_, broken) = std::io::pipe().unwrap();
    for (name, log) in [("full", Stdio::from(full)), ("broken", Stdio::from(broken))] {
        // `trace` also logs errors, with their causes.
        let mut run = sandbox.command(&format!("run --config scan.toml --stations 2 --out {name}"));
        let done = run.env("TAPLINE_LOG", "trace").stderr(log).output().unwrap();
        assert_eq!(done.status.code(), Some(0), "{name}");
        assert_eq!(finished(&sandbox.path(name)).len(), 2);
        for file in finished(&sandbox.path(name)).values() {
            sandbox.run(&format!("verify {}", file.display())).expect(0);
        }
    }
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    assert_eq!(sandbox.command("verify gone.h5").stderr(full).output().unwrap().status.code(), Some(1));
}

/// A folder of results is not continued by another scan.
#[test]
fn another_plan_or_configuration_is_refused() {
    let sandbox = scanned();
    sandbox.run("run --config scan.toml --stations 2 --out run").expect(0);
    let before = fs::read(sandbox.path("run/SOUND.h5")).unwrap();
    for (text, what) in [
        (SCAN.replace("locations = 60", "locations = 61"), "locations"),
        // The same taps, but another judgement than the one asked for.
        (format!("{SCAN}\n[fuse]\nre_inspect_rate = 0.01\n"), "re_inspect_rate"),
        (SCAN.replace("depth_mm = 6.0", "depth_mm = 7.0"), "depth_mm"),
        (SCAN.replace("\"SOUND\"", "\"OTHER\""), "OTHER"),
    ] {
        sandbox.write("other.toml", &text);
        let done = sandbox.run("run --config other.toml --stations 2 --out run").expect(1);
        assert!(done.err.contains("run has results of another run"), "{done:?}");
        assert!(done.err.contains(what) && done.err.contains("--out"), "{what}: {done:?}");
    }
    assert!(fs::read(sandbox.path("run/SOUND.h5")).unwrap() == before);
    // A folder with files of others is not used either.
    fs::create_dir(sandbox.path("mine")).unwrap();
    fs::write(sandbox.path("mine/mine.h5"), "mine").unwrap();
    let done = sandbox.run("run --config scan.toml --stations 2 --out mine").expect(1);
    assert!(done.err.contains("no run.toml that says which run made them"), "{done:?}");
    assert_eq!(fs::read_to_string(sandbox.path("mine/mine.h5")).unwrap(), "mine");
    // Neither a remark nor the pace makes it another run.
    sandbox.write("paced.toml", &format!("# tonight\n{SCAN}\n[acquire]\ntaps_per_s = 500.0\n"));
    for config in ["scan.toml", "paced.toml"] {
        sandbox.run(&format!("run --config {config} --stations 2 --out run")).expect(0);
    }
}
