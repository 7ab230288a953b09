//! Room in shared memory: checked before anything is created, and then reserved, since a full `/dev/shm` kills whoever
//! touches a page that was promised and is not there.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::{FallocateFlags, FileType, Mode, OFlags};
use rustix::io::Errno;

use crate::stream::address::{SHM, segments};
use crate::{LineAddress, LineError};

/// Bytes of one block in what the system tells of a file.
const BLOCK_BYTES: u64 = 512;

/// How often room is looked for while it is waited for.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Bytes free in shared memory.
///
/// # Errors
/// [`LineError::NoSharedMemory`] when it cannot be asked.
pub fn free_bytes() -> Result<u64, LineError> {
    let stat = rustix::fs::statvfs(SHM).map_err(|source| LineError::NoSharedMemory { source: source.into() })?;
    Ok(stat.f_bavail * stat.f_frsize)
}

/// Checks that `need_bytes` of shared memory are free for `what`.
///
/// # Errors
/// [`LineError::NoRoom`] with both numbers and the cure, when they are not.
pub fn check(what: &str, need_bytes: usize) -> Result<(), LineError> {
    enough(what, need_bytes as u64, free_bytes()?)
}

/// Waits until `need_bytes` of shared memory are free for `what`, and says that it waits, and that it has ended.
///
/// For a stage that starts again in the middle of a line: what fills the memory will end, or be ended.
///
/// # Errors
/// [`LineError::Stopped`] when `is_stopped` says so meanwhile; [`LineError::NoSharedMemory`].
pub fn wait(what: &str, need_bytes: usize, is_stopped: impl Fn() -> bool) -> Result<(), LineError> {
    wait_for(&is_stopped, || check(what, need_bytes))
}

/// Does `attempt` again and again while it fails for want of room, as [`wait`] does.
///
/// # Errors
/// As `attempt`, but for [`LineError::NoRoom`]; [`LineError::Stopped`] when `is_stopped` says so meanwhile.
pub fn wait_for<R>(
    is_stopped: &dyn Fn() -> bool,
    mut attempt: impl FnMut() -> Result<R, LineError>,
) -> Result<R, LineError> {
    let mut is_told = false;
    loop {
        match attempt() {
            Err(error @ LineError::NoRoom { .. }) => {
                if is_stopped() {
                    return Err(LineError::Stopped { topic: "shared memory" });
                }
                if !std::mem::replace(&mut is_told, true) {
                    tracing::error!("{error}; the line waits for it");
                }
                std::thread::sleep(LOOK_EVERY);
            }
            other => {
                if is_told && other.is_ok() {
                    tracing::warn!("there is room in shared memory again");
                }
                return other;
            }
        }
    }
}

/// What was reserved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Reserved {
    /// Segments that were not all there.
    pub segments: usize,
    /// Bytes that they were given.
    pub bytes: u64,
}

/// Reserves all memory of the line's segments that are there now, of whichever process: the layer only promises it.
///
/// To be called after a publisher was made, and again after a subscriber has come to it, as each pair has a segment of
/// its own. What is reserved already costs one look at each file.
///
/// # Errors
/// [`LineError::NoRoom`] when it is not there; nothing is to be sent then, and what was made is best let go.
/// [`LineError::File`] when a segment cannot be used.
pub fn reserve(what: &str, address: &LineAddress) -> Result<Reserved, LineError> {
    let wanting: Vec<(PathBuf, u64)> =
        segments(address.prefix()).filter_map(|path| wanting_bytes(&path).map(|bytes| (path, bytes))).collect();
    let bytes = wanting.iter().map(|(_, bytes)| bytes).sum();
    if bytes > 0 {
        enough(what, bytes, free_bytes()?)?;
    }
    for (path, _) in &wanting {
        match fill(path) {
            Ok(()) | Err(Errno::NOENT) => {} // its owner has gone meanwhile
            Err(Errno::NOSPC) => {
                return Err(LineError::NoRoom { what: what.to_owned(), need: bytes, free: free_bytes()? });
            }
            Err(error) => return Err(LineError::io(path, error)),
        }
    }
    Ok(Reserved { segments: wanting.len(), bytes })
}

/// Bytes that the segment has been promised and not given, `None` when there are none.
fn wanting_bytes(path: &Path) -> Option<u64> {
    use std::os::unix::fs::MetadataExt as _;
    let segment = path.symlink_metadata().ok()?;
    let bytes = segment.len().saturating_sub(segment.blocks() * BLOCK_BYTES);
    (bytes > 0).then_some(bytes)
}

fn fill(path: &Path) -> Result<(), Errno> {
    let flags = OFlags::WRONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let file = rustix::fs::open(path, flags, Mode::empty())?;
    let stat = rustix::fs::fstat(&file)?;
    if FileType::from_raw_mode(stat.st_mode) != FileType::RegularFile || stat.st_size <= 0 {
        return Ok(());
    }
    loop {
        match rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, stat.st_size.unsigned_abs()) {
            Err(Errno::INTR) => {}
            filled => return filled,
        }
    }
}

fn enough(what: &str, need: u64, free: u64) -> Result<(), LineError> {
    if need > free {
        return Err(LineError::NoRoom { what: what.to_owned(), need, free });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::fs::File;

    use super::*;

    #[test]
    fn room_that_is_there_passes_and_room_that_is_not_names_both_numbers() {
        assert!(check("nothing", 0).is_ok());
        let error = enough("taps of station 1", 2_000_000, 1_999_999).unwrap_err().to_string();
        assert!(error.contains("taps of station 1"), "{error}");
        assert!(error.contains("2.0 MB") && error.contains("/dev/shm"), "{error}");
        let error = check("everything", usize::MAX / 2).unwrap_err();
        assert!(matches!(error, LineError::NoRoom { .. }), "{error}");
    }

    #[test]
    fn what_is_reserved_is_there_and_what_cannot_be_is_told() {
        let address = LineAddress::fresh().unwrap();
        reserve("all", &address).unwrap();
        let path = Path::new(SHM).join(format!("{}data", address.prefix()));
        let file = File::create(&path).unwrap();
        file.set_len(1 << 20).unwrap();
        let reserved = reserve("all", &address).unwrap();
        assert_eq!(reserved, Reserved { segments: 1, bytes: 1 << 20 });
        assert_eq!(wanting_bytes(&path), None);
        assert_eq!(reserve("all", &address).unwrap(), Reserved::default());
        file.set_len(1 << 50).unwrap();
        let error = reserve("all", &address).unwrap_err();
        assert!(matches!(&error, LineError::NoRoom { need, free, .. } if need > free), "{error}");
        assert!(address.clear().unwrap());
    }

    #[test]
    fn room_is_waited_for_until_it_is_there_or_the_line_ends() {
        let attempts = Cell::new(0);
        let come = wait_for(&|| false, || {
            attempts.set(attempts.get() + 1);
            if attempts.get() < 3 { enough("it", 2, 1) } else { Ok(()) }
        });
        assert!(come.is_ok() && attempts.get() == 3);
        let ended = wait("everything", usize::MAX / 2, || true).unwrap_err();
        assert!(matches!(ended, LineError::Stopped { .. }), "{ended}");
    }
}
