//! What can go wrong with an archive.
//!
//! - here: every error and its message
//! - `cause`: what kind of failure an error is, and what someone can do about it
//! - `context`: errors of the system and of HDF5, with the file and the action that failed

mod cause;
mod context;

use std::io;
use std::path::PathBuf;

use tapline_codec::Codec;
use tapline_wire::TapId;

pub(crate) use self::context::Context;

/// What a fallible call of this crate returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why an archive cannot be made, opened, written or read.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io { action: &'static str, path: PathBuf, source: io::Error },
    /// The HDF5 library refused.
    #[error("cannot {action} in {}: {source}", path.display())]
    Hdf5 { action: &'static str, path: PathBuf, source: hdf5::Error },
    /// A new archive would overwrite a file.
    #[error("{} already exists; an archive is never overwritten", path.display())]
    Exists { path: PathBuf },
    /// Another process has the archive open: a writer, or a reader of what is to be written.
    #[error("{} is in use: one writer or several readers may have an archive open, not both", path.display())]
    InUse { path: PathBuf },
    /// The file that was being written was removed.
    #[error("{} was removed while it was being written", path.display())]
    Removed { path: PathBuf },
    /// The file that was being written, or its folder, was renamed.
    #[error("{} was moved while it was being written; it is now {now}", path.display())]
    Moved { path: PathBuf, now: String },
    /// Another file lies where the file that was being written was.
    #[error("{} is another file, not the one that was being written, which is now {now}", path.display())]
    Replaced { path: PathBuf, now: String },
    /// The file that was being written became shorter.
    #[error("{} was cut from {was} bytes to {is} while it was being written", path.display())]
    Cut { path: PathBuf, was: u64, is: u64 },
    /// The archive was closed unwritten after a write had failed.
    #[error("{} was abandoned after a write to it failed", path.display())]
    Abandoned { path: PathBuf },
    /// The file does not begin as an HDF5 file does.
    #[error("{} is not an HDF5 file", path.display())]
    NotHdf5 { path: PathBuf },
    /// The file is HDF5, but not an archive of this program.
    #[error("{} is not a tapline archive: {what}", path.display())]
    NotAnArchive { path: PathBuf, what: String },
    /// The archive has a layout this program does not know.
    #[error("{} has archive layout {got}; this program reads layout {known}: {}", path.display(), cause::way_out(*got, *known))]
    FormatVersion { path: PathBuf, got: u32, known: u32 },
    /// A table's numbers are in other units than this program's, or its units are not given.
    #[error("{} has {table} in the units {archived:?}; this program expects {known:?}", path.display())]
    OtherUnits {
        path: PathBuf,
        table: &'static str,
        /// Units in the file; empty if it gives none.
        archived: String,
        known: String,
    },
    /// The archive belongs to another scan plan.
    #[error("{} holds scan plan {archived:016x}; this run has scan plan {given:016x}", path.display())]
    OtherPlan { path: PathBuf, archived: u64, given: u64 },
    /// The archive was begun with another reference file.
    #[error("{} was begun with another reference file, or without one", path.display())]
    OtherReference { path: PathBuf },
    /// The archive was begun by another version of the program or with other options.
    #[error("{} has results made with {archived:?}; this program would make them with {given:?}: results of different lineage are never mixed in one archive (tapline reprocess makes new ones beside it)", path.display())]
    OtherLineage {
        path: PathBuf,
        /// First line that differs, as stored in the archive.
        archived: String,
        given: String,
    },
    /// The taps have changed since the results were computed from them.
    #[error("{} has results of the taps {made_of:.16}..., but {} now has the taps {there:.16}...: judge those again (tapline reprocess)", path.display(), raw.display())]
    OtherTaps { path: PathBuf, raw: PathBuf, made_of: String, there: String },
    /// A tap was put into an archive of only results.
    #[error("{} has only results, of the taps of another archive: no tap can be put into it", path.display())]
    ResultsAlone { path: PathBuf },
    /// The archive to be resumed is packed with a codec that is too slow for a line.
    #[error("{} is packed with {codec}, only for finished archives: repack it with lz4, zstd or none", path.display())]
    OfflineCodec { path: PathBuf, codec: Codec },
    /// The configuration names a codec that is too slow for a line.
    #[error("[store] codec is {codec}, which is too slow for a line; it must be lz4, zstd or none")]
    SlowCodec { codec: Codec },
    /// The archive is not finished: only its writer may use it.
    #[error("{} is not finished, or its end was changed: its line or the same command, run again, finishes it; a \
         finished file whose end was changed must be moved away first", path.display())]
    NotFinished { path: PathBuf },
    /// The archive is finished, and is never written again.
    #[error("{} is finished: it is never written again", path.display())]
    Finished { path: PathBuf },
    /// Taps cannot be added to the plan of an open archive.
    #[error("the plan of {} cannot grow: {what}", path.display())]
    CannotGrow { path: PathBuf, what: String },
    /// The archive is corrupt.
    #[error("{} is damaged: {what}", path.display())]
    Damaged { path: PathBuf, what: String },
    /// The records of the plan would hold no samples.
    #[error("a record of {channel_count} channels of {sample_count_max} samples is empty")]
    EmptyRecording { channel_count: usize, sample_count_max: u32 },
    /// The records of the plan would be longer than a chunk can be.
    #[error("a record of {bytes} bytes cannot be packed: the limit is {most}")]
    LongRecording { bytes: usize, most: usize },
    /// A record names a plan row that does not exist.
    #[error("plan row {plan_index} does not exist: the plan has {tap_count} taps")]
    NoSuchRow { plan_index: u32, tap_count: usize },
    /// A record names another tap than its plan row.
    #[error("plan row {plan_index} is {planned}, not {got}")]
    OtherTap { plan_index: u32, planned: Box<TapId>, got: Box<TapId> },
    /// A record has another shape than the plan prescribes.
    #[error("the record of plan row {plan_index} has {what} {got}; the plan allows {planned}")]
    RecordShape { plan_index: u32, what: &'static str, got: String, planned: String },
    /// A scan number that does not exist.
    #[error("scan {scan} does not exist: the plan has {scan_count} scans")]
    NoSuchScan { scan: u32, scan_count: usize },
    /// A damage map does not cover the locations of its scan.
    #[error("the damage map of scan {scan} has {got} where the plan has {planned}")]
    OtherCells { scan: u32, got: String, planned: String },
}
