//! Finishes an archive: closes it, seals it, syncs it and gives it its name.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use tapline_wire::TapState;

use crate::archive::Archive;
use crate::error::{Context as _, Error, Result};
use crate::file::background_sync::SyncErrors;
use crate::file::draft::{rename_new, sync_folder_of};
use crate::h5::seal::seal;
use crate::write::Writer;

/// A sealed archive that is to be synced and renamed, which may take long on a slow disk; any thread may do it.
#[derive(Debug)]
pub struct Finishing {
    /// Its present path.
    from: PathBuf,
    /// Its final path.
    path: PathBuf,
    file: File,
    sync_errors: SyncErrors,
}

impl Finishing {
    /// The final path of the archive.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits until the archive is on the disk and survives a power cut, and renames it; it never replaces a file. After an error
    /// it may be called again.
    ///
    /// # Errors
    /// [`crate::Error::Exists`], or what the system returns.
    pub fn complete(&self) -> Result<()> {
        self.sync_errors.last().context("sync", &self.from)?;
        self.file.sync_all().context("sync", &self.from)?;
        if self.from == self.path {
            return sync_folder_of(&self.from);
        }
        // An earlier call may have renamed it and then failed to sync the folders.
        if self.from.try_exists().context("look for", &self.from)? || !self.is_renamed()? {
            rename_new(&self.from, &self.path)?;
        }
        sync_folder_of(&self.path)?;
        sync_folder_of(&self.from)
    }

    fn is_renamed(&self) -> Result<bool> {
        use std::os::unix::fs::MetadataExt as _;
        let identity = |metadata: fs::Metadata| (metadata.dev(), metadata.ino());
        let held = identity(self.file.metadata().context("look for", &self.from)?);
        match fs::metadata(&self.path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            found => Ok(identity(found.context("look for", &self.path)?) == held),
        }
    }
}

/// Closes and seals `archive`, which must be flushed; `states` are those of its taps.
pub(crate) fn close_and_seal(archive: Archive, states: &[TapState]) -> Result<()> {
    let path = archive.path.clone();
    let mut samples = Vec::new();
    if !archive.is_results() {
        let file = File::open(&path).context("find samples", &path)?;
        let locations = archive.samples.locations(&file).context("find samples", &path)?;
        let archived = states.iter().zip(locations).filter(|(state, _)| **state == TapState::Archived);
        samples.extend(archived.filter_map(|(_, location)| location));
    }
    drop(archive);
    seal(&path, samples)
}

impl Writer {
    /// Finishes the archive: settles it as [`Writer::settle`] does, closes it and seals it. [`Finishing::complete`] then syncs it
    /// and renames it to `final_path`. It is never written again.
    ///
    /// On an error, records that wait for a flush are lost; after [`Writer::settle`] none do. The archive is then as it was, and
    /// [`Writer::resume`] continues it.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn finish_at(mut self, final_path: impl AsRef<Path>) -> Result<Finishing> {
        self.settle()?;
        let file = self.guard.read_handle()?;
        let archive = self.archive.take().ok_or_else(|| Error::Abandoned { path: self.path.clone() })?;
        close_and_seal(archive, self.ledger.taps())?;
        let (from, path) = (self.path.clone(), final_path.as_ref().to_owned());
        Ok(Finishing { from, path, file, sync_errors: self.sync_errors.clone() })
    }

    /// Finishes the archive under its present path: [`Writer::finish_at`] and [`Finishing::complete`].
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn finish(self) -> Result<()> {
        let path = self.path.clone();
        self.finish_at(path)?.complete()
    }

    /// Closes the unfinished archive and waits until it is on the disk; [`Writer::resume`] continues it.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn suspend(mut self) -> Result<()> {
        self.flush()?;
        drop(self.archive.take());
        self.sync_errors.last().context("sync", &self.path)?;
        self.guard.sync()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches an archive that gets its name though a background sync failed: the sync at the end does not report that.
    #[test]
    fn a_failed_background_sync_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let [from, path] = ["open.h5", "done.h5"].map(|name| folder.path().join(name));
        fs::write(&from, "").unwrap();
        let (file, sync_errors) = (File::open(&from).unwrap(), SyncErrors::default());
        let finishing = Finishing { from, path, file, sync_errors: sync_errors.clone() };
        sync_errors.note(&io::Error::from(rustix::io::Errno::IO));
        assert!(finishing.complete().unwrap_err().is_file_system_failure());
        assert!(finishing.from.exists() && !finishing.path.exists());
    }
}
