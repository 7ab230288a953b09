//! `tapline-lab pod` on archives: its numbers compared with published examples and hand counts, what it omits, its errors.

mod made;

use std::fs;
use std::time::SystemTime;

use serde_json::Value;
use tapline_store::results_path;
use tapline_testing::documents::text;

use self::made::{Archive, Shoulder};
use crate::sandbox::Sandbox;
use crate::statistics::{A_HAT, AIAG, HIT_MISS};

const HEAD: &str = "tyre,shoulder,first_location,location_count,size_mm\n";

/// A ring whose greatest index, at locations 3 and 4, is `peak`.
fn ring(peak: f64) -> [f64; 8] {
    [0.1, 0.2, 0.3, peak, peak, 0.4, 0.5, 0.6]
}

/// The tables of `pod` on `casings` with the rows of a truth file.
fn tables(sandbox: &Sandbox, rows: &str) -> Value {
    fs::write(sandbox.path("truth.csv"), format!("{HEAD}{rows}")).unwrap();
    sandbox.run("pod casings --truth truth.csv --json").json(0)
}

fn write(sandbox: &Sandbox, archives: &[Archive]) {
    fs::create_dir_all(sandbox.path("casings")).unwrap();
    for (number, archive) in archives.iter().enumerate() {
        archive.write(&sandbox.path(&format!("casings/{number:03}.h5")));
    }
}

/// The row of a table in JSON whose first cell is `first`.
fn row<'a>(table: &'a Value, first: &str) -> &'a Value {
    let rows = table.as_array().unwrap();
    let first_of = |row: &Value| row.as_object().unwrap().values().any(|cell| cell == first);
    rows.iter().find(|row| first_of(row)).unwrap_or_else(|| panic!("no {first}: {table:#}"))
}

/// To the four digits of a cell.
fn is_near(cell: &Value, expected: f64) -> bool {
    cell.as_f64().is_some_and(|got| (got - expected).abs() <= 6e-4 * expected.abs())
}

/// Catches a size that is paired with another crack's find, a bound that is Wald's or that of the other side, and misses that
/// are forgotten: the study "as the handbook wants", of which statsmodels' GLM says what is expected.
#[test]
fn the_probability_of_detection_is_that_of_statsmodels() {
    let case = &HIT_MISS[0];
    let sandbox = Sandbox::new();
    let (mut shoulders, mut rows) = (Vec::new(), String::new());
    for (number, (size, &is_hit)) in case.sizes.iter().zip(case.is_hit).enumerate() {
        shoulders.push(Shoulder::new(&format!("T{number:03}"), 1, &ring(if is_hit { 2.5 } else { 1.5 })));
        rows.push_str(&format!("T{number:03},1,4,3,{size}\n"));
    }
    write(&sandbox, &[Archive::new(1, &shoulders)]);
    let found = tables(&sandbox, &rows);
    let detection = found["detection"].as_array().unwrap();
    let hits = &detection[0];
    assert!(hits["class"] == "re-inspect limit" && hits["method"] == "hit/miss", "{hits}");
    assert_eq!(hits["targets"], case.sizes.len() as f64);
    assert_eq!(hits["found"], case.is_hit.iter().filter(|&&is_hit| is_hit).count() as f64);
    assert!(is_near(&hits["a50_mm"], case.a50) && is_near(&hits["a90_mm"], case.a90), "{hits}");
    assert!(is_near(&hits["a90_95_mm"], case.a90_95_likelihood.unwrap()), "{hits}");
    // No region reaches the reject limit, 3: no number, and why.
    let rejected = &detection[2];
    assert!(rejected["class"] == "reject limit" && rejected["a90_mm"].is_null(), "{rejected}");
    assert!(rejected["remark"].as_str().unwrap().starts_with("none of the"), "{rejected}");
}

