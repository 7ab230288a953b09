//! What can go wrong with an archive.

use std::io;
use std::path::{Path, PathBuf};

use rustix::io::Errno;
use tapline_codec::Codec;
use tapline_wire::TapId;

/// What a fallible call of this crate returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why an archive cannot be made, opened, written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The HDF5 library refused.
    #[error("cannot {action} in {}: {source}", path.display())]
    Hdf5 {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why not.
        source: hdf5::Error,
    },
    /// A new archive would overwrite a file.
    #[error("{} exists already; an archive is never overwritten", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Another writer has the archive, or a reader has what is to be written.
    #[error("{} is in use: one writer or several readers may have an archive, not both", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// The file that was being written was removed.
    #[error("{} was removed while it was being written", path.display())]
    Removed {
        /// The file.
        path: PathBuf,
    },
    /// The file that was being written, or its folder, has another name now.
    #[error("{} was moved while it was being written; it is now {now}", path.display())]
    Moved {
        /// Where it was.
        path: PathBuf,
        /// Where it is.
        now: String,
    },
    /// Another file has taken the place of the one that was being written.
    #[error("{} is another file than the one that was being written, which is now {now}", path.display())]
    Replaced {
        /// The place.
        path: PathBuf,
        /// Where the archive is.
        now: String,
    },
    /// The file that was being written became shorter.
    #[error("{} was cut from {was} bytes to {is} while it was being written", path.display())]
    Cut {
        /// The file.
        path: PathBuf,
        /// Bytes it had.
        was: u64,
        /// Bytes it has.
        is: u64,
    },
    /// An archive that could not be written was let go of.
    #[error("{} was let go of after it could not be written", path.display())]
    LetGo {
        /// The file.
        path: PathBuf,
    },
    /// The file does not begin as an HDF5 file does.
    #[error("{} is not an HDF5 file", path.display())]
    NotHdf5 {
        /// The file.
        path: PathBuf,
    },
    /// The file is HDF5, but no archive of this program.
    #[error("{} is not a tapline archive: {what}", path.display())]
    NotAnArchive {
        /// The file.
        path: PathBuf,
        /// What is amiss.
        what: String,
    },
    /// The archive has a layout this program does not know.
    #[error("{} has archive layout {got}; this program reads layout {known}: {}", path.display(), way_out(*got, *known))]
    FormatVersion {
        /// The file.
        path: PathBuf,
        /// Format of the file.
        got: u32,
        /// Format that this program writes.
        known: u32,
    },
    /// A table's numbers are in other units than this program's, or do not say in which.
    #[error("{} has {table} in the units {archived:?}; this program knows {known:?}", path.display())]
    OtherUnits {
        /// The file.
        path: PathBuf,
        /// The table.
        table: &'static str,
        /// Units of the file; empty when it does not say.
        archived: String,
        /// Units of this program.
        known: String,
    },
    /// The archive belongs to another scan plan.
    #[error("{} holds scan plan {archived:016x}; this run has scan plan {given:016x}", path.display())]
    OtherPlan {
        /// The file.
        path: PathBuf,
        /// Digest of the plan in the archive.
        archived: u64,
        /// Digest of the plan at hand.
        given: u64,
    },
    /// The archive was begun with another reference file.
    #[error("{} was begun with another reference file, or without one", path.display())]
    OtherReference {
        /// The archive.
        path: PathBuf,
    },
    /// The archive was begun by another program or with other options.
    #[error("{} has results made by {archived:?}; this program would make them by {given:?}: results of different lineage are never mixed in one archive (tapline reprocess makes new ones beside it)", path.display())]
    OtherLineage {
        /// The archive.
        path: PathBuf,
        /// First line that differs, in the archive.
        archived: String,
        /// That line now.
        given: String,
    },
    /// Results lie beside other taps than those they were made of.
    #[error("{} has results of the taps {made_of:.16}..., but {} has the taps {there:.16}... now: judge those again (tapline reprocess)", path.display(), raw.display())]
    OtherTaps {
        /// The results.
        path: PathBuf,
        /// The archive of the taps.
        raw: PathBuf,
        /// Digest of the taps that the results were made of.
        made_of: String,
        /// Digest of those that are there.
        there: String,
    },
    /// Taps are to be put into an archive that has results alone.
    #[error("{} has results alone, of the taps of another archive: no tap can be put into it", path.display())]
    ResultsAlone {
        /// The archive.
        path: PathBuf,
    },
    /// The archive was begun under another configuration.
    #[error("{} was begun with another configuration: line {line} was {archived:?}, now {given:?}", path.display())]
    OtherConfiguration {
        /// The file.
        path: PathBuf,
        /// First line that differs, from 1.
        line: usize,
        /// That line in the archive.
        archived: String,
        /// That line now.
        given: String,
    },
    /// An archive packed by what is too slow for a line is to be gone on with.
    #[error("{} is packed by {codec}, which is for archives that are done: pack it again by lz4, zstd or none", path.display())]
    OfflineCodec {
        /// The archive.
        path: PathBuf,
        /// What packs it.
        codec: Codec,
    },
    /// A line is to pack by what is too slow for it.
    #[error("[store] codec is {codec}, which is too slow for a line; it must be lz4, zstd or none")]
    SlowCodec {
        /// What was asked for.
        codec: Codec,
    },
    /// The archive is not finished, so that nothing but its writer may use it.
    #[error("{} is not finished, or its end was cut off: the line that writes it finishes it, or the same command again", path.display())]
    NotFinished {
        /// The archive.
        path: PathBuf,
    },
    /// The archive is finished, and is never written again.
    #[error("{} is finished: it is never written again", path.display())]
    Finished {
        /// The archive.
        path: PathBuf,
    },
    /// Taps cannot be added to the plan of an open archive.
    #[error("the plan of {} cannot grow: {what}", path.display())]
    CannotGrow {
        /// The archive.
        path: PathBuf,
        /// Why not.
        what: String,
    },
    /// The archive contradicts itself.
    #[error("{} is damaged: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is amiss.
        what: String,
    },
    /// A plan whose records would hold no samples.
    #[error("a record of {channel_count} channels of {sample_count_max} samples is empty")]
    EmptyRecording {
        /// Channels planned.
        channel_count: usize,
        /// Most samples planned.
        sample_count_max: u32,
    },
    /// A plan whose records would be longer than a codec can count.
    #[error("a record of {bytes} bytes cannot be packed: at most {most} can")]
    LongRecording {
        /// Bytes of the longest record planned.
        bytes: usize,
        /// Most bytes that there may be.
        most: usize,
    },
    /// A record names a plan row that does not exist.
    #[error("plan row {plan_index} does not exist: the plan has {tap_count} taps")]
    NoSuchRow {
        /// Row named.
        plan_index: u32,
        /// Rows there are.
        tap_count: usize,
    },
    /// A record carries another name than its plan row.
    #[error("plan row {plan_index} is {planned}, not {got}")]
    OtherTap {
        /// Row named.
        plan_index: u32,
        /// Tap planned in that row.
        planned: Box<TapId>,
        /// Tap of the record.
        got: Box<TapId>,
    },
    /// A record does not have the shape that the plan gives all records.
    #[error("the record of plan row {plan_index} has {what} {got}; the plan allows {planned}")]
    RecordShape {
        /// Row named.
        plan_index: u32,
        /// Which property.
        what: &'static str,
        /// Its value.
        got: String,
        /// What was planned.
        planned: String,
    },
    /// A scan number that does not exist.
    #[error("scan {scan} does not exist: the plan has {scan_count} scans")]
    NoSuchScan {
        /// Number named.
        scan: u32,
        /// Scans there are.
        scan_count: usize,
    },
    /// A damage map that does not cover its scan's locations.
    #[error("the damage map of scan {scan} has {got} where the plan has {planned}")]
    OtherCells {
        /// Number of the scan.
        scan: u32,
        /// What the map has.
        got: String,
        /// What it must have.
        planned: String,
    },
}

