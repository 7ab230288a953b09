//! Verbs on folders: which files of a folder count, one damaged file among many, and what becomes of many archives.

use std::fs;
use std::path::Path;

use crate::sandbox::Sandbox;
use crate::sandbox::archives::names;
use tapline_testing::documents::{csv_rows, text};

const SCAN: &str = "\
[scan]
locations = 12
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 2
[fuse]
reference = \"self\"
";

/// Three casings in `out`, and other results of one of them.
fn scanned() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.write("scan.toml", SCAN);
    sandbox.run("run --config scan.toml --stations 3 --out out").expect(0);
    sandbox
}

/// Flips a bit in the middle of the file's tables.
fn damage(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    bytes[3000] ^= 1;
    fs::write(path, bytes).unwrap();
}

/// Catches a table that is written as several, has a header in its middle, or lacks a casing.
#[test]
fn a_table_of_a_folder_is_one() {
    let sandbox = scanned();
    let casings = csv_rows(&sandbox.run("export out casings").expect(0).out);
    assert!(casings.iter().all(|row| row["force_calibrated_on"].is_empty()), "computed samples need no calibration");
    for table in ["discriminators", "damage", "regions", "verdicts", "ledger", "casings"] {
        let whole = sandbox.run(&format!("export out {table}")).expect(0).out;
        let rows = csv_rows(&whole);
        let mut count = 0;
        for casing in ["SIM-0001", "SIM-0002", "SIM-0003"] {
            let alone = csv_rows(&sandbox.run(&format!("export out/{casing}.h5 {table}")).expect(0).out);
            let file = format!("{casing}.h5");
            let of_it = rows.iter().filter(|row| row["file"] == file).cloned();
            let without_file: Vec<_> = of_it.map(|mut row| (row.remove("file"), row).1).collect();
            assert_eq!(without_file, alone, "{table} of {casing}");
            count += alone.len();
        }
        assert_eq!(rows.len(), count, "{table}");
        let named =
            sandbox.run(&format!("export out/SIM-0001.h5 out/SIM-0002.h5 out/SIM-0003.h5 {table}")).expect(0).out;
        assert_eq!(named, whole, "{table}");
        sandbox.run(&format!("export out {table} --format parquet --out {table}.parquet")).expect(0);
        assert!(fs::read(sandbox.path(&format!("{table}.parquet"))).unwrap().starts_with(b"PAR1"));
    }
}

/// Catches taps of several casings that do not come back, and archives that are combined although they cannot be one
/// set.
#[test]
fn taps_of_a_folder_are_one_tap_set() {
    let sandbox = scanned();
    sandbox.run("export out taps --out set").expect(0);
    sandbox.run("run --taps set --config set/config.toml --stations 3 --out again").expect(0);
    for table in ["discriminators", "damage", "verdicts"] {
        let exported = |folder: &str| sandbox.run(&format!("export {folder} {table}")).expect(0).out;
        assert_eq!(exported("again"), exported("out"), "{table}");
    }
    sandbox.run("export out taps --format uff --out uff").expect(0);
    assert_eq!(names(&sandbox.path("uff")).len(), 7);
    // The same casing twice, and another configuration.
    fs::create_dir(sandbox.path("twice")).unwrap();
    fs::copy(sandbox.path("out/SIM-0001.h5"), sandbox.path("twice/SIM-0001.h5")).unwrap();
    fs::copy(sandbox.path("out/SIM-0001.h5"), sandbox.path("twice/SIM-0001.2.h5")).unwrap();
    let done = sandbox.run("export twice taps --out no").expect(1);
    assert!(done.err.contains("a tap set has each casing once") && !sandbox.path("no").exists(), "{done:?}");
    sandbox.write("other.toml", &format!("{SCAN}re_inspect_rate = 0.01\n"));
    sandbox.run("run --config other.toml --out other").expect(0);
    let done = sandbox.run("-v export out other taps --out no").expect(1);
    let differ = "its options differ (fuse.re_inspect_rate = 0.01 here, 0.02 there)";
    assert!(done.err.contains(differ) && !sandbox.path("no").exists(), "{done:?}");
    assert!(!done.err.contains("reading "), "taps were read before all archives were checked: {done:?}");
    // How taps were simulated affects no result of recorded ones.
    let tyre = "seed = 7\n[[scan.tyre]]\nserial = \"OTHER\"\n[simulation]\nsample_count = 4096\n[fuse]";
    sandbox.write("simulated.toml", &SCAN.replace("[fuse]", tyre));
    sandbox.run("run --config simulated.toml --out simulated").expect(0);
    sandbox.run("export out simulated taps --out all").expect(0);
    sandbox.run("run --taps all --config all/config.toml --stations 3 --out together").expect(0);
    for archives in ["out", "simulated"] {
        let verdicts = |folder: &str| csv_rows(&sandbox.run(&format!("export {folder} verdicts")).expect(0).out);
        let together = verdicts("together");
        assert!(verdicts(archives).iter().all(|row| together.contains(row)), "{archives}: {together:?}");
    }
}

