//! The lock of an output folder: the file `.line`, which one line at a time holds. Its content says which line that is.

use std::fs::File;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use rustix::fs::{AtFlags, FileType, FlockOperation, Mode, OFlags};
use rustix::io::Errno;
use serde::{Deserialize, Serialize};

use crate::line::out_folder::process::ProcessName;

/// The lock of an output folder, and the address of the line that holds it.
pub(super) const LOCK: &str = ".line";

/// Most bytes of the lock that are read: it has a few short lines.
const LOCK_BYTES_MAX: u64 = 4096;

/// The content of the lock: the line that holds it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Entry {
    #[serde(flatten)]
    pub process: ProcessName,
    /// Folder that the line works in; absent while it has none.
    pub folder: Option<PathBuf>,
    /// Folder of an earlier line that was killed, until it is cleared: if this process is killed before that, the next
    /// one still knows of it.
    pub left: Option<PathBuf>,
}

/// Opens the lock, whatever kind of file it is, without following a link or waiting at a pipe.
pub(super) fn open_lock(folder: &OwnedFd, flags: OFlags) -> Result<File, Errno> {
    let flags = flags | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    rustix::fs::openat(folder, LOCK, flags, Mode::RUSR | Mode::WUSR).map(File::from)
}

/// Checks that the lock is a file of ours, with one name, that nobody else can read or write.
pub(super) fn check_lock(lock: &File, path: &Path) -> Result<()> {
    let name = path.join(LOCK);
    let stat = rustix::fs::fstat(lock).with_context(|| format!("cannot look at {}", name.display()))?;
    let is_file = FileType::from_raw_mode(stat.st_mode) == FileType::RegularFile;
    let is_ours = stat.st_uid == rustix::process::geteuid().as_raw();
    if is_file && !is_ours && stat.st_nlink <= 1 && stat.st_mode & 0o077 == 0 {
        bail!(
            "{} is from a line of another user (number {}): give this command as that user",
            name.display(),
            stat.st_uid
        );
    }
    ensure!(
        is_file && is_ours && stat.st_nlink <= 1 && stat.st_mode & 0o077 == 0,
        "{} was not made by a line of yours (user {}, mode {:03o}, links {}): check it, and remove it if no line runs there",
        name.display(),
        stat.st_uid,
        stat.st_mode & 0o777,
        stat.st_nlink
    );
    Ok(())
}

pub(super) fn lock_refused(path: &Path, error: Errno) -> String {
    let name = path.join(LOCK);
    match error {
        Errno::LOOP => format!("{} is a link; no line makes links: remove it", name.display()),
        Errno::ACCESS if name.exists() => format!("{} is from a line of another user", name.display()),
        Errno::ACCESS => format!("cannot write into {}: permission denied", path.display()),
        Errno::NXIO => format!("{} is not a regular file: remove it", name.display()),
        error => format!("cannot open {}: {error}", name.display()),
    }
}

/// Makes the lock if it does not exist, and takes it. It is open only for reading, so that the disk can still be
/// remounted read-only.
pub(super) fn take_lock(folder: &OwnedFd, path: &Path) -> Result<File> {
    loop {
        let lock = match open_lock(folder, OFlags::CREATE | OFlags::RDONLY) {
            Ok(lock) => lock,
            Err(error) => bail!(lock_refused(path, error)),
        };
        check_lock(&lock, path)?;
        let lock = match rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => lock,
            Err(Errno::WOULDBLOCK) => {
                let who = read_entry(&lock).map_or(String::new(), |entry| format!(" (process {})", entry.process.pid));
                bail!("another line{who} is writing to {}", path.display());
            }
            // A network file system locks only files that are open for writing.
            Err(Errno::BADF) => {
                let lock = open_lock(folder, OFlags::RDWR).map_err(|e| anyhow::anyhow!(lock_refused(path, e)))?;
                if rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
                    bail!("another line is writing to {}", path.display());
                }
                lock
            }
            Err(error) => return Err(error).with_context(|| format!("cannot lock {}", path.join(LOCK).display())),
        };
        // Whoever held it may have removed it since it was opened.
        let (held, named) = (rustix::fs::fstat(&lock), rustix::fs::statat(folder, LOCK, AtFlags::SYMLINK_NOFOLLOW));
        let is_same = matches!((held, named), (Ok(held), Ok(named)) if (held.st_dev, held.st_ino) == (named.st_dev, named.st_ino));
        if !is_same {
            continue;
        }
        // A line that released it while its disk is repaired still owns the folder.
        if let Some(entry) = read_entry(&lock).filter(|entry| entry.process.is_alive())
            && entry.process.pid != std::process::id()
        {
            bail!("another line (process {}) is writing to {}", entry.process.pid, path.display());
        }
        return Ok(lock);
    }
}

/// The content of the lock, if it can be read.
pub(super) fn read_entry(lock: &File) -> Option<Entry> {
    use std::os::unix::fs::FileExt as _;
    let mut text = vec![0; usize::try_from(LOCK_BYTES_MAX).ok()?];
    let count = lock.read_at(&mut text, 0).ok()?;
    toml::from_str(std::str::from_utf8(text.get(..count)?).ok()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a folder without permission that is reported as another user's.
    #[test]
    fn a_folder_without_permission_is_not_called_another_users() {
        let folder = tempfile::tempdir().unwrap();
        assert!(lock_refused(folder.path(), Errno::ACCESS).starts_with("cannot write into "));
        std::fs::write(folder.path().join(LOCK), "").unwrap();
        assert!(lock_refused(folder.path(), Errno::ACCESS).ends_with(".line is from a line of another user"));
    }
}
