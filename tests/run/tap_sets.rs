//! Tap sets from elsewhere through a whole line: faults are reported, and refused taps are in the ledger.

use std::fs;
use std::path::Path;

use crate::sandbox::recordings::{LOCATIONS, SCAN, tap_set, write_float_wav, write_wav};
use tapline_testing::documents::csv_rows;

#[test]
fn a_clean_set_is_archived_bit_for_bit() {
    let sandbox = tap_set();
    let summary = sandbox.run("run --taps taps --out set --json").json(0);
    assert_eq!((&summary["archived"], &summary["refused"]), (&24.into(), &0.into()));
    assert_eq!(summary["verdicts"][0]["verdict"], "PASS", "{summary}");
    let reader = tapline_store::Reader::open(sandbox.path("set/A-17.h5")).unwrap();
    let (header, samples) = reader.tap(7).unwrap().unwrap();
    assert_eq!((header.sample_count, header.sample_rate_hz, header.pre_trigger_samples), (4096, 41e3, 400));
    let wav: Vec<i16> =
        hound::WavReader::open(sandbox.path("taps/007.wav")).unwrap().samples::<i16>().map(Result::unwrap).collect();
    let planar: Vec<i16> = (0..2).flat_map(|c| wav.iter().skip(c).step_by(2).copied()).collect();
    assert_eq!(samples, tapline_store::OwnedSamples::I16(planar));
    let row = &csv_rows(&sandbox.run("export set/A-17.h5 discriminators").expect(0).out)[7];
    let f_max_n: f64 = row["f_max"].parse().unwrap();
    assert!((f_max_n / (0.14 * 1.06 * 222.0) - 1.0).abs() < 0.02, "{f_max_n}");
    assert_eq!((row["offset_mm"].as_str(), row["velocity_m_per_s"].as_str()), ("5", "1.85"));
}

/// A set whose scales have changed is not continued, because its archive would mix units.
#[test]
fn a_run_does_not_continue_with_a_changed_set() {
    let sandbox = tap_set();
    sandbox.run("run --taps taps --out set").expect(0);
    sandbox.write("taps/scan.toml", &SCAN.replace("222.0", "111.0"));
    let done = sandbox.run("run --taps taps --out set").expect(1);
    assert!(done.err.contains("set has results of another run (other recorded taps: A-17 "), "{done:?}");
    sandbox.write("taps/scan.toml", SCAN);
    sandbox.run("run --taps taps --out set").expect(0);
}

/// A tap that cannot be read is refused, with the file's name; the others are archived, and the shoulder does not pass.
#[test]
fn bad_recordings_are_refused_into_the_ledger() {
    type Harm = fn(&Path);
    let harms: [(&str, Harm, &str); 5] = [
        ("003.wav", |path| fs::remove_file(path).unwrap(), "003.wav"),
        ("004.wav", |path| write_wav(path, 1, 41_000, 4096, 4), "channel"),
        ("005.wav", |path| write_wav(path, 2, 44_100, 4096, 5), "44100"),
        ("006.wav", |path| fs::write(path, &fs::read(path).unwrap()[..5000]).unwrap(), "006.wav"),
        ("008.wav", |path| fs::write(path, b"RIFF, or so it says").unwrap(), "008.wav"),
    ];
    let sandbox = tap_set();
    for (file, harm, _) in &harms {
        harm(&sandbox.path("taps").join(file));
    }
    let summary = sandbox.run("run --taps taps --out set --json").json(3);
    assert_eq!((&summary["archived"], &summary["refused"], &summary["missing"]), (&19.into(), &5.into(), &0.into()));
    assert_eq!(summary["verdicts"][0]["verdict"], "RE-INSPECT");
    assert!(summary["verdicts"][0]["reasons"].as_str().unwrap().contains("taps_refused"));
    let ledger = csv_rows(&sandbox.run("export set/A-17.h5 ledger").expect(0).out);
    for (file, _, why) in harms {
        let location: usize = file[..3].parse().unwrap();
        let row = &ledger[location];
        assert_eq!(row["state"], "refused", "{row:?}");
        let line = format!("line {}", location + 2);
        for part in [file, why, &line] {
            assert!(row["reason"].contains(part), "{part:?} is not in {:?}", row["reason"]);
        }
    }
    sandbox.run("verify set/A-17.h5").expect(3);
}

