//! The folder that a line writes to: held by one line at a time, which is found by it.
//!
//! Beside the results it has the folder `open`, for those under way, `unreported`, for verdicts that are still to be reported, and while a
//! line runs the file `.line`: the lock, and in it where the line is found, so that the next line finds and clears what a killed one
//! has left, and `tapline status` finds the one that runs. Only who owns the folder may use it, as its owner could put anything in the place of a result;
//! nor may everyone be able to write in it, unless it is sticky. `.line` is of its user alone; results and `open` are as
//! the user's umask has it.

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

/// How long stages of a line that was killed are waited for before people are informed.
const REPORT_AFTER: Duration = Duration::from_millis(500);

/// An output folder that this process holds, until it is dropped.
#[derive(Debug)]
pub(crate) struct OutFolder {
    path: PathBuf,
    id: FolderId,
    entry: Entry,
    /// Where a line that was killed worked.
    left: Option<LineAddress>,
    /// Nothing of the folder is open while it is released.
    lock: Option<File>,
}

/// A line that was found by its output folder.
#[derive(Debug, Clone)]
pub(crate) struct FoundLine {
    /// Number of its first process.
    pub pid: u32,
    /// Where it is found.
    pub address: LineAddress,
}

impl OutFolder {
    /// Makes the folder and the one for results under way, if they are not there, and holds off every other line.
    ///
    /// # Errors
    /// That another line has it, by its process; that somebody else could change what is in it; an error of the system.
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

    /// Makes the folder for notes of verdicts that are still to be reported, if it is not there.
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

    /// Clears away what a line that was killed left, waiting up to `patience` for its stages to end.
    ///
    /// # Errors
    /// That they still run.
    pub(crate) fn clear_left(&mut self, patience: Duration) -> Result<()> {
        let Some(address) = &self.left else { return Ok(()) };
        let since = Instant::now();
        let mut is_reported = false;
        loop {
            match address.clear() {
                Ok(true) => break,
                Ok(false) => {}
                // Somebody else has taken its name since: nothing of it is left there.
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

    /// Writes down where the line that holds the folder is found. To be called before any stage starts.
    ///
    /// # Errors
    /// An error of the system.
    pub(crate) fn enter(&mut self, address: &LineAddress) -> Result<()> {
        self.entry.folder = Some(address.root().to_owned());
        self.entry.left = None;
        self.write()
    }

    /// Releases everything in the folder, so that its disk can be taken out, repaired and put back.
    ///
    /// No other line can have it meanwhile, as the lock names this process, which lives.
    pub(crate) fn release(&mut self) {
        self.lock = None;
    }

    /// Takes the folder back after [`OutFolder::release`]; whether it is there again.
    ///
    /// # Errors
    /// That another line has taken it meanwhile.
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

    /// The line that runs and writes to the folder at `path`, if one does. Changes nothing, holds nothing.
    ///
    /// # Errors
    /// That the folder or its lock cannot be read, or is not of this user.
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

    /// Writes the lock anew and has it on the disk.
    fn write(&self) -> Result<()> {
        let lock = self.path.join(LOCK);
        let write = || -> Result<()> {
            let folder = open_folder(&self.path)?;
            ensure!(id_of(&folder, &self.path)? == self.id, "another folder has taken its place");
            let mut file = open_lock(&folder, OFlags::WRONLY)?;
            check_lock(&file, &self.path)?;
            file.set_len(0)?;
            file.write_all(toml::to_string(&self.entry)?.as_bytes())?;
            // After its disk has failed and came back, the folder is recognised by this.
            file.sync_all()?;
            Ok(rustix::fs::fsync(&folder)?)
        };
        write().with_context(|| format!("cannot write {}", lock.display()))
    }
}

impl Drop for OutFolder {
    fn drop(&mut self) {
        if self.lock.is_none() && !self.take_back().unwrap_or(false) {
            return; // the next line finds it, and that its process has ended
        }
        if let Some(address) = &self.left {
            tracing::debug!(folder = %address.root().display(), "what an earlier line left is still there");
            return;
        }
        let path = self.path.join(LOCK);
        // With its folder it may have been removed already.
        if let Err(error) = std::fs::remove_file(&path)
            && error.kind() != ErrorKind::NotFound
        {
            tracing::warn!(path = %path.display(), %error, "cannot remove the lock");
        }
    }
}
