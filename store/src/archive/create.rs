//! A new archive: every table has its final size, so that only contents change afterwards.

use std::path::Path;

use hdf5::File;
use hdf5::filters::BloscShuffle;
use hdf5::plist::dataset_create::{AllocTime, FillTime};
use tapline_codec::RECORD_BYTES_MAX;
use tapline_codec::{Codec, placeholder};
use tapline_wire::{DamageCell, Plan, SampleFormat, TapState};

use crate::archive::metadata::Metadata;
use crate::archive::units::write_units;
use crate::error::{Context, Error, Result};
use crate::file::draft::{self, folder_of, remove_dead_drafts};
use crate::format::fields::fixed;
use crate::format::layout::{
    CellRow, DiscriminatorsRow, FORMAT, FORMAT_VERSION, HeaderRow, Key, LedgerRow, NOTES, PlanRow, ReasonRow, ScanRow,
    TruthRow, attribute, channel_units, table, units_of,
};
use crate::format::lineage::{Lineage, hex_of};
use crate::format::scan_rows::first_cells;
use crate::format::tap_rows::Growth;
use crate::h5::file::{abandon, files};
use crate::h5::samples::ChunkRows;
use crate::h5::structure;
use crate::h5::table::{Table, create as create_table};
use crate::h5::text::{create_text, write_number, write_text, write_texts};

/// Name of the samples within their group.
const SIGNAL: &str = "samples";

/// The axis of plain indices, as NeXus writes it.
const NO_AXIS: &str = ".";

/// Creates the archive of `plan`, with room for `taps_max` taps, at `path`, where it appears complete or not at all.
pub(crate) fn create(path: &Path, plan: &Plan, taps_max: usize, lineage: Lineage<'_>) -> Result<()> {
    let taps_max = taps_max.max(plan.taps().len());
    let recording = &plan.recording;
    if recording.channels.is_empty() || recording.sample_count_max == 0 {
        let (channel_count, sample_count_max) = (recording.channels.len(), recording.sample_count_max);
        return Err(Error::EmptyRecording { channel_count, sample_count_max });
    }
    let (bytes, most) = (recording.payload_bytes_max(), RECORD_BYTES_MAX);
    if bytes > most {
        return Err(Error::LongRecording { bytes, most });
    }
    if path.try_exists().context("look for", path)? {
        return Err(Error::Exists { path: path.to_owned() });
    }
    remove_dead_drafts(path);
    let draft = draft::begin(path).context("create", path)?;
    let file = files().create(&draft).context("create", path)?;
    let filled = fill(&file, path, plan, taps_max, lineage).context("lay out the tables", path);
    let changing = filled.and_then(|()| structure::changing(&file, lineage.raw.is_some(), &draft));
    let changing = changing.inspect_err(|_| {
        // A file that is half written, for example on a full disk, cannot be closed properly.
        drop(abandon(&file));
    })?;
    drop(file);
    structure::write(&draft, changing).context("lay out the tables", path)?;
    draft::publish(draft, path)
}

fn fill(file: &File, path: &Path, plan: &Plan, taps_max: usize, lineage: Lineage<'_>) -> hdf5::Result<()> {
    // First, so that it is found without the library.
    structure::create(file, taps_max)?;
    write_text(file, attribute::FORMAT, FORMAT)?;
    write_number(file, attribute::FORMAT_VERSION, &FORMAT_VERSION)?;
    write_text(file, attribute::TAPLINE_VERSION, env!("CARGO_PKG_VERSION"))?;
    write_text(file, attribute::GEOMETRY, plan.geometry.name())?;
    write_number(file, attribute::PLAN_DIGEST, &plan.digest())?;
    write_number(file, attribute::SOURCE_DIGEST, &plan.source_digest())?;
    write_number(file, attribute::BEGUN_TAPS, &(plan.taps().len() as u64))?;
    create_text(file, table::CONFIG, lineage.config_toml)?;
    create_text(file, table::MADE_BY, lineage.made_by)?;
    let calibration = serde_json::to_string(&plan.recording.calibration);
    create_text(file, table::CALIBRATION, &calibration.map_err(|error| hdf5::Error::from(error.to_string()))?)?;
    if let Some(reference) = lineage.reference {
        create_text(file, table::REFERENCE, reference)?;
    }

    let (taps, scan_of_tap) = (plan.taps(), plan.scan_of_tap());
    let to = u32::try_from(taps.len()).unwrap_or(u32::MAX);
    let begun = Growth { to, plan_digest: plan.digest() };
    Table::<PlanRow>::create(file, taps_max, |k| match taps.get(k) {
        Some(tap) => PlanRow::new(tap, scan_of_tap[k], begun),
        None => PlanRow::unwritten(),
    })?;
    match lineage.raw {
        Some((raw, digest)) => {
            let raw = from_beside(path, raw);
            write_text(file, attribute::RAW_DIGEST, &hex_of(&digest))?;
            write_text(file, attribute::RAW, &raw)?;
            // For other programs; this one opens the other archive itself, for reading.
            file.link_external(&raw, table::TAPS, table::TAPS)?;
        }
        None => {
            let group = file.create_group(table::TAPS)?;
            write_text(&group, attribute::NX_CLASS, "NXdata")?;
            write_text(&group, attribute::NX_SIGNAL, SIGNAL)?;
            write_texts(&group, attribute::NX_AXES, &[NO_AXIS; 3])?;
            Table::<HeaderRow>::create(file, taps_max, |_| HeaderRow::unwritten())?;
            create_samples(file, plan, taps_max, lineage.codec)?;
        }
    }
    let discriminators = DiscriminatorsRow::unwritten();
    Table::<DiscriminatorsRow>::create(file, taps_max, |_| discriminators)?;
    let missing = LedgerRow::new(TapState::Missing, 0);
    Table::<LedgerRow>::create(file, taps_max, |_| missing)?;
    Table::<ReasonRow>::create(file, taps_max, |_| ReasonRow::none())?;
    create_scans(file, plan, taps_max)?;
    create_truth(file, plan)?;
    let is_own = |name: &str| lineage.raw.is_none() || !name.starts_with(table::TAPS);
    for (name, note, units) in NOTES.into_iter().filter(|(name, ..)| is_own(name)) {
        let dataset = file.dataset(name)?;
        write_text(&dataset, attribute::NOTE, note)?;
        write_units(&dataset, &units_of(name, units, &plan.recording.calibration))?;
    }
    write_text(file, attribute::NX_CLASS, "NXroot")?;
    write_text(file, attribute::NX_DEFAULT, table::TAPS)?;
    write_text(file, attribute::DIGEST, &Metadata::read(file)?.map(|metadata| metadata.digest).unwrap_or_default())?;
    let key = file.new_dataset_builder().empty::<Key>().alloc_time(Some(AllocTime::Early)).obj_track_times(false);
    key.create(table::LINEAGE_KEY)?.write_scalar(&Key::new())?;
    file.flush()
}

