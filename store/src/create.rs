//! A new archive: every table at its final size, so that nothing but table contents changes afterwards.

use std::path::Path;

use hdf5::filters::BloscShuffle;
use hdf5::plist::dataset_create::{AllocTime, FillTime};
use hdf5::plist::file_access::{
    CacheDecreaseMode, CacheIncreaseMode, FileAccessBuilder, FlashIncreaseMode, MetadataCacheConfig,
};
use hdf5::types::{FixedAscii, VarLenUnicode};
use hdf5::{File, FileBuilder, H5Type, Location};
use tapline_wire::{Channel, DamageCell, Geometry, Plan, SampleFormat, TapState};

use crate::blosc::RECORD_BYTES_MAX;
use crate::chunk::{ChunkRows, let_go};
use crate::codec::{Codec, placeholder};
use crate::context::Context;
use crate::draft::{Draft, folder_of, remove_dead_drafts};
use crate::given::Given;
use crate::layout::{
    CellRow, DiscriminatorsRow, FORMAT, FORMAT_VERSION, HeaderRow, LedgerRow, NOTES, PlanRow, ReasonRow, ScanRow,
    TruthRow, attribute, table,
};
use crate::lineage::hex_of;
use crate::rows::fixed;
use crate::table::{Table, create as create_table};
use crate::units::write_units;
use crate::{Error, Lineage, Result};

/// How archives are opened for writing, so that a writer may be killed at any time.
///
/// Nothing that tells where things lie reaches the file but by a flush: the library evicts none of it on its own. Nothing is
/// allotted ahead, so that the file is never shorter than it says.
pub(crate) fn files() -> FileBuilder {
    let cache = MetadataCacheConfig {
        evictions_enabled: false,
        incr_mode: CacheIncreaseMode::Off,
        flash_incr_mode: FlashIncreaseMode::Off,
        decr_mode: CacheDecreaseMode::Off,
        ..MetadataCacheConfig::default()
    };
    let mut files = files_to_read();
    files.with_fapl(|plist| {
        plist.alignment(ALIGN_FROM_BYTES, PAGE_BYTES).mdc_config(&cache).meta_block_size(0).small_data_block_size(0)
    });
    files
}

/// How archives are opened for reading: by a descriptor, whatever driver the environment asks the library for.
pub(crate) fn files_to_read() -> FileBuilder {
    let mut files = FileBuilder::new();
    files.with_fapl(FileAccessBuilder::sec2);
    files
}

/// A lineage key that is not known yet, in the room of one that is.
pub(crate) type Key = FixedAscii<64>;

/// Page of memory and block of most file systems: samples that begin on one are written without touching a neighbour's.
const PAGE_BYTES: u64 = 4096;

/// Least size of what is put on a page boundary: rounding up smaller things would waste more than it gains.
const ALIGN_FROM_BYTES: u64 = 8 * PAGE_BYTES;

/// Name of the samples within their group.
const SIGNAL: &str = "samples";

/// Stands for an axis of plain indices: no dataset has positions of taps or channels in one dimension, or times.
const NO_AXIS: &str = ".";

/// Creates the archive of `plan` at `path`; it appears there whole or not at all.
pub(crate) fn create(path: &Path, plan: &Plan, lineage: Lineage<'_>) -> Result<()> {
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
    let draft = Draft::begin(path).context("create", path)?;
    let file = files().create(draft.path()).context("create", path)?;
    if let Err(error) = fill(&file, path, plan, lineage) {
        // What is half there cannot be closed in order, on a full disk for one.
        drop(let_go(&file));
        return Err(error).context("lay out the tables", path);
    }
    drop(file);
    draft.publish(path)
}

