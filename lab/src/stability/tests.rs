//! The committed tables of the breakdown curves are what the code computes.

use tapline_testing::documents::{docs, text};

use super::curves::{Curve, clipping, offset, restitution, velocity_drift};

/// Relative difference up to which errors are the same: the tables have five digits.
const SAME: f64 = 2e-3;
/// Errors below this are rounding, and differ from machine to machine.
const ROUNDING: f64 = 1e-6;

/// Catches a kernel that has changed under the committed curves, and tables that were edited by hand. The cheap four of
/// nine are computed again; an error may differ in its last digits only, or below 1e-6.
#[test]
fn tables_are_those_of_the_code() {
    for curve in [clipping(), offset(), restitution(), velocity_drift()] {
        compare(&curve, &text(&docs(&format!("stability/{}.csv", curve.name))));
    }
}

/// Catches a regression that was written into the tables: errors of the computed curves have limits of their own.
#[test]
fn errors_keep_their_limits() {
    let worst = |curve: &Curve, column: &str, is_in: &dyn Fn(f64) -> bool| {
        let place = curve.columns.iter().position(|name| *name == column).unwrap();
        let errors = curve.rows.iter().filter(|row| is_in(row.x)).map(|row| row.errors[place]);
        errors.max_by(f64::total_cmp).unwrap()
    };
    let all = |_: f64| true;
    let clipped = clipping();
    for (column, limit) in [("tau", 0.05), ("pr", 0.05), ("f_max", 0.6), ("a_1", 0.5)] {
        assert!(worst(&clipped, column, &all) < limit, "{column}: {}", worst(&clipped, column, &all));
    }
    assert!(
        clipped.rows.iter().all(|row| row.x > 0.999 || row.flags == "clipped"),
        "a clipped record without its flag"
    );
    let shifted = offset();
    for &column in &shifted.columns {
        assert!(worst(&shifted, column, &all) < 1e-6, "{column}: {}", worst(&shifted, column, &all));
    }
    let drifted = velocity_drift();
    let five_percent = |x: f64| x.abs() < 5.001;
    for (column, limit) in
        [("f_max_closed", 0.065), ("f_max_full", 0.065), ("tau_closed", 0.011), ("d_max_full", 0.045)]
    {
        assert!(worst(&drifted, column, &five_percent) < limit, "{column}: {}", worst(&drifted, column, &five_percent));
    }
    assert!(worst(&restitution(), "exact", &all) < 1e-6, "{}", worst(&restitution(), "exact", &all));
}

fn compare(curve: &Curve, committed: &str) {
    let computed = curve.csv().unwrap();
    assert_eq!(computed.lines().count(), committed.lines().count(), "{}", curve.name);
    assert_eq!(computed.lines().next(), committed.lines().next(), "{}", curve.name);
    for (a, b) in computed.lines().zip(committed.lines()).skip(1) {
        for (a_cell, b_cell) in a.split(',').zip(b.split(',')) {
            let is_same = match (a_cell.parse::<f64>(), b_cell.parse::<f64>()) {
                (Ok(x), Ok(y)) => (x - y).abs() <= SAME * y.abs() || (x.abs() < ROUNDING && y.abs() < ROUNDING),
                _ => a_cell == b_cell,
            };
            assert!(is_same, "{}: {a} against {b}", curve.name);
        }
    }
}
