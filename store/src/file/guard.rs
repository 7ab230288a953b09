//! Where an archive lies: whether the file that is being written is still there, and how it is put back when it is not.

use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::fs::statvfs;

use crate::error::{Context, Error, Result};
use crate::file::background_sync::{BackgroundSync, SyncErrors};
use crate::file::draft::{self, folder_of, remove_dead_drafts};

/// Bytes that are copied at a time when a file is put back: a block of most file systems, so that holes stay holes.
const BLOCK_BYTES: usize = 4096;

/// The place of an archive that is being written.
#[derive(Debug)]
pub(crate) struct FileGuard {
    path: PathBuf,
    /// To read only, and without a lock: it stands in nobody's way, and keeps a file that is removed from being lost.
    file: Arc<File>,
    /// Bytes that the file had when it was written last.
    least_bytes: u64,
    background: BackgroundSync,
}

impl FileGuard {
    /// The place of `file`, a handle to read with of what was opened at `path`.
    ///
    /// What failed behind the writer is told by `sync_errors`, whatever becomes of the file.
    pub(crate) fn new(file: File, path: &Path, sync_errors: &SyncErrors) -> Result<Self> {
        let file = Arc::new(file);
        let background = BackgroundSync::new(file.clone(), sync_errors);
        let mut guard = Self { path: path.to_owned(), file, least_bytes: 0, background };
        guard.least_bytes = guard.held()?.len();
        Ok(guard)
    }

    /// Notes that what the file holds now must not become less.
    pub(crate) fn note(&mut self) -> Result<()> {
        // The library itself makes the file shorter where the samples at its end give way to smaller ones.
        self.least_bytes = self.held()?.len();
        Ok(())
    }

    /// The open file once more.
    pub(crate) fn read_handle(&self) -> Result<File> {
        self.file.try_clone().context("open the archive", &self.path)
    }

    /// Checks that the file is still where it was opened, and as long.
    pub(crate) fn check(&self) -> Result<()> {
        let held = self.held()?;
        match fs::metadata(&self.path) {
            Ok(there) if is_same(&there, &held) => {}
            Ok(_) => return Err(Error::Replaced { path: self.path.clone(), now: self.now() }),
            Err(error) if error.kind() == ErrorKind::NotFound => return Err(self.gone(&held)),
            Err(error) => return Err(error).context("look for", &self.path),
        }
        self.check_whole(&held)
    }

    /// Checks that the file has what was in it.
    fn check_whole(&self, held: &Metadata) -> Result<()> {
        let (was, is) = (self.least_bytes, held.len());
        if is < was { Err(Error::Cut { path: self.path.clone(), was, is }) } else { Ok(()) }
    }

    /// Writes the file that was held to its path again, where it was removed and nothing else is there.
    pub(crate) fn put_back(&mut self) -> Result<()> {
        match self.check() {
            Err(Error::Removed { .. }) => {}
            checked => return checked,
        }
        remove_dead_drafts(&self.path);
        let draft = draft::begin(&self.path).context("write the archive again", &self.path)?;
        copy_sparse(&self.file, &draft).context("write the archive again", &self.path)?;
        match draft::publish(draft, &self.path) {
            // Whoever took the place meanwhile keeps it.
            Err(Error::Exists { .. }) => return self.check(),
            published => published?,
        }
        self.file = Arc::new(File::open(&self.path).context("open the archive", &self.path)?);
        Ok(())
    }

    /// Checks that the disk has room for `bytes` more, so that no attempt fills what little there is.
    pub(crate) fn check_room(&self, bytes: u64) -> Result<()> {
        let disk = statvfs(folder_of(&self.path)).map_err(io::Error::from).context("look for", &self.path)?;
        // A file system that does not count its blocks says that it has none.
        match disk.f_blocks > 0 && disk.f_bavail.saturating_mul(disk.f_frsize) < bytes {
            true => {
                Err(io::Error::from_raw_os_error(rustix::io::Errno::NOSPC.raw_os_error())).context("write", &self.path)
            }
            false => Ok(()),
        }
    }

    /// Has `bytes` that were handed to the system go to the disk meanwhile.
    pub(crate) fn note_written(&mut self, bytes: usize) {
        self.background.note(bytes);
    }

    /// Waits until all that was written is on the disk, where a power cut cannot take it back.
    pub(crate) fn sync(&self) -> Result<()> {
        self.file.sync_all().context("sync", &self.path)
    }

    fn held(&self) -> Result<Metadata> {
        self.file.metadata().context("look for", &self.path)
    }

    /// The error that nothing is at the path.
    fn gone(&self, held: &Metadata) -> Error {
        let path = self.path.clone();
        if held.nlink() == 0 { Error::Removed { path } } else { Error::Moved { path, now: self.now() } }
    }

    /// Where the file that was opened lies now, as the system says.
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
