//! The folder that a line writes to. One line at a time holds it, and is found through it.
//!
//! Besides the results it has the folder `open`, for results under way, the folder `unreported`, for verdicts that are
//! still to be reported, and, while a line runs, the file `.line`. This lock says where the line is, so that the next
//! line can clear what a killed one left, and `tapline status` finds the running one. Only its owner may use the
//! folder, who could replace any result; it must not be writable for everyone, unless it is sticky. Only the line's
//! user can open `.line`; for results and `open` the user's umask applies.

mod access;
mod lock;
mod process;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use rustix::fs::{FlockOperation, OFlags};
use rustix::io::Errno;
use tapline_host::messages::print_line;
use tapline_store::{OPEN_FOLDER, UNREPORTED_FOLDER};
use tapline_wire::LineAddress;

use crate::line::out_folder::access::{FolderId, id_of, make_all, make_inner, open_checked, open_folder};
use crate::line::out_folder::lock::{Entry, LOCK, check_lock, lock_refused, open_lock, read_entry, take_lock};
use crate::line::out_folder::process::ProcessName;

/// How long to wait for the stages of a killed line before people are informed.
const REPORT_AFTER: Duration = Duration::from_millis(500);

/// An output folder that this process holds, until it is dropped.
#[derive(Debug)]
pub(crate) struct OutFolder {
    path: PathBuf,
    id: FolderId,
    entry: Entry,
    /// The address of a line that was killed.
    left: Option<LineAddress>,
    /// Nothing in the folder is open while this is `None`.
    lock: Option<File>,
}

/// A line that was found by its output folder.
#[derive(Debug, Clone)]
pub(crate) struct FoundLine {
    /// Number of its first process.
    pub pid: u32,
    /// Its address.
    pub address: LineAddress,
}

impl OutFolder {
    /// Makes the folder and the one for results under way, if they do not exist, and keeps other lines out.
    ///
    /// # Errors
    /// Another line has it (its process is named); somebody else could change its contents; a system error.
    pub(crate) fn take(path: &Path) -> Result<Self> {
        let path = std::path::absolute(path).with_context(|| format!("{} is no usable path", path.display()))?;
        make_all(&path)?;
        let folder = open_checked(&path)?;
        let lock = take_lock(&folder, &path)?;
        make_inner(&folder, &path, OPEN_FOLDER)?;
        let left = read_entry(&lock).and_then(|entry| LineAddress::at(&entry.left.or(entry.folder)?).ok());
        let left_path = left.as_ref().map(|address| address.root().to_owned());
        let entry = Entry { process: ProcessName::own()?, folder: None, left: left_path };
        let id = id_of(&folder, &path)?;
        let folder = Self { path, id, entry, left, lock: Some(lock) };
        folder.write()?;
        Ok(folder)
    }

    /// Makes the folder for notes of verdicts that are still to be reported, if it does not exist.
    ///
    /// # Errors
    /// That somebody else could change what is in it; an error of the system.
    pub(crate) fn make_unreported(&self) -> Result<()> {
        make_inner(&open_checked(&self.path)?, &self.path, UNREPORTED_FOLDER)
    }

    /// The folder, absolute.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The folder of results under way, absolute.
    pub(crate) fn open_path(&self) -> PathBuf {
        self.path.join(OPEN_FOLDER)
    }