/// Catches a response that is not taken against the limit of its shoulder, or is not the greatest along the crack, a logarithm, the
/// bound of the delta method, and one beyond all cracks: scipy says what is expected. Half of the shoulders have all of it in another
/// unit.
#[test]
fn the_response_is_that_of_scipy() {
    for case in A_HAT {
        let sandbox = Sandbox::new();
        let (mut shoulders, mut rows) = (Vec::new(), String::new());
        for (number, (size, response)) in case.sizes.iter().zip(case.responses).enumerate() {
            let unit = if number % 2 == 0 { 1.0 } else { 0.1 };
            let limits = [case.threshold, 2.0 * case.threshold].map(|limit| unit * limit);
            let tyre = format!("T{number:03}");
            let index = [0.1, 0.2, 0.3, response - 1.0, *response, 0.4].map(|index| unit * index);
            shoulders.push(Shoulder { limits, ..Shoulder::new(&tyre, 1, &index) });
            rows.push_str(&format!("{tyre},1,3,2,{size}\n"));
        }
        write(&sandbox, &[Archive::new(1, &shoulders)]);
        let found = tables(&sandbox, &rows);
        let responses = &found["detection"][1];
        assert!(responses["class"] == "re-inspect limit" && responses["method"] == "response", "{responses}");
        assert!(is_near(&responses["a50_mm"], case.mu.exp()) && is_near(&responses["a90_mm"], case.a90), "{responses}");
        let is_within = case.sizes.iter().any(|size| *size >= case.a90_95_likelihood);
        assert_eq!(is_within, case.name == "logarithms of responses");
        match is_within {
            true => assert!(is_near(&responses["a90_95_mm"], case.a90_95_likelihood), "{responses}"),
            false => {
                let remark = responses["remark"].as_str().unwrap();
                assert!(responses["a90_95_mm"].is_null() && remark.contains("a90/95 beyond the sizes"), "{responses}");
            }
        }
    }
}

/// Catches stations taken for repeats, parts for stations, and readings out of order: the worked example of AIAG, whose
/// gauge takes 27.86 % and whose parts 96.04 % of the total, with four categories.
#[test]
fn the_gauge_is_that_of_aiag() {
    let sandbox = Sandbox::new();
    let mut archives = Vec::new();
    // Later ones first: time orders them, not their names.
    for repeat in (0..3_usize).rev() {
        for station in 0..3_u16 {
            let read = |(part, readings): (usize, &[f64; 9])| {
                let strongest_arc = readings[3 * usize::from(station) + repeat];
                Shoulder { strongest_arc, ..Shoulder::new(&format!("P{part}"), 1, &[f64::NAN; 4]) }
            };
            let shoulders: Vec<Shoulder> = AIAG.iter().enumerate().map(read).collect();
            let at_ns = (10 * repeat) as i64 + i64::from(station) + 1;
            archives.push(Archive { station: station + 1, ..Archive::new(at_ns, &shoulders) });
        }
    }
    write(&sandbox, &archives);
    // A copy of a recording is no fourth repeat.
    fs::create_dir(sandbox.path("casings/copies")).unwrap();
    fs::copy(sandbox.path("casings/000.h5"), sandbox.path("casings/copies/again.h5")).unwrap();
    let found = sandbox.run("pod casings --json").json(0);
    let gauge = &found["gauge"][0];
    assert_eq!((&gauge["stations"], &gauge["parts"], &gauge["repeats"]), (&"1 2 3".into(), &10.0.into(), &3.0.into()));
    for (column, percent) in [
        ("repeatability_percent", 18.42),
        ("reproducibility_percent", 20.90),
        ("gauge_percent", 27.86),
        ("part_percent", 96.04),
        ("ndc", 4.0),
    ] {
        assert!(is_near(&gauge[column], percent), "{column}: {gauge}");
    }
    assert_eq!(row(&found["basis"], "copies")["count"], 10.0);
    assert_eq!(row(&found["basis"], "repeated scans")["count"], 80.0);
    // The archives have no truth, and no location has an index.
    assert!(found["roc"][0]["auc"].is_null() && found["detection"][0]["a90_mm"].is_null());
    let of_locations = found["gauge"].as_array().unwrap().iter().find(|r| r["parts"] == 0.0).unwrap();
    assert!(of_locations["gauge_percent"].is_null() && !of_locations["remark"].is_null(), "{of_locations}");
}

