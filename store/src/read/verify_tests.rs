//! A scan's row against the plan.

use super::*;
use crate::format::fields::fixed;
use crate::testing::two_scans;

/// Catches a scan row that names another scan or another map, under a valid checksum.
#[test]
fn a_scan_is_the_planned_one() {
    let plan = two_scans();
    let row = ScanRow::open(&plan.scans()[1], 1);
    let complaints = |row: ScanRow| {
        let mut all = Vec::new();
        check_planned(&plan, 1, &row, 1, &mut |what| all.push(what));
        all.join("; ")
    };
    assert_eq!(complaints(row), "");
    assert_eq!(complaints(ScanRow { tyre: fixed("B"), ..row }), "its row is of tyre \"B\"; \"A\" is planned");
    let other = ScanRow { station: 1, shoulder: 1, first_cell: 0, ..row };
    let expected = "its row has station 1; 3 is planned; its row has shoulder 1; 2 is planned; its row has first cell 0; 1 is planned";
    assert_eq!(complaints(other), expected);
}
