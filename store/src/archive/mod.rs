//! An open archive: its tables, found and checked.

pub(crate) mod create;
pub(crate) mod ledger;
mod metadata;
pub(crate) mod states;
mod units;

use std::fs::TryLockError;
use std::io::{ErrorKind, Read as _};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use hdf5::File;
use tapline_codec::Codec;
use tapline_wire::{Channel, Geometry, Plan, PlanError, PlannedTap, Recording, SampleFormat, Truth};

use crate::archive::ledger::raw_digest;
use crate::archive::metadata::Metadata;
use crate::archive::units::check_units;
use crate::error::{Context, Error, Result};
use crate::format::checksum::SealedRow;
use crate::format::convert::{first_cells, serial};
use crate::format::layout::{
    CellRow, DiscriminatorsRow, FORMAT, FORMAT_VERSION, HeaderRow, Key, LedgerRow, PlanRow, ReasonRow, ScanRow,
    attribute, format_name, table,
};
use crate::format::lineage::{Digest, Lineage, hex_of, lineage_key};
use crate::h5::file::{abandon, close_in_children, files, files_to_read, read_handle, take_whole_file};
use crate::h5::samples::ChunkRows;
use crate::h5::seal::is_sealed;
use crate::h5::structure;
use crate::h5::table::Table;
use crate::h5::text::{read_number, read_text};

const SIGNATURE: &[u8] = b"\x89HDF\r\n\x1a\n";

/// A lock that is met is tried again so often before it is believed: a process that is being started has, for a moment, the
/// locks of the one that starts it.
const LOCK_TRIES: u32 = 20;
const LOCK_PAUSE: Duration = Duration::from_millis(10);

/// What an archive is opened for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Access {
    /// One that is finished, to be read.
    Read,
    /// Any, to be read: what is not finished is as its writer left it.
    ReadUnfinished,
    /// One that is not finished, to be written.
    Write,
}

/// An open archive.
#[derive(Debug)]
pub(crate) struct Archive {
    path: PathBuf,
    plan: Plan,
    config: String,
    /// The reference file of the run, as it was read.
    reference: Option<String>,
    samples: ChunkRows,
    headers: Table<HeaderRow>,
    discriminators: Table<DiscriminatorsRow>,
    ledger: Table<LedgerRow>,
    refusals: Table<ReasonRow>,
    scans: Table<ScanRow>,
    damage: Table<CellRow>,
    /// The plan as rows, and room for more of them.
    plan_rows: Table<PlanRow>,
    /// The plan as it was begun.
    begun: Plan,
    /// Taps that there is room for.
    taps_max: usize,
    /// Row in the damage table of the first cell of every scan, and of the end of its room.
    first_cells: Vec<usize>,
    /// Whether it is finished, and sealed.
    is_finished: bool,
    /// What the results were made by.
    made_by: String,
    file: File,
    /// The archive of the taps, where this one has results alone.
    raw: Option<Box<Archive>>,
}

impl Archive {
    /// Where it is.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Its plan, with what was added.
    pub(crate) fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The configuration it was begun with, word for word.
    pub(crate) fn config(&self) -> &str {
        &self.config
    }

    /// The reference file it was begun with, word for word.
    pub(crate) fn reference(&self) -> Option<&str> {
        self.reference.as_deref()
    }

    /// What its results were made by.
    pub(crate) fn made_by(&self) -> &str {
        &self.made_by
    }

    /// Taps that there is room for.
    pub(crate) fn taps_max(&self) -> usize {
        self.taps_max
    }

    /// Whether it is finished, and sealed.
    pub(crate) fn is_finished(&self) -> bool {
        self.is_finished
    }

    pub(crate) fn samples(&self) -> &ChunkRows {
        &self.samples
    }

    pub(crate) fn headers(&self) -> &Table<HeaderRow> {
        &self.headers
    }

    pub(crate) fn discriminators(&self) -> &Table<DiscriminatorsRow> {
        &self.discriminators
    }

    pub(crate) fn ledger(&self) -> &Table<LedgerRow> {
        &self.ledger
    }

    pub(crate) fn refusals(&self) -> &Table<ReasonRow> {
        &self.refusals
    }

    pub(crate) fn scans(&self) -> &Table<ScanRow> {
        &self.scans
    }

