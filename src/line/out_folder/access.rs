//! Who may change an output folder: only its owner, because others could replace results.

use std::os::fd::OwnedFd;
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use rustix::fs::{AtFlags, CWD, FileType, Mode, OFlags, Stat};
use rustix::io::Errno;

/// Identifies the folder, wherever its path leads by now.
pub(super) type FolderId = (u64, u64);

/// Makes the folder and those above it.
pub(super) fn make_all(path: &Path) -> Result<()> {
    match std::fs::create_dir_all(path) {
        Ok(()) => Ok(()),
        Err(_) if path.metadata().is_ok_and(|there| !there.is_dir()) => {
            bail!("{} is a file; the output of a line is a folder", path.display())
        }
        Err(error) => Err(error).with_context(|| format!("cannot make the folder {}", path.display())),
    }
}

pub(super) fn open_folder(path: &Path) -> Result<OwnedFd, Errno> {
    rustix::fs::open(path, OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC, Mode::empty())
}

/// Opens the folder if no other user can put files into it.
pub(super) fn open_checked(path: &Path) -> Result<OwnedFd> {
    let us = rustix::process::geteuid().as_raw();
    let is_trusted = |stat: &Stat| stat.st_uid == us || stat.st_uid == 0;
    let name = rustix::fs::statat(CWD, path, AtFlags::SYMLINK_NOFOLLOW)
        .with_context(|| format!("cannot look at {}", path.display()))?;
    ensure!(is_trusted(&name), "{}: {}", path.display(), owned_by(&name));
    let folder = open_folder(path).with_context(|| format!("cannot look into {}", path.display()))?;
    let stat = rustix::fs::fstat(&folder).with_context(|| format!("cannot look at {}", path.display()))?;
    ensure!(is_trusted(&stat), "{}: {}", path.display(), owned_by(&stat));
    ensure!(
        stat.st_mode & 0o002 == 0 || stat.st_mode & 0o1000 != 0,
        "everyone may write to {} and could change results there: chmod o-w it, or give another --out",
        path.display()
    );
    Ok(folder)
}

fn owned_by(stat: &Stat) -> String {
    format!(
        "it belongs to user {}, who could change results there: use a folder of your own, or run the line as that user",
        stat.st_uid
    )
}

/// Makes the folder `inner` for the line's own files, or checks an existing one.
pub(super) fn make_inner(folder: &OwnedFd, path: &Path, inner: &str) -> Result<()> {
    let name = path.join(inner);
    match rustix::fs::mkdirat(folder, inner, Mode::from_raw_mode(0o777)) {
        Ok(()) | Err(Errno::EXIST) => {}
        Err(error) => return Err(error).with_context(|| format!("cannot make the folder {}", name.display())),
    }
    let stat = rustix::fs::statat(folder, inner, AtFlags::SYMLINK_NOFOLLOW)
        .with_context(|| format!("cannot look at {}", name.display()))?;
    let is_folder = FileType::from_raw_mode(stat.st_mode) == FileType::Directory;
    ensure!(is_folder, "{} is not a folder: a line keeps files of its own there", name.display());
    let is_ours = stat.st_uid == rustix::process::geteuid().as_raw();
    ensure!(is_ours, "{}: {}", name.display(), owned_by(&stat));
    ensure!(stat.st_mode & 0o002 == 0, "everyone may write to {}: chmod o-w it", name.display());
    Ok(())
}

pub(super) fn id_of(folder: &OwnedFd, path: &Path) -> Result<FolderId> {
    let stat = rustix::fs::fstat(folder).with_context(|| format!("cannot look at {}", path.display()))?;
    Ok((stat.st_dev, stat.st_ino))
}