/// Catches verdicts that differ behind an excellent gauge, kappa by other chances, shoulders that were scanned once, first scans that
/// decide between stations, arcs that are not taken against their limits, and a scatter of cracked shoulders, or without the scans that
/// reached the limit. By hand, statsmodels' `cohens_kappa`, scipy's `binomtest(3, 7)`, `beta.ppf` of 3.5 in 5 and `t.interval`, and numpy.
#[test]
fn agreement_of_verdicts_is_that_of_scipy() {
    let sandbox = Sandbox::new();
    // At each of two stations the strongest arcs of two scans; NaN where there is none.
    let arcs = [
        [[1.0, 1.2], [1.1, 1.3]],
        [[1.7, 2.1], [1.8, 2.2]],
        [[2.5, 2.4], [3.1, 2.6]],
        [[1.9, 1.5], [2.05, 1.6]],
        [[9.0, 8.0], [10.0, 9.5]],
        [[f64::NAN; 2], [0.5, 0.7]],
        [[0.9, 1.0], [f64::NAN; 2]],
    ];
    let scan = |station: usize, repeat: usize| {
        let read = |(part, arcs): (usize, &[[f64; 2]; 2])| {
            let unit = if part == 1 { 0.1 } else { 1.0 };
            Shoulder {
                strongest_arc: unit * arcs[station][repeat],
                limits: made::LIMITS.map(|limit| unit * limit),
                is_scatter_off: (part, repeat) == (6, 1),
                ..Shoulder::new(&format!("P{part}"), 1, &ring(unit * arcs[station][repeat]))
            }
        };
        let mut shoulders: Vec<Shoulder> = arcs.iter().enumerate().map(read).collect();
        shoulders.retain(|shoulder| !shoulder.strongest_arc.is_nan());
        let at_ns = (1 + 2 * repeat + station) as i64;
        Archive { station: station as u16 + 1, ..Archive::new(at_ns, &shoulders) }
    };
    write(
        &sandbox,
        &[scan(0, 1), scan(1, 1), scan(0, 0), scan(1, 0), Archive::new(9, &[Shoulder::new("once", 1, &ring(9.0))])],
    );
    let found = sandbox.run("pod casings --json --out found").json(0);
    let agreement = found["agreement"].as_array().unwrap();
    assert_eq!(agreement.len(), 2, "{agreement:#?}");
    for (row, (stations, counts, numbers)) in agreement.iter().zip([
        ("all", (7.0, 24.0, 3.0), [0.098_988, 0.815_948, 0.364_539, f64::NAN, f64::NAN, f64::NAN]),
        ("1 2", (5.0, 20.0, 3.5), [0.209_417, 0.977_487, 0.538_462, 0.1975, -0.109_482, 0.504_482]),
    ]) {
        assert_eq!(row["stations"], stations);
        assert!(
            (&row["shoulders"], &row["scans"], &row["same"]) == (&counts.0.into(), &counts.1.into(), &counts.2.into()),
            "{row}"
        );
        let columns = ["same_low", "same_high", "kappa", "bias", "bias_low", "bias_high"];
        for (column, expected) in columns.into_iter().zip(numbers) {
            assert!(
                if expected.is_nan() { row[column].is_null() } else { is_near(&row[column], expected) },
                "{column}: {row}"
            );
        }
    }
    assert_eq!(agreement[0]["remark"], "1 shoulder differs although no scan reaches the limit");
    let scatter = &found["scatter"][0];
    assert!(scatter["shoulders"] == 5.0 && scatter["scans"] == 16.0, "{scatter}");
    for (column, expected) in [("level", 0.641_25), ("sd", 0.112_673), ("distance_in_sd", 3.183_979)] {
        assert!(is_near(&scatter[column], expected), "{column}: {scatter}");
    }
    let page = text(&sandbox.path("found/page.md"));
    assert!(
        page.contains("3 of 7 shoulders that were scanned again have the same verdict in all scans (0.09899 to"),
        "{page}"
    );
    assert!(page.contains("The strongest arc of 5 shoulders below the limit is"), "{page}");
    // One verdict for all leaves nothing to chance.
    fs::create_dir(sandbox.path("alike")).unwrap();
    let alike = |at_ns| Archive::new(at_ns, &[Shoulder::new("A", 1, &ring(1.0))]);
    [alike(1), alike(2)]
        .iter()
        .zip(["1", "2"])
        .for_each(|(of, name)| of.write(&sandbox.path(&format!("alike/{name}.h5"))));
    let found = sandbox.run("pod alike --json").json(0);
    let all = &found["agreement"][0];
    assert!(
        all["same"] == 1.0 && all["kappa"].is_null() && all["remark"] == "no kappa: there is only one verdict",
        "{all}"
    );
    assert!(found["scatter"][0]["level"] == 0.5 && found["scatter"][0]["distance_in_sd"].is_null(), "{found}");
}