    pub(crate) fn damage(&self) -> &Table<CellRow> {
        &self.damage
    }

    /// Its plan as it was begun.
    pub(crate) fn begun(&self) -> &Plan {
        &self.begun
    }

    /// Version of the program that created it; `None` where it does not say.
    pub(crate) fn written_by(&self) -> Option<String> {
        read_text(&self.file, attribute::TAPLINE_VERSION).ok()
    }

    pub(crate) fn plan_rows(&self) -> &Table<PlanRow> {
        &self.plan_rows
    }

    /// Closes it without writing anything more to it: see [`crate::h5::file::abandon`].
    pub(crate) fn abandon(self) -> hdf5::Result<()> {
        abandon(&self.file)
    }

    /// Hands all that was written to the system.
    pub(crate) fn flush(&self) -> hdf5::Result<()> {
        self.file.flush()
    }

    /// Checks that this is the archive of `plan`, begun with the configuration and the reference of `lineage`.
    pub(crate) fn check_same(&self, plan: &Plan, lineage: Lineage<'_>) -> Result<()> {
        let (archived, given) = (self.plan.digest(), plan.digest());
        if archived != given {
            return Err(Error::OtherPlan { path: self.path.clone(), archived, given });
        }
        self.check_lineage(lineage)
    }

    /// Checks that it was begun with the configuration and the reference of `lineage`, for results made by the same.
    pub(crate) fn check_lineage(&self, lineage: Lineage<'_>) -> Result<()> {
        if self.config != lineage.config_toml {
            return Err(Error::other_configuration(&self.path, &self.config, lineage.config_toml));
        }
        self.check_made_alike(lineage)
    }

    /// Checks that its results are made as those of `lineage` are.
    pub(crate) fn check_made_alike(&self, lineage: Lineage<'_>) -> Result<()> {
        if self.reference.as_deref() != lineage.reference {
            return Err(Error::OtherReference { path: self.path.clone() });
        }
        if self.made_by != lineage.made_by {
            return Err(Error::other_lineage(&self.path, &self.made_by, lineage.made_by));
        }
        Ok(())
    }

    /// Whether the taps that results are of are those that they were made of.
    fn check_raw(&self) -> Result<()> {
        if !self.is_results() {
            return Ok(());
        }
        let made_of =
            read_text(&self.file, attribute::RAW_DIGEST).context("read the digest of the taps", &self.path)?;
        let there = hex_of(&self.raw_digest()?);
        if made_of == there {
            return Ok(());
        }
        let raw = self.samples.dataset().filename();
        Err(Error::OtherTaps { path: self.path.clone(), raw: raw.into(), made_of, there })
    }

    /// The key that was written down; empty where none was.
    pub(crate) fn stored_key(&self) -> Result<String> {
        let key: hdf5::Result<Key> = self.file.dataset(table::LINEAGE_KEY).and_then(|key| key.read_scalar());
        // Of a damaged file the text may be none.
        Ok(String::from_utf8_lossy(key.context("read the key of the results", &self.path)?.as_bytes()).into_owned())
    }

    /// Whether this archive has results alone, of the taps of another.
    pub(crate) fn is_results(&self) -> bool {
        self.raw.is_some()
    }

    /// The ledger that vouches for the samples, which may be another archive's.
    pub(crate) fn ledger_of_taps(&self) -> &Table<LedgerRow> {
        self.raw.as_ref().map_or(&self.ledger, |raw| &raw.ledger)
    }

    /// The plan with why taps were asked for, which may be another archive's.
    pub(crate) fn plan_of_taps(&self) -> &Table<PlanRow> {
        self.raw.as_ref().map_or(&self.plan_rows, |raw| &raw.plan_rows)
    }

