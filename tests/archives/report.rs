//! `report`: pages that need nothing else, agree with the tables, and are the same each time.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use tapline_store::Reader;

use crate::sandbox::Sandbox;
use crate::sandbox::archives::{names, part_of};
use crate::sandbox::recordings::write_wav;
use tapline_testing::documents::csv_rows;
use tapline_testing::program::Done;

/// A cracked tyre whose name looks like markup, and a sound one whose name looks like a path into another folder.
const SCAN: &str = r#"
[scan]
stations = 2
offsets_mm = [0.0, 5.0]
velocities_m_per_s = [1.85]
repetitions = 2
locations = 60
confirm = false

[[scan.tyre]]
serial = "<script>&\"x'"
station = 1
crack = [{ shoulder = 2, first_location = 57, location_count = 5, depth_mm = 6.0, length_mm = 22.0 }]

[[scan.tyre]]
serial = "..\\B 2"
station = 2

[fuse]
reference = "self"
"#;

/// Few taps.
const SHORT: &str =
    "[scan]\nlocations = 24\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.85]\nrepetitions = 1\nconfirm = false\n";

const CRACKED: &str = "tyre-_script___x_.html";
const SOUND: &str = "tyre-.._B_2.html";

/// Both archives as a run leaves them, in the folder `run`, and copies with simpler names.
fn scanned() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.write("scan.toml", SCAN);
    sandbox.run("run --config scan.toml --out run").expect(0);
    for (file, name) in [("%3Cscript%3E%26%22x%27.h5", "cracked.h5"), ("%2E.%5CB%202.h5", "sound.h5")] {
        fs::copy(sandbox.path("run").join(file), sandbox.path(name)).unwrap();
    }
    sandbox
}

fn page(sandbox: &Sandbox, name: &str) -> String {
    fs::read_to_string(sandbox.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// The pages in `folder`, by name.
fn pages(sandbox: &Sandbox, folder: &str) -> BTreeMap<String, String> {
    let names = names(&sandbox.path(folder)).into_iter();
    names.map(|name| (name.clone(), page(sandbox, &format!("{folder}/{name}")))).collect()
}

/// Checks that every element is closed in order, every attribute is quoted, and every `&` begins an entity.
fn assert_well_formed(name: &str, text: &str) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = text.strip_prefix("<!DOCTYPE html>").unwrap();
    while let Some(start) = rest.find('<') {
        let entities = rest[..start].split('&').skip(1);
        let is_entity = |text: &str| text.find(';').is_some_and(|end| (2..9).contains(&end));
        assert!(entities.into_iter().all(is_entity) && !rest[..start].contains('>'), "{name}: {}", &rest[..start]);
        let mut is_quoted = false;
        let end = rest[start..].find(|c| {
            is_quoted ^= c == '"';
            c == '>' && !is_quoted
        });
        let tag = &rest[start + 1..start + end.unwrap_or_else(|| panic!("{name}: a tag does not end"))];
        let word = tag.trim_start_matches('/').split([' ', '/']).next().unwrap();
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(word), "{name}");
        } else if !tag.ends_with('/') && !["meta", "br"].contains(&word) {
            open.push(word);
        }
        rest = &rest[start + tag.len() + 2..];
    }
    assert_eq!(open, Vec::<&str>::new(), "{name}");
}

/// Catches a page that is not well formed, loads something from elsewhere, runs a script, or is too large to send.
#[test]
fn pages_stand_alone() {
    let sandbox = scanned();
    for (archive, tyre) in [("cracked", CRACKED), ("sound", SOUND)] {
        let printed = sandbox.run(&format!("report {archive}.h5")).expect(0).out;
        let folder = format!("{archive}-report");
        assert_eq!(printed.lines().collect::<Vec<_>>(), [tyre, "shift.html"].map(|n| format!("{folder}/{n}")));
        let pages = pages(&sandbox, &folder);
        assert_eq!(pages.keys().map(String::as_str).collect::<Vec<_>>(), ["shift.html", tyre]);
        assert_stand_alone(&pages);
    }
    assert!(page(&sandbox, &format!("cracked-report/{CRACKED}")).contains("<h1>Tyre &lt;script&gt;&amp;&quot;x"));
}

