//! The end of an archive: closed, sealed, on the disk, and under its name.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use tapline_wire::TapState;

use crate::archive::Archive;
use crate::error::{Context as _, Result};
use crate::file::background_sync::SyncErrors;
use crate::file::draft::{rename_new, sync_folder_of};
use crate::h5::seal::{Extent, seal};
use crate::write::Writer;

/// An archive that is sealed, and is to be put on the disk and under its name: slow on a slow disk, and for any thread.
#[derive(Debug)]
pub struct Finishing {
    /// Where it is.
    from: PathBuf,
    /// Where it will be.
    path: PathBuf,
    file: File,
    sync_errors: SyncErrors,
}

impl Finishing {
    /// Where the archive will be.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits until the archive is on the disk, where a power cut cannot take it back, and gives it its name. It never replaces
    /// a file. Where it has failed it may be called again.
    ///
    /// # Errors
    /// [`crate::Error::Exists`], or what the system says.
    pub fn complete(&self) -> Result<()> {
        self.sync_errors.last().context("sync", &self.from)?;
        self.file.sync_all().context("sync", &self.from)?;
        if self.from == self.path {
            return sync_folder_of(&self.from);
        }
        // The name may have been given by a call whose folders could not be synced.
        if self.from.try_exists().context("look for", &self.from)? || !self.is_named()? {
            rename_new(&self.from, &self.path)?;
        }
        sync_folder_of(&self.path)?;
        sync_folder_of(&self.from)
    }

    fn is_named(&self) -> Result<bool> {
        use std::os::unix::fs::MetadataExt as _;
        let of = |held: fs::Metadata| (held.dev(), held.ino());
        let held = of(self.file.metadata().context("look for", &self.from)?);
        match fs::metadata(&self.path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            there => Ok(of(there.context("look for", &self.path)?) == held),
        }
    }
}

/// Closes `archive`, in which everything is flushed and the taps stand as `states` says, and seals it.
pub(crate) fn close_and_seal(archive: Archive, states: &[TapState]) -> Result<()> {
    let path = archive.path().to_owned();
    let mut samples = Vec::new();
    if !archive.is_results() {
        let file = File::open(&path).context("find samples", &path)?;
        let places = archive.samples().places(&file).context("find samples", &path)?;
        let archived = states.iter().zip(places).filter(|(state, _)| **state == TapState::Archived);
        samples.extend(archived.filter_map(|(_, place)| place.map(Extent::from)));
    }
    drop(archive);
    seal(&path, samples)
}

impl Writer {
    /// Ends the archive: does what [`Writer::settle`] does, closes it and seals it; [`Finishing::complete`] then puts it on the
    /// disk and names it `final_path`. It is never written again.
    ///
    /// What waits for a flush is lost where this fails: [`Writer::settle`] beforehand leaves nothing waiting. The archive is
    /// then as it was, and [`Writer::resume`] goes on with it.
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn finish_at(mut self, final_path: impl AsRef<Path>) -> Result<Finishing> {
        self.settle()?;
        let file = self.guard.read_handle()?;
        let Some(archive) = self.archive.take() else {
            return Err(crate::error::Error::Abandoned { path: self.path.clone() });
        };
        close_and_seal(archive, self.ledger.taps())?;
        let (from, path) = (self.path.clone(), final_path.as_ref().to_owned());
        Ok(Finishing { from, path, file, sync_errors: self.sync_errors.clone() })
    }

    /// Ends the archive where it lies: [`Writer::finish_at`] its path, and [`Finishing::complete`].
    ///
    /// # Errors
    /// As [`Writer::flush`].
    pub fn finish(self) -> Result<()> {
        let path = self.path.clone();
        self.finish_at(path)?.complete()
    }

    /// Closes the archive unfinished, to be gone on with by [`Writer::resume`], and waits until what it has is on the disk.
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
