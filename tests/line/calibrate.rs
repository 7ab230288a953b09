//! Calibration of full-scale samples: found by listening, kept in archives, and reported where it is missing.

use std::fs::File;
use std::io::Write as _;
use std::process::Stdio;

use tapline_store::Reader;
use tapline_testing::documents::csv_rows;
use tapline_testing::program::Done;

use crate::line::capture::{plug_in, sound_card};
use crate::sandbox::Sandbox;
use crate::sandbox::recordings::{SCAN, tap_set};
use crate::sandbox::running::Running;

const RATE_HZ: f64 = 48_000.0;

const PLANT: &str = "[[station]]\nnumber = 1\nsource = \"alsa\"\ndevice = \"bench\"\n";

/// Runs `calibrate ARGUMENTS` while the sound card plays `frames` of force and sound.
fn calibrate(sandbox: &Sandbox, arguments: &str, frames: impl Iterator<Item = (f64, f64)>) -> Done {
    sandbox.write("plant.toml", PLANT);
    sound_card(sandbox, "bench");
    drop(std::fs::remove_file(sandbox.path("bench.pcm")));
    plug_in(sandbox, "bench");
    let mut command =
        sandbox.command(&format!("calibrate {arguments} --config plant.toml --out station.toml --patience-s 20"));
    command.env("ALSA_CONFIG_PATH", sandbox.path("asound.conf"));
    let running = Running::of(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap());
    let count = |x: f64| ((x * 32_768.0).round() as i16).to_le_bytes();
    let bytes: Vec<u8> = frames.flat_map(|(force, sound)| [count(force), count(sound)]).flatten().collect();
    // It stays open, so that the card is silent at its end; the listener may have heard enough before.
    let mut card = File::options().write(true).open(sandbox.path("bench.pcm")).unwrap();
    drop(card.write_all(&bytes));
    running.finish()
}

/// One second with a blow of `peak` in its middle.
fn blow(peak: f64) -> impl Iterator<Item = (f64, f64)> {
    (0..48_000).map(move |k| {
        let t = (f64::from(k) - 24_000.0) / RATE_HZ;
        let force = if (0.0..1e-3).contains(&t) { peak * (std::f64::consts::PI * t / 1e-3).sin() } else { 0.0 };
        let noise = f64::from((k * 7919) % 101) / 101.0 - 0.5;
        (force + 1e-4 * noise, 1e-4 * noise)
    })
}

/// Catches a scale from other blows than those that were heard, a tone taken for its peak, a channel that is lost when the other is
/// calibrated, and a file that no station can use.
#[test]
fn a_station_is_calibrated_by_listening() {
    let sandbox = Sandbox::new();
    // 222 N at full scale; the second blow is clipped and is struck again.
    let peaks = [0.2, 1.5, 0.25, 0.3];
    let done = calibrate(&sandbox, "blows --known-n 44.4,55.5,66.6", peaks.into_iter().flat_map(blow)).expect(0);
    assert_eq!(done.err.matches("not counted, strike again").count(), 1, "{done:?}");
    let prompts =
        ["strike the sensor: 3 blows are wanted", "blow 1: 20.0", "; strike again, 2 left", "; strike again, 1 left"];
    assert!(prompts.iter().all(|prompt| done.err.contains(prompt)), "{}", done.err);
    let tone = |rms: f64| {
        (0..480_000)
            .map(move |k| (0.0, rms * 2f64.sqrt() * (std::f64::consts::TAU * 1003.2 * f64::from(k) / RATE_HZ).sin()))
    };
    calibrate(&sandbox, "tone --known-pa 1.0", tone(0.05)).expect(0);
    let file: toml::Table = std::fs::read_to_string(sandbox.path("station.toml")).unwrap().parse().unwrap();
    let full_scale = |channel: &str| file[channel]["full_scale"].as_float().unwrap();
    assert!((full_scale("force") / 222.0 - 1.0).abs() < 5e-3, "{file}");
    assert!((full_scale("sound") / 20.0 - 1.0).abs() < 1e-3, "{file}");
    assert_eq!((file["force"]["unit"].as_str(), file["sound"]["unit"].as_str()), (Some("N"), Some("Pa")));
    // What is no calibration is refused, and changes nothing.
    let refused =
        calibrate(&sandbox, "blows --known-n 44.4 --count 3 --force", [0.2, 0.25, 0.3].into_iter().flat_map(blow))
            .expect(1);
    assert!(refused.err.contains("differs from blow to blow by"), "{refused:?}");
    let refused = calibrate(&sandbox, "tone --known-pa 1.0 --force", tone(0.001)).expect(1);
    assert!(refused.err.contains("% of full scale; it must be"), "{refused:?}");
    assert_eq!(std::fs::read_to_string(sandbox.path("station.toml")).unwrap().parse::<toml::Table>().unwrap(), file);
}