/// A whole folder is a shift: it has a page for each tyre, and one for all, the worst first.
#[test]
fn a_folder_is_a_shift() {
    let sandbox = scanned();
    let printed = sandbox.run("report run").expect(0).out;
    assert_eq!(printed.lines().count(), 3, "{printed}");
    let pages = pages(&sandbox, "run-report");
    assert_eq!(pages.keys().map(String::as_str).collect::<Vec<_>>(), ["shift.html", SOUND, CRACKED]);
    assert_stand_alone(&pages);
    let shift = &pages["shift.html"];
    assert!(shift.find(CRACKED).unwrap() < shift.find(SOUND).unwrap(), "the worst is not first");
    // Of thousands of casings, nobody reads the pages; the one that is left links to none.
    assert_eq!(sandbox.run("report run --shift-only --out alone").expect(0).out, "alone/shift.html\n");
    let alone = page(&sandbox, "alone/shift.html");
    assert!(alone.contains("REJECT") && !alone.contains(CRACKED) && !alone.contains("<a href=\"tyre-"));
    assert_eq!(fs::read_dir(sandbox.path("alone")).unwrap().count(), 1);
}

/// Catches an operator, a plant or a reference of one archive that stands for all, in the order in which they are named; archives that
/// are left out without a word; and a shoulder that did not pass, and nobody learns why.
#[test]
fn a_shift_says_what_differs_and_what_it_lacks() {
    let sandbox = Sandbox::new();
    for (name, operator) in [("a", "A. Smith"), ("b", "B. Jones")] {
        let casing = format!("[[scan.tyre]]\nserial = \"{name}\"\ncrack = []\n[fuse]\nreference = \"self\"\n");
        let printed = format!("[report]\nplant = \"North\"\noperator = \"{operator}\"\n");
        let scan = format!("{SHORT}{casing}{printed}");
        sandbox.write("scan.toml", &scan);
        sandbox.run(&format!("run --config scan.toml --out {name}")).expect(0);
    }
    let whole = fs::read(sandbox.path("a/a.h5")).unwrap();
    fs::write(sandbox.path("b/cut.h5"), &whole[..whole.len() / 2]).unwrap();
    fs::create_dir_all(sandbox.path("b/open")).unwrap();
    fs::write(sandbox.path("b/open/under-way.1.h5"), &whole[..100]).unwrap();
    let shift = |folders: &str| {
        sandbox.run(&format!("report {folders} --shift-only --force --out shift")).expect(3);
        page(&sandbox, "shift/shift.html")
    };
    let one = shift("a b");
    assert_eq!(one.matches("<dt>Plant</dt><dd>North</dd>").count(), 1);
    for words in ["<strong>1 tyre: </strong>A. Smith", "<strong>1 tyre: </strong>B. Jones", "cut.h5", "under-way.1.h5"]
    {
        assert!(one.contains(words), "{words}");
    }
    let list = |page: &str| page.split("<dt>Plant</dt>").nth(1).unwrap().split("</dl>").next().unwrap().to_owned();
    assert_eq!(list(&one), list(&shift("b a")));
    sandbox.run("report a --shift-only --out alone").expect(0);
    let alone = page(&sandbox, "alone/shift.html");
    assert!(alone.contains("<dt>Operator</dt><dd>A. Smith</dd>") && !alone.contains("left out"));
    // A crack of the default tyre, and no cracked one at the other station.
    sandbox.write("cracked.toml", &format!("{SHORT}[fuse]\nreference = \"self\"\n"));
    sandbox.run("run --config cracked.toml --stations 2 --out cracked").expect(0);
    sandbox.run("report cracked --shift-only --out why").expect(0);
    let why = page(&sandbox, "why/shift.html");
    assert!(why.contains("1: REJECT (damage") && why.contains("<td><code>damage</code></td>"));
}

