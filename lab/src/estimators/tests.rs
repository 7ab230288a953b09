//! The committed table of estimators, part of it measured again.

use std::path::Path;

use super::{Cell, Row, csv, markdown, measure};

fn committed(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name)).unwrap()
}

fn rows() -> Vec<Row> {
    ::csv::Reader::from_reader(committed("estimators.csv").as_bytes()).deserialize().map(|row| row.unwrap()).collect()
}

/// Catches an estimator, a pulse or a sound that has changed since the table was written: cells of every table, again.
#[test]
fn the_table_of_estimators_is_not_stale() {
    let is_cheap = |cell: &Cell| match cell.table.as_str() {
        "sound" => cell.snr_db.is_none() || (cell.rate_hz == 10_240 && cell.fault == "hum 3 %"),
        _ => cell.snr_db.is_none_or(|db| db == 40),
    };
    let measured = measure(is_cheap).unwrap();
    let written: Vec<Row> = rows();
    let name = |row: &Row| {
        (row.table.clone(), row.signal.clone(), row.rate_hz, row.snr_db, row.fault.clone(), row.estimator.clone())
    };
    assert!(measured.len() > 300, "{}", measured.len());
    for row in &measured {
        let same = written.iter().find(|other| name(other) == name(row) && other.quantity == row.quantity);
        let same = same.unwrap_or_else(|| panic!("not in the table: {row:?}"));
        // Transforms differ in their last digits from machine to machine.
        for (x, y) in [(row.bias_percent, same.bias_percent), (row.spread_percent, same.spread_percent)] {
            assert!((x - y).abs() <= 0.002 + 1e-3 * y.abs(), "{row:?} is {same:?} in the table; write it anew");
        }
    }
}

/// Catches a page that does not show the table beside it.
#[test]
fn the_page_shows_the_table() {
    assert!(markdown(&rows()) == committed("estimators.md"), "run `tapline-lab estimators`");
    assert_eq!(csv(&rows()).unwrap(), committed("estimators.csv"));
}
