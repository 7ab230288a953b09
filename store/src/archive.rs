//! An open archive: its tables, found and checked.

use std::fs::TryLockError;
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use hdf5::types::VarLenUnicode;
use hdf5::{File, H5Type, Location};
use tapline_wire::{Channel, Geometry, Plan, Recording, SampleFormat, Truth};

use crate::check::{other_configuration, other_lineage};
use crate::chunk::{ChunkRows, close_in_children, take_whole_file};
use crate::codec::Codec;
use crate::context::Context;
use crate::create::{Key, files, files_to_read, format_name, geometry_name};
use crate::given::Given;
use crate::layout::{
    CellRow, DiscriminatorsRow, FORMAT, FORMAT_VERSION, HeaderRow, LedgerRow, OLDEST_VERSION, ReasonRow, ScanRow,
    attribute, table,
};
use crate::lineage::{hex_of, lineage_key, raw_digest};
use crate::rows::serial;
use crate::sealed::{ChunkSeal, SealedRow};
use crate::settled::Raw;
use crate::table::Table;
use crate::units::check_units;
use crate::{Error, Lineage, Part, Result};

const SIGNATURE: &[u8] = b"\x89HDF\r\n\x1a\n";

/// A lock that is met is tried again so often before it is believed: a process that is being started has, for a moment, the
/// locks of the one that starts it.
const LOCK_TRIES: u32 = 20;
const LOCK_PAUSE: Duration = Duration::from_millis(10);

/// What an archive is opened for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Access {
    Read,
    Write,
}

/// An open archive.
#[derive(Debug)]
pub(crate) struct Archive {
    pub(crate) path: PathBuf,
    pub(crate) plan: Plan,
    pub(crate) config: String,
    /// The reference file of the run, as it was read.
    pub(crate) reference: Option<String>,
    pub(crate) samples: ChunkRows,
    /// By the layout of the file that has the samples.
    pub(crate) chunk_seal: ChunkSeal,
    pub(crate) headers: Table<HeaderRow>,
    pub(crate) discriminators: Table<DiscriminatorsRow>,
    pub(crate) ledger: Table<LedgerRow>,
    pub(crate) refusals: Table<ReasonRow>,
    pub(crate) scans: Table<ScanRow>,
    pub(crate) damage: Table<CellRow>,
    /// Which file of its run this is, where that may take several.
    pub(crate) part: Option<Part>,
    /// What the results were made by.
    pub(crate) made_by: String,
    pub(crate) file: File,
    /// The archive of the taps, where this one has results alone.
    raw: Option<Raw>,
}

impl Archive {
    /// Checks that this is the archive of `plan`, begun with the configuration and the reference of `lineage`.
    pub(crate) fn check_same(&self, plan: &Plan, lineage: Lineage<'_>) -> Result<()> {
        let (archived, given) = (self.plan.digest(), plan.digest());
        if archived != given {
            return Err(Error::OtherPlan { path: self.path.clone(), archived, given });
        }
        self.check_lineage(lineage.config_toml, lineage.reference, lineage.made_by)
    }

