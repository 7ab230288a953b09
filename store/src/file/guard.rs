//! Watches the file that is being written: checks that it is still at its path, and restores it if it was removed.

use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::fs::statvfs;

use crate::error::{Context, Error, Result};
use crate::file::background_sync::{BackgroundSync, SyncErrors};
use crate::file::draft::{self, folder_of, remove_dead_drafts};

/// Bytes copied at a time when a file is restored: a block of most file systems, so that holes stay holes.
const BLOCK_BYTES: usize = 4096;

/// The file of an archive that is being written.
#[derive(Debug)]
pub(crate) struct FileGuard {
    path: PathBuf,
    /// Open for reading, without a lock; a file that is removed stays readable through it.
    file: Arc<File>,
    /// Bytes that the file had after the last write.
    least_bytes: u64,
    background: BackgroundSync,
}

impl FileGuard {
    /// Guards the file at `path`, open for reading as `file`; errors of background syncs go to `sync_errors`.
    pub(crate) fn new(file: File, path: &Path, sync_errors: &SyncErrors) -> Result<Self> {
        let file = Arc::new(file);
        let background = BackgroundSync::new(file.clone(), sync_errors);
        let mut guard = Self { path: path.to_owned(), file, least_bytes: 0, background };
        guard.least_bytes = guard.held()?.len();
        Ok(guard)
    }

    /// Notes the length of the file, which must not become less.
    pub(crate) fn note(&mut self) -> Result<()> {
        // HDF5 itself shortens the file when smaller samples replace those at its end.
        self.least_bytes = self.held()?.len();
        Ok(())
    }

    /// Another handle of the open file.
    pub(crate) fn read_handle(&self) -> Result<File> {
        self.file.try_clone().context("open the archive", &self.path)
    }

    /// Checks that the file is still at its path and has not become shorter.
    pub(crate) fn check(&self) -> Result<()> {
        let held = self.held()?;
        match fs::metadata(&self.path) {
            Ok(there) if is_same(&there, &held) => {}
            Ok(_) => return Err(Error::Replaced { path: self.path.clone(), now: self.now() }),
            Err(error) if error.kind() == ErrorKind::NotFound => return Err(self.gone(&held)),
            Err(error) => return Err(error).context("look for", &self.path),
        }
        self.check_length(&held)
    }

    /// Checks that the file has not become shorter.
    fn check_length(&self, held: &Metadata) -> Result<()> {
        let (was, is) = (self.least_bytes, held.len());
        if is < was { Err(Error::Cut { path: self.path.clone(), was, is }) } else { Ok(()) }
    }

    /// Writes the file to its path again, if it was removed and nothing else has taken its path.
    pub(crate) fn put_back(&mut self) -> Result<()> {
        match self.check() {
            Err(Error::Removed { .. }) => {}
            checked => return checked,
        }
        remove_dead_drafts(&self.path);
        let draft = draft::begin(&self.path).context("write the archive again", &self.path)?;
        copy_sparse(&self.file, &draft).context("write the archive again", &self.path)?;
        match draft::publish(draft, &self.path) {
            // Another file was created at the path meanwhile: it stays.
            Err(Error::Exists { .. }) => return self.check(),
            published => published?,
        }
        self.file = Arc::new(File::open(&self.path).context("open the archive", &self.path)?);
        Ok(())
    }

    /// Checks that the disk has room for `bytes` more: an attempt would otherwise fill what is left of it.
    pub(crate) fn check_room(&self, bytes: u64) -> Result<()> {
        let disk = statvfs(folder_of(&self.path)).map_err(io::Error::from).context("look for", &self.path)?;
        // A file system that does not count its blocks reports none.
        match disk.f_blocks > 0 && disk.f_bavail.saturating_mul(disk.f_frsize) < bytes {
            true => {
                Err(io::Error::from_raw_os_error(rustix::io::Errno::NOSPC.raw_os_error())).context("write", &self.path)
            }
            false => Ok(()),
        }
    }

    /// Counts `bytes` that were written, for background syncs.
    pub(crate) fn note_written(&mut self, bytes: usize) {
        self.background.note(bytes);
    }

    /// Waits until all that was written is on the disk and survives a power cut.
    pub(crate) fn sync(&self) -> Result<()> {
        self.file.sync_all().context("sync", &self.path)
    }

    fn held(&self) -> Result<Metadata> {
        self.file.metadata().context("look for", &self.path)
    }

    /// The error for a path without a file: it was removed or renamed.
    fn gone(&self, held: &Metadata) -> Error {
        let path = self.path.clone();
        if held.nlink() == 0 { Error::Removed { path } } else { Error::Moved { path, now: self.now() } }
    }

    /// The present path of the open file, as the system reports it.
    fn now(&self) -> String {
        use std::os::fd::AsRawFd as _;
        let link = format!("/proc/self/fd/{}", self.file.as_raw_fd());
        fs::read_link(link).map_or_else(|_| "an unknown place".to_owned(), |path| path.display().to_string())
    }
}

fn is_same(a: &Metadata, b: &Metadata) -> bool {
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

/// Copies `from` to the file at `to`, leaving out blocks of zeros.
fn copy_sparse(from: &File, to: &Path) -> io::Result<()> {
    let to = File::options().write(true).open(to)?;
    let bytes = from.metadata()?.len();
    to.set_len(bytes)?;
    let mut block = [0; BLOCK_BYTES];
    let mut at = 0;
    while at < bytes {
        let count = from.read_at(&mut block, at)?;
        if count == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        if block[..count].iter().any(|&byte| byte != 0) {
            to.write_all_at(&block[..count], at)?;
        }
        at += count as u64;
    }
    to.sync_all()
}