/// Catches a file that was cut, and that one verb calls damaged and another unfinished, as if a line went on with it.
#[test]
fn verbs_agree_on_a_cut_file() {
    let sandbox = scanned();
    let file = fs::OpenOptions::new().write(true).open(sandbox.path("out/SIM-0001.h5")).unwrap();
    let bytes = file.metadata().unwrap().len();
    file.set_len(bytes - 1).unwrap();
    let verified = sandbox.run("verify out/SIM-0001.h5").expect(3).out;
    assert!(verified.contains("out/SIM-0001.h5: NOT FINISHED: "), "{verified}");
    file.set_len(bytes / 2).unwrap();
    for verb in ["verify", "report", "explain", "export"] {
        let done = sandbox.run(&format!("{verb} out/SIM-0001.h5{}", if verb == "export" { " verdicts" } else { "" }));
        let said = format!("{}{}", done.out, done.err);
        assert!(said.contains("out/SIM-0001.h5 is damaged: it is shorter than it says"), "{verb}: {said}");
    }
}

/// Catches one damaged file that ends a verb for all others, or is not reported.
#[test]
fn a_damaged_file_among_many_is_named_and_the_others_are_done() {
    let sandbox = scanned();
    damage(&sandbox.path("out/SIM-0002.h5"));
    let with_one_damaged = |arguments: &str| {
        // What was altered is what `verify` looks for; others do what they can.
        let done = sandbox.run(arguments).expect(if arguments.starts_with("verify") { 1 } else { 3 });
        assert!(format!("{}{}", done.out, done.err).contains("out/SIM-0002.h5"), "{arguments}: {done:?}");
        done
    };
    assert_eq!(csv_rows(&with_one_damaged("export out verdicts").out).len(), 4);
    let verified = with_one_damaged("verify out").out;
    assert!(verified.contains("out/SIM-0002.h5: UNREADABLE\n"), "{verified}");
    assert!(verified.ends_with("3 archives: 2 complete, 0 incomplete, 1 damaged\n"));
    let last = with_one_damaged("verify out --json").out.lines().last().unwrap().to_owned();
    assert!(last.contains("\"complete\":2") && last.contains("\"is_complete\":false"), "{last}");
    // Nor is an empty file passed over: an archive that a copy never reached.
    fs::write(sandbox.path("empty.h5"), "").unwrap();
    let of_two = sandbox.run("verify nowhere.h5 out/SIM-0001.h5").expect(1);
    assert!(of_two.err.contains("nowhere.h5: ") && of_two.out.contains("SIM-0001.h5: complete"), "{of_two:?}");
    let empty = sandbox.run("verify empty.h5 --json").expect(1).out;
    assert!(empty.contains("empty.h5 is not an HDF5 file\"") && empty.contains("\"is_complete\":false"), "{empty}");
    with_one_damaged("report out --out pages");
    assert_eq!(names(&sandbox.path("pages")), ["shift.html", "tyre-SIM-0001.html", "tyre-SIM-0003.html"]);
    with_one_damaged("explain out");
    with_one_damaged("repack out --codec none --out packed");
    assert_eq!(names(&sandbox.path("packed")), ["SIM-0001.h5", "SIM-0003.h5"]);
    with_one_damaged("reference out --shoulder SIM-0003/2 --out sound.json");
    with_one_damaged("export out taps --out set");
    let results = with_one_damaged("reprocess out --from-samples").out;
    assert_eq!(results.lines().count(), 2, "{results}");
    with_one_damaged("diff out packed");
    // An error in an option is reported once, not for each file.
    for (reference, wrong) in [("none.json", "cannot read the reference none.json"), ("a/b", "--reference")] {
        let done = sandbox.run(&format!("reprocess out --reference {reference}")).expect(1);
        assert!(done.err.contains(wrong) && done.err.lines().count() == 1, "{}", done.err);
    }
    // What only lacks its last byte is named, too.
    let path = sandbox.path("out/SIM-0003.h5");
    let mut bytes = fs::read(&path).unwrap();
    bytes.pop();
    fs::write(&path, bytes).unwrap();
    let said = sandbox.run("verify out/SIM-0003.h5").expect(3).out;
    assert!(said.contains("its end was changed") && said.contains("; 1 problem; casing SIM-0003, "), "{said}");
    // The verb fails if it is the only file.
    sandbox.run("export out/SIM-0002.h5 verdicts").expect(1);
}