fn fill(file: &File, path: &Path, plan: &Plan, lineage: Lineage<'_>) -> hdf5::Result<()> {
    write_text(file, attribute::FORMAT, FORMAT)?;
    write_number(file, attribute::FORMAT_VERSION, &FORMAT_VERSION)?;
    write_text(file, attribute::TAPLINE_VERSION, env!("CARGO_PKG_VERSION"))?;
    write_text(file, attribute::GEOMETRY, geometry_name(plan.geometry))?;
    write_number(file, attribute::PLAN_DIGEST, &plan.digest())?;
    write_number(file, attribute::SOURCE_DIGEST, &plan.source_digest())?;
    if let Some(part) = lineage.part {
        write_number(file, attribute::PART, &part.number)?;
        write_number(file, attribute::RUN_DIGEST, &part.run_digest)?;
    }
    let config = file.new_dataset_builder().empty::<VarLenUnicode>().obj_track_times(false).create(table::CONFIG)?;
    config.write_scalar(&var_len(lineage.config_toml)?)?;
    let made_by = file.new_dataset_builder().empty::<VarLenUnicode>().obj_track_times(false).create(table::MADE_BY)?;
    made_by.write_scalar(&var_len(lineage.made_by)?)?;
    if let Some(reference) = lineage.reference {
        let builder = file.new_dataset::<u8>().shape(reference.len()).obj_track_times(false);
        builder.create(table::REFERENCE)?.write_raw(reference.as_bytes())?;
    }

    let (taps, scan_of_tap) = (plan.taps(), plan.scan_of_tap());
    create_table(file, table::PLAN, taps.len(), |k| PlanRow::new(&taps[k], scan_of_tap[k]))?;
    match lineage.raw {
        Some((raw, digest)) => {
            let raw = from_beside(path, raw);
            write_text(file, attribute::RAW_DIGEST, &hex_of(&digest))?;
            write_text(file, attribute::RAW, &raw)?;
            // For other readers of HDF5; this program opens the other archive itself, to read only.
            file.link_external(&raw, table::TAPS, table::TAPS)?;
        }
        None => {
            let group = file.create_group(table::TAPS)?;
            write_text(&group, attribute::NX_CLASS, "NXdata")?;
            write_text(&group, attribute::NX_SIGNAL, SIGNAL)?;
            write_texts(&group, attribute::NX_AXES, &[NO_AXIS; 3])?;
            Table::<HeaderRow>::create(file, taps.len(), |_| HeaderRow::unwritten())?;
            create_samples(file, plan, lineage.codec)?;
        }
    }
    let discriminators = DiscriminatorsRow::unwritten();
    Table::<DiscriminatorsRow>::create(file, taps.len(), |_| discriminators)?;
    let missing = LedgerRow::new(TapState::Missing, 0);
    Table::<LedgerRow>::create(file, taps.len(), |_| missing)?;
    Table::<ReasonRow>::create(file, taps.len(), |_| ReasonRow::none())?;
    create_scans(file, plan)?;
    create_truth(file, plan)?;
    let is_own = |name: &str| lineage.raw.is_none() || !name.starts_with(table::TAPS);
    for (name, note, units) in NOTES.into_iter().filter(|(name, ..)| is_own(name)) {
        let dataset = file.dataset(name)?;
        write_text(&dataset, attribute::NOTE, note)?;
        write_units(&dataset, units)?;
    }
    write_text(file, attribute::NX_CLASS, "NXroot")?;
    write_text(file, attribute::NX_DEFAULT, table::TAPS)?;
    write_text(file, attribute::DIGEST, &Given::read(file)?.map(|given| given.digest).unwrap_or_default())?;
    write_number(file, attribute::LINEAGE_KEY, &Key::new())?;
    file.flush()
}

/// The name of `raw` as seen from the folder of `path`: it lies there, or in the folder of that folder.
fn from_beside(path: &Path, raw: &Path) -> String {
    let name = raw.file_name().unwrap_or_default().to_string_lossy();
    if folder_of(path) == folder_of(raw) { name.into_owned() } else { format!("../{name}") }
}