/// Catches a shoulder whose taps never came and that is explained by what follows from this, a fault of a sensor that a few refused taps
/// hide, a line of the list for each file, and reasons that lack in a table.
#[test]
fn taps_that_never_came_are_the_reason() {
    let sandbox = Sandbox::new();
    sandbox.write(
        "scan.toml",
        &format!("{SHORT}[[scan.tyre]]\nserial = \"A\"\ncrack = []\n[fuse]\nreference = \"self\"\n"),
    );
    sandbox.run("run --config scan.toml --out made").expect(0);
    let again = |taps: &str, alter: &dyn Fn(usize, &Path)| {
        sandbox.run(&format!("export made/A.h5 taps --out {taps}")).expect(0);
        let table = csv_rows(&fs::read_to_string(sandbox.path(&format!("{taps}/taps.csv"))).unwrap());
        for (k, row) in table.iter().filter(|row| row["shoulder"] == "2").enumerate() {
            alter(k, &sandbox.path(&format!("{taps}/{}", row["file"])));
        }
        sandbox.run(&format!("run --taps {taps} --config {taps}/config.toml --out {taps}-run")).expect(3);
        sandbox.run(&format!("report {taps}-run --shift-only --out {taps}-report")).expect(0);
        let page = page(&sandbox, &format!("{taps}-report/shift.html"));
        assert_well_formed(taps, &page);
        let verdicts = csv_rows(&sandbox.run(&format!("export {taps}-run/A.h5 verdicts")).expect(0).out);
        (page, verdicts[1]["reasons"].clone(), table.len() / 2)
    };
    // The casing went away after its first shoulder.
    let (shift, reasons, count) = again("gone", &|_, file| fs::remove_file(file).unwrap());
    let cause = format!("{count} of {count} planned taps were refused: the file does not exist");
    assert!(shift.contains(&format!("2: RE-INSPECT ({cause})")), "{shift}");
    assert!(shift.contains(&format!("<td>the file does not exist</td><td class=\"n\">{count}</td>")), "{shift}");
    let (overview, why) = shift.split_once("Why shoulders did not pass").unwrap();
    assert!(why.contains("<td><code>taps_refused</code></td>"), "{why}");
    for follows in ["location_blind", "no_index", "discriminators_absent"] {
        assert!(!overview.contains(follows) && !why.contains(&format!("<code>{follows}</code>")), "{follows}");
        assert!(reasons.contains(follows), "{follows}: {reasons}");
    }
    sandbox.run("report gone-run --out tyre").expect(0);
    let tyre = page(&sandbox, "tyre/tyre-A.html");
    assert!(tyre.contains(&format!("\"why\">{cause}. ")) && !tyre.contains("A discriminator that the index needs"));
    // One lacks, and the microphone was dead all the time.
    let mute = |k: usize, file: &Path| {
        if k == 7 {
            return fs::remove_file(file).unwrap();
        }
        let mut bytes = fs::read(file).unwrap();
        let start = bytes.windows(4).position(|word| word == b"data").unwrap() + 8;
        // 16 bits of force, then 16 bits of sound.
        bytes[start..].chunks_exact_mut(4).for_each(|frame| frame[2..].fill(0));
        fs::write(file, bytes).unwrap();
    };
    let (shift, ..) = again("mute", &mute);
    let cause = format!("2: RE-INSPECT (1 of {count} planned taps were refused: the file does not exist; ");
    assert!(shift.contains(&cause), "{shift}");
    assert!(shift.contains("<code>discriminators_absent</code>"), "{shift}");
    // A few neighbours lack, and nothing else.
    let (shift, reasons, _) = again("few", &|k, file| {
        if k < 5 {
            fs::remove_file(file).unwrap()
        }
    });
    assert!(
        shift.contains(&format!("2: RE-INSPECT (5 of {count} planned taps were refused: the file does not exist)")),
        "{shift}"
    );
    assert!(
        reasons.contains("discriminators_absent") && !shift.contains("<code>discriminators_absent</code>"),
        "{reasons}"
    );
}