/// Catches folders after the first that are left out, archives of one name in two folders that are confused, and a folder within
/// another that counts twice.
#[test]
fn several_folders_count_as_one() {
    let sandbox = Sandbox::new();
    for (folder, tyre, peak) in [("monday", "A", 1.0), ("monday/late", "B", 2.5), ("tuesday", "C", 4.0)] {
        fs::create_dir(sandbox.path(folder)).unwrap();
        Archive::new(1, &[Shoulder::new(tyre, 1, &ring(peak))]).write(&sandbox.path(&format!("{folder}/1.h5")));
    }
    fs::write(sandbox.path("truth.csv"), format!("{HEAD}A,1,,0,\nB,1,3,2,9\nC,1,3,2,12\n")).unwrap();
    let found = sandbox.run("pod monday tuesday monday/late --truth truth.csv --json").json(0);
    assert_eq!(row(&found["basis"], "archives")["count"], 3.0);
    let archives: Vec<&Value> = found["shoulders"].as_array().unwrap().iter().map(|row| &row["archive"]).collect();
    assert_eq!(archives, ["monday/1.h5", "monday/late/1.h5", "tuesday/1.h5"]);
    let refused = sandbox.run("pod monday nowhere").expect(1).err;
    assert!(refused.contains("cannot read nowhere"), "{refused}");
}

/// Catches a casing that comes back cracked and is judged by its old truth, or counts as scanned again, and a list of inspections with
/// other columns that is refused, or taken without a word.
#[test]
fn a_casing_that_comes_back_has_a_new_truth() {
    const DAY_NS: i64 = 86_400_000_000_000;
    let sandbox = Sandbox::new();
    let on = |day: i64, peak: f64| Archive::new(day * DAY_NS + 1, &[Shoulder::new("A", 1, &ring(peak))]);
    // 2026-11-24 and the day after; a year later.
    write(&sandbox, &[on(20_781, 0.9), on(20_782, 1.0), on(21_146, 4.0)]);
    let with = |rows: &str| {
        let head = "tyre,shoulder,first_location,location_count,inspector,scanned_on,result\n";
        fs::write(sandbox.path("truth.csv"), format!("{head}{rows}")).unwrap();
        sandbox.run("pod casings --truth truth.csv --json")
    };
    let done = with("A,1,,0,Kim,,sound\nA,1,3,2,Lee,2027-11-24,cracked\n");
    let found = done.json(0);
    for (number, counts) in [(0.0, 1.0), (0.0, 1.0), (1.0, 1.0), (1.0, 1.0)].into_iter().enumerate() {
        let row = &found["calls"][number];
        assert!(row["calls"] == counts.0 && row["judged"] == counts.1, "{row}");
    }
    assert!(found["agreement"][0]["shoulders"] == 1.0 && found["agreement"][0]["scans"] == 2.0, "{found}");
    assert!(done.err.contains("truth.csv: unknown columns are ignored: inspector, result"), "{done:?}");
    assert_eq!(row(&found["basis"], "columns of the truth file left out")["remark"], "inspector, result");
    // Before its first day nothing is known.
    let found = with("A,1,,0,Kim,2026-11-25,\n").json(0);
    assert_eq!(row(&found["basis"], "shoulders left out")["count"], 1.0);
    assert_eq!(row(&found["basis"], "sound shoulders")["count"], 1.0);
    for (rows, expected) in [
        (
            "A,1,,0,,2027-11-25,\n",
            "truth.csv line 2: tyre A shoulder 1: scanned_on is 2027-11-25; no scan is of that day",
        ),
        (
            "A,1,,0,,,\nA,1,,0,,2026-11-24,\n",
            "truth.csv line 2: tyre A shoulder 1: no scan is before its first scanned_on",
        ),
        (
            "A,1,,0,,24.11.2026,\n",
            "truth.csv line 2: scanned_on is \"24.11.2026\"; it must be a day such as 2026-11-24",
        ),
    ] {
        let err = with(rows).expect(1).err;
        assert!(err.contains(expected), "{rows}: {err}");
    }
}

