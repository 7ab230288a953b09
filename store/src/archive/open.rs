//! Opens an archive: first with plain reads, which no damaged file can mislead, then through the HDF5 library.

use std::ffi::OsStr;
use std::fs::TryLockError;
use std::io::{ErrorKind, Read as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::time::Duration;

use hdf5::File;
use rustix::fs::OFlags;
use tapline_codec::Codec;

use crate::archive::Archive;
use crate::archive::metadata::Metadata;
use crate::archive::plan::{Planned, read_plan};
use crate::archive::units::check_units;
use crate::error::{Context, Error, Result};
use crate::format::checksum::ChecksummedRow;
use crate::format::layout::{FORMAT, FORMAT_VERSION, attribute, table};
use crate::format::lineage::hex_of;
use crate::format::scan_rows::first_cells;
use crate::h5::file::{close_in_children, files, files_to_read, take_whole_file};
use crate::h5::samples::ChunkRows;
use crate::h5::seal::is_sealed;
use crate::h5::structure;
use crate::h5::table::Table;
use crate::h5::text::{read_number, read_text};

const SIGNATURE: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Attempts before a lock counts: a process that is being started briefly holds the locks of the process that
/// starts it.
const LOCK_TRIES: u32 = 200;
const LOCK_PAUSE: Duration = Duration::from_millis(10);

/// What an archive is opened for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Access {
    /// To read a finished archive.
    Read,
    /// To read any archive; an unfinished one is as its writer left it.
    ReadUnfinished,
    /// To write an unfinished archive.
    Write,
}

impl Archive {
    /// Opens the archive at `path` and checks that all its tables are there and fit each other.
    pub(crate) fn open(path: &Path, access: Access) -> Result<Self> {
        Self::open_if(path, access, true)
    }

    /// As [`Archive::open`]; a file of results is refused unless it `may_be_results`.
    fn open_if(path: &Path, access: Access, may_be_results: bool) -> Result<Self> {
        let is_finished = probe(path, access)?;
        let file = match access {
            Access::Read | Access::ReadUnfinished => files_to_read().open(path),
            Access::Write => files().open_rw(path),
        }
        .context("open the archive", path)?;
        if access == Access::Write {
            take_whole_file(&file).context("claim the whole file", path)?;
        }
        close_in_children(&file).context("keep the archive to this process", path)?;
        check_format(&file, path)?;
        let metadata = read_metadata(&file, path)?;
        let raw = open_raw(&file, path, may_be_results)?;
        let taps_file = raw.as_ref().map_or(&file, |raw| &raw.file);
        let calibration = serde_json::from_slice(&metadata.calibration)
            .map_err(|error| Error::damaged(path, format!("its calibration is invalid: {error}")))?;
        check_units(&file, taps_file, &calibration, path)?;
        let Planned { plan, begun } = read_plan(&metadata, calibration, taps_file, path)?;
        if raw.as_ref().is_some_and(|raw| raw.plan.digest() != plan.digest()) {
            return Err(Error::damaged(path, "its scan plan is not that of the archive of its taps"));
        }
        let (tap_count, taps_max) = (plan.taps().len(), metadata.plan.len());
        let taps_max_of_taps = raw.as_ref().map_or(taps_max, |raw| raw.taps_max);
        let first_cells = first_cells(&begun, taps_max);
        let cells_max = first_cells[plan.scans().len()];
        let config = text_of(metadata.config, table::CONFIG, path)?;
        let made_by = text_of(metadata.made_by, table::MADE_BY, path)?;
        let reference = metadata.reference.map(|text| text_of(text, table::REFERENCE, path)).transpose()?;
        let samples = taps_file.dataset(table::SAMPLES).context("find the samples", path)?;
        let codec = read_text(&samples, attribute::CODEC).context("read the codec", path)?;
        let codec = Codec::from_name(&codec).ok_or_else(|| {
            Error::damaged(path, format!("its samples are packed with {codec:?}, which is not a codec of archives"))
        })?;
        let samples = (samples.shape().first() == Some(&taps_max_of_taps))
            .then(|| ChunkRows::new(samples, codec, plan.recording.payload_bytes_max()))
            .flatten()
            .ok_or_else(|| Error::damaged(path, "the samples do not have the shape that the plan asks for"))?;
        Ok(Self {
            path: path.to_owned(),
            config,
            made_by,
            reference,
            samples,
            headers: open_table(taps_file, path, tap_count, taps_max_of_taps)?,
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
        })
    }
}

/// Whether the file at `path` has only results, without a look at the archive that it names.
///
/// # Errors
/// As when it is opened.
pub fn has_only_results(path: &Path) -> Result<bool> {
    probe(path, Access::ReadUnfinished)?;
    let file = files_to_read().open(path).context("open the archive", path)?;
    let names = file.attr_names().context("read the attributes", path)?;
    Ok(names.iter().any(|name| name == attribute::RAW))
}