    /// Clears away what a killed line left, waiting up to `patience` for its stages to end; fails if they still run.
    pub(crate) fn clear_left(&mut self, patience: Duration) -> Result<()> {
        let Some(address) = &self.left else { return Ok(()) };
        let since = Instant::now();
        let mut is_reported = false;
        loop {
            match address.clear() {
                Ok(true) => break,
                Ok(false) => {}
                // Somebody else has taken its name since: nothing of the line is left there.
                Err(error) => {
                    tracing::warn!(%error, "what an earlier line left is not touched");
                    break;
                }
            }
            if since.elapsed() > REPORT_AFTER && !std::mem::replace(&mut is_reported, true) {
                print_line(&format!("waiting for stages of an earlier line on {} to end", self.path.display()));
            }
            if since.elapsed() > patience {
                bail!("stages of an earlier line on {} still run: end them first (ps shows them)", self.path.display());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        self.left = None;
        Ok(())
    }

    /// Records the address of the line that holds the folder. To be called before any stage starts.
    pub(crate) fn enter(&mut self, address: &LineAddress) -> Result<()> {
        self.entry.folder = Some(address.root().to_owned());
        self.entry.left = None;
        self.write()
    }

    /// Closes everything in the folder, so that its disk can be taken out, repaired and put back.
    ///
    /// No other line can take it meanwhile, because the lock names this process, which is alive.
    pub(crate) fn release(&mut self) {
        self.lock = None;
    }

    /// Takes the folder back after [`OutFolder::release`]; whether it is there again.
    ///
    /// # Errors
    /// If another line has taken it meanwhile.
    pub(crate) fn take_back(&mut self) -> Result<bool> {
        if self.lock.is_some() {
            return Ok(true);
        }
        // While its disk is away, an empty folder may be where it was.
        let Ok(folder) = open_folder(&self.path) else { return Ok(false) };
        let Ok(lock) = open_lock(&folder, OFlags::RDONLY) else { return Ok(false) };
        match read_entry(&lock) {
            Some(entry) if entry.process == self.entry.process => {}
            Some(entry) if entry.process.is_alive() => {
                bail!("another line (process {}) has taken {} meanwhile", entry.process.pid, self.path.display());
            }
            _ => return Ok(false),
        }
        if rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
            return Ok(false);
        }
        self.id = id_of(&folder, &self.path)?;
        self.lock = Some(lock);
        Ok(true)
    }

    /// The running line that writes to the folder at `path`, if any. Changes nothing and holds nothing.
    ///
    /// # Errors
    /// If the folder or its lock cannot be read, or belongs to another user.
    pub(crate) fn find_line(path: &Path) -> Result<Option<FoundLine>> {
        let folder = open_folder(path).with_context(|| format!("cannot look into {}", path.display()))?;
        let lock = match open_lock(&folder, OFlags::RDONLY) {
            Ok(lock) => lock,
            Err(Errno::NOENT) => return Ok(None),
            Err(error) => bail!(lock_refused(path, error)),
        };
        check_lock(&lock, path)?;
        let Some(entry) = read_entry(&lock).filter(|entry| entry.process.is_alive()) else { return Ok(None) };
        let address = entry.folder.map(|folder| LineAddress::at(&folder)).transpose()?;
        Ok(address.map(|address| FoundLine { pid: entry.process.pid, address }))
    }

    /// Rewrites the lock, and syncs it to the disk.
    fn write(&self) -> Result<()> {
        let lock = self.path.join(LOCK);
        let write = || -> Result<()> {
            let folder = open_folder(&self.path)?;
            ensure!(id_of(&folder, &self.path)? == self.id, "another folder has taken its place");
            let mut file = open_lock(&folder, OFlags::WRONLY)?;
            check_lock(&file, &self.path)?;
            file.set_len(0)?;
            file.write_all(toml::to_string(&self.entry)?.as_bytes())?;
            // After its disk has failed and is back, the folder is recognised by this.
            file.sync_all()?;
            Ok(rustix::fs::fsync(&folder)?)
        };
        write().with_context(|| format!("cannot write {}", lock.display()))
    }
}

impl Drop for OutFolder {
    fn drop(&mut self) {
        if self.lock.is_none() && !self.take_back().unwrap_or(false) {
            return; // the next line finds it, and sees that its process has ended
        }
        if let Some(address) = &self.left {
            tracing::debug!(folder = %address.root().display(), "what an earlier line left is still there");
            return;
        }
        let path = self.path.join(LOCK);
        // It may have been removed already, with its folder.
        if let Err(error) = std::fs::remove_file(&path)
            && error.kind() != ErrorKind::NotFound
        {
            tracing::warn!(path = %path.display(), %error, "cannot remove the lock");
        }
    }
}