fn create_scans(file: &File, plan: &Plan) -> hdf5::Result<()> {
    let mut first_cell = 0;
    Table::<ScanRow>::create(file, plan.scans().len(), |k| {
        let row = ScanRow::open(&plan.scans()[k], first_cell);
        first_cell += row.cell_count;
        row
    })?;
    let cells: Vec<CellRow> = (0..)
        .zip(plan.scans())
        .flat_map(|(number, scan)| {
            scan.locations.iter().map(move |&(location, angle_deg)| {
                let angle_deg = angle_deg.unwrap_or(f64::NAN);
                CellRow::new(number, scan, &DamageCell { location, angle_deg, ..DamageCell::default() })
            })
        })
        .collect();
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

/// Samples lie one tap a chunk, and the index of their chunks is final from the start.
///
/// Without a codec every chunk's place is allotted, and stays a hole in the file until a tap fills it. Packed chunks have no
/// size beforehand: the index is filled with the shortest chunks there are, so that a tap changes one entry where it stands.
fn create_samples(file: &File, plan: &Plan, codec: Codec) -> hdf5::Result<()> {
    let recording = &plan.recording;
    let (channel_count, sample_count) = (recording.channels.len(), recording.sample_count_max as usize);
    let builder = match recording.sample_format {
        SampleFormat::I16 => file.new_dataset::<i16>(),
        SampleFormat::F32 => file.new_dataset::<f32>(),
    };
    let builder = builder
        .shape((plan.taps().len(), channel_count, sample_count))
        .chunk((1, channel_count, sample_count))
        .obj_track_times(false);
    let builder = match codec {
        Codec::None => builder.fill_time(FillTime::Never).alloc_time(Some(AllocTime::Early)),
        Codec::Lz4 => builder.fill_time(FillTime::Never).blosc_lz4(codec.level(), BloscShuffle::Bit),
        Codec::Zstd => builder.fill_time(FillTime::Never).blosc_zstd(codec.level(), BloscShuffle::Bit),
        Codec::Lzf => builder.shuffle().lzf(),
        Codec::Gzip => builder.shuffle().deflate(codec.level()),
    };
    let dataset = builder.create(table::SAMPLES)?;
    if codec.blosc().is_some() {
        let row_bytes = recording.payload_bytes_max();
        let nothing = placeholder(codec, row_bytes / (channel_count * sample_count), row_bytes);
        let rows = ChunkRows::new(dataset.clone(), codec, row_bytes);
        let rows = rows.ok_or_else(|| hdf5::Error::from("the samples have not the shape they were given"))?;
        (0..).zip(plan.taps()).try_for_each(|(row, _)| rows.write(row, &nothing))?;
    }
    write_text(&dataset, attribute::CODEC, codec.name())?;
    let channels: Vec<&str> = recording.channels.iter().map(|c| c.name()).collect();
    write_text(&dataset, attribute::CHANNELS, &channels.join(","))?;
    let units: Vec<&str> = recording.channels.iter().map(|&c| unit_of(c)).collect();
    write_text(&dataset, attribute::CHANNEL_UNITS, &units.join(","))?;
    write_text(&dataset, attribute::SAMPLE_FORMAT, format_name(recording.sample_format))?;
    write_number(&dataset, attribute::SAMPLE_RATE_HZ, &recording.sample_rate_hz)?;
    write_number(&dataset, attribute::PRE_TRIGGER_SAMPLES, &recording.pre_trigger_samples)
}

/// Name of a geometry in archives, as in configurations.
pub(crate) fn geometry_name(geometry: Geometry) -> &'static str {
    match geometry {
        Geometry::Ring => "ring",
        Geometry::Line => "line",
    }
}

/// Name of a sample format in archives, as in configurations.
pub(crate) fn format_name(format: SampleFormat) -> &'static str {
    match format {
        SampleFormat::I16 => "i16",
        SampleFormat::F32 => "f32",
    }
}

/// Unit of a channel's samples once they are scaled.
pub(crate) fn unit_of(channel: Channel) -> &'static str {
    match channel {
        Channel::Force => "N",
        Channel::Sound => "V",
    }
}

fn var_len(text: &str) -> hdf5::Result<VarLenUnicode> {
    text.parse().map_err(|_error| hdf5::Error::from("a text holds a NUL character"))
}

pub(crate) fn write_text(place: &Location, name: &str, text: &str) -> hdf5::Result<()> {
    write_number(place, name, &var_len(text)?)
}

fn write_texts(place: &Location, name: &str, texts: &[&str]) -> hdf5::Result<()> {
    let texts: Vec<VarLenUnicode> = texts.iter().map(|text| var_len(text)).collect::<hdf5::Result<_>>()?;
    place.new_attr::<VarLenUnicode>().shape(texts.len()).create(name)?.write_raw(&texts)
}

fn write_number<T: H5Type>(place: &Location, name: &str, value: &T) -> hdf5::Result<()> {
    place.new_attr::<T>().create(name)?.write_scalar(value)
}
