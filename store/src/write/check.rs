//! Checks records before they are put into an archive.

use tapline_wire::{Channel, DamageCell, Plan, RecordKind, SampleFormat, TapHeader, TapId};

use crate::error::{Error, Result};

/// Checks that `id`, at any attempt, is the tap planned in row `plan_index`.
pub(crate) fn check_id(plan: &Plan, plan_index: u32, id: &TapId) -> Result<()> {
    let tap_count = plan.taps().len();
    let planned = plan.taps().get(plan_index as usize).ok_or(Error::NoSuchRow { plan_index, tap_count })?.id;
    if planned.planned() == id.planned() {
        Ok(())
    } else {
        Err(Error::OtherTap { plan_index, planned: Box::new(planned), got: Box::new(*id) })
    }
}

/// Checks that the record of `header` and `samples` has the shape that `plan` prescribes.
pub(crate) fn check_shape(plan: &Plan, header: &TapHeader, samples: &[u8]) -> Result<()> {
    let (recording, plan_index) = (&plan.recording, header.plan_index);
    let check = |is_right: bool, what: &'static str, got: String, planned: String| {
        if is_right { Ok(()) } else { Err(Error::RecordShape { plan_index, what, got, planned }) }
    };
    let kind = header.stamp.kind();
    check(kind == Some(RecordKind::Data), "kind", format!("{kind:?}"), format!("{:?}", RecordKind::Data))?;
    let (format, planned) = (SampleFormat::from_code(header.sample_format), recording.sample_format);
    let name = format.map_or("unknown", SampleFormat::name).to_owned();
    check(format == Some(planned), "sample format", name, planned.name().to_owned())?;
    let (rate, planned) = (header.sample_rate_hz, recording.sample_rate_hz);
    check(rate.total_cmp(&planned).is_eq(), "sample rate", format!("{rate} Hz"), format!("{planned} Hz"))?;
    let channels: Vec<Channel> = header.channels().map(|(kind, _)| kind).collect();
    let is_same = channels == recording.channels && channels.len() == header.channel_count as usize;
    check(is_same, "channels", format!("{channels:?}"), format!("{:?}", recording.channels))?;
    let (count, most) = (header.sample_count, recording.sample_count_max);
    check(count <= most, "sample count", count.to_string(), format!("at most {most}"))?;
    let (got, need) = (samples.len(), header.payload_bytes());
    check(got >= need, "bytes of samples", got.to_string(), format!("{need} or more"))
}

/// Checks that the plan has a scan `scan`.
pub(crate) fn check_scan(plan: &Plan, scan: u32) -> Result<()> {
    let scan_count = plan.scans().len();
    if (scan as usize) < scan_count { Ok(()) } else { Err(Error::NoSuchScan { scan, scan_count }) }
}

/// Checks that `cells` are the locations of scan `scan`, which must exist, in their order.
pub(crate) fn check_cells(plan: &Plan, scan: u32, cells: &[DamageCell]) -> Result<()> {
    let locations = &plan.scans()[scan as usize].locations;
    if cells.len() != locations.len() {
        let (got, planned) = (format!("{} cells", cells.len()), format!("{} locations", locations.len()));
        return Err(Error::OtherCells { scan, got, planned });
    }
    for (cell, &(location, _)) in cells.iter().zip(locations) {
        if cell.location != location {
            let (got, planned) = (format!("location {}", cell.location), format!("location {location}"));
            return Err(Error::OtherCells { scan, got, planned });
        }
    }
    Ok(())
}
