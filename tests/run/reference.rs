//! A reference: made from archives, named by a run, kept in the archive; and what is refused.

use std::path::PathBuf;

use tapline_testing::documents::{csv_rows, text};

use crate::sandbox::Sandbox;
use crate::sandbox::archives::finished;

const SCAN: &str = "[scan]\noffsets_mm = [0.0, 10.0]\nvelocities_m_per_s = [1.5]\nrepetitions = 2\n";

/// Two sound tyres and a cracked one, for a separate run.
fn tyres(prefix: &str, cracked: bool) -> String {
    let crack = "crack = [{ shoulder = 1, first_location = 30, location_count = 6, depth_mm = 5.0 }]\n";
    let tyre = |k: u32, crack: &str| format!("[[scan.tyre]]\nserial = \"{prefix}{k}\"\n{crack}");
    let third = if cracked { tyre(3, crack) } else { String::new() };
    format!("{}{}{third}", tyre(1, ""), tyre(2, ""))
}

const SOUND: &str = "sound/S1.h5 sound/S2.h5";
const CRACKED: &str = "cracked/C1.h5 cracked/C2.h5 cracked/C3.h5";

/// A folder with the runs `sound` and `cracked`, in which every tyre was its own reference.
fn scanned() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.write("sound.toml", &format!("{SCAN}seed = 5\n{}", tyres("S", false)));
    sandbox.write("cracked.toml", &format!("{SCAN}seed = 6\n{}", tyres("C", true)));
    for name in ["sound", "cracked"] {
        sandbox.run(&format!("run --config {name}.toml --out {name} --reference self --json")).expect(0);
    }
    sandbox
}

fn verdicts(sandbox: &Sandbox, archive: &str) -> Vec<(String, String, String)> {
    let files = finished(&sandbox.path(archive)).into_values();
    let texts = files.map(|file| sandbox.run(&format!("export {} verdicts", file.display())).expect(0).out);
    let rows = texts.flat_map(|text| csv_rows(&text));
    rows.map(|row| (format!("{}/{}", row["tyre"], row["shoulder"]), row["verdict"].clone(), row["reasons"].clone()))
        .collect()
}

/// Catches a softer casing that passes by a reference that never saw one, and one that does not by a reference that did; the page says so.
#[test]
fn a_reference_covers_the_temperatures_that_it_was_made_at() {
    let sandbox = Sandbox::new();
    let run = |name: &str, modulus: f64, seed: u32, serials: std::ops::Range<u32>, reference: &str| {
        let tyres: String = serials.map(|k| format!("[[scan.tyre]]\nserial = \"T-{k}\"\n")).collect();
        sandbox.write("c.toml", &format!("[scan]\nseed = {seed}\n{tyres}[simulation]\nmodulus_ratio = {modulus:?}\n"));
        sandbox.run(&format!("run --config c.toml --out {name} --reference {reference}"));
        verdicts(&sandbox, name)
    };
    run("usual", 1.0, 1, 0..12, "self");
    sandbox.run("reference usual --out usual.json").expect(0);
    for (name, modulus, serials) in [("all/cold", 1.05, 0..4), ("all/warm", 0.95, 4..8), ("all/usual", 1.0, 8..12)] {
        run(name, modulus, 1, serials, "self");
    }
    sandbox.run("reference all --out all.json").expect(0);
    let softer = run("by-usual", 0.97, 2, 20..24, "usual.json");
    assert!(softer.iter().all(|(_, verdict, why)| verdict != "PASS" && why.contains("level_off")), "{softer:?}");
    let softer = run("by-all", 0.97, 2, 20..24, "all.json");
    assert!(softer.iter().filter(|(_, verdict, _)| verdict == "PASS").count() >= 7, "{softer:?}");
}

