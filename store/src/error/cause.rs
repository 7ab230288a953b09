//! What kind of failure an error is, and what someone can do about it.

use std::io;
use std::path::Path;

use rustix::io::Errno;

use super::Error;

/// What to do with an archive of layout `got` where only `known` is read.
pub(super) fn way_out(got: u32, known: u32) -> &'static str {
    if got > known { "a newer tapline wrote it, and reads it" } else { "an older tapline wrote it, and reads it" }
}

impl Error {
    /// The archive at `path` is corrupt: `what` says how.
    pub(crate) fn damaged(path: &Path, what: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), what: what.into() }
    }

    /// Whether the writer can continue once the cause is gone, for example a full disk: see [`crate::Writer::recover`].
    pub fn is_recoverable(&self) -> bool {
        let is_io = matches!(self, Self::Io { .. } | Self::Hdf5 { .. } | Self::Abandoned { .. });
        let is_of_the_path = matches!(
            self,
            Self::Removed { .. } | Self::Moved { .. } | Self::Replaced { .. } | Self::Cut { .. } | Self::InUse { .. }
        );
        is_io || is_of_the_path
    }

    /// Whether the file system has failed or is read-only. It can be repaired only after every process has closed its files
    /// there.
    pub fn is_file_system_failure(&self) -> bool {
        self.has_errno(&[Errno::IO, Errno::ROFS, Errno::SHUTDOWN, Errno::UCLEAN, Errno::NODEV, Errno::NXIO])
    }

    /// Whether part of a file cannot be read, because of a bad sector or a wrong length, while others may be readable.
    pub fn is_unreadable_part(&self) -> bool {
        let is_short = |source: &io::Error| source.kind() == io::ErrorKind::UnexpectedEof;
        matches!(self, Self::Io { source, .. } if is_short(source)) || self.has_errno(&[Errno::IO])
    }

    fn has_errno(&self, numbers: &[Errno]) -> bool {
        match self {
            Self::Io { source, .. } => numbers.iter().any(|errno| source.raw_os_error() == Some(errno.raw_os_error())),
            // HDF5 has the number only in its message.
            Self::Hdf5 { source, .. } => {
                let text = source.to_string();
                numbers.iter().any(|errno| text.contains(&format!("errno = {},", errno.raw_os_error())))
            }
            _ => false,
        }
    }

    /// Whether the disk, or this user's quota on it, is full.
    pub fn is_disk_full(&self) -> bool {
        let Self::Io { source, .. } = self else { return false };
        matches!(source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
    }

    /// What someone can do about an error that [is recoverable](Self::is_recoverable).
    pub fn remedy(&self) -> &'static str {
        match self {
            _ if self.is_disk_full() => "make room on that disk",
            Self::Io { source, .. } => match source.kind() {
                io::ErrorKind::ReadOnlyFilesystem => "mount that disk as writable again",
                io::ErrorKind::NotFound => "restore that folder",
                io::ErrorKind::PermissionDenied => "give this user permission to write to it",
                _ => "check that disk",
            },
            Self::Removed { .. } => "restore its folder: the archive is then written there again",
            Self::Moved { .. } => "move it back",
            Self::Replaced { .. } => "move the other file away and this one back",
            Self::InUse { .. } => "stop what reads it",
            Self::Cut { .. } => "replace it with an intact copy",
            _ => "check that disk and file",
        }
    }
}
