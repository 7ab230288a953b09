//! Files that are there whole or not at all.

use std::fs::{self, File};
use std::path::Path;

use anyhow::{Context, Result};

/// Has `write` fill the file at `path`: what stands there is replaced at the end, and stays if that fails.
///
/// What is no plain file, as a pipe, a device or a link, is written to as it stands.
pub(crate) fn whole_file<E>(path: &Path, write: impl FnOnce(File) -> Result<(), E>) -> Result<()>
where
    Result<(), E>: Context<(), E>,
{
    let context = || format!("cannot write {}", path.display());
    // A file in the place of a device would take the device from everyone on the machine.
    if fs::symlink_metadata(path).is_ok_and(|there| !there.is_file()) {
        return write(File::create(path).with_context(context)?).with_context(context);
    }
    let draft = path.with_added_extension("new");
    let file = File::create(&draft).with_context(context)?;
    let written = write(file).with_context(context).and_then(|()| fs::rename(&draft, path).with_context(context));
    // What is half there is nothing; where it cannot be removed the error above says more.
    written.inspect_err(|_| drop(fs::remove_file(&draft)))
}
