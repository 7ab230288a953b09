//! A file is written under a temporary name in its folder, then renamed: under its own name it is complete or absent.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::Path;

use tempfile::{Builder, TempPath};

use crate::error::{Context, Error, Result};

/// Creates an empty file beside `path`, which removes itself when the value is dropped before [`publish`].
///
/// # Errors
/// What the system returns; HDF5's own message for a missing folder is a page of C.
pub(crate) fn begin(path: &Path) -> io::Result<TempPath> {
    let mut prefix = path.file_name().unwrap_or_default().to_owned();
    prefix.push(format!(".{}-", std::process::id()));
    let draft =
        Builder::new().prefix(&prefix).suffix(SUFFIX).make_in(folder_of(path), |path| File::create_new(path))?;
    Ok(draft.into_temp_path())
}

/// End of a draft's name.
const SUFFIX: &str = ".new";

/// Renames `draft` to `path` and syncs the folder, so that a power cut does not undo it.
///
/// # Errors
/// [`Error::Exists`] if `path` exists, or what the system returns.
pub(crate) fn publish(draft: TempPath, path: &Path) -> Result<()> {
    rename_temporary(draft, path)?;
    sync_folder_of(path)
}

/// Renames the file at `from` to `to`, unless `to` exists.
///
/// # Errors
/// [`Error::Exists`], or what the system returns.
pub(crate) fn rename_new(from: &Path, to: &Path) -> Result<()> {
    let mut from = TempPath::try_from_path(from).context("rename to", to)?;
    // It is an archive: where it cannot be renamed it stays under its old name.
    from.disable_cleanup(true);
    rename_temporary(from, to)
}

fn rename_temporary(from: TempPath, to: &Path) -> Result<()> {
    match from.persist_noclobber(to).map_err(|error| error.error) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Err(Error::Exists { path: to.to_owned() }),
        renamed => renamed.context("rename to", to),
    }
}

/// Waits until the names in the folder of `path` are on the disk.
pub(crate) fn sync_folder_of(path: &Path) -> Result<()> {
    File::open(folder_of(path)).and_then(|folder| folder.sync_all()).context("sync the folder of", path)
}

/// The folder that `path` is in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Removes the drafts of `path` whose processes have died. A draft that cannot be examined or removed stays; it only
/// takes room.
pub(crate) fn remove_dead_drafts(path: &Path) {
    let Ok(entries) = fs::read_dir(folder_of(path)) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let Some(pid) = pid_of_draft(&name, path.file_name().unwrap_or_default()) else { continue };
        // A process on another machine that shares the folder keeps its draft locked.
        let is_free = || File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok());
        if !Path::new(&format!("/proc/{pid}")).exists() && is_free() {
            drop(fs::remove_file(entry.path()));
        }
    }
}

/// The process that created `name`, if `name` is a draft of `of`.
fn pid_of_draft(name: &OsStr, of: &OsStr) -> Option<u32> {
    let rest = name.to_str()?.strip_prefix(of.to_str()?)?.strip_prefix('.')?.strip_suffix(SUFFIX)?;
    rest.split_once('-')?.0.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a draft of a living process or another file that is removed, and a draft of a dead process that stays.
    #[test]
    fn only_drafts_of_dead_processes_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        let own = begin(&path).unwrap();
        // No process has a number that large.
        let dead = folder.path().join("run.h5.4194999-abc.new");
        let others =
            ["other.h5.4194999-0.new", "run.h5.x-0.new", "run.h5.4194999.new", "run.h5.new", "run.h5.4194999-0.newer"];
        for name in others.map(|name| folder.path().join(name)).iter().chain([&dead]) {
            fs::write(name, "").unwrap();
        }
        let locked = folder.path().join("run.h5.4194999-1.new");
        let lock = File::create(&locked).unwrap();
        lock.lock().unwrap();
        remove_dead_drafts(&path);
        assert!(!dead.exists() && own.exists() && locked.exists());
        assert!(others.iter().all(|name| folder.path().join(name).exists()));
        let name = own.to_path_buf();
        drop(own);
        assert!(!name.exists());
    }

    /// Catches a file that is overwritten, or removed because it could not be renamed.
    #[test]
    fn a_rename_replaces_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let [from, to] = ["a", "b"].map(|name| folder.path().join(name));
        fs::write(&from, "a").unwrap();
        fs::write(&to, "b").unwrap();
        assert!(matches!(rename_new(&from, &to), Err(Error::Exists { .. })));
        assert!(matches!(publish(begin(&to).unwrap(), &to), Err(Error::Exists { .. })));
        assert_eq!([&from, &to].map(|path| fs::read_to_string(path).unwrap()), ["a", "b"]);
        fs::remove_file(&to).unwrap();
        rename_new(&from, &to).unwrap();
        assert!(!from.exists() && fs::read_to_string(&to).unwrap() == "a");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
