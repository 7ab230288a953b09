//! Exported taps: a tap set gives back the same archive, and pyuff reads Universal Files.

use std::fs;
use std::path::Path;

use tapline_acquire::{Source as _, TapSet};
use tapline_store::{OwnedSamples, Reader};
use tapline_wire::{CacheLine, Discriminator, SourceKind, TapHeader, TapState, cache_lines_for};

use crate::sandbox::Sandbox;
use crate::sandbox::archives::{Contents, assert_same, bend, contents, names, part_of, table_bytes};
use crate::sandbox::recordings;
use tapline_testing::documents::csv_rows;

/// Two tyres at two stations, a crack, taps that are taken again, and a closing tap in every turn.
const SCAN: &str = "
[scan]
offsets_mm = [0.0, 5.0]
velocities_m_per_s = [1.85]
locations = 30
confirm = false

[[scan.tyre]]
serial = \"CRACKED\"
station = 1
crack = [{ shoulder = 2, first_location = 10, location_count = 4, depth_mm = 6.0, length_mm = 22.0 }]

[[scan.tyre]]
serial = \"SOUND \u{e9}\"
station = 2

[simulation]
sample_count = 4096

[[simulation.fault]]
kind = \"double_hit\"
fraction = 0.1
";

/// The archive's content, except for the kind of source, which an export cannot keep.
pub(crate) fn as_from_a_tap_set(mut contents: Contents) -> Contents {
    for (header, _) in contents.taps.iter_mut().flatten() {
        header.source = SourceKind::TapSet.code();
    }
    contents
}

/// A run of the simulated line: `run.h5` is the cracked tyre, `sound.h5` the other.
pub(crate) fn run() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.write("scan.toml", SCAN);
    sandbox.run("run --config scan.toml --stations 2 --out run").expect(0);
    fs::rename(sandbox.path("run/CRACKED.h5"), sandbox.path("run.h5")).unwrap();
    fs::rename(sandbox.path("run/SOUND%20%C3%A9.h5"), sandbox.path("sound.h5")).unwrap();
    sandbox
}

/// Catches anything that is lost, rounded, reordered or invented between an archive and its tap set: samples, scales,
/// velocities, distances, angles, closing taps, stations, attempts, times, truth, and with them results and verdicts.
#[test]
fn an_exported_tap_set_gives_the_same_archive() {
    let sandbox = run();
    for (archive, file) in [("run.h5", "CRACKED.h5"), ("sound.h5", "SOUND%20%C3%A9.h5")] {
        comes_back(&sandbox, archive, &format!("again/{file}"));
        for made in ["set", "set-again", "again"] {
            fs::remove_dir_all(sandbox.path(made)).unwrap();
        }
    }
}

fn comes_back(sandbox: &Sandbox, archive: &str, again: &str) {
    let done = sandbox.run(&format!("export {archive} taps --out set")).expect(0);
    assert_eq!(done.out, "set: 124 taps written, 0 refused, 0 missing\n");
    sandbox.run("run --taps set --config set/config.toml --out again").expect(0);
    let (before, after) = (contents(&sandbox.path(archive)), contents(&sandbox.path(again)));
    assert!(before.taps.iter().flatten().any(|(header, _)| header.id.attempt > 0), "a tap was taken again");
    assert!(before.taps.iter().flatten().all(|(header, _)| header.tap_time_ns != 0));
    assert_same(&as_from_a_tap_set(before), &after);
    let [before, after] = [archive, again].map(|name| Reader::open(sandbox.path(name)).unwrap());
    assert_eq!(before.plan().taps(), after.plan().taps());
    assert_eq!(before.plan().scans(), after.plan().scans());
    // Only the list of taps has the day of simulated taps.
    let mut recording = after.plan().recording.clone();
    assert_eq!(recording.calibration.tapped_on.take().as_deref(), Some("2026-01-01"));
    assert_eq!(before.plan().recording, recording);
    assert_eq!(before.plan().geometry, after.plan().geometry);
    assert!(before.truth() == after.truth() && !before.truth().is_empty());
    assert_eq!(before.truth().values().any(|&is_cracked| is_cracked), archive == "run.h5");
    for table in ["discriminators", "damage", "regions", "verdicts", "ledger"] {
        // A tap set does not record the attempts before the last one.
        let kept = |line: &str| match table {
            "ledger" => line.rsplitn(4, ',').last().unwrap().to_owned(),
            _ => line.to_owned(),
        };
        let table_of = |archive: &str| -> Vec<String> {
            sandbox.run(&format!("export {archive} {table}")).expect(0).out.lines().map(kept).collect()
        };
        assert_eq!(table_of(archive), table_of(again), "{table}");
    }
    // And again: an export of what came from a tap set is the same.
    sandbox.run(&format!("export {again} taps --format wav --out set-again")).expect(0);
    let files = |folder: &str| {
        ["taps.csv", "truth.csv", "config.toml"].map(|f| fs::read(sandbox.path(folder).join(f)).unwrap())
    };
    assert!(files("set") == files("set-again"));
}