/// Catches a casing that was rejected and whose other scan, which passed, is far below it; casings of another shift; a limit that is taken
/// for one of another time zone; and times that nobody at the line reads on a clock.
#[test]
fn a_shift_has_its_casings_and_its_time() {
    let sandbox = Sandbox::new();
    for (out, crack) in
        [("first", "{ shoulder = 2, first_location = 10, location_count = 4, depth_mm = 6.0 }"), ("then", "")]
    {
        let tyre = |serial: &str, crack: &str| format!("[[scan.tyre]]\nserial = \"{serial}\"\ncrack = [{crack}]\n");
        let tyres = format!("{}{}", tyre("X", crack), tyre(&format!("Y-{out}"), ""));
        sandbox.write("scan.toml", &format!("{SHORT}{tyres}[fuse]\nreference = \"self\"\n"));
        sandbox.run(&format!("run --config scan.toml --out {out}")).expect(0);
    }
    let report = |options: &str| {
        let arguments = format!("report first then --shift-only --force --out shift {options}");
        Done::from(sandbox.command(&arguments).env("TZ", "<+02>-2").output().unwrap())
    };
    let shift = |options: &str| {
        report(options).expect(0);
        page(&sandbox, "shift/shift.html")
    };
    let all = shift("");
    assert_well_formed("shift", &all);
    let (head, rest) = all.split_once("<dl>").unwrap();
    assert!(head.contains("<strong>Scanned more than once: </strong>X (REJECT, PASS)."), "{head}");
    assert!(rest.contains("(4 scans of 3 tyres)") && rest.contains(" +02:00"), "{rest}");
    // Both runs have the same simulated times.
    let last_s = |casing: &str| {
        let headers = Reader::open(sandbox.path(&format!("first/{casing}.h5"))).unwrap().headers().unwrap();
        headers.into_iter().flatten().map(|header| header.tap_time_ns).max().unwrap() / 1_000_000_000
    };
    assert!(last_s("X") < last_s("Y-first"));
    let at = |seconds: i64, zone: &str| format!("{}T00:00:{seconds:02}{zone}", "2026-01-01");
    let second = last_s("Y-first") - last_s("X").div_euclid(86_400) * 86_400;
    let local = at(second, "").replace("T00", "T02");
    for time in [local.clone(), at(second, "Z")] {
        let (early, late) = (shift(&format!("--to {time}")), shift(&format!("--from {time}")));
        assert!(early.contains(">X<") && !early.contains(">Y-first<"), "{time}: {early}");
        assert!(late.contains(">Y-first<") && !late.contains(">X<"), "{time}: {late}");
        let said = local.replace('T', " ") + " +02:00";
        assert!(early.contains(&format!(
            "<strong>Casings last tapped before {said}.</strong> Left out: 2 archives of other times."
        )));
        assert!(late.contains(&format!(
            "<strong>Casings last tapped from {said} on.</strong> Left out: 2 archives of other times."
        )));
    }
    for (options, said) in [
        (
            "--from 2027-01-01".to_owned(),
            "no casing was last tapped from 2027-01-01 00:00:00 +02:00 on: 4 archives of other times",
        ),
        (format!("--from {local} --to {local}"), "must be before --to"),
        ("--from soon".to_owned(), "it must be a time such as 2026-11-30T22:00"),
    ] {
        let done = report(&options);
        assert!(done.err.contains(said), "{options}: {}", done.err);
    }
}

fn assert_stand_alone(pages: &BTreeMap<String, String>) {
    for (name, text) in pages {
        assert_well_formed(name, text);
        assert!(text.len() < 1_000_000, "{name} has {} bytes", text.len());
        for outside in ["http:", "https:", "src=", "<script", "<link", "@import", "url(", "NaN", "xmlns"] {
            assert!(!text.contains(outside), "{name} has {outside}");
        }
        assert!(text.contains("<meta name=\"viewport\"") && text.contains("@page"), "{name}");
        // Whatever a page refers to is in the folder, or in the page.
        for target in text.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap()) {
            assert!(target.starts_with("data:image/png;base64,") || pages.contains_key(target), "{name}: {target}");
        }
    }
}

