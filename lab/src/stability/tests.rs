//! The committed tables of the breakdown curves are what the code computes.

use std::path::Path;

use super::curves::{Curve, clipping, offset, restitution, velocity_drift};

/// Relative difference of two errors that is none: the tables have five digits.
const SAME: f64 = 2e-3;
/// Errors below this are rounding, and differ from machine to machine.
const ROUNDING: f64 = 1e-6;

/// Catches a kernel that has changed under the committed curves, and tables that were edited by hand. The cheap four of
/// nine are computed anew; an error may differ in its last digits only, or below 1e-6.
#[test]
fn tables_are_those_of_the_code() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/stability");
    for curve in [clipping(), offset(), restitution(), velocity_drift()] {
        let path = folder.join(format!("{}.csv", curve.name));
        let committed = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        compare(&curve, &committed);
    }
}

fn compare(curve: &Curve, committed: &str) {
    let computed = curve.csv();
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