/// 40 sound shoulders, of which 2 are inspected again and 1 of these is rejected, and 4 cracked ones; scipy's
/// `binomtest(2, 40).proportion_ci()` is 0.0061136 to 0.169197, and of 1 in 40 0.00063273 to 0.131586. Catches calls over all
/// shoulders, PASS counted, an approximate interval, shoulders without a row that count as sound, and second looks, or scans of unknown time,
/// that count.
#[test]
fn false_calls_and_roc_are_those_of_hands() {
    let sandbox = Sandbox::new();
    let (mut shoulders, mut rows) = (Vec::new(), String::new());
    for number in 0..40 {
        let peak = [2.2, 3.5].get(number).copied().unwrap_or(1.0 - 0.01 * number as f64);
        shoulders.push(Shoulder::new(&format!("S{number:02}"), 2, &ring(peak)));
        rows.push_str(&format!("S{number:02},2,,0,\n"));
    }
    for (number, peak) in [5.0, 3.2, 2.1, 0.7].into_iter().enumerate() {
        shoulders.push(Shoulder::new(&format!("C{number}"), 1, &ring(peak)));
        rows.push_str(&format!("C{number},1,3,2,\n"));
    }
    // Nobody looked into these.
    let unknown: Vec<Shoulder> = (0..3).map(|k| Shoulder::new(&format!("U{k}"), 1, &ring(4.0))).collect();
    let again: Vec<Shoulder> = shoulders.iter().map(|s| Shoulder::new(&s.tyre, s.shoulder, &ring(9.0))).collect();
    // That of unknown time is not the first.
    let archives =
        [Archive::new(20, &again), Archive::new(10, &[shoulders, unknown].concat()), Archive::new(0, &again)];
    write(&sandbox, &archives);
    let found = tables(&sandbox, &rows);
    let calls = found["calls"].as_array().unwrap();
    for (number, (kind, call, stated, counts, interval)) in [
        ("sound", "not passed", Some(0.02), (2.0, 40.0), (0.006_113_6, 0.169_197)),
        ("sound", "rejected", Some(0.001), (1.0, 40.0), (0.000_632_73, 0.131_586)),
        ("cracked", "not passed", None, (3.0, 4.0), (0.194_120, 0.993_69)),
        ("cracked", "rejected", None, (2.0, 4.0), (0.067_586, 0.932_41)),
    ]
    .into_iter()
    .enumerate()
    {
        let row = &calls[number];
        assert!(row["shoulders"] == kind && row["call"] == call && row["stated"].as_f64() == stated, "{row}");
        assert!(row["calls"] == counts.0 && row["judged"] == counts.1, "{row}");
        assert!(is_near(&row["rate_low"], interval.0) && is_near(&row["rate_high"], interval.1), "{row}");
    }
    // 5 beats all 40 sound ones; 3.2 all but 3.5; 2.1 all but 3.5 and 2.2; 0.7 the nine below it and ties with one.
    let roc = &found["roc"][0];
    assert!(is_near(&roc["auc"], (40.0 + 39.0 + 38.0 + 9.5) / 160.0), "{roc}");
    // Two of 40 false calls are 5 %: all but 0.7 stand above the third.
    assert!(is_near(&roc["tpr_at_5"], 0.75), "{roc}");
    // 8 locations of 44 shoulders, of which each cracked one has two.
    assert!(found["roc"][1]["cracked"] == 8.0 && found["roc"][1]["sound"] == 344.0, "{}", found["roc"][1]);
    let left_out = row(&found["basis"], "shoulders left out");
    assert_eq!(left_out["count"], 3.0);
    assert!(left_out["remark"].as_str().unwrap().ends_with("U0/1 U1/1 U2/1"), "{left_out}");
    assert_eq!(row(&found["basis"], "repeated scans")["count"], 88.0);
    // No crack has a size.
    assert!(
        found["detection"][0]["remark"].as_str().unwrap().contains("no crack of an inspected shoulder has a size_mm")
    );
    assert_eq!(row(&found["basis"], "cracks without a size")["count"], 4.0);
}