/// Catches a calibration that may not be replaced, or a file that cannot be read, and that is refused only after the blows.
#[test]
fn what_cannot_be_kept_is_refused_before_anything_is_heard() {
    let sandbox = Sandbox::new();
    sandbox.run("calibrate state --channel force --full-scale-v 5 --sensitivity-mv 22.5 --out s.toml").expect(0);
    sandbox.write("broken.toml", "[force\n");
    // The configuration of the station is read only to listen.
    let refused =
        |out: &str| sandbox.run(&format!("calibrate blows --known-n 44.4 --config no.toml --out {out}")).expect(1).err;
    let anew = "s.toml has a calibration of the force already: replace it with --force, which keeps the other channel";
    assert!(refused("s.toml").contains(anew), "{}", refused("s.toml"));
    assert!(refused("broken.toml").contains("broken.toml"), "{}", refused("broken.toml"));
}

/// Catches a sensitivity, gain or voltage that enters the scale the wrong way, and a value out of its bounds.
#[test]
fn data_sheets_give_a_scale() {
    let sandbox = Sandbox::new();
    let state = |arguments: &str| sandbox.run(&format!("calibrate state {arguments} --out s.toml"));
    state("--channel force --full-scale-v 5 --sensitivity-mv 22.5 --gain 10").expect(0);
    state("--channel sound --full-scale-v 5 --gain 100").expect(0);
    let file: toml::Table = std::fs::read_to_string(sandbox.path("s.toml")).unwrap().parse().unwrap();
    let of = |channel: &str| (file[channel]["full_scale"].as_float().unwrap(), file[channel]["unit"].as_str().unwrap());
    assert!((of("force").0 - 5.0 / 10.0 / 0.0225).abs() < 1e-9 && (of("sound").0 - 0.05).abs() < 1e-12, "{file}");
    assert_eq!((of("force").1, of("sound").1), ("N", "V"));
    // One channel anew; the other stays.
    state("--channel force --full-scale-v 5 --sensitivity-mv 22.5 --gain 20 --force").expect(0);
    let anew: toml::Table = std::fs::read_to_string(sandbox.path("s.toml")).unwrap().parse().unwrap();
    let ratio = anew["force"]["full_scale"].as_float().unwrap() / of("force").0;
    assert!((ratio - 0.5).abs() < 1e-9 && anew["sound"] == file["sound"], "{anew}");
    // The range of a module is compared with it.
    assert_eq!(file["force"]["full_scale_v"].as_float(), Some(5.0), "{file}");
    let error = state("--channel force --full-scale-v 5").expect(1).err;
    assert!(error.contains("--sensitivity-mv is missing"), "{error}");
    let error = state("--channel sound --full-scale-v 0").expect(1).err;
    assert!(error.contains("--full-scale-v is 0; it must be above 0"), "{error}");
    let error = state("--channel sound --full-scale-v 5 --valid-days -3").expect(2).err;
    assert!(error.contains("'-3' for '--valid-days") && error.contains("0..=65535"), "{error}");
}

