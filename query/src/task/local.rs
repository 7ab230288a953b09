//! Casing files on the disk of this host, where the HDF5 library can open them.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use tempfile::TempDir;
use tokio::runtime::Handle;

use crate::places::{CasingFile, Key, objects};

/// A casing file that can be opened: itself, or a fetched object, which is removed with this value.
#[derive(Debug)]
pub(crate) struct Local {
    path: PathBuf,
    fetched: Option<TempDir>,
}

impl Local {
    /// Gets `file` here; `Err` with the reason if an object is gone or replaced.
    ///
    /// # Errors
    /// An object that cannot be read now, and a disk that cannot hold it: another host may do better.
    pub(crate) fn of(file: &CasingFile) -> Result<Result<Self, String>> {
        if Key::of_address(&file.path).is_none() {
            return Ok(Ok(Self { path: PathBuf::from(&file.path), fetched: None }));
        }
        let folder = temporary_folder()?;
        let at = |name: &str| folder.path().join(base_name(name));
        if let Some(archive) = &file.archive {
            let archive = CasingFile::new(archive.clone(), archive.clone());
            if let Err(why) = put_at(&archive, &at(&archive.name))? {
                return Ok(Err(why));
            }
        }
        let path = at(&file.name);
        Ok(put_at(file, &path)?.map(|()| Self { path, fetched: Some(folder) }))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// A message about it, with the place that the user knows.
    pub(crate) fn message(&self, file: &CasingFile, message: &str) -> String {
        let text = message.replace(&self.path.display().to_string(), &file.path);
        match (&self.fetched, &file.archive) {
            (Some(folder), Some(archive)) => {
                let archive_here = folder.path().join(base_name(archive)).display().to_string();
                text.replace(&archive_here, archive)
            }
            _ => text,
        }
    }
}

/// Makes `to` the file, by a link or by fetching it; `Err` with the reason if an object is gone or another.
///
/// # Errors
/// As for [`Local::of`].
pub(super) fn put_at(file: &CasingFile, to: &Path) -> Result<Result<(), String>> {
    match Key::of_address(&file.path) {
        Some(key) => Handle::current().block_on(objects::fetch(&key, file.e_tag.as_deref(), to)),
        None => {
            symlink(&file.path, to).with_context(|| format!("cannot make the link {}", to.display()))?;
            Ok(Ok(()))
        }
    }
}

/// A folder for what is under way, which goes with its value.
pub(super) fn temporary_folder() -> Result<TempDir> {
    tempfile::Builder::new().prefix("tapline-query-").tempdir().context("cannot make a folder for temporary files")
}

/// The last part of a file's name.
pub(super) fn base_name(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}