/// Catches a refused tap that an export leaves out silently, or that comes back with another reason; and 32-bit
/// floats that change.
#[test]
fn refused_taps_and_floats_are_exported() {
    let sandbox = recordings::tap_set();
    for location in 0..24 {
        recordings::write_float_wav(&sandbox.path(&format!("taps/{location:03}.wav")), location);
    }
    fs::remove_file(sandbox.path("taps/003.wav")).unwrap();
    sandbox.run("run --taps taps --out run").expect(3);
    fs::copy(sandbox.path("run/A-17.h5"), sandbox.path("run.h5")).unwrap();
    let done = sandbox.run("export run.h5 taps --out set").expect(3);
    assert_eq!(done.out, "set: 23 taps written, 1 refused, 0 missing; taps.csv lists them with the reason\n");
    let rows = csv_rows(&fs::read_to_string(sandbox.path("set/taps.csv")).unwrap());
    assert!(rows[3]["file"].is_empty() && rows[3]["refused"].contains("003.wav"), "{:?}", rows[3]);
    assert!(rows.iter().enumerate().all(|(k, row)| (k == 3) != row["refused"].is_empty()));
    sandbox.run("run --taps set --config set/config.toml --out again").expect(3);
    let (before, after) = (contents(&sandbox.path("run.h5")), contents(&sandbox.path("again/A-17.h5")));
    assert!(matches!(before.taps[0], Some((_, OwnedSamples::F32(_)))));
    assert_same(&before, &after);
    let reasons = ["run.h5", "again/A-17.h5"].map(|name| Reader::open(sandbox.path(name)).unwrap().refusals().unwrap());
    assert!(reasons[0].len() == 1 && reasons[0] == reasons[1], "{reasons:?}");
    // A reason that was changed is not passed on.
    let reason_bytes = table_bytes(&sandbox.path("run.h5"), "refusals").len() / 24;
    bend(&sandbox.path("run.h5"), "refusals", 3 * reason_bytes);
    assert!(matches!(sandbox.run("verify run.h5").code, Some(1 | 3)));
    for arguments in ["export run.h5 taps --out bent", "export run.h5 ledger", "report run.h5", "reprocess run.h5"] {
        let done = sandbox.run(arguments);
        assert!(matches!(done.code, Some(1 | 3)), "{arguments}: {done:?}");
    }
}

/// Catches a missing tap that is exported as if it were there, or as if it had never been planned.
#[test]
fn missing_taps_are_said_to_be_missing() {
    let sandbox = run();
    // Half a casing: the plan has two shoulders, and the first has taps.
    let whole = Reader::open(sandbox.path("run.h5")).unwrap();
    part_of(&whole, sandbox.path("half.h5"), 0..62, |_, _| ());
    let done = sandbox.run("export half.h5 taps --out set").expect(3);
    assert_eq!(done.out, "set: 62 taps written, 0 refused, 62 missing; taps.csv lists them with the reason\n");
    sandbox.run("run --taps set --config set/config.toml --out again").expect(3);
    let again = Reader::open(sandbox.path("again/CRACKED.h5")).unwrap();
    assert_eq!(again.plan().taps(), whole.plan().taps());
    assert_eq!(again.ledger().count(TapState::Refused), 62);
    assert!(again.refusals().unwrap().iter().all(|refusal| refusal.reason == "missing in the archive"));
}

/// Catches one corrupt tap that blocks the export of all others, and one that is exported as if it were valid.
#[test]
fn damaged_taps_are_left_behind() {
    let sandbox = run();
    fs::copy(sandbox.path("run.h5"), sandbox.path("bent.h5")).unwrap();
    bend_samples(&sandbox.path("bent.h5"), 7);
    for format in ["wav", "uff", "mat"] {
        let done = sandbox.run(&format!("export bent.h5 taps --format {format} --out {format}")).expect(3);
        let said = format!(
            "{format}: 123 taps written, 0 refused, 0 missing, 1 damaged; taps.csv lists them with the reason\n"
        );
        assert_eq!(done.out, said);
        let rows = csv_rows(&fs::read_to_string(sandbox.path(&format!("{format}/taps.csv"))).unwrap());
        let is_damaged =
            |k: &usize| rows[*k]["refused"].starts_with("damaged in the archive: ") && rows[*k]["file"].is_empty();
        let damaged: Vec<usize> = (0..rows.len()).filter(is_damaged).collect();
        assert_eq!(damaged, [7]);
    }
    sandbox.run("run --taps wav --config wav/config.toml --out again").expect(3);
    let again = Reader::open(sandbox.path("again/CRACKED.h5")).unwrap();
    assert_eq!((again.ledger().count(TapState::Archived), again.ledger().count(TapState::Refused)), (123, 1));
    // Tables have a checksum: if one row was changed, no row is believed.
    bend(&sandbox.path("bent.h5"), "taps/header", 9 * 8);
    let done = sandbox.run("export bent.h5 taps --out sealed").expect(1);
    assert!(done.err.contains("seal") && !sandbox.path("sealed").exists(), "{done:?}");
}