/// What to do with an archive of layout `got` where `known` is read.
fn way_out(got: u32, known: u32) -> &'static str {
    if got > known { "a newer tapline wrote it, and reads it" } else { "no released tapline wrote it" }
}

impl Error {
    /// The archive at `path` contradicts itself in `what`.
    pub(crate) fn damaged(path: &Path, what: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), what: what.into() }
    }

    /// The error that names the first line in which two configurations differ.
    pub(crate) fn other_configuration(path: &Path, archived: &str, given: &str) -> Self {
        let (line, archived, given) = first_difference(archived, given);
        Self::OtherConfiguration { path: path.to_owned(), line, archived, given }
    }

    /// The error that names the first line in which two lineages differ.
    pub(crate) fn other_lineage(path: &Path, archived: &str, given: &str) -> Self {
        let (_, archived, given) = first_difference(archived, given);
        Self::OtherLineage { path: path.to_owned(), archived, given }
    }

    /// Whether a writer that met this may go on when its cause is gone, as a full disk: see [`crate::Writer::recover`].
    pub fn is_of_the_disk(&self) -> bool {
        let is_io = matches!(self, Self::Io { .. } | Self::Hdf5 { .. } | Self::LetGo { .. });
        let is_of_the_place = matches!(
            self,
            Self::Removed { .. } | Self::Moved { .. } | Self::Replaced { .. } | Self::Cut { .. } | Self::InUse { .. }
        );
        is_io || is_of_the_place
    }

    /// Whether the file system has failed, or may not be written: whoever holds a file in it keeps it from being mended.
    pub fn is_of_the_file_system(&self) -> bool {
        const FAILED: [Errno; 6] = [Errno::IO, Errno::ROFS, Errno::SHUTDOWN, Errno::UCLEAN, Errno::NODEV, Errno::NXIO];
        match self {
            Self::Io { source, .. } => FAILED.iter().any(|errno| source.raw_os_error() == Some(errno.raw_os_error())),
            // The library says it in words.
            Self::Hdf5 { source, .. } => {
                let text = source.to_string();
                FAILED.iter().any(|errno| text.contains(&format!("errno = {},", errno.raw_os_error())))
            }
            _ => false,
        }
    }

    /// Whether one place of a file cannot be read, as where a sector is bad or a length is, and not the disk.
    pub fn is_of_one_place(&self) -> bool {
        let Self::Io { source, .. } = self else { return false };
        source.kind() == io::ErrorKind::UnexpectedEof || source.raw_os_error() == Some(Errno::IO.raw_os_error())
    }

    /// Whether the disk, or what of it this user may have, is full.
    pub fn is_no_room(&self) -> bool {
        let Self::Io { source, .. } = self else { return false };
        matches!(source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
    }

    /// What someone can do about it, where this is of the disk.
    pub fn remedy(&self) -> &'static str {
        match self {
            _ if self.is_no_room() => "make room on that disk",
            Self::Io { source, .. } => match source.kind() {
                io::ErrorKind::ReadOnlyFilesystem => "mount that disk to be written again",
                io::ErrorKind::NotFound => "bring that folder back",
                io::ErrorKind::PermissionDenied => "give this user the right to write it",
                _ => "see to that disk",
            },
            Self::Removed { .. } => "bring its folder back: the archive is then written there again",
            Self::Moved { .. } => "move it back",
            Self::Replaced { .. } => "move the other file away and this one back",
            Self::InUse { .. } => "end what reads it",
            Self::Cut { .. } => "put a whole copy in its place",
            _ => "see to that disk and file",
        }
    }
}