/// Catches a casing that stands still under the impactor and passes, though it has a crack that is never tapped.
#[test]
fn a_casing_that_does_not_turn_does_not_pass() {
    let sandbox = Sandbox::new();
    let run = |name: &str, seed: u32, stands_still: bool, reference: &str| {
        let crack = "crack = [{ shoulder = 1, first_location = 40, location_count = 5, depth_mm = 6.0, length_mm = 22.0, offset_mm = 0.0 }]";
        let crack = if stands_still { crack } else { "" };
        let tyres: String = (0..8).map(|k| format!("[[scan.tyre]]\nserial = \"T-{seed}-{k}\"\n{crack}\n")).collect();
        let uneven =
            format!("[simulation]\nring_variation = 0.05\nlocation_scatter = 0.04\nstands_still = {stands_still}\n");
        sandbox.write("c.toml", &format!("[scan]\nseed = {seed}\n{tyres}{uneven}"));
        sandbox.run(&format!("run --config c.toml --out {name} --reference {reference}"))
    };
    run("turning", 1, false, "self").expect(0);
    sandbox.run("reference turning --out sound.json").expect(0);
    let said = run("still", 2, true, "sound.json").expect(0).out;
    let found = verdicts(&sandbox, "still");
    assert!(found.iter().all(|(_, verdict, why)| verdict == "RE-INSPECT" && why.contains("scatter_low")), "{found:?}");
    let sign = said.lines().find(|line| line.trim_start().starts_with("station 1: scatter_low on "));
    assert!(sign.is_some_and(|sign| sign.contains(": 0.") && sign.ends_with(" times the reference's")), "{said}");
    assert!(!said.contains("scatter_low: "), "its number stands once, below the table: {said}");
    run("turned", 3, false, "sound.json").expect(0);
    let found = verdicts(&sandbox, "turned");
    assert!(found.iter().all(|(_, _, why)| !why.contains("scatter_low")), "{found:?}");
}

/// Catches one casing that was recorded differently and keeps a whole folder from being a reference.
#[test]
fn what_was_recorded_differently_is_left_out() {
    let sandbox = scanned();
    let long = format!("{SCAN}seed = 5\n{}[simulation]\nsample_count = 4096\n", tyres("Z", false));
    sandbox.write("long.toml", &long);
    sandbox.run("run --config long.toml --out long --reference self").expect(0);
    let done = sandbox.run(&format!("reference {SOUND} long --out sound.json")).expect(0);
    assert!(done.out.contains("4 shoulders: S1/1, S1/2, S2/1, S2/2;"), "{done:?}");
    assert!(done.err.contains("long/Z1.h5: its taps were recorded") && done.err.contains("left out"), "{done:?}");
    // What is asked for by name is not left out.
    let named =
        sandbox.run(&format!("reference {SOUND} long --shoulder S1/1 --shoulder Z1/1 --out named.json")).expect(1);
    assert!(named.err.contains("long/Z1.h5: its taps were recorded"), "{named:?}");
}

/// Catches one shoulder that passed although it is cracked and keeps a whole folder from being a reference, or that is taken as sound.
#[test]
fn a_cracked_shoulder_that_passed_is_left_out() {
    let sandbox = scanned();
    sandbox.run("export sound taps --out set").expect(0);
    let truth = text(&sandbox.path("set/truth.csv"));
    sandbox.write("set/truth.csv", &truth.replace("\nS1,1,5,0\n", "\nS1,1,5,1\n"));
    sandbox.run("run --taps set --config set/config.toml --out known").expect(0);
    assert!(verdicts(&sandbox, "known").iter().any(|(name, verdict, _)| name == "S1/1" && verdict == "PASS"));
    let done = sandbox.run("reference known --out sound.json").expect(0);
    assert!(done.out.contains("3 shoulders: S1/2, S2/1, S2/2;"), "{done:?}");
    let words = "known/S1.h5: S1/1 passed although it is known to be cracked, and is left out";
    assert!(done.err.contains(words), "{done:?}");
    let named = sandbox.run("reference known --shoulder S1/1 --out named.json").expect(1);
    assert!(named.err.contains("S1/1 is known to be cracked; --labelled"), "{named:?}");
}