/// Catches newtons or volts that nobody stated, on any page or in any table, and a remark that is missing.
#[test]
fn units_that_are_not_known_are_not_printed() {
    let sandbox = tap_set();
    let unscaled: String =
        SCAN.lines().filter(|line| !line.contains("full_scale")).map(|line| format!("{line}\n")).collect();
    sandbox.write("taps/scan.toml", &unscaled);
    let summary = sandbox.run("run --taps taps --out set --json").json(0);
    assert_eq!(summary["verdicts"][0]["verdict"], "PASS", "{summary}");
    let row = &csv_rows(&sandbox.run("export set/A-17.h5 discriminators").expect(0).out)[7];
    assert_eq!((row["force_unit"].as_str(), row["sound_unit"].as_str()), ("FS", "FS"));
    assert!((row["f_max"].parse::<f64>().unwrap() / (0.14 * 1.06) - 1.0).abs() < 0.02);
    sandbox.run("report set/A-17.h5 --out pages").expect(0);
    let page = std::fs::read_to_string(sandbox.path("pages/tyre-A-17.html")).unwrap();
    for unit in ["force, N", "F_max, N", "V s", "V²", "sound, V"] {
        assert!(!page.contains(unit), "{unit} is on the page");
    }
    assert!(page.contains(" FS<") && page.contains("There is no calibration of a channel"));
    sandbox.run("export set/A-17.h5 taps --out again").expect(0);
    let scan = std::fs::read_to_string(sandbox.path("again/scan.toml")).unwrap();
    assert!(!scan.contains("full_scale") && !sandbox.path("again/calibration.toml").exists(), "{scan}");
    // Taps in newtons are not compared with it.
    sandbox.run("reference set --shoulder A-17/1 --out unscaled.json").expect(0);
    sandbox.write("taps/scan.toml", SCAN);
    let error = sandbox.run("run --taps taps --out scaled --reference unscaled.json").expect(1).err;
    assert!(error.contains("units = [\"FS\", \"FS\"] there, units = [\"N\", \"V\"] here"), "{error}");
}

/// Catches a calibration that is lost between a tap set, its archive and the tap set of that, one that expires unseen, and a plant
/// that wants one and passes a casing without it.
#[test]
fn a_calibration_goes_with_the_taps() {
    let sandbox = tap_set();
    let channel = |name: &str, unit: &str, full_scale: f64| {
        format!(
            "[{name}]\nunit = {unit:?}\nfull_scale = {full_scale:?}\n[{name}.certificate]\nmethod = \"blows\"\ndate = \"2026-01-02\"\nvalid_until = \"2026-06-30\"\n"
        )
    };
    let calibration = channel("force", "N", 222.0) + &channel("sound", "Pa", 20.0);
    let unscaled: String =
        SCAN.lines().filter(|line| !line.contains("full_scale")).map(|line| format!("{line}\n")).collect();
    sandbox.write("taps/scan.toml", &unscaled);
    sandbox.write("taps/calibration.toml", &calibration);
    let list = std::fs::read_to_string(sandbox.path("taps/taps.csv")).unwrap();
    let at = |time_ns: i64| -> String {
        let dated = list.lines().enumerate().map(|(k, line)| match k {
            0 => format!("{line},tap_time_ns\n"),
            k => format!("{line},{}\n", time_ns + k as i64),
        });
        dated.collect()
    };
    // 30 June 2026, the last day, and the next one.
    let (fresh, late) = (at(1_782_777_600_000_000_000), at(1_782_864_000_000_000_000));
    for (out, list, is_out) in [("fresh", &fresh, false), ("undated", &list, true), ("late", &late, true)] {
        sandbox.write("taps/taps.csv", list);
        let summary = sandbox.run(&format!("run --taps taps --out {out} --json")).json(0);
        let verdict = &summary["verdicts"][0];
        assert_eq!(verdict["verdict"], "PASS", "{summary}");
        let rows = csv_rows(&sandbox.run(&format!("export {out}/A-17.h5 verdicts")).expect(0).out);
        assert!(!rows[0]["reasons"].contains("not_calibrated"), "{rows:?}");
        assert_eq!(rows[0]["reasons"].contains("calibration_out_of_date"), is_out, "{rows:?}");
    }
    let reader = Reader::open(sandbox.path("late/A-17.h5")).unwrap();
    let kept = &reader.plan().recording.calibration;
    assert_eq!((kept.sound.unit.name(), kept.tapped_on.as_deref()), ("Pa", Some("2026-07-01")));
    assert_eq!(kept.force.certificate.as_ref().unwrap().valid_until.as_deref(), Some("2026-06-30"));
    sandbox.run("export late/A-17.h5 taps --out again").expect(0);
    sandbox.run("run --taps again --out twice").expect(0);
    let again = Reader::open(sandbox.path("twice/A-17.h5")).unwrap();
    assert_eq!(again.plan().recording.calibration, *kept);
    assert_eq!(again.discriminators().unwrap(), reader.discriminators().unwrap());
    sandbox.write("strict.toml", "[fuse]\nreference = \"self\"\nrequires_calibration = true\n");
    let strict = sandbox.run("run --taps taps --config strict.toml --out strict --json").json(0);
    assert_eq!(strict["verdicts"][0]["verdict"], "RE-INSPECT", "{strict}");
    // A scale that contradicts the certificate is not taken.
    sandbox.write("taps/scan.toml", &format!("{unscaled}force_full_scale_n = 200.0\n"));
    let error = sandbox.run("run --taps taps --out other").expect(1).err;
    assert!(error.contains("is 222 N; it must be 200 N, as in scan.toml"), "{error}");
}