/// Catches a page whose verdict, regions or limits differ from the tables.
#[test]
fn pages_say_what_the_tables_say() {
    let sandbox = scanned();
    sandbox.run("report cracked.h5 --out cracked").expect(0);
    sandbox.run("report sound.h5 --out sound").expect(0);
    let (cracked, sound) = (page(&sandbox, &format!("cracked/{CRACKED}")), page(&sandbox, &format!("sound/{SOUND}")));
    let table =
        |table: &str| ["cracked.h5", "sound.h5"].map(|f| sandbox.run(&format!("export {f} {table}")).expect(0).out);
    let regions = table("regions").map(|text| csv_rows(&text)).concat();
    assert_eq!(regions.len(), 1);
    for column in ["start_deg", "end_deg", "peak_angle_deg"] {
        let deg: f64 = regions[0][column].parse().unwrap();
        assert!(cracked.contains(&format!(">{deg:.1}°<span class=\"at\">location ")), "{column} {deg}");
    }
    for row in table("verdicts").map(|text| csv_rows(&text)).concat() {
        let text = if row["tyre"].starts_with('<') { &cracked } else { &sound };
        for column in ["limit_re_inspect", "limit_reject"] {
            let limit: f64 = row[column].parse().unwrap();
            assert!(text.contains(&format!("{limit:.2}</td>")), "{column} {limit}");
        }
        let class = row["verdict"].to_lowercase();
        let line = format!(
            "<tr><td data-label=\"shoulder\">{}</td><td data-label=\"verdict\"><span class=\"word-{class}\">{}</span>",
            row["shoulder"], row["verdict"]
        );
        assert!(text.contains(&line), "{line}");
    }
    assert!(cracked.contains("<p class=\"word\">REJECT</p>") && sound.contains("<p class=\"word\">PASS</p>"));
    assert!(sound.contains("no region of damage was found"));
    // A run of one tyre, so that its score is its own; the score of the other run is of both.
    sandbox.write("alone.toml", &SCAN.replace("[[scan.tyre]]\nserial = \"..\\\\B 2\"\nstation = 2\n", ""));
    let auc = sandbox.run("run --config alone.toml --out alone --json").json(0)["auc"]["index"].as_f64().unwrap();
    let shift = page(&sandbox, "cracked/shift.html");
    assert!(shift.contains(&format!("AUC of the index {auc:.4}")), "{auc}");
    // Lineage, character by character.
    let digest = sandbox.run("verify cracked.h5 --json").json(0)["plan_digest"].as_str().unwrap().to_owned();
    assert!(cracked.contains(&digest) && cracked.contains("locations = 60"));
}

/// Catches a page that nobody could sign or take to the casing: without serial and number on each sheet, plant, operator, room for a
/// signature, millimetres along the tread, or where angles begin; and a length that counts locations.
#[test]
fn a_page_can_be_signed() {
    let sandbox = scanned();
    sandbox.write(
        "plant.toml",
        "[report]\nplant = \"<North>\"\nline = \"2\"\noperator = \"A. Smith\"\nprocedure = \"QP-17\"\nstart_mark = \"valve\"\n\
         tread_circumference_mm = 3600\na90_95_mm = 12.5\na90_95_source = \"study 3\"\n",
    );
    sandbox.run("report cracked.h5 --out a --config plant.toml --shift early").expect(0);
    let (tyre, shift) = (page(&sandbox, &format!("a/{CRACKED}")), page(&sandbox, "a/shift.html"));
    for (text, of) in [(&tyre, "Tyre \\3c script"), (&shift, "Shift: \\3c North\\3e , line 2, shift early")] {
        assert_well_formed("a", text);
        assert!(text.contains("counter(page) \" of \" counter(pages)") && text.contains(of), "{of}");
        for part in [
            "&lt;North&gt;, line 2", "A. Smith", "QP-17", "signature</th>", "12.5 mm or longer, 90 % are found",
            "study 3",
        ] {
            assert!(text.contains(part), "{part}");
        }
    }
    let region = &csv_rows(&sandbox.run("export cracked.h5 regions").expect(0).out)[0];
    let deg = |column: &str| region[column].parse::<f64>().unwrap();
    // 3600 mm round the tread are 10 mm a degree.
    for deg in [deg("start_deg"), deg("end_deg"), deg("extent_deg")] {
        assert!(tyre.contains(&format!(">{deg:.1}°<span class=\"at\">{:.0} mm</span>", 10.0 * deg)), "{deg}");
    }
    assert!(tyre.contains("0°: valve") && tyre.contains(" times the rest"));
    let error = sandbox.run("report cracked.h5 --out b --config missing.toml").expect(1).err;
    assert!(error.contains("cannot read the configuration missing.toml"), "{error}");
}

