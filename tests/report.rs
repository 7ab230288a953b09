//! `report`: pages that stand alone, say what the tables say, and are the same each time.

use std::collections::BTreeMap;
use std::fs;

use tapline_store::{Reader, Writer};
use tapline_wire::{
    Channel, DamageCell, Geometry, Judgement, Plan, PlannedTap, Reasons, RecordKind, Recording, SampleFormat, Serial,
    Stamp, TapId, Truth, Verdict,
};

use crate::rig::{Rig, csv_rows};

/// A cracked tyre with a name that would be markup, and a sound one with a file name that another folder would have.
const SCAN: &str = r#"
[scan]
offsets_mm = [0.0, 5.0]
velocities_m_per_s = [1.85]
repetitions = 2
locations = 60

[[scan.tyre]]
serial = "<script>&\"x'"
station = 1
crack = [{ shoulder = 2, first_location = 57, location_count = 5, depth_mm = 6.0, length_mm = 22.0 }]

[[scan.tyre]]
serial = "..\\B 2"
station = 2
"#;

const CRACKED: &str = "tyre-_script___x_.html";
const SOUND: &str = "tyre-.._B_2.html";

fn scanned() -> Rig {
    let rig = Rig::new();
    rig.write("scan.toml", SCAN);
    rig.run("run --config scan.toml --out run.h5").expect(0);
    rig
}

fn page(rig: &Rig, name: &str) -> String {
    fs::read_to_string(rig.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// The pages in `folder` by name.
fn pages(rig: &Rig, folder: &str) -> BTreeMap<String, String> {
    let files = fs::read_dir(rig.path(folder)).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap());
    files.map(|name| (name.clone(), page(rig, &format!("{folder}/{name}")))).collect()
}

/// Checks that every element is closed in its order, every attribute in its quotes, and every `&` is an entity.
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

/// Catches a page that is no page, asks for something from elsewhere, runs anything, or is too large to be sent.
#[test]
fn pages_stand_alone() {
    let rig = scanned();
    let told = rig.run("report run.h5").expect(0).out;
    assert_eq!(told.lines().collect::<Vec<_>>(), [CRACKED, SOUND, "shift.html"].map(|n| format!("run-report/{n}")));
    let pages = pages(&rig, "run-report");
    assert_eq!(pages.keys().map(String::as_str).collect::<Vec<_>>(), ["shift.html", SOUND, CRACKED]);
    for (name, text) in &pages {
        assert_well_formed(name, text);
        assert!(text.len() < 1_000_000, "{name} has {} bytes", text.len());
        for outside in ["http:", "https:", "src=", "<script", "<link", "@import", "url(", "NaN", "xmlns"] {
            assert!(!text.contains(outside), "{name} has {outside}");
        }
        assert!(text.contains("<meta name=\"viewport\"") && text.contains("@page"), "{name}");
        // Whatever a page refers to is beside it, or in it.
        for target in text.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap()) {
            assert!(target.starts_with("data:image/png;base64,") || pages.contains_key(target), "{name}: {target}");
        }
    }
    assert!(pages[CRACKED].contains("<h1>Tyre &lt;script&gt;&amp;&quot;x"), "the serial is not there");
}