/// Catches a reference that is not used or not recorded, a sound tyre of another construction that counts as damaged, a
/// crack that is missed, and an archive without the reference of its verdicts.
#[test]
fn tyres_are_judged_by_a_reference_of_others() {
    let sandbox = scanned();
    let done = sandbox.run(&format!("reference {SOUND} --out sound.json")).expect(0);
    assert!(done.out.contains("4 shoulders: S1/1, S1/2, S2/1, S2/2; 400 sound and 0 cracked locations"), "{done:?}");
    let again = "run --config cracked.toml --out by --reference sound.json --json";
    sandbox.run(again).expect(0);
    for (name, verdict, reasons) in verdicts(&sandbox, "by") {
        assert_eq!(verdict == "REJECT", name == "C3/1", "{name} {verdict} {reasons}");
        assert!(!reasons.contains("self_reference"), "{name} {reasons}");
    }
    assert!(verdicts(&sandbox, "cracked").iter().all(|(_, _, reasons)| reasons.contains("self_reference")));
    let regions = sandbox.run("export by/C3.h5 regions").out;
    let region: Vec<&str> = regions.lines().nth(1).unwrap().split(',').collect();
    let (first, last): (u32, u32) = (region[3].parse().unwrap(), region[4].parse().unwrap());
    assert!((28..=31).contains(&first) && (34..=37).contains(&last), "{regions}");
    let p_value: f64 = region[14].parse().unwrap();
    assert!(p_value <= 0.01 && region[16] == "0", "the belt edge sees it: {regions}");

    let reader = tapline_store::Reader::open(sandbox.path("by/C3.h5")).unwrap();
    assert_eq!(reader.reference(), Some(std::fs::read_to_string(sandbox.path("sound.json")).unwrap().as_str()));
    drop(reader);
    // The same run again has nothing to do; with another reference it is another run.
    sandbox.run(again).expect(0);
    sandbox.run("reference sound/S1.h5 --shoulder S1/1 --shoulder S1/2 --out sound.json --force").expect(0);
    let done = sandbox.run(again).expect(1);
    assert!(done.err.contains("another reference"), "{done:?}");
}

/// Catches a shoulder that is not judged because recordings of the other one are missing, at most taps or at a
/// location.
#[test]
fn a_shoulder_without_its_recordings_leaves_the_other_alone() {
    let sandbox = scanned();
    sandbox.run(&format!("reference {SOUND} --out sound.json")).expect(0);
    sandbox.run("export cracked/C3.h5 taps --out set").expect(0);
    sandbox.run("run --taps set --reference sound.json --out whole").expect(0);
    let of_shoulder =
        |name: &str, archive: &str| verdicts(&sandbox, archive).into_iter().find(|v| v.0 == name).unwrap();
    let (whole, damaged) = (of_shoulder("C3/1", "whole"), of_shoulder("C3/2", "whole"));
    assert_eq!((whole.1.as_str(), damaged.1.as_str()), ("REJECT", "PASS"));
    let taps = csv_rows(&text(&sandbox.path("set/taps.csv")));
    let files = |is_lost: &dyn Fn(u32) -> bool| -> Vec<PathBuf> {
        let of_it = taps.iter().filter(|tap| tap["shoulder"] == "2" && is_lost(tap["location"].parse().unwrap()));
        of_it.map(|tap| sandbox.path("set").join(&tap["file"])).collect()
    };
    // Every tap of a location, then most taps of the shoulder, then all.
    let ranges = [("location", 40..=40), ("most", 41..=u32::MAX), ("all", 0..=39)];
    for (lost, files) in ranges.map(|(lost, range)| (lost, files(&|location| range.contains(&location)))) {
        files.iter().for_each(|file| std::fs::remove_file(file).unwrap());
        sandbox.run(&format!("run --taps set --reference sound.json --out {lost}")).expect(3);
        assert_eq!(of_shoulder("C3/1", lost), whole);
        let (_, verdict, reasons) = of_shoulder("C3/2", lost);
        assert_eq!(verdict, "RE-INSPECT");
        assert!(reasons.contains("taps_refused") && reasons.contains("discriminators_absent"), "{lost}: {reasons}");
        assert!(lost != "all" || !reasons.contains("level_unknown"), "the reference has levels: {reasons}");
    }
}

