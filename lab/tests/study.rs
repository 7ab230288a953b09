//! `tapline study`: what it says depends on the seed alone, is within its bounds, and is what the committed page says.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::rig::{Rig, csv_rows, docs, files};

/// Every number of the column `name` of a table in JSON; a cell that is null has none.
fn column(table: &Value, name: &str) -> Vec<f64> {
    table.as_array().unwrap().iter().filter_map(|row| row[name].as_f64()).collect()
}

/// Catches bytes that depend on threads, areas and rates out of their bounds, an interval that does not hold its value, a
/// table without rows, and sound shoulders that are called oftener than is stated.
#[test]
fn a_quick_study_is_sound_whatever_the_threads() {
    let rig = Rig::new();
    let told = |threads: u32| {
        let done = rig.run(&format!("study --quick --json --seed 5 --threads {threads} --out threads-{threads}/study"));
        (done.json(0), done.out, files(&rig.path(&format!("threads-{threads}/study"))))
    };
    let (found, out, written) = told(1);
    let (_, out_2, written_2) = told(2);
    assert!(out == out_2 && written == written_2);
    for (name, table) in found.as_object().unwrap() {
        let rows = table.as_array().unwrap();
        assert!(!rows.is_empty(), "{name}");
        assert_eq!(csv_rows(&written[&format!("{name}.csv")]).len(), rows.len(), "{name}");
        for area in ["auc", "auc_ring", "default", "alone", "mean", "least", "mean_auc", "overlap", "rate"] {
            assert!(column(table, area).iter().all(|x| (0.0..=1.0).contains(x)), "{name}: {area}");
        }
    }
    let indices = found["indices"].as_array().unwrap();
    assert!(indices.len() >= 2 * 20, "{}", indices.len());
    for row in indices {
        let at = |column: &str| row[column].as_f64().unwrap();
        assert!(at("tyres_low") <= at("auc") && at("auc") <= at("tyres_high"), "{row}");
        assert_eq!(row["fell_back"], "no", "{row}");
    }
    let of_default = |row: &&Value| row["index"] == "repeatability";
    for row in found["false_calls"].as_array().unwrap().iter().filter(of_default) {
        assert_eq!(row["consistent"], "yes", "{row}");
    }
    for name in ["roc", "indices", "pod", "plans"] {
        let svg = &written[&format!("{name}.svg")];
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n") && !svg.contains("NaN"), "{name}");
    }
}

/// Catches a page that went stale against its tables, and a number on it that no table has.
#[test]
fn the_page_says_what_the_tables_say() {
    let files = files(&docs("study"));
    let page = &files["study.md"];
    let head = include_str!("../src/study/head.md");
    let said = page.strip_prefix(head).expect("the page begins with its head");
    let mut cells = BTreeSet::new();
    for (name, table) in files.iter().filter(|(name, _)| name.ends_with(".csv")) {
        let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(table.as_bytes());
        let rows: Vec<Vec<String>> = reader.deserialize().map(|row| row.unwrap()).collect();
        if page.contains(&format!("([{name}]")) {
            let row = |row: &Vec<String>| format!("| {} |", row.join(" | "));
            assert!(rows[1..].iter().all(|r| said.contains(&row(r))), "{name}");
        }
        cells.extend(rows.into_iter().flatten());
    }
    let is_between = |c: char| c.is_whitespace() || matches!(c, ',' | ';' | '|' | ':' | '(' | ')');
    let words = said.lines().filter(|line| line.starts_with("- ")).flat_map(|line| line.split(is_between));
    let numbers = words.map(|word| word.trim_end_matches('.')).filter(|w| w.contains('.') && w.parse::<f64>().is_ok());
    let mut count = 0;
    for number in numbers.filter(|number| *number != "0.01") {
        count += 1;
        assert!(cells.contains(number), "{number} is in no table");
    }
    assert!(count > 20, "{count}");
}

/// Catches too few tyres for halves of both kinds.
#[test]
fn too_few_tyres_are_refused() {
    let done = Rig::new().run("study --quick --tyres 7").expect(1);
    assert!(done.err.contains("--tyres is 7; at least 8 are needed"), "{done:?}");
}