    /// Opens the archive at `path` and checks that all its tables are there and fit each other.
    pub(crate) fn open(path: &Path, access: Access) -> Result<Self> {
        let is_finished = probe(path, access)?;
        let file = match access {
            Access::Read | Access::ReadUnfinished => files_to_read().open(path),
            Access::Write => files().open_rw(path),
        }
        .context("open the archive", path)?;
        if access == Access::Write {
            take_whole_file(&file).context("take the whole file", path)?;
        }
        close_in_children(&file).context("keep the archive to this process", path)?;
        check_format(&file, path)?;
        let given = read_given(&file, path)?;
        let raw = open_raw(&file, path)?;
        let taps_file = raw.as_ref().map_or(&file, |raw| &raw.file);
        check_units(&file, taps_file, path)?;
        let Planned { plan, begun } = read_plan(&given, taps_file, path)?;
        if let Some(raw) = raw.as_ref().filter(|raw| raw.plan.digest() != plan.digest()) {
            let (archived, given) = (raw.plan.digest(), plan.digest());
            return Err(Error::OtherPlan { path: raw.path.clone(), archived, given });
        }
        let (tap_count, taps_max) = (plan.taps().len(), given.plan.len());
        let taps_max_there = raw.as_ref().map_or(taps_max, |raw| raw.taps_max);
        let first_cells = first_cells(&begun, taps_max);
        let cells_max = first_cells[plan.scans().len()];
        let config = text_of(given.config, table::CONFIG, path)?;
        let made_by = text_of(given.made_by, table::MADE_BY, path)?;
        let reference = given.reference.map(|text| text_of(text, table::REFERENCE, path)).transpose()?;
        let samples = taps_file.dataset(table::SAMPLES).context("find the samples", path)?;
        let codec = read_text(&samples, attribute::CODEC).context("read what packs the samples", path)?;
        let codec = Codec::from_name(&codec).ok_or_else(|| {
            Error::damaged(path, format!("its samples are packed by {codec:?}, which is none of its codecs"))
        })?;
        let samples = (samples.shape().first() == Some(&taps_max_there))
            .then(|| ChunkRows::new(samples, codec, plan.recording.payload_bytes_max()))
            .flatten()
            .ok_or_else(|| Error::damaged(path, "the samples have not the shape that the plan asks for"))?;
        let archive = Self {
            path: path.to_owned(),
            config,
            made_by,
            reference,
            samples,
            headers: open_table(taps_file, path, tap_count, taps_max_there)?,
            discriminators: open_table(&file, path, tap_count, taps_max)?,
            ledger: open_table(&file, path, tap_count, taps_max)?,
            refusals: open_table(&file, path, tap_count, taps_max)?,
            scans: open_table(&file, path, plan.scans().len(), plan.scans().len())?,
            damage: open_table(&file, path, cells_max, cells_max)?,
            plan_rows: open_table(&file, path, tap_count, taps_max)?,
            begun,
            taps_max,
            first_cells,
            is_finished,
            plan,
            raw: raw.map(Box::new),
            file,
        };
        archive.check_raw()?;
        Ok(archive)
    }

    /// The error that this archive contradicts itself in `what`.
    pub(crate) fn damaged(&self, what: impl Into<String>) -> Error {
        Error::damaged(&self.path, what)
    }

    /// BLAKE3 of what was recorded in the archived taps: see [`raw_digest`].
    pub(crate) fn raw_digest(&self) -> Result<Digest> {
        raw_digest(&self.path, &self.plan, self.ledger_of_taps(), &self.headers)
    }

    /// The key of the results as they are.
    pub(crate) fn key(&self) -> Result<String> {
        Ok(lineage_key(&self.raw_digest()?, &self.made_by, self.reference.as_deref()))
    }

    /// Writes down the key of the results, which are whole, and hands it to the system.
    pub(crate) fn write_key(&self) -> Result<()> {
        let key = Key::from_ascii(self.key()?.as_bytes()).map_err(|error| hdf5::Error::from(error.to_string()));
        key.and_then(|key| self.file.dataset(table::LINEAGE_KEY)?.write_scalar(&key))
            .and_then(|()| self.file.flush())
            .context("write the key of the results", &self.path)
    }

    /// Row in the damage table of the first cell of scan `scan`.
    pub(crate) fn first_cell(&self, scan: usize) -> usize {
        self.first_cells[scan]
    }

    /// Rows of the cells of scan `scan`.
    pub(crate) fn cells(&self, scan: usize) -> Range<usize> {
        let first = self.first_cells[scan];
        first..first + self.plan.scans()[scan].locations.len()
    }

    /// The open file once more, to read only: see [`crate::h5::file::read_handle`].
    pub(crate) fn read_handle(&self) -> Result<std::fs::File> {
        read_handle(&self.file).context("open the archive", &self.path)
    }