/// Catches labels that are not read, cracked locations that count as sound, and directions that are not learned.
#[test]
fn a_labelled_reference_teaches() {
    let sandbox = scanned();
    let labelled = format!("reference {CRACKED} {SOUND} --labelled --learn-directions --out known.json");
    let done = sandbox.run(&labelled).expect(0);
    assert!(done.out.contains("994 sound and 6 cracked"), "{done:?}");
    // Six are too few.
    assert_eq!((done.out.matches(", given").count(), done.out.matches(", learned").count()), (8, 0), "{done:?}");
    sandbox.write("later.toml", &format!("{SCAN}seed = 7\n{}[fuse]\nreference = \"known.json\"\n", tyres("L", true)));
    let done = sandbox.run("run --config later.toml --out later --json").expect(0);
    for (name, verdict, reasons) in verdicts(&sandbox, "later") {
        // One in fifty sound shoulders may be RE-INSPECT.
        assert_eq!(verdict == "REJECT", name == "L3/1", "{name} {verdict} {reasons}");
        assert!(reasons.contains("extrapolated"), "{name} {reasons}");
    }
    // Five casings support 1/6 and no less; that is reported once for all six shoulders.
    let why = "reject_rate: 5 casings support 16.667 %; 0.1 % is extrapolated";
    let remarks = |text: &str| text.lines().filter(|line| line.contains(why)).count();
    assert_eq!(remarks(&done.err), 1, "{done:?}");
    let summary = done.json(0);
    let texts = summary["remarks"].as_array().unwrap();
    assert_eq!(texts.iter().filter(|text| remarks(text.as_str().unwrap()) == 1).count(), 1, "{texts:?}");
    let again = sandbox.run("run --config later.toml --out later");
    assert_eq!((again.code, remarks(&again.err)), (Some(0), 1), "also when nothing is left to do: {again:?}");
}

/// Catches a casing that is cracked all round, as nobody knows, among those that passed by themselves; one that is stated to be
/// sound and is not, without a word; and a reference that is used without one.
#[test]
fn what_stands_out_of_a_reference_is_reported() {
    let sandbox = Sandbox::new();
    let scan = "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.5]\nrepetitions = 1\nseed = 5\n";
    let tyre = |serial: &str, cracks: &str| format!("[[scan.tyre]]\nserial = \"{serial}\"\ncrack = [{cracks}]\n");
    let crack = |shoulder, count| {
        format!("{{ shoulder = {shoulder}, first_location = 0, location_count = {count}, depth_mm = 5.0 }}")
    };
    let sound: String = (1..8).map(|k| tyre(&format!("S{k}"), "")).collect();
    let round = tyre("R1", &format!("{}, {}", crack(1, 100), crack(2, 100)));
    sandbox.write("scan.toml", &format!("{scan}{sound}{round}{}", tyre("C1", &crack(1, 6))));
    sandbox.run("run --config scan.toml --out known --reference self").expect(0);
    // As a plant has them: nobody knows what is cracked.
    sandbox.run("export known taps --out set").expect(0);
    std::fs::remove_file(sandbox.path("set/truth.csv")).unwrap();
    let summary = sandbox.run("run --taps set --out scanned --reference self --json").expect(0).json(0);
    assert!(summary.get("auc").is_some_and(serde_json::Value::is_null), "{summary}");
    let done = sandbox.run("reference scanned --out passed.json --json").expect(0);
    assert!(done.err.contains("R1 stands out from the other casings and may be cracked: it is left out"), "{done:?}");
    assert!(done.err.contains("scanned/C1.h5: C1/1 did not pass and is left out"), "{done:?}");
    let slip = sandbox.run("reference scanned --shoulder C1/11 --out slip.json").expect(1);
    assert!(
        slip.err.contains("C1/11 is in none of the archives that could be read; did you mean \"C1/1\"?"),
        "{slip:?}"
    );
    let slip = sandbox.run("reference scanned --shoulder C1 --out slip.json").expect(1);
    assert!(slip.err.contains("; that casing has C1/1, C1/2"), "{slip:?}");
    assert!(done.out.contains("S7/2") && !done.out.contains("R1/1"), "{done:?}");
    let named: String = (1..8).map(|k| format!(" --shoulder S{k}/1")).collect();
    let done = sandbox.run(&format!("reference scanned{named} --shoulder C1/1 --out stated.json")).expect(0);
    assert!(done.err.contains("C1 stands out from the other casings and may be cracked: limits"), "{done:?}");
    let done = sandbox.run("run --taps set --out again --reference stated.json").expect(0);
    assert!(done.err.contains("reference: C1 may be cracked"), "{done:?}");
}

