//! A folder that appears whole or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::Context as _;
use crate::{Error, Result};

/// A folder that is being filled beside the place where it will stand; it is taken away again unless it is finished.
#[derive(Debug)]
pub(crate) struct Draft {
    draft: PathBuf,
    folder: PathBuf,
}

impl Draft {
    /// Begins what will be `folder`, which may stand there already if it is empty.
    pub(crate) fn new(folder: &Path) -> Result<Self> {
        // A name that ends in a slash, or is none, as "." is: the parent is wanted, and something to add to.
        // One that is there may be so by way of a link, which stays.
        let folder = match (folder.canonicalize(), folder.file_name()) {
            (Ok(there), _) => there,
            (Err(_), Some(name)) if !folder.is_symlink() => folder.with_file_name(name),
            // Also a link to nothing, in whose place no folder can be put.
            (there, _) => there.context("find the folder", folder)?,
        };
        match fs::read_dir(&folder).map(|mut entries| entries.next().is_none()) {
            Ok(true) => {}
            Ok(false) => return Err(Error::FolderNotEmpty { path: folder }),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(error).context("use as a folder for taps", &folder),
        }
        let draft = folder.with_added_extension(format!("{}.new", std::process::id()));
        fs::create_dir(&draft).context("make the folder", &draft)?;
        Ok(Self { draft, folder })
    }

    /// The path of a file in the folder while it is a draft, its own folder made.
    pub(crate) fn path(&self, name: &str) -> Result<PathBuf> {
        let path = self.draft.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).context("make the folder", parent)?;
        }
        Ok(path)
    }

    /// Whether something called `name` is in the folder.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.draft.join(name).exists()
    }

    /// Writes a file of text.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<()> {
        let path = self.path(name)?;
        fs::write(&path, text).context("write", &path)
    }

    /// Puts the folder in its place.
    pub(crate) fn finish(self) -> Result<()> {
        // An empty folder in that place is replaced; one that has been filled meanwhile is not.
        fs::rename(&self.draft, &self.folder).context("put in place the folder", &self.folder)
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        // Gone when it is finished; and whoever asked has been told of an error already.
        drop(fs::remove_dir_all(&self.draft));
    }
}
