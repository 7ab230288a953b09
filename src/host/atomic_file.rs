//! Files that are written completely or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _};
use std::os::fd::AsFd as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

/// Source: HDF5 File Format Specification Version 3.0, section II.A.
const HDF5_SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

/// Links that are followed, one to the next; the system follows as many.
const LINKS_MAX: usize = 40;

/// Has `write` fill the file at `path`: what stands there, or where a link there leads, is replaced at the end, and stays if
/// that fails; no archive is replaced. A pipe, a device and what is open already, as `/dev/stdout` is, are written to.
pub(crate) fn write_atomically<E>(path: &Path, write: impl FnOnce(File) -> Result<(), E>) -> Result<()>
where
    Result<(), E>: Context<(), E>,
{
    let context = || format!("cannot write {}", path.display());
    let place = match place_of(path) {
        Place::Standard(fd) => return write(fd.with_context(context)?).with_context(context),
        // A file in the place of a device would take the device from everyone on the machine.
        Place::There => {
            let file = OpenOptions::new().append(true).open(path).with_context(context)?;
            return write(file).with_context(context);
        }
        Place::File(place) => place,
    };
    if is_hdf5(&place) {
        bail!("{} is an HDF5 file, as archives are; nothing takes its place", path.display());
    }
    let draft = place.with_added_extension("new");
    let file = File::create(&draft).with_context(context)?;
    let written = write(file).with_context(context).and_then(|()| fs::rename(&draft, &place).with_context(context));
    // A half-written draft is of no use; where it cannot be removed, the error above is the one that counts.
    written.inspect_err(|_| drop(fs::remove_file(&draft)))
}

/// Where a path leads.
enum Place {
    /// To this program's own output, which whoever has it too goes on with behind what is written.
    Standard(io::Result<File>),
    /// To what is there to be written to: a device, a pipe, or what some process has open.
    There,
    /// To a plain file, or where one may be.
    File(PathBuf),
}

fn place_of(path: &Path) -> Place {
    let mut place = path.to_owned();
    for _ in 0..LINKS_MAX {
        let folder = place.parent().unwrap_or(Path::new("")).to_owned();
        // What processes have open looks like links to where it was when it was opened.
        let of_processes = folder.canonicalize().ok().filter(|folder| folder.starts_with("/proc"));
        if let Some(folder) = of_processes {
            let is_own = Path::new("/proc/self/fd").canonicalize().is_ok_and(|own| own == folder);
            return match place.file_name().and_then(|name| name.to_str()) {
                Some("1") if is_own => Place::Standard(io::stdout().as_fd().try_clone_to_owned().map(File::from)),
                Some("2") if is_own => Place::Standard(io::stderr().as_fd().try_clone_to_owned().map(File::from)),
                _ => Place::There,
            };
        }
        let Ok(next) = place.read_link() else { break };
        place = folder.join(next);
    }
    match fs::metadata(&place) {
        Ok(there) if !there.is_file() && !there.is_dir() => Place::There,
        _ => Place::File(place),
    }
}

/// Whether an HDF5 file is at `path`, by how it begins.
fn is_hdf5(path: &Path) -> bool {
    let mut begin = [0; HDF5_SIGNATURE.len()];
    let is_file = fs::metadata(path).is_ok_and(|there| there.is_file());
    is_file && File::open(path).and_then(|mut file| file.read_exact(&mut begin)).is_ok() && begin == HDF5_SIGNATURE
}
