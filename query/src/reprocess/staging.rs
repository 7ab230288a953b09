//! The folder in which the results of a job gather until they are committed.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::Write as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use crate::places::{COMMIT_FILE, CasingFile};
use crate::reprocess::commit::Committed;
use crate::task::FILES;
use anyhow::{Context as _, Result, ensure};
use tapline_store::Folder;

/// What staging folders are called.
const PREFIX: &str = ".staging-";

/// Locked while folders are made or cleared away.
const LOCK: &str = ".lock";

/// A staging folder, locked by this process, and removed if nothing is committed.
#[derive(Debug)]
pub(super) struct Staging {
    folder: PathBuf,
    _lock: File,
}

impl Drop for Staging {
    fn drop(&mut self) {
        // Where that fails, the next job removes it.
        drop(remove(&self.folder));
    }
}

/// Removes a staging folder in which executors may still work: under another name they find it no more.
fn remove(folder: &Path) -> std::io::Result<()> {
    let gone = folder.with_extension("gone");
    match fs::rename(folder, &gone) {
        Ok(()) => fs::remove_dir_all(gone),
        Err(_) => fs::remove_dir_all(folder),
    }
}

/// The folder `out`, made if it is not there, absolute.
pub(super) fn out_folder(out: &Path) -> Result<PathBuf> {
    let context = || format!("cannot make the folder {}", out.display());
    fs::create_dir_all(out).with_context(context)?;
    out.canonicalize().with_context(context)
}

impl Staging {
    /// Makes a staging folder in `out` with the folders of `files`, and removes those whose processes are gone.
    pub(super) fn new(out: &Path, files: &[CasingFile]) -> Result<Self> {
        let context = || format!("cannot make a staging folder in {}", out.display());
        let all = File::create(out.join(LOCK)).and_then(|lock| lock.lock().map(|()| lock)).with_context(context)?;
        remove_abandoned(out).with_context(context)?;
        let folder = tempfile::Builder::new().prefix(PREFIX).tempdir_in(out).with_context(context)?.keep();
        let lock = File::create(folder.join(LOCK)).and_then(|lock| lock.lock().map(|()| lock));
        let lock = lock.with_context(context)?;
        drop(all);
        let places: BTreeSet<_> = files.iter().filter_map(|file| Path::new(&file.name).parent()).collect();
        for place in std::iter::once(Path::new("")).chain(places) {
            fs::create_dir_all(folder.join(FILES).join(place)).with_context(context)?;
        }
        Ok(Self { folder, _lock: lock })
    }

    /// Its path.
    pub(super) fn text(&self) -> Result<String> {
        let path = &self.folder;
        Ok(path.to_str().with_context(|| format!("the name of {} is not UTF-8", path.display()))?.to_owned())
    }

    /// Number of results.
    pub(super) fn count(&self) -> Result<usize> {
        Ok(Folder::list(&self.folder.join(FILES))?.finished.len())
    }

    /// Turns what was gathered into the folder `to`, with its commit file; `false` if it was committed meanwhile.
    ///
    /// # Errors
    /// Results that are not there, and what the system returns. Nothing is committed then.
    pub(super) fn commit(self, to: &Path, committed: &Committed, files: &[CasingFile]) -> Result<bool> {
        let from = self.folder.join(FILES);
        for row in &committed.rows {
            let (Some(results), Some(bytes)) = (&row.results, row.bytes) else { continue };
            let there =
                from.join(results).metadata().with_context(|| format!("the results of {} are gone", row.file))?;
            ensure!(there.len() == bytes, "the results of {} have {} bytes, not {bytes}", row.file, there.len());
        }
        // Results are read with the samples of their archive, which is looked for in the same folder.
        for file in files {
            let link = from.join(&file.name);
            symlink(&file.path, &link).with_context(|| format!("cannot make the link {}", link.display()))?;
        }
        let path = from.join(COMMIT_FILE);
        let text = committed.text()?;
        let written = File::create(&path).and_then(|mut file| {
            file.write_all(&text)?;
            file.sync_all()
        });
        written.with_context(|| format!("cannot write {}", path.display()))?;
        match fs::rename(&from, to) {
            Err(_) if to.join(COMMIT_FILE).exists() => return Ok(false),
            renamed => renamed.with_context(|| format!("cannot commit {}", to.display()))?,
        }
        if let Some(folder) = to.parent() {
            File::open(folder)
                .and_then(|folder| folder.sync_all())
                .with_context(|| format!("cannot sync {}", folder.display()))?;
        }
        Ok(true)
    }
}

/// Removes the staging folders that no process has locked.
fn remove_abandoned(out: &Path) -> std::io::Result<()> {
    for entry in fs::read_dir(out)? {
        let entry = entry?;
        if !entry.file_name().as_encoded_bytes().starts_with(PREFIX.as_bytes()) {
            continue;
        }
        let is_in_use = File::open(entry.path().join(LOCK))
            .is_ok_and(|lock| matches!(lock.try_lock(), Err(TryLockError::WouldBlock)));
        if !is_in_use {
            remove(&entry.path())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(folder: &Path, name: &str) -> CasingFile {
        CasingFile::new(name, folder.join(name).display().to_string())
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn committed(results: Option<&str>) -> Committed {
        let row = super::super::Row {
            file: "1/A.h5".to_owned(),
            results: results.map(str::to_owned),
            bytes: results.map(|_| 3),
            ..Default::default()
        };
        Committed { version: 1, job: "j".to_owned(), program: "p".to_owned(), rows: vec![row] }
    }

    /// Catches a job that is there in parts, or twice.
    #[test]
    fn what_is_committed_is_whole_and_there_once() {
        let out = tempfile::tempdir().unwrap();
        let files = [file(out.path(), "1/A.h5")];
        let to = out.path().join("run=1");
        let abandoned = Staging::new(out.path(), &files).unwrap();
        let gone = abandoned.commit(&to, &committed(Some("1/A.0.h5")), &files).unwrap_err().to_string();
        assert_eq!(gone, "the results of 1/A.h5 are gone");
        assert_eq!(names(out.path()), [".lock"]);

        let (first, second) = (Staging::new(out.path(), &files).unwrap(), Staging::new(out.path(), &files).unwrap());
        for staging in [&first, &second] {
            fs::write(staging.folder.join("files/1/A.0.h5"), "abc").unwrap();
        }
        assert!(first.commit(&to, &committed(Some("1/A.0.h5")), &files).unwrap());
        assert!(!second.commit(&to, &committed(Some("1/A.0.h5")), &files).unwrap());
        assert_eq!(names(out.path()), [".lock", "run=1"]);
        assert_eq!(names(&to), ["1", COMMIT_FILE]);
        assert_eq!(names(&to.join("1")), ["A.0.h5", "A.h5"]);
    }

    /// Catches staging folders of killed clients that fill the disk, and one of a live client that is removed.
    #[test]
    fn only_abandoned_folders_are_removed() {
        let out = tempfile::tempdir().unwrap();
        let live = Staging::new(out.path(), &[]).unwrap();
        fs::create_dir_all(out.path().join(".staging-killed/files")).unwrap();
        fs::write(out.path().join(".staging-killed/.lock"), "").unwrap();
        let _next = Staging::new(out.path(), &[]).unwrap();
        assert!(live.folder.exists() && !out.path().join(".staging-killed").exists());
    }
}