/// Flips a bit in the middle of the packed samples of a tap.
fn bend_samples(archive: &Path, row: usize) {
    let file = hdf5::File::open(archive).unwrap();
    let chunk = file.dataset("taps/samples").unwrap().chunk_info(row).unwrap();
    drop(file);
    let mut bytes = fs::read(archive).unwrap();
    bytes[usize::try_from(chunk.addr + chunk.size / 2).unwrap()] ^= 16;
    fs::write(archive, bytes).unwrap();
}

/// Catches an empty export that seems to succeed.
#[test]
fn nothing_that_can_be_read_is_no_export() {
    let sandbox = run();
    let whole = Reader::open(sandbox.path("run.h5")).unwrap();
    part_of(&whole, sandbox.path("one.h5"), 0..1, |_, _| ());
    bend_samples(&sandbox.path("one.h5"), 0);
    for format in ["wav", "uff", "mat"] {
        let done = sandbox.run(&format!("export one.h5 taps --format {format} --out {format}")).expect(1);
        assert!(done.err.contains("readable samples for none of its 124 planned taps"), "{done:?}");
        assert!(!sandbox.path(format).exists());
    }
}

/// Catches taps with other scales or another distance than the first tap, that come back with those of the first.
#[test]
fn scales_are_kept_tap_by_tap() {
    let sandbox = run();
    let whole = Reader::open(sandbox.path("run.h5")).unwrap();
    let mut headers = Vec::new();
    part_of(&whole, sandbox.path("mixed.h5"), 0..4, |row, header| {
        header.channels[0].unit_per_count /= f64::from(row % 3 + 1);
        header.channels[1].unit_per_count *= if row == 3 { 0.7 } else { 1.0 };
        header.microphone_distance_m += f64::from(row) / 30.0;
        headers.push(*header);
    });
    sandbox.run("export mixed.h5 taps --out set").expect(3);
    let mut set = TapSet::open(&sandbox.path("set"), 1).unwrap();
    let mut buffer = vec![CacheLine::default(); cache_lines_for(set.plan().recording.payload_bytes_max())];
    for (row, want) in (0..).zip(headers) {
        let mut got = TapHeader::default();
        set.render(row, 0, &mut got, &mut buffer).unwrap();
        assert_eq!(got.channels, want.channels, "row {row}");
        assert_eq!(got.microphone_distance_m.to_bits(), want.microphone_distance_m.to_bits(), "row {row}");
    }
}

/// Catches an export onto existing files, of nothing, or in a format that does not exist, without an error that says
/// so.
#[test]
fn what_cannot_be_exported_is_said() {
    let sandbox = run();
    let fails = |arguments: &str, parts: &[&str]| {
        let done = sandbox.run(arguments).expect(1);
        for part in parts {
            assert!(done.err.contains(part), "{part:?} is not in {:?}", done.err);
        }
    };
    fails("export run.h5 taps --format csv --out x", &["--format csv", "taps", "wav or uff or mat"]);
    fails("export run.h5 damage --format uff --out x", &["--format uff", "damage", "csv or parquet"]);
    fails("export run.h5 taps", &["--out"]);
    fs::create_dir(sandbox.path("full")).unwrap();
    sandbox.write("full/mine.txt", "mine");
    fails("export run.h5 taps --out full", &["full", "empty"]);
    fails("export run.h5 taps --out run.h5", &["run.h5"]);
    fails("export run.h5 taps --out run.h5/set", &["run.h5"]);
    assert_eq!(fs::read_to_string(sandbox.path("full/mine.txt")).unwrap(), "mine");

    part_of(&Reader::open(sandbox.path("run.h5")).unwrap(), sandbox.path("none.h5"), 0..0, |_, _| ());
    fails("export none.h5 taps --out x", &["none.h5", "none of its 124"]);
    assert!(!sandbox.path("x").exists());
    fs::create_dir(sandbox.path("empty")).unwrap();
    sandbox.run("export run.h5 taps --out empty/").expect(0);
    assert!(sandbox.path("empty/scan.toml").exists());
    sandbox.run("export run.h5 taps --out not/there/set").expect(0);
    assert!(sandbox.path("not/there/set/scan.toml").exists());
    let left = names(&sandbox.path(""));
    assert!(!left.iter().any(|name| name.ends_with(".new")), "drafts are left behind: {left:?}");
}

/// Catches Parquet from the command line that is not the table: to a file and to standard output.
#[test]
fn a_table_is_written_as_parquet() {
    let sandbox = run();
    sandbox.run("export run.h5 discriminators --format parquet --out found.parquet").expect(0);
    let to_file = fs::read(sandbox.path("found.parquet")).unwrap();
    let to_stdout = sandbox.command("export run.h5 discriminators --format parquet").output().unwrap().stdout;
    assert!(to_file.starts_with(b"PAR1") && to_file.ends_with(b"PAR1"));
    assert!(to_file == to_stdout);
    let has = |text: &str| to_file.windows(text.len()).any(|window| window == text.as_bytes());
    assert!(Discriminator::ALL.into_iter().all(|which| has(which.column())) && has("quality_bits"));
}
