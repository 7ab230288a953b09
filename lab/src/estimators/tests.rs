//! The committed table of estimators, part of it measured again.

use tapline_testing::documents::{docs, text};

use super::{Row, SignalCase, csv, markdown, measure};

fn rows() -> Vec<Row> {
    ::csv::Reader::from_reader(text(&docs("estimators.csv")).as_bytes()).deserialize().map(|row| row.unwrap()).collect()
}

/// Catches an estimator, a pulse or a sound that has changed since the table was written: cells of every table, again.
#[test]
fn the_table_of_estimators_is_not_stale() {
    let is_cheap = |cell: &SignalCase| match cell.table {
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
            assert!((x - y).abs() <= 0.002 + 1e-3 * y.abs(), "{row:?} is {same:?} in the table; write it again");
        }
    }
}

/// Catches a regression that was written into the table: the default estimators have limits of their own.
#[test]
fn default_estimators_keep_their_limits() {
    // Greatest bias and spread in % of the truth over all signals at 41 kHz without a fault, by noise in dB.
    const LIMITS: [(&str, &str, Option<u32>, f64, f64); 12] = [
        ("f_max", "parabola", None, 0.05, 0.1),
        ("f_max", "parabola", Some(60), 0.05, 0.2),
        ("f_max", "parabola", Some(40), 0.8, 1.0),
        // Of a skewed pulse, alike at all noises: a fifth to a quarter short.
        ("tau_s", "half_sine", None, 25.0, 0.05),
        ("tau_s", "half_sine", Some(40), 25.0, 1.3),
        ("pr", "0.4 s", None, 0.001, 0.001),
        ("pr", "0.4 s", Some(60), 0.1, 0.2),
        ("e_f", "0.4 s", Some(60), 0.1, 0.2),
        ("p_f", "0.4 s", Some(60), 0.8, 1.2),
        // A record of the default length smooths the peak of P_f.
        ("pr", "0.05 s", Some(60), 1.0, 0.2),
        ("e_f", "0.05 s", Some(60), 1.0, 0.2),
        ("p_f", "0.05 s", Some(60), 9.0, 0.5),
    ];
    let is_wanted = |cell: &SignalCase| {
        let is_plain = cell.rate_hz == 40_960 && cell.fault.is_empty();
        is_plain && LIMITS.iter().any(|limit| limit.2 == cell.snr_db)
    };
    let measured = measure(is_wanted).unwrap();
    for (quantity, estimator, snr_db, bias_max, spread_max) in LIMITS {
        let is_it = |row: &&Row| row.quantity == quantity && row.estimator == estimator && row.snr_db == snr_db;
        let rows: Vec<&Row> = measured.iter().filter(is_it).collect();
        assert!(rows.len() >= 2, "{quantity} {estimator} {snr_db:?}");
        for row in rows {
            assert!(row.bias_percent.abs() <= bias_max && row.spread_percent <= spread_max, "{row:?}");
            assert!(row.absent_percent <= 0.0, "{row:?}");
        }
    }
}

/// Catches a page that does not show the committed table.
#[test]
fn the_page_shows_the_table() {
    assert!(markdown(&rows()) == text(&docs("estimators.md")), "run `tapline-lab estimators --force`");
    assert_eq!(csv(&rows()).unwrap(), text(&docs("estimators.csv")));
}