/// Opens the archive of the taps, if `file` has only results, and checks that the taps have not changed since these were computed;
/// else `None`.
fn open_raw(file: &File, path: &Path, may_be_results: bool) -> Result<Option<Archive>> {
    if !file.attr_names().context("read the attributes", path)?.iter().any(|name| name == attribute::RAW) {
        return Ok(None);
    }
    // Before it is followed: a file that was renamed may name itself.
    if !may_be_results {
        return Err(Error::damaged(path, "it has only results, and is named as the archive of their taps"));
    }
    let name = read_text(file, attribute::RAW).context("read the name of the taps' archive", path)?;
    if !is_near(&name) {
        let what = format!(
            "it names {name:?} as the archive of its taps, which is neither in its folder nor in the one above"
        );
        return Err(Error::damaged(path, what));
    }
    let raw = Archive::open_if(&path.with_file_name(&name), Access::Read, false)?;
    let made_of = read_text(file, attribute::RAW_DIGEST).context("read the digest of the taps", path)?;
    let there = hex_of(&raw.raw_digest()?);
    match made_of == there {
        true => Ok(Some(raw)),
        false => Err(Error::OtherTaps { path: path.to_owned(), raw: raw.path, made_of, there }),
    }
}

/// Whether `name` is that of a file in the same folder, or in the one above: results may come from a stranger, and are to name no
/// other.
fn is_near(name: &str) -> bool {
    let name = name.strip_prefix("../").unwrap_or(name);
    Path::new(name).file_name() == Some(OsStr::new(name))
}

/// Checks with plain reads whether the file can be opened, for clear error messages; returns whether it is finished.
///
/// The lock is tried with a separate descriptor: within a process the library opens a file once and shares it, so it would let
/// a second writer in.
fn probe(path: &Path, access: Access) -> Result<bool> {
    let mut file = std::fs::OpenOptions::new()
        .read(true)
        .write(access == Access::Write)
        // A pipe would be waited for.
        .custom_flags(OFlags::NONBLOCK.bits().cast_signed())
        .open(path)
        .context("open the archive", path)?;
    if !file.metadata().context("open the archive", path)?.is_file() {
        return Err(Error::NotHdf5 { path: path.to_owned() });
    }
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
        // A child that another thread has just started would keep holding it, and the library would not get it.
        Ok(()) => file.unlock().context("unlock the archive", path)?,
        // Without locks in the file system, the library decides.
        Err(TryLockError::Error(_)) => {}
    }
    let mut signature = [0; 8];
    match file.read_exact(&mut signature) {
        Ok(()) if signature == *SIGNATURE => {}
        Err(error) if error.kind() != ErrorKind::UnexpectedEof => return Err(error).context("read the archive", path),
        _ => return Err(Error::NotHdf5 { path: path.to_owned() }),
    }
    let is_finished = is_sealed(&file, path)?;
    match access {
        // A file of another program, or a damaged one, gets an error of its own.
        Access::Read if !is_finished => {
            structure::check(&file, path).and(Err(Error::NotFinished { path: path.to_owned() }))
        }
        Access::Write if is_finished => Err(Error::Finished { path: path.to_owned() }),
        _ if is_finished => Ok(true),
        _ => structure::check(&file, path).map(|()| false),
    }
}

/// Checks that `file` is an archive of the known layout.
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

/// The metadata, if its digest is valid.
fn read_metadata(file: &File, path: &Path) -> Result<Metadata> {
    let digest = read_text(file, attribute::DIGEST).context("read the digest", path)?;
    let metadata = Metadata::read(file).context("read the metadata", path)?;
    metadata.filter(|metadata| metadata.digest == digest).ok_or_else(|| {
        let what =
            "its plan, truth, configuration, reference or attributes are not what was written: their digest differs";
        Error::damaged(path, what)
    })
}

fn open_table<R: ChecksummedRow>(file: &File, path: &Path, row_count: usize, capacity: usize) -> Result<Table<R>> {
    Table::open(file, row_count, capacity)
        .context("find a table", path)?
        .ok_or_else(|| Error::damaged(path, format!("{} does not have {capacity} rows of this layout", R::TABLE)))
}

fn text_of(text: Vec<u8>, name: &str, path: &Path) -> Result<String> {
    let text = String::from_utf8(text).map_err(|_error| Error::damaged(path, format!("{name:?} is not UTF-8")))?;
    // A terminal would obey it; TOML and JSON have no others.
    match text.chars().find(|&c| c.is_ascii_control() && !['\n', '\r', '\t'].contains(&c)) {
        Some(c) => Err(Error::damaged(path, format!("{name:?} holds the control character {c:?}"))),
        None => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches results that have any file of the machine read as the archive of their taps.
    #[test]
    fn results_name_an_archive_nearby() {
        for name in ["A-17.h5", "../A-17.h5", "..h5"] {
            assert!(is_near(name), "{name}");
        }
        for name in ["", "..", "../..", "../../A.h5", "a/A.h5", "/A.h5", "..//dev/ptmx", "./A.h5", "A.h5/"] {
            assert!(!is_near(name), "{name}");
        }
    }
}