/// Catches a truth of the archives that is not used, or used where a shoulder is known in part; a perfect area that is certain;
/// limits of other references that are pooled silently; and a page that lacks a table or a figure.
#[test]
fn archives_tell_their_own_truth() {
    let sandbox = Sandbox::new();
    let mut shoulders = Vec::new();
    for number in 0..24_u32 {
        let is_cracked = number < 4;
        let known = Some(if is_cracked { vec![3, 4] } else { Vec::new() });
        let limits = if number == 5 { [2.4, 3.1] } else { made::LIMITS };
        let index = ring(if is_cracked { 4.0 } else { 0.9 });
        shoulders.push(Shoulder { known, limits, ..Shoulder::new(&format!("T{number:02}"), 1, &index) });
    }
    shoulders.push(Shoulder::new("X", 1, &ring(1.0)));
    write(&sandbox, &[Archive::new(1, &shoulders)]);
    let done = sandbox.run("pod casings --out found").expect(0);
    // The table breaks lines.
    let said = done.out.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("archives have no truth") && said.contains("X/1"), "{}", done.out);
    let page = text(&sandbox.path("found/page.md"));
    for name in ["basis", "detection", "roc", "calls", "gauge", "agreement", "scatter", "cracks", "shoulders"] {
        assert!(page.contains(&format!("({name}.csv)")), "{name}: {page}");
        assert!(!text(&sandbox.path(&format!("found/{name}.csv"))).is_empty());
    }
    assert!(page.contains("![Cracked against sound ones that are called](roc.svg)"), "{page}");
    assert!(text(&sandbox.path("found/roc.svg")).ends_with("</svg>\n"));
    // 4 pairs of different tyres, all won: 0.3976 to 1. All 4 cracked tyres found: the same.
    assert!(page.contains("AUC of shoulders by strongest arc 1 (0.3976 to 1)"), "{page}");
    assert!(page.contains("TPR at 5 % false calls 1 (0.3976 to 1)"), "{page}");
    assert!(page.contains("limits lie between 2 and 2.4"), "{page}");
    assert!(page.contains("no shoulder was scanned twice at one station"), "{page}");
    assert!(page.contains("No probability of detection: no crack has a size."), "{page}");
}

