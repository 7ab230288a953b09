//! What the unit tests share.

use tapline_wire::{Calibration, Channel, Geometry, Plan, PlannedTap, Purpose, Recording, SampleFormat, Serial, TapId};

/// A plan of two shoulders of a tyre "A" at station 3, a tap each.
pub(crate) fn two_scans() -> Plan {
    let tap = |shoulder| {
        let mut id = TapId::default();
        (id.station, id.tyre, id.shoulder) = (3, Serial::new("A").unwrap(), shoulder);
        PlannedTap { id, angle_deg: None, purpose: Purpose::Scan }
    };
    let recording = Recording {
        sample_rate_hz: 40960.0,
        pre_trigger_samples: 8,
        sample_count_max: 32,
        sample_format: SampleFormat::I16,
        channels: Channel::BOTH.to_vec(),
        calibration: Calibration::stated(),
    };
    Plan::new(Geometry::Ring, recording, vec![tap(1), tap(2)], [].into()).unwrap()
}