/// Catches a run without a clear reference, and errors that do not say what to do.
#[test]
fn what_cannot_be_a_reference_is_refused() {
    let sandbox = scanned();
    let refused = |arguments: &str, words: &[&str]| {
        let done = sandbox.run(arguments).expect(1);
        for word in words {
            assert!(done.err.contains(word), "{arguments}: {word} is not in {}", done.err);
        }
    };
    let done =
        tapline_testing::program::Done::from(sandbox.plain("run --config sound.toml --out none").output().unwrap());
    assert!(done.code == Some(1) && done.err.contains("no reference is named"), "{done:?}");
    assert!(!sandbox.path("none").exists());
    refused("run --config sound.toml --out a --reference missing.json", &["missing.json"]);
    refused("run --config sound.toml --out a --reference nonsense", &["--reference", "nonsense", "self"]);
    refused(
        "run --config sound.toml --out a --reference X/1",
        &["X/1", "does not have it", "tapline reference FOLDER"],
    );
    sandbox.write("bad.json", "{}");
    refused("run --config sound.toml --out a --reference bad.json", &["bad.json", "not a reference"]);
    refused(&format!("reference {SOUND} --out sound.txt"), &["sound.txt", ".json"]);
    refused(&format!("reference {SOUND} --shoulder S9/1 --out s.json"), &["S9/1"]);
    // An archive that is named twice counts once.
    let once = sandbox.run("reference sound/S1.h5 sound/S1.h5 --out once.json");
    assert!(once.code == Some(0) && once.out.contains("2 shoulders: S1/1, S1/2"), "{once:?}");
    refused("reference missing.h5 --out s.json", &["missing.h5"]);
    // A shoulder that did not pass is not sound unless it is named.
    let done = sandbox.run(&format!("reference {CRACKED} --out c.json"));
    assert!(done.code == Some(0) && done.err.contains("C3/1 did not pass"), "{done:?}");
    assert!(done.out.contains(" shoulders: C") && !done.out.contains("C3/1"), "{done:?}");
    // Naming a shoulder that is known to be cracked does not make it sound; the error asks for the truth of each
    // location.
    refused("reference cracked/C3.h5 --shoulder C3/1 --out named.json", &["C3/1 is known to be cracked", "--labelled"]);
    assert!(!sandbox.path("named.json").exists());
    sandbox.run(&format!("reference {SOUND} --out sound.json")).expect(0);
    sandbox.write("other.toml", &format!("{SCAN}{}[process]\nf_c_hz = 600.0\n", tyres("S", false)));
    refused("run --config other.toml --out a --reference sound.json", &["f_c_hz = 550.0 there", "f_c_hz = 600.0 here"]);
    // A line of folders, of which nothing else is known.
    let station = "[[station]]\nnumber = 1\nsource = \"folder\"\nfolder = \"in\"\n";
    sandbox.write("folder.toml", &format!("{station}[process]\nf_c_hz = 600.0\n[fuse]\nreference = \"sound.json\"\n"));
    refused("config --check folder.toml", &["f_c_hz = 550.0 there, f_c_hz = 600.0 here"]);
    sandbox.write("folder.toml", &format!("{station}[fuse]\nreference = \"sound.json\"\n"));
    sandbox.run("config --check folder.toml").expect(0);
    // Archives that were analysed differently cannot be combined either.
    sandbox.run("run --config other.toml --out other --reference self").expect(0);
    refused(
        "reference sound/S1.h5 other/S2.h5 --out both.json",
        &["other/S2.h5", "sound/S1.h5", "f_c_hz = 550.0 there, f_c_hz = 600.0 here"],
    );
    assert!(!sandbox.path("both.json").exists());
    sandbox.write("elsewhere.toml", "[scan]\noffsets_mm = [7.0]\nvelocities_m_per_s = [1.5]\n");
    refused("run --config elsewhere.toml --out a --reference sound.json", &["7 mm", "10 mm", "in common"]);
    sandbox.write("farther.toml", "[scan]\noffsets_mm = [0.0, 7.0]\nvelocities_m_per_s = [1.5]\nlocations = 100\n");
    let farther = sandbox.run("run --config farther.toml --out farther --reference sound.json").expect(0);
    assert!(farther.err.contains("the reference has no taps at 7 mm, 1.5 m/s: a shoulder"), "{}", farther.err);
    assert!(farther.out.contains("condition_unknown"), "{}", farther.out);
    let edited = std::fs::read_to_string(sandbox.path("sound.json")).unwrap().replace("\"S1\"", "\"S8\"");
    sandbox.write("edited.json", &edited);
    refused("run --config sound.toml --out a --reference edited.json", &["edited.json", "changed"]);
}