/// Catches results that count as archives or are opened where nobody asked for them, results that are not the newest, and an
/// archive that is judged beside those of others.
#[test]
fn results_take_the_place_of_archives() {
    let sandbox = Sandbox::new();
    let of = |tyre: &str, peak| Archive::new(1, &[Shoulder::new(tyre, 1, &ring(peak))]);
    write(&sandbox, &[of("A", 1.0), of("B", 1.0), of("C", 1.0)]);
    assert!(sandbox.run("pod casings --results").expect(1).err.contains("casings has no results of tapline reprocess"));
    let [a, b, c] = ["000", "001", "002"].map(|name| sandbox.path(&format!("casings/{name}.h5")));
    of("A", 4.0).write_results(&a, "aaaaaaaaaaaa");
    let older = fs::File::options().write(true).open(results_path(&a, "aaaaaaaaaaaa")).unwrap();
    older.set_modified(SystemTime::UNIX_EPOCH).unwrap();
    of("A", 2.5).write_results(&a, "bbbbbbbbbbbb");
    of("B", 3.5).write_results(&b, "bbbbbbbbbbbb");
    let rows = "A,1,3,2,12\nB,1,,0,\nC,1,,0,\n";
    fs::write(sandbox.path("truth.csv"), format!("{HEAD}{rows}")).unwrap();
    let calls = |found: &Value| -> Vec<(f64, f64)> {
        let count = |row: &Value, column: &str| row[column].as_f64().unwrap();
        let rows = found["calls"].as_array().unwrap().iter();
        rows.map(|row| (count(row, "calls"), count(row, "judged"))).collect()
    };
    // Sound ones not passed and rejected, then cracked ones.
    let done = sandbox.run("pod casings --results --truth truth.csv --json");
    let found = done.json(0);
    assert_eq!(calls(&found), [(1.0, 1.0), (1.0, 1.0), (1.0, 1.0), (0.0, 1.0)]);
    assert_eq!(row(&found["basis"], "archives")["count"], 2.0);
    for expected in ["casings: 1 of 3 archives have no results and are left out", "truth.csv: rows of C/1 are left out"]
    {
        assert!(done.err.contains(expected), "{expected}: {done:?}");
    }
    // What is in no archive is an error all the same.
    fs::write(sandbox.path("wrong.csv"), format!("{HEAD}{rows}D,1,,0,\n")).unwrap();
    let refused = sandbox.run("pod casings --results --truth wrong.csv").expect(1).err;
    assert!(refused.contains("wrong.csv line 5: tyre \"D\" is in none of the archives"), "{refused}");
    // Without the option results are not even opened.
    fs::write(results_path(&c, "cccccccccccc"), "no archive").unwrap();
    let found = tables(&sandbox, rows);
    assert_eq!(calls(&found), [(0.0, 2.0), (0.0, 2.0), (0.0, 1.0), (0.0, 1.0)]);
    assert_eq!(row(&found["basis"], "archives")["count"], 3.0);
    assert_eq!(row(&found["basis"], "judged scans of shoulders")["count"], 3.0);
}

/// Catches shoulders that were compared with their own casing and are taken for those of another reference, and another reference that
/// is not named beside them.
#[test]
fn shoulders_compared_with_their_own_casing_are_counted() {
    let remarks = |last_limits: [f64; 2]| -> [String; 3] {
        let shoulder = |number: usize| Shoulder {
            known: Some(if number == 0 { vec![3, 4] } else { Vec::new() }),
            limits: [made::LIMITS, [2.5, 3.2], [2.6, 3.3], last_limits][number],
            is_scatter_off: (1..3).contains(&number),
            ..Shoulder::new(&format!("T{number}"), 1, &ring(0.5 + number as f64))
        };
        let shoulders: Vec<Shoulder> = (0..4).map(shoulder).collect();
        let sandbox = Sandbox::new();
        write(&sandbox, &[Archive::new(1, &shoulders), Archive::new(2, &shoulders)]);
        let found = sandbox.run("pod casings --json").json(0);
        [&found["roc"][0], &found["roc"][1], &found["gauge"][0]].map(|row| row["remark"].to_string())
    };
    let expected = ["2 shoulders were", "2 shoulders were", "4 scans were"];
    let pooled = ["references are pooled", "references are pooled", "not all scans had the same reference"];
    let (alike, different) = (remarks(made::LIMITS), remarks([2.2, 3.1]));
    for number in 0..3 {
        let own = format!("{} compared with their own casings because their scatter was off", expected[number]);
        assert!(alike[number].contains(&own) && !alike[number].contains("limits lie"), "{alike:#?}");
        let limits = "limits lie between 2 and 2.2: ";
        assert!(different[number].contains(&own) && different[number].contains(limits), "{different:#?}");
        assert!(different[number].contains(pooled[number]), "{different:#?}");
    }
}