/// Number, from 1, and wording of the first line in which two texts differ; a line that is not there is empty.
fn first_difference(archived: &str, given: &str) -> (usize, String, String) {
    let line_count = archived.lines().count().max(given.lines().count());
    let pair = |k: usize| (archived.lines().nth(k).unwrap_or(""), given.lines().nth(k).unwrap_or(""));
    // Texts that differ only in their line ends differ in no line: the last is then named.
    let k = (0..line_count).find(|&k| pair(k).0 != pair(k).1).unwrap_or(line_count.saturating_sub(1));
    let (archived, given) = pair(k);
    (k + 1, archived.to_owned(), given.to_owned())
}

/// Adds to an HDF5 error what was tried and on which file.
pub(crate) trait Context<T> {
    /// The result, its error naming `action` and `path`.
    fn context(self, action: &'static str, path: &Path) -> Result<T>;
}

impl<T> Context<T> for hdf5::Result<T> {
    fn context(self, action: &'static str, path: &Path) -> Result<T> {
        self.map_err(|source| match system_error(&source) {
            Some(source) => Error::Io { action, path: path.to_owned(), source },
            None => Error::Hdf5 { action, path: path.to_owned(), source },
        })
    }
}

impl<T> Context<T> for io::Result<T> {
    fn context(self, action: &'static str, path: &Path) -> Result<T> {
        self.map_err(|source| Error::Io { action, path: path.to_owned(), source })
    }
}

/// What the system said to the library, which says it on within a page of its own.
fn system_error(error: &hdf5::Error) -> Option<io::Error> {
    let stack = error.stack()?;
    let number = |text: &str| text.split_once("errno = ")?.1.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok();
    stack.iter().find_map(|frame| number(frame.desc())).filter(|&errno| errno != 0).map(io::Error::from_raw_os_error)
}