/// Catches a line that begins without a calibration that a station names, or by a reference that no casing of it can be compared
/// with, one that is refused although its stations hear what the reference is of, and a calibration that ends unannounced.
#[test]
fn a_line_begins_only_with_what_its_stations_need() {
    let sandbox = tap_set();
    sandbox.run("run --taps taps --reference self --out set").expect(0);
    sandbox.run("reference set --shoulder A-17/1 --out sound.json").expect(0);
    let station = "[[station]]\nnumber = 1\nsource = \"alsa\"\ndevice = \"nowhere\"\ncalibration = \"station.toml\"\n";
    let scan = "[scan]\nconfirm = false\nshoulders = 1\nlocations = 24\noffsets_mm = [5.0]\n";
    sandbox.write(
        "plant.toml",
        &format!("{station}{scan}[capture]\nsample_rate_hz = 41000\nsample_count = 4096\npre_trigger_samples = 400\n"),
    );
    let starts =
        |until: &str| sandbox.run(&format!("line --config plant.toml --out out --reference {until}")).expect(1).err;
    let error = starts("sound.json");
    assert!(error.contains("station.toml: cannot be read"), "{error}");
    sandbox.run("calibrate state --channel force --full-scale-v 5 --sensitivity-mv 22.5 --out station.toml").expect(0);
    let error = starts("sound.json");
    assert!(error.contains("units = [\"N\", \"V\"] there, units = [\"N\", \"FS\"] here"), "{error}");
    sandbox.run("calibrate state --channel sound --full-scale-v 5 --out station.toml").expect(0);
    // Its last day was in 2026.
    let fresh = std::fs::read_to_string(sandbox.path("station.toml")).unwrap();
    let until = fresh.lines().find(|line| line.starts_with("valid_until")).unwrap();
    sandbox.write(
        "station.toml",
        &fresh.replace(until, "valid_until = \"2026-01-02\"").replace("date = \"20", "date = \"19"),
    );
    let plant = std::fs::read_to_string(sandbox.path("plant.toml")).unwrap();
    sandbox.write("plant.toml", &format!("{plant}[fuse]\nrequires_calibration = true\n"));
    let error = starts("sound.json");
    assert!(
        error.contains("the force of station 1 has a calibration that was valid until 2026-01-02; today is"),
        "{error}"
    );
    sandbox.write("plant.toml", &plant);
    sandbox.write("station.toml", &fresh);
    let ten_days = "--full-scale-v 5 --sensitivity-mv 22.5 --valid-days 10 --force";
    sandbox.run(&format!("calibrate state --channel force {ten_days} --out station.toml")).expect(0);
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --reference sound.json");
    line.wait_for_log(&["the force of station 1 has a calibration that ends on 20"]);
    line.wait_for_log(&["station 1", "nowhere", "not heard"]);
    line.interrupt().expect(0);
}