/// Catches results that count as well as their archives, newest results that are not found, a casing that is named
/// without its shoulder and gets no help, and a file that is taken for the folder of pages.
#[test]
fn results_are_taken_when_they_are_asked_for() {
    let sandbox = scanned();
    let before = sandbox.run("export out verdicts").expect(0).out;
    sandbox.run("reference out --shoulder SIM-0002/1 --shoulder SIM-0002/2 --out sound.json").expect(0);
    let made = sandbox.run("reprocess out --reference sound.json").expect(0).out;
    assert_eq!(made.lines().count(), 3);
    assert_eq!(sandbox.run("export out verdicts").expect(0).out, before);
    let after = csv_rows(&sandbox.run("export out verdicts --results").expect(0).out);
    assert_eq!(after.len(), 6);
    assert!(after.iter().all(|row| made.contains(&row["file"])), "{after:?}");
    assert!(sandbox.run("verify out").expect(0).out.contains("6 archives: 6 complete"));
    let changed = sandbox.run("diff out out --results").expect(0).out;
    assert!(changed.contains("fuse.reference: \"self\" -> \"a file\"") && !changed.contains("partner"), "{changed}");
    let (before, lines) = (csv_rows(&before), changed.lines().rev().take_while(|line| !line.contains(" compared: ")));
    let verdicts_differ = before.iter().zip(&after).filter(|(before, after)| before["verdict"] != after["verdict"]);
    assert_eq!(lines.filter(|line| line.contains(" -> ")).count(), verdicts_differ.count(), "{changed}");
    assert!(changed.contains("\n3 casings compared: 0 have the same numbers, "), "{changed}");
    let lines = sandbox.run("diff out out --results --json").expect(0).out;
    let summary: serde_json::Value = serde_json::from_str(lines.lines().last().unwrap()).unwrap();
    let listed = summary["verdicts_differ"].as_array().unwrap();
    assert_eq!((lines.lines().count(), &summary["compared"], &summary["same"]), (4, &3.into(), &0.into()), "{lines}");
    for change in listed {
        let [file, shoulder, before, after] =
            ["file", "shoulder", "before", "after"].map(|key| change[key].as_str().unwrap());
        assert!(changed.contains(&format!("\n{file}: {shoulder} {before} -> {after}\n")), "{change} {changed}");
    }
    assert!(changed.contains(&format!("0 have the same numbers, {} verdict", listed.len())), "{changed} {summary}");
    let ways: u64 = summary["changes"].as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum();
    assert_eq!(ways, listed.len() as u64, "{summary}");
    assert!(changed.contains(", re-inspect limit ") && changed.contains(", strongest arc "), "{changed}");
    let end = sandbox.run("diff out out --results --summary").expect(0).out;
    assert!(end.starts_with("3 casings compared: ") && changed.ends_with(&end), "{end}");
    // The archives of results that are the only ones here have another name.
    fs::create_dir(sandbox.path("renamed")).unwrap();
    fs::copy(sandbox.path("out/SIM-0001.h5"), sandbox.path("renamed/FIRST.h5")).unwrap();
    let results =
        names(&sandbox.path("out")).into_iter().find(|name| name.starts_with("SIM-0001.") && name.len() > 11).unwrap();
    fs::copy(sandbox.path(&format!("out/{results}")), sandbox.path(&format!("renamed/{results}"))).unwrap();
    let refused = sandbox.run("export renamed verdicts --results").expect(1).err;
    let gone = format!("renamed/{results} has those of renamed/SIM-0001.h5, which is not there");
    assert!(
        refused.contains("1 file of results of tapline reprocess without an archive") && refused.contains(&gone),
        "{refused}"
    );
    let said = sandbox.run("explain out --shoulder SIM-0003/1 --results").expect(0).out;
    assert!(said.starts_with("out/SIM-0003.") && said.matches("lineage").count() == 1, "{said}");
    // Those that are asked for again are the newest again.
    sandbox.run("reprocess out --reference self").expect(0);
    sandbox.run("reprocess out --reference sound.json").expect(0);
    assert_eq!(csv_rows(&sandbox.run("export out verdicts --results").expect(0).out), after);
    // Of two kinds of results, one casing has the other as its newest.
    assert!(!sandbox.run("export out verdicts --results").expect(0).err.contains("made alike"));
    sandbox.run("reprocess out/SIM-0002.h5 --reference self").expect(0);
    let warned = sandbox.run("export out verdicts --results").expect(0).err;
    assert!(warned.contains("out: the newest results were not all made alike: SIM-0001."), "{warned}");
    assert!(warned.contains(" with fuse.reference = \"a file\", SIM-0002."), "{warned}");
    assert!(sandbox.run("explain out --shoulder SIM-0009/1").expect(1).err.contains("none of the 3 archives"));
    let meant = "SIM-0002\": that casing has SIM-0002/1 and SIM-0002/2";
    assert!(sandbox.run("explain out --shoulder SIM-0002").expect(1).err.contains(meant));
    let refusal = sandbox.run("report out --out sound.json").expect(1).err;
    assert!(refusal.contains("sound.json is a file; it must be a folder"), "{refusal}");
    let refusal = sandbox.run("diff out sound.json").expect(1).err;
    assert!(refusal.contains("out and sound.json: two files are compared, or two folders"), "{refusal}");
}