/// Catches a page that depends on the time or place of writing, and a draft that is left behind.
#[test]
fn the_same_archive_gives_the_same_bytes() {
    let sandbox = scanned();
    sandbox.run("report cracked.h5 --out a").expect(0);
    sandbox.run("report cracked.h5 --out a --force").expect(0);
    sandbox.run(&format!("report {} --out deep/b", sandbox.path("cracked.h5").display())).expect(0);
    assert_eq!(pages(&sandbox, "a"), pages(&sandbox, "deep/b"));
}

/// Catches an incomplete archive that is refused, that passes, or whose page does not say what is missing.
#[test]
fn what_is_incomplete_is_shown() {
    let sandbox = scanned();
    // Half a casing: the plan has two shoulders, and the first has taps.
    part_of(&Reader::open(sandbox.path("cracked.h5")).unwrap(), sandbox.path("part.h5"), 0..244, |_, _| ());
    sandbox.run("report part.h5").expect(0);
    let pages = pages(&sandbox, "part-report");
    for (name, text) in &pages {
        assert_well_formed(name, text);
        let (notice, head) = (text.find("Incomplete.").unwrap(), text.find("<dl>").unwrap());
        assert!(notice < head && text.contains("which counts as RE-INSPECT"), "{name}");
        assert!(!text.contains("<p class=\"word\">PASS"), "{name}");
    }
    assert!(pages["shift.html"].contains("244 of 488 planned taps are missing."), "{}", pages["shift.html"]);
}

/// Catches a line, or a ring without angles, drawn as a ring, degrees where there are none, a refusal without its reason, and an absent value that
/// is drawn as 0 or bridged.
#[test]
fn a_line_is_a_strip() {
    const ABSENT: u32 = 5;
    let sandbox = Sandbox::new();
    fs::create_dir(sandbox.path("taps")).unwrap();
    let scan =
        "geometry = \"line\"\nchannels = [\"force\", \"sound\"]\nsample_rate_hz = 41000\npre_trigger_samples = 400\n";
    sandbox.write("taps/scan.toml", scan);
    let mut table = "file,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition".to_owned();
    for location in 0..24 {
        if location != ABSENT {
            write_wav(&sandbox.path(&format!("taps/{location:03}.wav")), 2, 41_000, 4096, location);
        }
        table += &format!("\n{location:03}.wav,slab,7,,,{location},,0");
    }
    sandbox.write("taps/taps.csv", &table);
    sandbox.run("run --taps taps --reference self --out slab").expect(3);
    sandbox.run("report slab/taps.h5").expect(0);
    let text = page(&sandbox, "taps-report/tyre-slab.html");
    assert_well_formed("slab", &text);
    assert!(text.contains("<h1>Piece slab</h1>"));
    let ledger = csv_rows(&sandbox.run("export slab/taps.h5 ledger").expect(0).out);
    let reason = &ledger[ABSENT as usize]["reason"];
    assert!(!reason.is_empty() && text.contains(&format!("<td>{reason}</td>")), "{reason}");
    assert!(text.contains(&format!("1 of 24 planned taps were refused: {reason}.")), "{text}");
    assert!(!text.contains('°') && !text.contains("start mark"));
    // The curve of a discriminator is interrupted there: two pieces, and its sample in the key.
    let f_max = text.split("aria-label=\"F_max, line 7\"").nth(1).unwrap().split("</svg>").next().unwrap();
    assert_eq!(f_max.matches("stroke=\"#0072B2\" stroke-width=\"6\"").count(), 3);
    // A tyre with unrecorded angles is not drawn as if they were known.
    sandbox.write("taps/scan.toml", &scan.replace("line", "ring"));
    sandbox.write("taps/taps.csv", &table.replace("slab,7", "slab,1"));
    sandbox.run("run --taps taps --reference self --out tyre").expect(3);
    sandbox.run("report tyre --out tyre-report").expect(0);
    let text = page(&sandbox, "tyre-report/tyre-slab.html");
    assert!(text.contains("<h1>Tyre slab</h1>") && !text.contains('°') && !text.contains("start mark"));
}