    /// The plan is `plan` from now on, which has more taps.
    pub(crate) fn grow_to(&mut self, plan: Plan) {
        let tap_count = plan.taps().len();
        self.plan_rows.grow_to(tap_count);
        self.headers.grow_to(tap_count);
        self.discriminators.grow_to(tap_count);
        self.ledger.grow_to(tap_count);
        self.refusals.grow_to(tap_count);
        self.plan = plan;
    }
}

/// Opens the archive whose taps the results in `file` are of; `None` where they are its own.
fn open_raw(file: &File, path: &Path) -> Result<Option<Archive>> {
    if !file.attr_names().context("read the attributes", path)?.iter().any(|name| name == attribute::RAW) {
        return Ok(None);
    }
    let name = read_text(file, attribute::RAW).context("read the name of the taps' archive", path)?;
    let raw = Archive::open(&path.with_file_name(&name), Access::Read)?;
    match raw.is_results() {
        true => Err(Error::damaged(path, "it names other results as the archive of its taps")),
        false => Ok(Some(raw)),
    }
}

/// Gives the plain reasons why a file cannot be opened, before the library gives its own.
///
/// The lock is tried with a descriptor of its own: the library shares one file between all its openings within a
/// process and would let a second writer in.
/// Says whether it is finished.
fn probe(path: &Path, access: Access) -> Result<bool> {
    let mut file = std::fs::OpenOptions::new()
        .read(true)
        .write(access == Access::Write)
        .open(path)
        .context("open the archive", path)?;
    let try_lock = || match access {
        Access::Read | Access::ReadUnfinished => file.try_lock_shared(),
        Access::Write => file.try_lock(),
    };
    let mut locked = try_lock();
    for _ in 0..LOCK_TRIES {
        if !matches!(locked, Err(TryLockError::WouldBlock)) {
            break;
        }
        std::thread::sleep(LOCK_PAUSE);
        locked = try_lock();
    }
    match locked {
        Err(TryLockError::WouldBlock) => return Err(Error::InUse { path: path.to_owned() }),
        // A file system without locks cannot say; the library then decides.
        Err(TryLockError::Error(_)) | Ok(()) => {}
    }
    let mut signature = [0; 8];
    match file.read_exact(&mut signature) {
        Ok(()) if signature == *SIGNATURE => {}
        Err(error) if error.kind() != ErrorKind::UnexpectedEof => return Err(error).context("read the archive", path),
        _ => return Err(Error::NotHdf5 { path: path.to_owned() }),
    }
    let is_finished = is_sealed(&file, path)?;
    match access {
        Access::Read if !is_finished => Err(Error::NotFinished { path: path.to_owned() }),
        Access::Write if is_finished => Err(Error::Finished { path: path.to_owned() }),
        _ if is_finished => Ok(true),
        _ => structure::check(&file, path).map(|()| false),
    }
}

/// Checks that `file` is an archive of the layout that is known.
fn check_format(file: &File, path: &Path) -> Result<()> {
    let format = read_text(file, attribute::FORMAT).unwrap_or_default();
    if format != FORMAT {
        let what = format!("its attribute {:?} is {format:?}, not {FORMAT:?}", attribute::FORMAT);
        return Err(Error::NotAnArchive { path: path.to_owned(), what });
    }
    let got: u32 = read_number(file, attribute::FORMAT_VERSION).context("read the format version", path)?;
    if got != FORMAT_VERSION {
        return Err(Error::FormatVersion { path: path.to_owned(), got, known: FORMAT_VERSION });
    }
    Ok(())
}

/// What was given to the archive, if it is what it was then.
fn read_given(file: &File, path: &Path) -> Result<Metadata> {
    let said = read_text(file, attribute::DIGEST).context("read the digest", path)?;
    let given = Metadata::read(file).context("read what does not change", path)?;
    given.filter(|given| given.digest == said).ok_or_else(|| {
        let what =
            "its plan, truth, configuration, reference or attributes are not what was written: their digest differs";
        Error::damaged(path, what)
    })
}

/// The plan of an archive.
struct Planned {
    plan: Plan,
    /// As it was begun.
    begun: Plan,
}