#[test]
fn a_page_of_a_shift_is_of_all_days() {
    let sandbox = scanned();
    // As a line arranges them, including one that is under way.
    for (name, place) in [("SIM-0001", "day/2026-11-23"), ("SIM-0002", "day/2026-11-24"), ("SIM-0003", "day/open")] {
        fs::create_dir_all(sandbox.path(place)).unwrap();
        fs::copy(sandbox.path(&format!("out/{name}.h5")), sandbox.path(&format!("{place}/{name}.h5"))).unwrap();
    }
    sandbox.run("report day --out pages").expect(0);
    let shift = text(&sandbox.path("pages/shift.html"));
    assert!(shift.contains("SIM-0001") && shift.contains("SIM-0002"));
    assert!(shift.contains("1 archive is not finished and is left out</strong>: SIM-0003.h5."));
    assert_eq!(shift.matches("SIM-0003").count(), 1);
    let checked = sandbox.run("verify day").expect(3);
    assert!(checked.out.contains("day/open/SIM-0003.h5: NOT FINISHED"), "{checked:?}");
    let rows = csv_rows(&sandbox.run("export day verdicts").expect(0).out);
    assert_eq!(rows[3]["file"], "2026-11-24/SIM-0002.h5");
}

/// Catches casings of one name that are compared crosswise, that a table does not distinguish, or of which a copy takes the place
/// of another's.
#[test]
fn casings_of_one_name_differ_by_their_days() {
    let sandbox = scanned();
    for (from, to) in [("SIM-0001", "2026-11-23/A"), ("SIM-0002", "2026-11-24/A"), ("SIM-0003", "2026-11-24/B")] {
        fs::create_dir_all(sandbox.path(&format!("day/{to}")).parent().unwrap()).unwrap();
        fs::copy(sandbox.path(&format!("out/{from}.h5")), sandbox.path(&format!("day/{to}.h5"))).unwrap();
    }
    let changed = sandbox.run("diff day day").expect(0).out;
    assert_eq!(changed, "3 casings compared: 3 have the same numbers, 0 verdicts differ\n");
    let pairs = sandbox.run("diff day day --json").expect(0).out;
    assert!(pairs.contains("{\"before\":\"day/2026-11-23/A.h5\",\"after\":\"day/2026-11-23/A.h5\","), "{pairs}");
    let other = sandbox.run("diff day/2026-11-23 day/2026-11-24").expect(1);
    assert!(other.out.contains("day/2026-11-24/B.h5: without a partner"), "{other:?}");
    assert!(other.err.contains("cannot be compared tap by tap"), "{other:?}");
    for named in ["day/2026-11-23/A.h5 day/2026-11-24/A.h5", "day/2026-11-23 day/2026-11-24/A.h5"] {
        let rows = csv_rows(&sandbox.run(&format!("export {named} verdicts")).expect(0).out);
        let files: Vec<_> = rows.iter().step_by(2).map(|row| row["file"].as_str()).collect();
        assert_eq!(files, ["2026-11-23/A.h5", "2026-11-24/A.h5"], "{named}");
    }
    sandbox.run("repack day/2026-11-23/A.h5 day/2026-11-24/A.h5 --codec zstd --out packed").expect(0);
    assert!(sandbox.path("packed/2026-11-24/A.h5").exists());
}