/// A sample that is not a number is found when the tap is read, and the tap is refused.
#[test]
fn a_sample_that_is_not_a_number_is_refused() {
    let sandbox = tap_set();
    for location in 0..LOCATIONS {
        write_float_wav(&sandbox.path(&format!("taps/{location:03}.wav")), location);
    }
    // Sample 2000 of the second channel; the file ends with its 4096 samples of two channels, 4 bytes each.
    let mut bytes = fs::read(sandbox.path("taps/009.wav")).unwrap();
    let at = bytes.len() - 4 * 2 * (4096 - 2000) + 4;
    bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(sandbox.path("taps/009.wav"), bytes).unwrap();
    let summary = sandbox.run("run --taps taps --out set --json").json(3);
    assert_eq!((&summary["archived"], &summary["refused"]), (&23.into(), &1.into()));
    let reason = &csv_rows(&sandbox.run("export set/A-17.h5 ledger").expect(0).out)[9]["reason"];
    assert!(reason.contains("009.wav") && reason.contains("NaN") && reason.contains("2000"), "{reason}");
}

/// Faults of the tables stop the run before its first tap, with file, line and reason.
#[test]
fn bad_tables_stop_before_the_first_tap() {
    type Change = fn(&str) -> String;
    let rows = |change: Change| change;
    let cases: [(Change, &[&str]); 6] = [
        (rows(|t| t.replace("repetition", "rep")), &["taps.csv", "rep"]),
        (rows(|t| t.replacen(",repetition", "", 1)), &["taps.csv", "repetition"]),
        (
            rows(|t| t.replacen("002.wav,A-17,1,5,1.85,2,30,0", "002.wav,A-17,1,5,1.85,1,15,0", 1)),
            &["taps.csv", "3", "4"],
        ),
        (rows(|t| t.replacen("1.85,2,", "fast,2,", 1)), &["taps.csv", "4", "velocity_m_per_s", "fast"]),
        (rows(|t| t.replacen("1.85,2,", "-1,2,", 1)), &["taps.csv", "4", "velocity_m_per_s", "-1"]),
        (rows(|t| t.lines().next().unwrap_or_default().to_owned()), &["taps.csv"]),
    ];
    for (change, parts) in cases {
        let sandbox = tap_set();
        let table = fs::read_to_string(sandbox.path("taps/taps.csv")).unwrap();
        sandbox.write("taps/taps.csv", &change(&table));
        let done = sandbox.run("run --taps taps --out set").expect(1);
        for part in parts {
            assert!(done.err.contains(part), "{part:?} is not in {:?}", done.err);
        }
        assert!(!sandbox.path("set").exists());
    }
    let sandbox = tap_set();
    sandbox.write("taps/scan.toml", &SCAN.replace("pre_trigger_samples", "pre_triger_samples"));
    let done = sandbox.run("run --taps taps --out set").expect(1);
    assert!(done.err.contains("scan.toml") && done.err.contains("pre_triger_samples"), "{done:?}");
}

/// Catches a tap that was faster than the others of its set and counts as one of another planned velocity.
#[test]
fn a_tap_of_another_velocity_than_its_set_is_flagged() {
    let sandbox = tap_set();
    let table = fs::read_to_string(sandbox.path("taps/taps.csv")).unwrap();
    let fast = table.replace("011.wav,A-17,1,5,1.85", "011.wav,A-17,1,5,2.05");
    assert_ne!(fast, table);
    sandbox.write("taps/taps.csv", &fast);
    let summary = sandbox.run("run --taps taps --out set --json").json(0);
    assert_eq!(summary["verdicts"][0]["verdict"], "PASS", "it is kept, and compared with those beside it: {summary:#}");
    for row in csv_rows(&sandbox.run("export set/A-17.h5 discriminators").expect(0).out) {
        let is_fast = row["location"] == "11";
        assert_eq!(row["quality"], if is_fast { "velocity_off" } else { "" }, "{row:?}");
        assert_eq!(row["velocity_m_per_s"], if is_fast { "2.05" } else { "1.85" });
    }
}