    /// Checks that it was begun with that configuration and that reference, for results made by `made_by`.
    pub(crate) fn check_lineage(&self, config: &str, reference: Option<&str>, made_by: &str) -> Result<()> {
        if self.config != config {
            return Err(other_configuration(&self.path, &self.config, config));
        }
        if self.reference.as_deref() != reference {
            return Err(Error::OtherReference { path: self.path.clone() });
        }
        if self.made_by != made_by {
            return Err(other_lineage(&self.path, &self.made_by, made_by));
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
        let there = hex_of(&raw_digest(self)?);
        if made_of == there {
            return Ok(());
        }
        let raw = self.samples.dataset().filename();
        Err(Error::OtherTaps { path: self.path.clone(), raw: raw.into(), made_of, there })
    }

    /// The key that was written down; empty where none was.
    pub(crate) fn stored_key(&self) -> Result<String> {
        let key: hdf5::Result<Key> = read_number(&self.file, attribute::LINEAGE_KEY);
        // Of a damaged file the text may be none.
        Ok(String::from_utf8_lossy(key.context("read the key of the results", &self.path)?.as_bytes()).into_owned())
    }

    /// Whether this archive has results alone, of the taps of another.
    pub(crate) fn is_results(&self) -> bool {
        self.raw.is_some()
    }

    /// The ledger that vouches for the samples, and the discriminators that it vouches for besides.
    pub(crate) fn of_taps(&self) -> (&Table<LedgerRow>, &Table<DiscriminatorsRow>) {
        self.raw.as_ref().map_or((&self.ledger, &self.discriminators), |raw| (&raw.ledger, &raw.discriminators))
    }

    /// Opens the archive at `path` and checks that all its tables are there and fit each other.
    pub(crate) fn open(path: &Path, access: Access) -> Result<Self> {
        probe(path, access)?;
        let file = match access {
            Access::Read => files_to_read().open(path),
            Access::Write => files().open_rw(path),
        }
        .context("open the archive", path)?;
        if access == Access::Write {
            take_whole_file(&file).context("take the whole file", path)?;
        }
        close_in_children(&file).context("keep the archive to this process", path)?;
        let version = check_format(&file, path)?;
        let given = read_given(&file, path)?;
        let (raw_file, taps_version) = open_raw(&file, path)?.unzip();
        let taps_file = raw_file.as_ref().unwrap_or(&file);
        check_units(&file, taps_file, path)?;
        let plan = read_plan(&given, taps_file, path)?;
        let tap_count = plan.taps().len();
        let cell_count = plan.scans().iter().map(|s| s.locations.len()).sum();
        let config = text_of(&given.config, table::CONFIG, path)?;
        let made_by = text_of(&given.made_by, table::MADE_BY, path)?;
        let reference = given.reference.map(String::from_utf8).transpose();
        let reference = reference.map_err(|_error| damaged(path, "the reference is not UTF-8"))?;
        let samples = taps_file.dataset(table::SAMPLES).context("find the samples", path)?;
        let codec = read_text(&samples, attribute::CODEC).context("read what packs the samples", path)?;
        let codec = Codec::from_name(&codec).ok_or_else(|| {
            damaged(path, format!("its samples are packed by {codec:?}, which is none of its codecs"))
        })?;
        let samples = (samples.shape().first() == Some(&tap_count))
            .then(|| ChunkRows::new(samples, codec, plan.recording.payload_bytes_max()))
            .flatten()
            .ok_or_else(|| damaged(path, "the samples have not the shape that the plan asks for"))?;
        let archive = Self {
            path: path.to_owned(),
            part: given.part,
            config,
            made_by,
            reference,
            samples,
            chunk_seal: ChunkSeal::of_layout(taps_version.unwrap_or(version)),
            headers: open_table(taps_file, path, tap_count)?,
            discriminators: open_table(&file, path, tap_count)?,
            ledger: open_table(&file, path, tap_count)?,
            refusals: open_table(&file, path, tap_count)?,
            scans: open_table(&file, path, plan.scans().len())?,
            damage: open_table(&file, path, cell_count)?,
            plan,
            raw: raw_file.map(|file| Raw::of(file, path, tap_count)).transpose()?,
            file,
        };
        archive.check_raw()?;
        Ok(archive)
    }

    /// The error that this archive contradicts itself in `what`.
    pub(crate) fn damaged(&self, what: impl Into<String>) -> Error {
        damaged(&self.path, what)
    }

    /// The key of the results as they are.
    pub(crate) fn key(&self) -> Result<String> {
        Ok(lineage_key(&raw_digest(self)?, &self.made_by, self.reference.as_deref()))
    }

    /// Writes down the key of the results, which are whole, and hands it to the system.
    pub(crate) fn write_key(&self) -> Result<()> {
        let key = Key::from_ascii(self.key()?.as_bytes()).map_err(|error| hdf5::Error::from(error.to_string()));
        key.and_then(|key| self.file.attr(attribute::LINEAGE_KEY)?.write_scalar(&key))
            .and_then(|()| self.file.flush())
            .context("write the key of the results", &self.path)
    }

    /// Row in the damage table of the first cell of every scan, and of the end.
    pub(crate) fn first_cells(&self) -> Vec<usize> {
        let mut first_cells = vec![0];
        for scan in self.plan.scans() {
            first_cells.push(first_cells[first_cells.len() - 1] + scan.locations.len());
        }
        first_cells
    }
}

/// Opens the archive whose taps the results in `file` are of, and says its layout; `None` where they are its own.
fn open_raw(file: &File, path: &Path) -> Result<Option<(File, u32)>> {
    if !file.attr_names().context("read the attributes", path)?.iter().any(|name| name == attribute::RAW) {
        return Ok(None);
    }
    let name = read_text(file, attribute::RAW).context("read the name of the taps' archive", path)?;
    let raw_path = path.with_file_name(&name);
    probe(&raw_path, Access::Read)?;
    let raw = files_to_read().open(&raw_path).context("open the archive of the taps", &raw_path)?;
    close_in_children(&raw).context("keep the archive to this process", &raw_path)?;
    let version = check_format(&raw, &raw_path)?;
    let digest =
        |of: &File, path: &Path| read_number::<u64>(of, attribute::PLAN_DIGEST).context("read the plan's digest", path);
    let (archived, given) = (digest(&raw, &raw_path)?, digest(file, path)?);
    if archived != given {
        return Err(Error::OtherPlan { path: raw_path, archived, given });
    }
    Ok(Some((raw, version)))
}

fn damaged(path: &Path, what: impl Into<String>) -> Error {
    Error::Damaged { path: path.to_owned(), what: what.into() }
}

/// Gives the plain reasons why a file cannot be opened, before the library gives its own.
///
/// The lock is tried with a descriptor of its own: the library shares one file between all its openings within a
/// process and would let a second writer in.
fn probe(path: &Path, access: Access) -> Result<()> {
    let mut file = std::fs::OpenOptions::new()
        .read(true)
        .write(access == Access::Write)
        .open(path)
        .context("open the archive", path)?;
    let try_lock = || match access {
        Access::Read => file.try_lock_shared(),
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
        Ok(()) if signature == *SIGNATURE => Ok(()),
        Err(error) if error.kind() != ErrorKind::UnexpectedEof => Err(error).context("read the archive", path),
        _ => Err(Error::NotHdf5 { path: path.to_owned() }),
    }
}

/// The version of the layout of `file`, if it is one that is known.
fn check_format(file: &File, path: &Path) -> Result<u32> {
    let format = read_text(file, attribute::FORMAT).unwrap_or_default();
    if format != FORMAT {
        let what = format!("its attribute {:?} is {format:?}, not {FORMAT:?}", attribute::FORMAT);
        return Err(Error::NotAnArchive { path: path.to_owned(), what });
    }
    let got: u32 = read_number(file, attribute::FORMAT_VERSION).context("read the format version", path)?;
    if !(OLDEST_VERSION..=FORMAT_VERSION).contains(&got) {
        return Err(Error::FormatVersion { path: path.to_owned(), got, known: FORMAT_VERSION });
    }
    Ok(got)
}

/// What was given to the archive, if it is what it was then.
fn read_given(file: &File, path: &Path) -> Result<Given> {
    let said = read_text(file, attribute::DIGEST).context("read the digest", path)?;
    let given = Given::read(file).context("read what does not change", path)?;
    given.filter(|given| given.digest == said).ok_or_else(|| {
        let what =
            "its plan, truth, configuration, reference or attributes are not what was written: their digest differs";
        damaged(path, what)
    })
}

fn read_plan(given: &Given, taps_file: &File, path: &Path) -> Result<Plan> {
    let geometry = text_of(&given.geometry, attribute::GEOMETRY, path)?;
    let geometry = [Geometry::Ring, Geometry::Line]
        .into_iter()
        .find(|&g| geometry_name(g) == geometry)
        .ok_or_else(|| damaged(path, format!("its geometry is {geometry:?}")))?;
    let recording = read_recording(taps_file, path)?;
    let mut taps = Vec::with_capacity(given.plan.len());
    for (k, row) in given.plan.iter().enumerate() {
        taps.push(row.to_tap().map_err(|e| damaged(path, format!("row {k} of its plan: {e}")))?);
    }
    let mut truth = Truth::new();
    for (k, row) in given.truth.iter().enumerate() {
        let tyre = serial(&row.tyre).ok_or_else(|| damaged(path, format!("row {k} of its truth names no tyre")))?;
        truth.insert((tyre, row.shoulder, row.location), row.cracked != 0);
    }
    let plan = Plan::of_source(geometry, recording, taps, truth, given.source_digest)
        .map_err(|e| damaged(path, format!("its plan: {e}")))?;
    let archived = given.plan_digest;
    if plan.digest() != archived {
        let what = format!("its plan has digest {:016x}, but it says {archived:016x}", plan.digest());
        return Err(damaged(path, what));
    }
    Ok(plan)
}

fn read_recording(file: &File, path: &Path) -> Result<Recording> {
    let samples = file.dataset(table::SAMPLES).context("find the samples", path)?;
    let format = read_text(&samples, attribute::SAMPLE_FORMAT).context("read the sample format", path)?;
    let sample_format = [SampleFormat::I16, SampleFormat::F32]
        .into_iter()
        .find(|&f| format_name(f) == format)
        .ok_or_else(|| damaged(path, format!("its sample format is {format:?}")))?;
    let names = read_text(&samples, attribute::CHANNELS).context("read the channels", path)?;
    let channels: Option<Vec<Channel>> =
        names.split(',').map(|name| [Channel::Force, Channel::Sound].into_iter().find(|c| c.name() == name)).collect();
    let shape = samples.shape();
    let sample_count_max = shape.get(2).and_then(|&n| u32::try_from(n).ok());
    Ok(Recording {
        sample_rate_hz: read_number(&samples, attribute::SAMPLE_RATE_HZ).context("read the sample rate", path)?,
        pre_trigger_samples: read_number(&samples, attribute::PRE_TRIGGER_SAMPLES)
            .context("read the pre-trigger samples", path)?,
        sample_count_max: sample_count_max.ok_or_else(|| damaged(path, format!("its samples have shape {shape:?}")))?,
        sample_format,
        channels: channels.ok_or_else(|| damaged(path, format!("its channels are {names:?}")))?,
    })
}

pub(crate) fn open_table<R: SealedRow>(file: &File, path: &Path, row_count: usize) -> Result<Table<R>> {
    Table::open(file, row_count)
        .context("find a table", path)?
        .ok_or_else(|| damaged(path, format!("{} has not {row_count} rows of this layout", R::TABLE)))
}

fn text_of(text: &VarLenUnicode, name: &str, path: &Path) -> Result<String> {
    utf8(text).ok_or_else(|| damaged(path, format!("{name:?} is not UTF-8")))
}

fn utf8(text: &VarLenUnicode) -> Option<String> {
    std::str::from_utf8(text.as_bytes()).ok().map(str::to_owned)
}

pub(crate) fn read_text(place: &Location, name: &str) -> hdf5::Result<String> {
    utf8(&read_number(place, name)?).ok_or_else(|| hdf5::Error::from("a text is not UTF-8"))
}

fn read_number<T: H5Type>(place: &Location, name: &str) -> hdf5::Result<T> {
    place.attr(name)?.read_scalar()
}
