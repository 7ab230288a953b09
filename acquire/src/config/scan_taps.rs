//! The taps of a scan, from the table `[scan]`.

use tapline_wire::{PlannedTap, Purpose, Serial, TapId};

use crate::{Error, ScanConfig};

/// Every tap of `tyres`, each with its station, in the order in which it is taken: tyre, shoulder, offset, velocity, repetition,
/// full turn.
pub(crate) fn taps_of(scan: &ScanConfig, tyres: impl Iterator<Item = (Serial, u16)>) -> Result<Vec<PlannedTap>, Error> {
    let mut taps = Vec::new();
    for (serial, station) in tyres {
        for shoulder in 1..=scan.shoulders {
            for &offset_mm in &scan.offsets_mm {
                for &velocity_m_per_s in &scan.velocities_m_per_s {
                    let mut id = id_of(offset_mm, velocity_m_per_s)?;
                    (id.tyre, id.station, id.shoulder) = (serial, station, shoulder);
                    for repetition in 0..scan.repetitions {
                        id.repetition = repetition;
                        taps.extend(turn(scan, id));
                    }
                }
            }
        }
    }
    Ok(taps)
}

fn id_of(offset_mm: f64, velocity_m_per_s: f64) -> Result<TapId, Error> {
    let named = TapId::default().with_offset_mm(Some(offset_mm));
    named.and_then(|id| id.with_velocity_m_per_s(Some(velocity_m_per_s))).map_err(|e| {
        let value = format!("{offset_mm} or {velocity_m_per_s}");
        Error::setting("scan.offsets_mm or scan.velocities_m_per_s", value, e.bound())
    })
}

/// One full turn of `id`, with the first location again at its end.
fn turn(scan: &ScanConfig, id: TapId) -> impl Iterator<Item = PlannedTap> {
    let locations = scan.locations;
    let closing = scan.closing_tap.then_some(locations);
    (0..locations).chain(closing).map(move |location| {
        let mut id = id;
        id.location = location;
        let angle_deg = 360.0 * f64::from(location) / f64::from(locations);
        PlannedTap { id, angle_deg: Some(angle_deg), purpose: Purpose::closing_if(location == locations) }
    })
}
