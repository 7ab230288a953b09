//! Files that are written whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::path::{Path, PathBuf};

use crate::signals::note_folder;

/// Source: HDF5 File Format Specification Version 3.0, section II.A.
const HDF5_SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

/// Links that are followed, one to the next; the system follows as many.
const LINKS_MAX: usize = 40;

/// What to do with an existing file at the path of a new one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Keep it, and write nothing.
    Keep,
    /// Replace it with the new one once that is complete.
    Replace,
}

/// Why a file was not written.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
pub enum WriteError {
    /// Something exists there already.
    #[error("{} exists already: give another name, or replace it with --force", path.display())]
    Exists { path: PathBuf },
    /// A file is where a folder belongs.
    #[error("{} is a file; it must be a folder, or a new name", path.display())]
    NoFolder { path: PathBuf },
    /// It is an HDF5 file.
    #[error("{} is an HDF5 file, as archives are; nothing takes its place", path.display())]
    IsHdf5 { path: PathBuf },
    /// It cannot be written.
    #[error("cannot write {}", path.display())]
    Failed { path: PathBuf, source: Box<dyn std::error::Error + Send + Sync> },
}

/// Lets `write` fill the file at `path`, and makes missing folders. A file at `path`, or where a link at `path`
/// leads, is replaced at the end if `existing` says so, and stays if `write` fails; archives are never replaced. Pipes, devices and
/// what is already open, such as `/dev/stdout`, are written to.
///
/// # Errors
/// [`WriteError`].
pub fn write_atomically<E>(
    path: &Path,
    existing: Existing,
    write: impl FnOnce(File) -> Result<(), E>,
) -> Result<(), WriteError>
where
    E: Into<Box<dyn std::error::Error + Send + Sync>>,
{
    let failed = |source| WriteError::Failed { path: path.to_owned(), source };
    let io = |error: io::Error| failed(error.into());
    let place = match place_of(path) {
        Destination::Standard(fd) => return write(fd.map_err(io)?).map_err(|error| failed(error.into())),
        // Replacing a device with a file would take it from everyone on the machine.
        Destination::There => {
            let file = OpenOptions::new().append(true).open(path).map_err(io)?;
            return write(file).map_err(|error| failed(error.into()));
        }
        Destination::File(place) => place,
    };
    check_free(path, &place, existing)?;
    let draft = place.with_added_extension(format!("{}.new", std::process::id()));
    note_folder(&draft);
    if let Some(folder) = place.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder)
            .map_err(|error| WriteError::Failed { path: folder.to_owned(), source: error.into() })?;
    }
    let file = File::create(&draft).map_err(io)?;
    tracing::debug!("writing {}, which becomes {}", draft.display(), place.display());
    let written =
        write(file).map_err(|error| failed(error.into())).and_then(|()| publish(path, &place, &draft, existing));
    // A half-written draft is useless; if it cannot be removed, the error above is the one that counts.
    written.inspect_err(|_| drop(fs::remove_file(&draft)))
}

/// Checks that a file may be written at `path`, before the work for it is done.
///
/// # Errors
/// [`WriteError::Exists`] and [`WriteError::IsHdf5`].
pub fn check_writable(path: &Path, existing: Existing) -> Result<(), WriteError> {
    match place_of(path) {
        Destination::File(place) => check_free(path, &place, existing),
        Destination::Standard(_) | Destination::There => Ok(()),
    }
}

/// Checks that files may be written into the folder `path`: it is new or empty, or its files may be replaced.
///
/// # Errors
/// [`WriteError::NoFolder`] or [`WriteError::Exists`].
pub fn check_folder(path: &Path, existing: Existing) -> Result<(), WriteError> {
    if path.exists() && !path.is_dir() {
        return Err(WriteError::NoFolder { path: path.to_owned() });
    }
    let has_files = fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some());
    match existing {
        Existing::Keep if has_files => Err(WriteError::Exists { path: path.to_owned() }),
        Existing::Keep | Existing::Replace => Ok(()),
    }
}

