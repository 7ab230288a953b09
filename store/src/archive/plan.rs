//! The scan plan of an archive: the rows it was begun with, and those that were added while its casing was open.

use std::ops::Range;
use std::path::Path;

use hdf5::File;
use tapline_wire::{Calibration, Channel, Geometry, Plan, PlanError, PlannedTap, Recording, SampleFormat, Truth};

use crate::archive::metadata::Metadata;
use crate::error::{Context, Error, Result};
use crate::format::checksum::ChecksummedRow as _;
use crate::format::fields::serial;
use crate::format::layout::{PlanRow, attribute, table};
use crate::h5::text::{read_number, read_text};

/// The plan of an archive.
pub(super) struct Planned {
    /// With the taps that were added.
    pub plan: Plan,
    /// As it was begun.
    pub begun: Plan,
}

/// The plan in `metadata`, with the recording that the samples in `taps_file` have.
pub(super) fn read_plan(
    metadata: &Metadata,
    calibration: Calibration,
    taps_file: &File,
    path: &Path,
) -> Result<Planned> {
    let geometry = Geometry::from_name(&metadata.geometry)
        .ok_or_else(|| Error::damaged(path, format!("its geometry is {:?}", metadata.geometry)))?;
    let recording = Recording { calibration, ..read_recording(taps_file, path)? };
    let taps_in = |rows: Range<usize>| -> Result<Vec<PlannedTap>> {
        let tap =
            |k: usize| metadata.plan[k].to_tap().map_err(|e| Error::damaged(path, format!("row {k} of its plan: {e}")));
        rows.map(tap).collect()
    };
    let mut truth = Truth::new();
    for (k, row) in metadata.truth.iter().enumerate() {
        let tyre =
            serial(&row.tyre).ok_or_else(|| Error::damaged(path, format!("row {k} of its truth names no tyre")))?;
        truth.insert((tyre, row.shoulder, row.location), row.cracked != 0);
    }
    let not_a_plan = |error: PlanError| Error::damaged(path, format!("its plan: {error}"));
    let begun =
        Plan::from_source(geometry, recording, taps_in(0..metadata.begun_count)?, truth, metadata.source_digest)
            .map_err(not_a_plan)?;
    let archived = metadata.plan_digest;
    if begun.digest() != archived {
        let what = format!("its plan has digest {:016x}, but {archived:016x} is stored", begun.digest());
        return Err(Error::damaged(path, what));
    }
    let mut plan = begun.clone();
    while let Some(rows) = growth(&metadata.plan, plan.taps().len()) {
        let (first, digest) = (rows.start, metadata.plan[rows.start].plan_digest);
        // A writer that was killed while it added taps may have left some of their rows, or rows of an earlier attempt.
        match taps_in(rows).ok().and_then(|taps| plan.grown(&taps).ok()).filter(|grown| grown.digest() == digest) {
            Some(grown) => plan = grown,
            None => {
                tracing::warn!(
                    "{}: the taps that were added from plan row {first} on are incomplete and are ignored",
                    path.display()
                );
                break;
            }
        }
    }
    Ok(Planned { plan, begun })
}

/// The rows that were added together to a plan of `tap_count` taps; `None` if there are none, or one is corrupt.
fn growth(rows: &[PlanRow], tap_count: usize) -> Option<Range<usize>> {
    let first = rows.get(tap_count)?;
    let added = tap_count..(first.grown_to as usize).min(rows.len());
    let are_valid = added.clone().all(|k| rows[k].is_valid(k));
    Some(added).filter(|added| are_valid && !added.is_empty())
}

fn read_recording(file: &File, path: &Path) -> Result<Recording> {
    let samples = file.dataset(table::SAMPLES).context("find the samples", path)?;
    let format = read_text(&samples, attribute::SAMPLE_FORMAT).context("read the sample format", path)?;
    let sample_format = SampleFormat::from_name(&format)
        .ok_or_else(|| Error::damaged(path, format!("its sample format is {format:?}")))?;
    let names = read_text(&samples, attribute::CHANNELS).context("read the channels", path)?;
    let channels: Option<Vec<Channel>> = names.split(',').map(Channel::from_name).collect();
    let shape = samples.shape();
    let sample_count_max = shape.get(2).and_then(|&n| u32::try_from(n).ok());
    Ok(Recording {
        sample_rate_hz: read_number(&samples, attribute::SAMPLE_RATE_HZ).context("read the sample rate", path)?,
        pre_trigger_samples: read_number(&samples, attribute::PRE_TRIGGER_SAMPLES)
            .context("read the pre-trigger samples", path)?,
        sample_count_max: sample_count_max
            .ok_or_else(|| Error::damaged(path, format!("its samples have shape {shape:?}")))?,
        sample_format,
        calibration: Calibration::default(),
        channels: channels.ok_or_else(|| Error::damaged(path, format!("its channels are {names:?}")))?,
    })
}