/// Catches a page whose verdict, regions or limits are others than those of the tables.
#[test]
fn pages_say_what_the_tables_say() {
    let rig = scanned();
    rig.run("report run.h5 --out pages").expect(0);
    let (cracked, sound) = (page(&rig, &format!("pages/{CRACKED}")), page(&rig, &format!("pages/{SOUND}")));
    let regions = csv_rows(&rig.run("export run.h5 regions").expect(0).out);
    assert_eq!(regions.len(), 1);
    for column in ["start_deg", "end_deg", "peak_angle_deg"] {
        let deg: f64 = regions[0][column].parse().unwrap();
        assert!(cracked.contains(&format!(">{deg:.1}°<span class=\"at\">location ")), "{column} {deg}");
    }
    for row in csv_rows(&rig.run("export run.h5 verdicts").expect(0).out) {
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
    let shift = page(&rig, "pages/shift.html");
    assert!(shift.find(CRACKED).unwrap() < shift.find(SOUND).unwrap(), "the worst is not first");
    let auc = rig.run("run --config scan.toml --out run.h5 --json").json(0)["auc"]["index"].as_f64().unwrap();
    assert!(shift.contains(&format!("AUC of the index {auc:.4}")), "{auc}");
    // Lineage, to the letter.
    let digest = rig.run("verify run.h5 --json").json(0)["plan_digest"].as_str().unwrap().to_owned();
    assert!(cracked.contains(&digest) && cracked.contains("locations = 60"));
}

/// Catches a page that depends on the moment or the place it is written, and a draft left behind.
#[test]
fn the_same_archive_gives_the_same_bytes() {
    let rig = scanned();
    rig.run("report run.h5 --out a").expect(0);
    rig.run("report run.h5 --out a").expect(0);
    rig.run(&format!("report {} --out deep/b", rig.path("run.h5").display())).expect(0);
    assert_eq!(pages(&rig, "a"), pages(&rig, "deep/b"));
}

/// Catches an archive that is not whole being refused, passed, or shown without saying what is missing.
#[test]
fn what_is_not_whole_is_told() {
    let rig = scanned();
    {
        let whole = Reader::open(rig.path("run.h5")).unwrap();
        let found = whole.discriminators().unwrap();
        let mut part = Writer::create(rig.path("part.h5"), whole.plan(), whole.config()).unwrap();
        let station_1 = whole.plan().scans()[0].taps.len() as u32;
        for row in 0..station_1 / 2 {
            if row % 10 == 3 {
                part.put_refusal(row, &whole.plan().taps()[row as usize].id, "the <impactor> stuck").unwrap();
                continue;
            }
            let (header, samples) = whole.tap(row).unwrap().unwrap();
            part.put_tap(&header, samples.as_samples().as_bytes()).unwrap();
            part.put_discriminators(&found[row as usize].unwrap()).unwrap();
        }
        part.finish().unwrap();
        Writer::create(rig.path("none.h5"), whole.plan(), "unknown_key = 1\n").unwrap().finish().unwrap();
    }
    for archive in ["part", "none"] {
        rig.run(&format!("report {archive}.h5")).expect(0);
        for (name, text) in pages(&rig, &format!("{archive}-report")) {
            assert_well_formed(&name, &text);
            let (notice, head) = (text.find("Not whole.").unwrap(), text.find("<dl>").unwrap());
            assert!(notice < head && text.contains("missing."), "{archive}/{name}");
            assert!(!text.contains("<p class=\"word\">PASS"), "{archive}/{name}");
        }
    }
    let part = page(&rig, &format!("part-report/{CRACKED}"));
    assert!(part.contains("the &lt;impactor&gt; stuck") && part.contains("were refused"), "no reason");
    assert!(page(&rig, &format!("none-report/{SOUND}")).contains("configuration could not be read"));
}

/// Catches a line drawn as a ring, an absent index drawn as none at all or as 0, and degrees on what has none.
#[test]
fn a_line_is_a_strip() {
    let rig = Rig::new();
    let serial = Serial::new("slab").unwrap();
    let tap = |location| PlannedTap { id: TapId::new(1, serial, 7, location), angle_deg: None, is_closing: false };
    let recording = Recording {
        sample_rate_hz: 2e5,
        pre_trigger_samples: 100,
        sample_count_max: 1000,
        sample_format: SampleFormat::I16,
        channels: vec![Channel::Sound],
    };
    let plan = Plan::new(Geometry::Line, recording, (0..20).map(tap).collect(), Truth::new()).unwrap();
    let cell = |location| DamageCell {
        location,
        region: u32::from((4..=6).contains(&location)),
        damage_index: if location == 9 { f64::NAN } else { f64::from(location % 7) },
        ..DamageCell::default()
    };
    let judgement = Judgement {
        stamp: Stamp { plan_digest: plan.digest(), kind: RecordKind::Data.code(), ..Stamp::default() },
        verdict: Verdict::Reject.code(),
        reasons: Reasons::DAMAGE,
        limit_re_inspect: 2.0,
        limit_reject: 3.0,
        planned_count: 20,
        ..Judgement::default()
    };
    let mut writer = Writer::create(rig.path("slab.h5"), &plan, "").unwrap();
    writer.end_scan(0).unwrap();
    writer.put_judgement(0, &judgement, &(0..20).map(cell).collect::<Vec<_>>()).unwrap();
    writer.finish().unwrap();
    rig.run("report slab.h5").expect(0);
    let text = page(&rig, "slab-report/tyre-slab.html");
    assert_well_formed("slab", &text);
    assert!(text.contains("<h1>Piece slab</h1>") && text.contains(">location 4</td><td data-label=\"to\">location 6</td>"));
    assert!(!text.contains('°') && !text.contains("start mark"));
    assert_eq!(text.matches("fill=\"#E8E8E8\"").count(), 1, "one location is without value");
    // The curve of the index is broken there: two pieces of one colour, beside its sign in the key.
    let blue = "fill=\"none\" stroke=\"#0072B2\"";
    assert_eq!(text.matches(blue).count(), 3);
}

/// Catches a file that is no archive taken for one, and a folder made for nothing.
#[test]
fn what_is_no_archive_leaves_nothing() {
    let rig = Rig::new();
    rig.write("none.h5", "nothing");
    let done = rig.run("report none.h5").expect(1);
    assert!(done.err.contains("none.h5") && !rig.path("none-report").exists(), "{done:?}");
}