/// Writes each text to its path, or none if one may not be written.
///
/// # Errors
/// [`WriteError`].
pub fn write_texts(files: &[(PathBuf, String)], existing: Existing) -> Result<(), WriteError> {
    files.iter().try_for_each(|(path, _)| check_writable(path, existing))?;
    for (path, text) in files {
        write_atomically(path, existing, |mut file| file.write_all(text.as_bytes()))?;
    }
    Ok(())
}

fn check_free(path: &Path, place: &Path, existing: Existing) -> Result<(), WriteError> {
    let path = path.to_owned();
    if is_hdf5(place) {
        return Err(WriteError::IsHdf5 { path });
    }
    match existing {
        Existing::Keep if place.symlink_metadata().is_ok() => Err(WriteError::Exists { path }),
        Existing::Keep | Existing::Replace => Ok(()),
    }
}

/// Gives the draft its final name; if nothing may be replaced, not even a file that has appeared meanwhile.
fn publish(path: &Path, place: &Path, draft: &Path, existing: Existing) -> Result<(), WriteError> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    let renamed = match existing {
        Existing::Replace => fs::rename(draft, place),
        Existing::Keep => match renameat_with(CWD, draft, CWD, place, RenameFlags::NOREPLACE) {
            Err(rustix::io::Errno::EXIST) => return Err(WriteError::Exists { path: path.to_owned() }),
            // A file system that does not know the flag.
            Err(rustix::io::Errno::INVAL) => fs::rename(draft, place),
            renamed => renamed.map_err(io::Error::from),
        },
    };
    renamed.map_err(|error| WriteError::Failed { path: path.to_owned(), source: error.into() })
}

/// Where a path leads.
enum Destination {
    /// To this program's own output, to which other holders append after what is written here.
    Standard(io::Result<File>),
    /// To something that takes writes: a device, a pipe, or a file that a process has open.
    There,
    /// To a plain file, or to a path where one may be made.
    File(PathBuf),
}

fn place_of(path: &Path) -> Destination {
    let mut place = path.to_owned();
    for _ in 0..LINKS_MAX {
        let folder = place.parent().unwrap_or(Path::new("")).to_owned();
        // Open files look like links to the path at which they were opened.
        let of_processes = folder.canonicalize().ok().filter(|folder| folder.starts_with("/proc"));
        if let Some(folder) = of_processes {
            let is_own = Path::new("/proc/self/fd").canonicalize().is_ok_and(|own| own == folder);
            return match place.file_name().and_then(|name| name.to_str()) {
                Some("1") if is_own => Destination::Standard(io::stdout().as_fd().try_clone_to_owned().map(File::from)),
                Some("2") if is_own => Destination::Standard(io::stderr().as_fd().try_clone_to_owned().map(File::from)),
                _ => Destination::There,
            };
        }
        let Ok(next) = place.read_link() else { break };
        place = folder.join(next);
    }
    match fs::metadata(&place) {
        Ok(there) if !there.is_file() && !there.is_dir() => Destination::There,
        _ => Destination::File(place),
    }
}

/// Whether the file at `path` is HDF5, by its first bytes.
fn is_hdf5(path: &Path) -> bool {
    let mut begin = [0; HDF5_SIGNATURE.len()];
    let is_file = fs::metadata(path).is_ok_and(|there| there.is_file());
    is_file && File::open(path).and_then(|mut file| file.read_exact(&mut begin)).is_ok() && begin == HDF5_SIGNATURE
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a file that is lost because its folder is not there, and a draft that is left where the work for it has failed.
    #[test]
    fn the_folders_of_a_file_are_made() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b/text");
        let failed = write_atomically(&path, Existing::Keep, |_| Err(io::Error::other("no text")));
        assert!(matches!(failed, Err(WriteError::Failed { .. })), "{failed:?}");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 0);
        write_atomically(&path, Existing::Keep, |mut file| file.write_all(b"text")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"text");
    }
}
