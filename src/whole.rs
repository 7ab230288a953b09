//! Files that are there whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::path::Path;

use anyhow::{Context, Result};

/// Has `write` fill the file at `path`: what stands there, or where a link there leads, is replaced at the end, and stays if
/// that fails. A pipe, a device and what is open already, as `/dev/stdout` is, are written to.
pub(crate) fn whole_file<E>(path: &Path, write: impl FnOnce(File) -> Result<(), E>) -> Result<()>
where
    Result<(), E>: Context<(), E>,
{
    let context = || format!("cannot write {}", path.display());
    let is_special = fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir());
    // A file in the place of a device would take the device from everyone on the machine.
    if is_special || is_open_already(path) {
        return write(OpenOptions::new().append(true).open(path).with_context(context)?).with_context(context);
    }
    let place = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let draft = place.with_added_extension("new");
    let file = File::create(&draft).with_context(context)?;
    let written = write(file).with_context(context).and_then(|()| fs::rename(&draft, &place).with_context(context));
    // What is half there is nothing; where it cannot be removed the error above says more.
    written.inspect_err(|_| drop(fs::remove_file(&draft)))
}

/// Whether `path` names what some process has open, itself or by a link.
fn is_open_already(path: &Path) -> bool {
    let folder = path.parent().and_then(|folder| folder.canonicalize().ok());
    folder.into_iter().chain(path.read_link()).any(|place| place.starts_with("/proc"))
}
