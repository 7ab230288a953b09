//! Files under way to a name: whole under it, or not there at all.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;

use crate::error::{Context, Error, Result};

/// A new file beside the one that it is to become; it is removed when dropped, unless it was renamed.
#[derive(Debug)]
pub(crate) struct Draft {
    path: PathBuf,
}

impl Draft {
    /// Begins an empty file beside `path`, under a name that no other draft has.
    ///
    /// # Errors
    /// What the system says; the library's own message for a missing folder is a page of C.
    pub(crate) fn begin(path: &Path) -> io::Result<Self> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}-{number}.new", std::process::id()));
        let draft = Self { path: path.with_file_name(name) };
        File::create(&draft.path)?;
        Ok(draft)
    }

    /// Gives the draft its name, if nothing has it by now, so that no power cut takes it back.
    ///
    /// # Errors
    /// [`Error::Exists`], or what the system says.
    pub(crate) fn publish(self, path: &Path) -> Result<()> {
        rename_new(&self.path, path)?;
        File::open(folder_of(path)).and_then(|folder| folder.sync_all()).context("name", path)
    }

    /// Where it lies.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        // Renamed, it is not there; and one that cannot be removed harms nobody.
        drop(fs::remove_file(&self.path));
    }
}

/// Gives the file at `from` the name `to`, if nothing has it by now.
///
/// # Errors
/// [`Error::Exists`], or what the system says.
pub(crate) fn rename_new(from: &Path, to: &Path) -> Result<()> {
    let named = match renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        // A file system that cannot do both at once.
        Err(Errno::INVAL | Errno::NOSYS) => fs::hard_link(from, to).and_then(|()| fs::remove_file(from)),
        named => named.map_err(io::Error::from),
    };
    match named {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Err(Error::Exists { path: to.to_owned() }),
        named => named.context("name", to),
    }
}

/// The folder that `path` is in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Removes the drafts of `path` whose processes have died.
///
/// What cannot be looked at or removed stays: it only takes room.
pub(crate) fn remove_dead_drafts(path: &Path) {
    let Ok(entries) = fs::read_dir(folder_of(path)) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let Some(pid) = pid_of_draft(&name, path.file_name().unwrap_or_default()) else { continue };
        // The process may be one of another machine that shares the folder: it has its draft locked.
        let is_free = || File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok());
        if !Path::new(&format!("/proc/{pid}")).exists() && is_free() {
            drop(fs::remove_file(entry.path()));
        }
    }
}

/// The process that made `name`, if that is a draft of `of`.
fn pid_of_draft(name: &OsStr, of: &OsStr) -> Option<u32> {
    let rest = name.to_str()?.strip_prefix(of.to_str()?)?.strip_prefix('.')?.strip_suffix(".new")?;
    let (pid, number) = rest.split_once('-')?;
    number.parse::<u32>().ok()?;
    pid.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a draft of the living or another's file that is removed, and one of the dead that stays.
    #[test]
    fn only_drafts_of_the_dead_go() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        let own = Draft::begin(&path).unwrap();
        // No process has a number that large.
        let dead = folder.path().join("run.h5.4194999-0.new");
        let others = ["other.h5.4194999-0.new", "run.h5.4194999-x.new", "run.h5.new", "run.h5.4194999-0.newer"];
        for name in others.map(|name| folder.path().join(name)).iter().chain([&dead]) {
            fs::write(name, "").unwrap();
        }
        let locked = folder.path().join("run.h5.4194999-1.new");
        let lock = File::create(&locked).unwrap();
        lock.lock().unwrap();
        remove_dead_drafts(&path);
        assert!(!dead.exists() && own.path().exists() && locked.exists());
        assert!(others.iter().all(|name| folder.path().join(name).exists()));
        let name = own.path().to_owned();
        drop(own);
        assert!(!name.exists());
    }
}
