//! What a scan's row says of the plan.

use tapline_wire::{Channel, Geometry, PlannedTap, Recording, SampleFormat, Serial};

use super::*;
use crate::rows::fixed;

/// Catches a scan that passes for another's, or for one with another map, under a seal that fits.
#[test]
fn a_scan_is_the_planned_one() {
    let tap = |shoulder| {
        let mut id = TapId::default();
        (id.station, id.tyre, id.shoulder) = (3, Serial::new("A").unwrap(), shoulder);
        PlannedTap { id, angle_deg: None, is_closing: false }
    };
    let recording = Recording {
        sample_rate_hz: 40960.0,
        pre_trigger_samples: 8,
        sample_count_max: 32,
        sample_format: SampleFormat::I16,
        channels: vec![Channel::Force, Channel::Sound],
    };
    let plan = Plan::new(Geometry::Ring, recording, vec![tap(1), tap(2)], [].into()).unwrap();
    let row = ScanRow::open(&plan.scans()[1], 1);
    let complaints = |row: ScanRow| {
        let mut all = Vec::new();
        check_planned(&plan, 1, &row, 1, &mut |what| all.push(what));
        all.join("; ")
    };
    assert_eq!(complaints(row), "");
    assert_eq!(complaints(ScanRow { tyre: fixed("B"), ..row }), "its row is of tyre \"B\"; \"A\" is planned");
    let other = ScanRow { station: 1, shoulder: 1, first_cell: 0, ..row };
    let said = "its row has station 1; 3 is planned; its row has shoulder 1; 2 is planned; its row has first cell 0; 1 is planned";
    assert_eq!(complaints(other), said);
}