/// Catches a row of a casing that was never scanned, or that lies outside of what was, taken in silence.
#[test]
fn what_is_wrong_is_named() {
    let sandbox = Sandbox::new();
    assert!(sandbox.run("pod casings").expect(1).err.contains("cannot read casings"));
    write(&sandbox, &[Archive::new(1, &[Shoulder::new("A", 1, &ring(1.0))])]);
    let refusal = |rows: &str| {
        fs::write(sandbox.path("truth.csv"), format!("{HEAD}{rows}")).unwrap();
        sandbox.run("pod casings --truth truth.csv").expect(1).err
    };
    for (rows, expected) in [
        ("B,1,,0,\n", "truth.csv line 2: tyre \"B\" is in none of the archives"),
        ("A,2,,0,\n", "truth.csv line 2: tyre A: shoulder is 2; the archives have 1"),
        ("A,1,8,1,\n", "truth.csv line 2: tyre A shoulder 1: first_location is 8; it must lie in 0 to 7"),
        ("A,1,7,2,-3\n", "truth.csv line 2: size_mm is \"-3\"; it must be a number above 0"),
        ("A,1,7,2,\nA,1,7,2,\n", "truth.csv line 3: names the crack of tyre A shoulder 1 at location 7 again"),
    ] {
        assert!(refusal(rows).contains(expected), "{rows}: {}", refusal(rows));
    }
    // Two tyres of one name, as simulations with two seeds have them.
    let of = |at_ns, known: &[u32]| {
        let shoulder = Shoulder { known: Some(known.to_vec()), ..Shoulder::new("B", 1, &ring(1.0)) };
        Archive::new(at_ns, &[shoulder])
    };
    fs::create_dir(sandbox.path("two")).unwrap();
    of(1, &[3, 4]).write(&sandbox.path("two/1.h5"));
    of(2, &[6]).write(&sandbox.path("two/2.h5"));
    let err = sandbox.run("pod two").expect(1).err;
    assert!(
        err.contains("location 3 of tyre B shoulder 1 is cracked in 1.h5 or in 2.h5, and sound in the other"),
        "{err}"
    );
    // Their own truth is not needed beside another.
    fs::write(sandbox.path("truth.csv"), format!("{HEAD}B,1,3,2,\n")).unwrap();
    let done = sandbox.run("pod two --truth truth.csv").expect(0);
    assert!(done.err.contains("location 3 of tyre B shoulder 1 is cracked in 1.h5 or in 2.h5"), "{done:?}");
    fs::write(sandbox.path("casings/broken.h5"), "no archive").unwrap();
    // The tyre of the second row may be that of the archive that cannot be read, as may another shoulder of the first.
    fs::write(sandbox.path("truth.csv"), format!("{HEAD}A,1,,0,\nB,1,3,2,\nA,2,,0,\n")).unwrap();
    let done = sandbox.run("pod casings --truth truth.csv --json");
    let found = done.json(3);
    let damage = done.err.find("broken.h5 is not an HDF5 file");
    let rows =
        done.err.find("truth.csv: rows of A/2 B/1 are left out: they are in none of the archives that were read");
    assert!(damage.is_some() && rows > damage, "{done:?}");
    assert_eq!(row(&found["basis"], "shoulders of the truth file left out")["count"], 2.0);
    assert_eq!(row(&found["basis"], "sound shoulders")["count"], 1.0);
    // The others are still checked, and the damage is named before an error in them.
    let err = refusal("A,1,8,1,\n");
    let place = err.find("first_location is 8; it must lie in 0 to 7");
    assert!(err.find("broken.h5 is not").is_some_and(|damage| place > Some(damage)), "{err}");
    assert!(row(&found["basis"], "archive left out")["remark"].as_str().unwrap().contains("broken.h5"), "{found}");
    fs::remove_file(sandbox.path("casings/000.h5")).unwrap();
    assert!(sandbox.run("pod casings").expect(1).err.contains("none of 1 archives can be read"));
}