/// The name of `raw` as seen from the folder of `path`: `raw` lies there, or in its parent.
fn from_beside(path: &Path, raw: &Path) -> String {
    let name = raw.file_name().unwrap_or_default().to_string_lossy();
    if folder_of(path) == folder_of(raw) { name.into_owned() } else { format!("../{name}") }
}

fn create_scans(file: &File, plan: &Plan, taps_max: usize) -> hdf5::Result<()> {
    let first_cells = first_cells(plan, taps_max);
    Table::<ScanRow>::create(file, plan.scans().len(), |k| {
        ScanRow::open(&plan.scans()[k], u32::try_from(first_cells[k]).unwrap_or(u32::MAX))
    })?;
    let mut cells = vec![CellRow::unwritten(); first_cells[plan.scans().len()]];
    for ((number, scan), &first) in (0..).zip(plan.scans()).zip(&first_cells) {
        for (cell, &(location, angle_deg)) in cells[first..].iter_mut().zip(&scan.locations) {
            let angle_deg = angle_deg.unwrap_or(f64::NAN);
            *cell = CellRow::new(number, scan, &DamageCell { location, angle_deg, ..DamageCell::default() });
        }
    }
    Table::<CellRow>::create(file, cells.len(), |k| cells[k])?;
    Ok(())
}

fn create_truth(file: &File, plan: &Plan) -> hdf5::Result<()> {
    let rows: Vec<TruthRow> = plan
        .truth()
        .iter()
        .map(|(&(tyre, shoulder, location), &cracked)| TruthRow {
            tyre: fixed(tyre.as_str()),
            shoulder,
            location,
            cracked: cracked.into(),
        })
        .collect();
    if !rows.is_empty() {
        create_table(file, table::TRUTH, rows.len(), |k| rows[k])?;
    }
    Ok(())
}

/// Creates the samples: one chunk per tap, with an index that has its final size from the start.
///
/// Without a codec every chunk is allocated, and is a hole in the file until a tap fills it. The size of a packed chunk is not
/// known beforehand: the index is filled with the shortest possible chunks, so that a tap later changes one entry in place.
fn create_samples(file: &File, plan: &Plan, taps_max: usize, codec: Codec) -> hdf5::Result<()> {
    let recording = &plan.recording;
    let (channel_count, sample_count) = (recording.channels.len(), recording.sample_count_max as usize);
    let builder = match recording.sample_format {
        SampleFormat::I16 => file.new_dataset::<i16>(),
        SampleFormat::F32 => file.new_dataset::<f32>(),
    };
    let builder = builder
        .shape((taps_max, channel_count, sample_count))
        .chunk((1, channel_count, sample_count))
        .obj_track_times(false);
    let builder = match codec {
        Codec::None => builder.fill_time(FillTime::Never).alloc_time(Some(AllocTime::Early)),
        Codec::Lz4 => builder.fill_time(FillTime::Never).blosc_lz4(codec.level(), BloscShuffle::Bit),
        Codec::Zstd => builder.fill_time(FillTime::Never).blosc_zstd(codec.level(), BloscShuffle::Bit),
        Codec::Gzip => builder.shuffle().deflate(codec.level()),
    };
    let dataset = builder.create(table::SAMPLES)?;
    if codec.blosc().is_some() {
        let row_bytes = recording.payload_bytes_max();
        let empty = placeholder(codec, row_bytes / (channel_count * sample_count), row_bytes);
        let rows = ChunkRows::new(dataset.clone(), codec, row_bytes);
        let rows = rows.ok_or_else(|| hdf5::Error::from("the samples do not have the shape they were given"))?;
        (0..).take(taps_max).try_for_each(|row| rows.write(row, &empty))?;
    }
    write_text(&dataset, attribute::CODEC, codec.name())?;
    let channels: Vec<&str> = recording.channels.iter().map(|c| c.name()).collect();
    write_text(&dataset, attribute::CHANNELS, &channels.join(","))?;
    write_text(&dataset, attribute::CHANNEL_UNITS, &channel_units(recording))?;
    write_text(&dataset, attribute::SAMPLE_FORMAT, recording.sample_format.name())?;
    write_number(&dataset, attribute::SAMPLE_RATE_HZ, &recording.sample_rate_hz)?;
    write_number(&dataset, attribute::PRE_TRIGGER_SAMPLES, &recording.pre_trigger_samples)
}
