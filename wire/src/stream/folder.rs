//! The private folder of a line: where it may be, how it is made, and when a file is private.

use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{FileType, Mode, OFlags, Stat};
use rustix::io::Errno;

use crate::LineError;

/// Beginning of the name of every line's folder; its token follows.
pub(crate) const PREFIX: &str = "tapline-";

/// Digits of a token: 64 random bits in hexadecimal.
pub(crate) const TOKEN_DIGITS: usize = 16;

/// Longest path of a line's folder, in bytes. The layer's longest name, of a connection, has 156: the prefix, a hash, two
/// numbers of up to 39 digits, and its kind. The layer appends it to this path, for 255 in all.
pub(crate) const ROOT_BYTES_MAX: usize = 96;

/// Checks that a file is of this kind, belongs to this user, is closed to others and, unless it is a folder, has no second name.
pub(crate) fn check_private(path: &Path, stat: &Stat, kind: FileType) -> Result<(), LineError> {
    if FileType::from_raw_mode(stat.st_mode) != kind {
        return Err(LineError::not_ours(path, "is not the kind of file that a line makes"));
    }
    if stat.st_uid != rustix::process::geteuid().as_raw() {
        return Err(LineError::not_ours(path, format!("belongs to user {}", stat.st_uid)));
    }
    if stat.st_mode & 0o077 != 0 {
        return Err(LineError::not_ours(path, format!("is open to other users (mode {:03o})", stat.st_mode & 0o777)));
    }
    if kind != FileType::Directory && stat.st_nlink > 1 {
        return Err(LineError::not_ours(path, "has a second name"));
    }
    Ok(())
}

/// Opens a line's folder if it is private.
pub(crate) fn open_private(root: &Path) -> Result<OwnedFd, LineError> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let folder = match rustix::fs::open(root, flags, Mode::empty()) {
        Ok(folder) => folder,
        Err(Errno::LOOP | Errno::NOTDIR) => return Err(LineError::not_ours(root, "is a link or a file")),
        Err(Errno::ACCESS) => return Err(LineError::not_ours(root, "belongs to another user")),
        Err(error) => return Err(LineError::io(root, error)),
    };
    let stat = rustix::fs::fstat(&folder).map_err(|e| LineError::io(root, e))?;
    check_private(root, &stat, FileType::Directory)?;
    Ok(folder)
}

/// Folders in which a line may make its own, the best first.
pub(crate) fn bases() -> Vec<PathBuf> {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    let runtime = runtime.filter(|folder| folder.is_absolute() && open_private(folder).is_ok());
    runtime.into_iter().chain([std::env::temp_dir(), PathBuf::from("/tmp")]).collect()
}

/// Makes a new folder of a line in `base`.
pub(crate) fn create(base: &Path) -> Result<PathBuf, String> {
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let base = base.canonicalize().map_err(|e| text(&e))?;
    let there = base.metadata().map_err(|e| text(&e))?;
    if ![0, rustix::process::geteuid().as_raw()].contains(&there.uid()) {
        return Err(format!("it belongs to user {}", there.uid()));
    }
    if there.mode() & 0o022 != 0 && there.mode() & 0o1000 == 0 {
        return Err("others may remove its files (it is not sticky)".to_owned());
    }
    if base.as_os_str().len() + 1 + PREFIX.len() + TOKEN_DIGITS > ROOT_BYTES_MAX {
        return Err(format!("its path has more than {} bytes", ROOT_BYTES_MAX - 1 - PREFIX.len() - TOKEN_DIGITS));
    }
    for _ in 0..16 {
        let mut token = [0_u8; TOKEN_DIGITS / 2];
        let filled = rustix::rand::getrandom(&mut token, rustix::rand::GetRandomFlags::empty());
        if filled.map_err(|e| text(&e))? != token.len() {
            return Err("the system gives no random numbers".to_owned());
        }
        let root = base.join(format!("{PREFIX}{:016x}", u64::from_le_bytes(token)));
        match rustix::fs::mkdir(&root, Mode::RWXU) {
            Ok(()) => return Ok(root),
            Err(Errno::EXIST) => {}
            Err(error) => return Err(text(&error)),
        }
    }
    Err("every name is taken".to_owned())
}

pub(crate) fn path_bytes(path: &Path) -> &[u8] {
    std::os::unix::ffi::OsStrExt::as_bytes(path.as_os_str())
}
