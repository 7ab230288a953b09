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
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// The action that failed.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// The HDF5 library refused.
    #[error("cannot {action} in {}: {source}", path.display())]
    Hdf5 {
        /// The action that failed.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The reason.
        source: hdf5::Error,
    },
    /// A new archive would overwrite a file.
    #[error("{} already exists; an archive is never overwritten", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Another process has the archive open: a writer, or a reader of what is to be written.
    #[error("{} is in use: one writer or several readers may have an archive open, not both", path.display())]
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
    /// The file that was being written, or its folder, was renamed.
    #[error("{} was moved while it was being written; it is now {now}", path.display())]
    Moved {
        /// Its path before.
        path: PathBuf,
        /// Its path now.
        now: String,
    },
    /// Another file lies where the file that was being written was.
    #[error("{} is another file, not the one that was being written, which is now {now}", path.display())]
    Replaced {
        /// The path.
        path: PathBuf,
        /// Path of the archive now.
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
    /// The archive was closed unwritten after a write had failed.
    #[error("{} was abandoned after a write to it failed", path.display())]
    Abandoned {
        /// The file.
        path: PathBuf,
    },
    /// The file does not begin as an HDF5 file does.
    #[error("{} is not an HDF5 file", path.display())]
    NotHdf5 {
        /// The file.
        path: PathBuf,
    },
    /// The file is HDF5, but not an archive of this program.
    #[error("{} is not a tapline archive: {what}", path.display())]
    NotAnArchive {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The archive has a layout this program does not know.
    #[error("{} has archive layout {got}; this program reads layout {known}: {}", path.display(), cause::way_out(*got, *known))]
    FormatVersion {
        /// The file.
        path: PathBuf,
        /// Format of the file.
        got: u32,
        /// Format that this program writes.
        known: u32,
    },
    /// A table's numbers are in other units than this program's, or its units are not given.
    #[error("{} has {table} in the units {archived:?}; this program expects {known:?}", path.display())]
    OtherUnits {
        /// The file.
        path: PathBuf,
        /// The table.
        table: &'static str,
        /// Units in the file; empty if it gives none.
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
        /// Digest of the plan of this run.
        given: u64,
    },
    /// The archive was begun with another reference file.
    #[error("{} was begun with another reference file, or without one", path.display())]
    OtherReference {
        /// The archive.
        path: PathBuf,
    },
    /// The archive was begun by another version of the program or with other options.
    #[error("{} has results made with {archived:?}; this program would make them with {given:?}: results of different lineage are never mixed in one archive (tapline reprocess makes new ones beside it)", path.display())]
    OtherLineage {
        /// The archive.
        path: PathBuf,
        /// First line that differs, as stored in the archive.
        archived: String,
        /// That line in this run.
        given: String,
    },
    /// The taps have changed since the results were computed from them.
    #[error("{} has results of the taps {made_of:.16}..., but {} now has the taps {there:.16}...: judge those again (tapline reprocess)", path.display(), raw.display())]
    OtherTaps {
        /// The results.
        path: PathBuf,
        /// The archive of the taps.
        raw: PathBuf,
        /// Digest of the taps that the results were computed from.
        made_of: String,
        /// Digest of the taps that the archive has now.
        there: String,
    },
    /// A tap was put into an archive of only results.
    #[error("{} has only results, of the taps of another archive: no tap can be put into it", path.display())]
    ResultsAlone {
        /// The archive.
        path: PathBuf,
    },
    /// The archive to be resumed is packed with a codec that is too slow for a line.
    #[error("{} is packed with {codec}, only for finished archives: repack it with lz4, zstd or none", path.display())]
    OfflineCodec {
        /// The archive.
        path: PathBuf,
        /// Its codec.
        codec: Codec,
    },
    /// The configuration names a codec that is too slow for a line.
    #[error("[store] codec is {codec}, which is too slow for a line; it must be lz4, zstd or none")]
    SlowCodec {
        /// The codec.
        codec: Codec,
    },
    /// The archive is not finished: only its writer may use it.
    #[error("{} is not finished, or its end was changed: its line or the same command, run again, finishes it; a \
         finished file whose end was changed must be moved away first", path.display())]
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
    /// The archive is corrupt.
    #[error("{} is damaged: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The records of the plan would hold no samples.
    #[error("a record of {channel_count} channels of {sample_count_max} samples is empty")]
    EmptyRecording {
        /// Channels planned.
        channel_count: usize,
        /// Most samples planned.
        sample_count_max: u32,
    },
    /// The records of the plan would be longer than a chunk can be.
    #[error("a record of {bytes} bytes cannot be packed: the limit is {most}")]
    LongRecording {
        /// Bytes of the longest record planned.
        bytes: usize,
        /// Most bytes that a record may have.
        most: usize,
    },
    /// A record names a plan row that does not exist.
    #[error("plan row {plan_index} does not exist: the plan has {tap_count} taps")]
    NoSuchRow {
        /// The row it names.
        plan_index: u32,
        /// Rows of the plan.
        tap_count: usize,
    },
    /// A record names another tap than its plan row.
    #[error("plan row {plan_index} is {planned}, not {got}")]
    OtherTap {
        /// The row it names.
        plan_index: u32,
        /// Tap planned in that row.
        planned: Box<TapId>,
        /// Tap of the record.
        got: Box<TapId>,
    },
    /// A record has another shape than the plan prescribes.
    #[error("the record of plan row {plan_index} has {what} {got}; the plan allows {planned}")]
    RecordShape {
        /// The row it names.
        plan_index: u32,
        /// Which property.
        what: &'static str,
        /// Its value in the record.
        got: String,
        /// The value planned.
        planned: String,
    },
    /// A scan number that does not exist.
    #[error("scan {scan} does not exist: the plan has {scan_count} scans")]
    NoSuchScan {
        /// The number.
        scan: u32,
        /// Scans of the plan.
        scan_count: usize,
    },
    /// A damage map does not cover the locations of its scan.
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