/// Catches results whose archive was replaced and that a check leaves out of its lines, and a shoulder of which one of two archives is
/// taken without a word.
#[test]
fn a_replaced_archive_is_noticed() {
    let sandbox = scanned();
    sandbox.write("bands.toml", "[process]\nf_c_hz = 600.0\n");
    sandbox.run("reprocess out/SIM-0001.h5 --config bands.toml").expect(0);
    fs::copy(sandbox.path("out/SIM-0002.h5"), sandbox.path("out/SIM-0001.h5")).unwrap();
    let checked = sandbox.run("verify out --json").expect(1);
    assert_eq!(checked.out.lines().filter(|line| line.contains("\"archive\":")).count(), 4, "{checked:?}");
    assert!(checked.out.contains("has results of the taps"), "{checked:?}");
    let refused = sandbox.run("reference out --shoulder SIM-0002/1 --out r.json").expect(1).err;
    let words =
        "out/SIM-0002.h5: another of the archives has --shoulder SIM-0002/1 too: name only the file that is meant";
    assert!(refused.contains(words), "{refused}");
    sandbox.run("reference out/SIM-0002.h5 --shoulder SIM-0002/1 --out r.json").expect(0);
}

/// Catches an archive that is explained, or compared, with all tyres of its run, of which there may be hundreds.
#[test]
fn of_the_simulated_tyres_only_an_archive_s_own_are_shown() {
    let sandbox = Sandbox::new();
    let tyre = |k: u32, more: &str| format!("[[scan.tyre]]\nserial = \"T{k}\"\n{more}");
    let tyres = |last: &str| format!("{SCAN}{}{}{}", tyre(1, ""), tyre(2, ""), tyre(3, last));
    let crack = "crack = [{ shoulder = 1, first_location = 3, location_count = 2, depth_mm = 5.0 }]\n";
    for (name, last) in [("a", ""), ("b", crack)] {
        sandbox.write(&format!("{name}.toml"), &tyres(last));
        sandbox.run(&format!("run --config {name}.toml --out {name}")).expect(0);
    }
    let changed = sandbox.run("diff a/T2.h5 b/T2.h5").expect(0).out;
    assert!(changed.contains("scan.tyre: entries of other casings -> changed\n"), "{changed}");
    for arguments in ["explain a/T2.h5", "explain a/T2.h5 --json"] {
        let said = sandbox.run(arguments).expect(0).out.replace('\\', "");
        assert!(said.contains("serial = \"T2\"") && said.contains("}] and 2 others"), "{arguments}: {said}");
        assert!(!said.contains("\"T1\"") && !said.contains("\"T3\""), "{arguments}: {said}");
    }
}

/// Catches an index that is not there and is printed as a number.
#[test]
fn a_location_without_an_index_has_none() {
    let sandbox = scanned();
    let said = sandbox.run("explain out/SIM-0001.h5 --shoulder SIM-0001/1 --location 3").expect(0).out;
    assert!(said.contains("location   3: it has no index"), "{said}");
}

/// Catches a reference that does not suit a casing of a list and is reported too late, or without advice.
#[test]
fn a_shoulder_of_another_casing_is_no_reference() {
    let sandbox = scanned();
    sandbox.run("run --config scan.toml --out one --reference SIM-0001/2").expect(0);
    let many = sandbox.run("run --config scan.toml --stations 2 --out two --reference SIM-0001/2").expect(1);
    sandbox.write("plant.toml", &format!("{SCAN}[[station]]\nnumber = 1\nsource = \"simulated\"\n"));
    let line = sandbox.run("line --config plant.toml --out three --reference SIM-0001/2").expect(1);
    for done in [many, line] {
        assert!(done.err.contains("tapline reference FOLDER") && done.err.contains("--reference self"), "{done:?}");
    }
    assert!(!sandbox.path("two").exists() && !sandbox.path("three").exists());
}

#[test]
fn a_folder_with_nothing_is_an_error() {
    let sandbox = Sandbox::new();
    fs::create_dir(sandbox.path("empty")).unwrap();
    for arguments in ["export empty verdicts", "verify empty", "report empty", "explain empty", "reprocess empty"] {
        let done = sandbox.run(arguments).expect(1);
        assert!(done.err.contains("empty has no finished archive"), "{done:?}");
    }
}
