//! A folder that appears complete or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::Context as _;
use crate::{Error, Result};

/// A folder that is filled under another name and then renamed; it is removed unless it is finished.
#[derive(Debug)]
pub(crate) struct Draft {
    draft: PathBuf,
    folder: PathBuf,
}

impl Draft {
    /// Begins the folder that will be `folder`, which may exist already if it is empty; those above it are made.
    pub(crate) fn new(folder: &Path) -> Result<Self> {
        // The path may end in a slash or be ".": canonical, it has a parent and a name to which a suffix can be added. If it is a
        // link to a folder, the link stays.
        let folder = match (folder.canonicalize(), folder.file_name()) {
            (Ok(existing), _) => existing,
            (Err(_), Some(name)) if !folder.is_symlink() => folder.with_file_name(name),
            // For example a link to nothing, which a folder cannot replace.
            (missing, _) => missing.context("find the folder", folder)?,
        };
        match fs::read_dir(&folder).map(|mut entries| entries.next().is_none()) {
            Ok(true) => {}
            Ok(false) => return Err(Error::FolderNotEmpty { path: folder }),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(error).context("use as a folder for taps", &folder),
        }
        let draft = folder.with_added_extension(format!("{}.new", std::process::id()));
        if let Some(above) = folder.parent() {
            fs::create_dir_all(above).context("make the folder", above)?;
        }
        fs::create_dir(&draft).context("make the folder", &draft)?;
        Ok(Self { draft, folder })
    }

    /// The present path of the file `name`, whose own folder is created.
    pub(crate) fn path(&self, name: &str) -> Result<PathBuf> {
        let path = self.draft.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).context("make the folder", parent)?;
        }
        Ok(path)
    }

    /// The present path of the folder.
    pub(crate) fn present(&self) -> &Path {
        &self.draft
    }

    /// Whether the folder has a file or folder `name`.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.draft.join(name).exists()
    }

    /// Writes a file of text.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<()> {
        let path = self.path(name)?;
        fs::write(&path, text).context("write", &path)
    }

    /// Renames the folder to its final name.
    pub(crate) fn finish(self) -> Result<()> {
        // This replaces an empty folder, but not one that was filled meanwhile.
        fs::rename(&self.draft, &self.folder).context("rename the folder to", &self.folder)
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        // Nothing is left there after `finish`; an error here matters less than the one that led here.
        drop(fs::remove_dir_all(&self.draft));
    }
}