fn read_plan(given: &Metadata, taps_file: &File, path: &Path) -> Result<Planned> {
    let geometry = [Geometry::Ring, Geometry::Line]
        .into_iter()
        .find(|&g| g.name() == given.geometry)
        .ok_or_else(|| Error::damaged(path, format!("its geometry is {:?}", given.geometry)))?;
    let recording = read_recording(taps_file, path)?;
    let taps_in = |rows: Range<usize>| -> Result<Vec<PlannedTap>> {
        let tap =
            |k: usize| given.plan[k].to_tap().map_err(|e| Error::damaged(path, format!("row {k} of its plan: {e}")));
        rows.map(tap).collect()
    };
    let mut truth = Truth::new();
    for (k, row) in given.truth.iter().enumerate() {
        let tyre =
            serial(&row.tyre).ok_or_else(|| Error::damaged(path, format!("row {k} of its truth names no tyre")))?;
        truth.insert((tyre, row.shoulder, row.location), row.cracked != 0);
    }
    let not_a_plan = |error: PlanError| Error::damaged(path, format!("its plan: {error}"));
    let begun = Plan::of_source(geometry, recording, taps_in(0..given.begun_count)?, truth, given.source_digest)
        .map_err(not_a_plan)?;
    let archived = given.plan_digest;
    if begun.digest() != archived {
        let what = format!("its plan has digest {:016x}, but it says {archived:016x}", begun.digest());
        return Err(Error::damaged(path, what));
    }
    let mut plan = begun.clone();
    while let Some(rows) = growth(&given.plan, plan.taps().len()) {
        let (first, digest) = (rows.start, given.plan[rows.start].plan_digest);
        // Of a writer that died while it added them some may be there, or such that were added before and are not meant.
        match taps_in(rows).ok().and_then(|taps| plan.grown(&taps).ok()).filter(|grown| grown.digest() == digest) {
            Some(grown) => plan = grown,
            None => {
                tracing::warn!(
                    "{}: taps from plan row {first} on are not all there: they do not count",
                    path.display()
                );
                break;
            }
        }
    }
    Ok(Planned { plan, begun })
}

/// The rows that were added together to a plan of `tap_count` taps; `None` where none were, or one is not what was written.
fn growth(rows: &[PlanRow], tap_count: usize) -> Option<Range<usize>> {
    let first = rows.get(tap_count)?;
    let added = tap_count..(first.grown_to as usize).min(rows.len());
    let are_whole = added.clone().all(|k| rows[k].is_whole(k));
    Some(added).filter(|added| are_whole && !added.is_empty())
}

fn read_recording(file: &File, path: &Path) -> Result<Recording> {
    let samples = file.dataset(table::SAMPLES).context("find the samples", path)?;
    let format = read_text(&samples, attribute::SAMPLE_FORMAT).context("read the sample format", path)?;
    let sample_format = [SampleFormat::I16, SampleFormat::F32]
        .into_iter()
        .find(|&f| format_name(f) == format)
        .ok_or_else(|| Error::damaged(path, format!("its sample format is {format:?}")))?;
    let names = read_text(&samples, attribute::CHANNELS).context("read the channels", path)?;
    let channels: Option<Vec<Channel>> =
        names.split(',').map(|name| [Channel::Force, Channel::Sound].into_iter().find(|c| c.name() == name)).collect();
    let shape = samples.shape();
    let sample_count_max = shape.get(2).and_then(|&n| u32::try_from(n).ok());
    Ok(Recording {
        sample_rate_hz: read_number(&samples, attribute::SAMPLE_RATE_HZ).context("read the sample rate", path)?,
        pre_trigger_samples: read_number(&samples, attribute::PRE_TRIGGER_SAMPLES)
            .context("read the pre-trigger samples", path)?,
        sample_count_max: sample_count_max
            .ok_or_else(|| Error::damaged(path, format!("its samples have shape {shape:?}")))?,
        sample_format,
        channels: channels.ok_or_else(|| Error::damaged(path, format!("its channels are {names:?}")))?,
    })
}

pub(crate) fn open_table<R: SealedRow>(
    file: &File,
    path: &Path,
    row_count: usize,
    capacity: usize,
) -> Result<Table<R>> {
    Table::open(file, row_count, capacity)
        .context("find a table", path)?
        .ok_or_else(|| Error::damaged(path, format!("{} has not {capacity} rows of this layout", R::TABLE)))
}

fn text_of(text: Vec<u8>, name: &str, path: &Path) -> Result<String> {
    String::from_utf8(text).map_err(|_error| Error::damaged(path, format!("{name:?} is not UTF-8")))
}
