//! Shared memory as a resource: checked before anything is created, then reserved. A process is killed if it touches a
//! promised page that a full `/dev/shm` cannot provide.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::{FallocateFlags, FileType, Mode, OFlags};
use rustix::io::{Errno, retry_on_intr};

use crate::stream::cleanup::{SHM, segments};
use crate::{LineAddress, LineError};

/// Bytes of a block in the system's count of the blocks of a file.
const BLOCK_BYTES: u64 = 512;

/// Time between two attempts while memory is short.
const RETRY_EVERY: Duration = Duration::from_millis(200);

/// Bytes free in shared memory.
///
/// # Errors
/// [`LineError::File`] if the system call fails.
pub fn free_bytes() -> Result<u64, LineError> {
    let stat = rustix::fs::statvfs(SHM).map_err(|error| LineError::io(Path::new(SHM), error))?;
    Ok(stat.f_bavail * stat.f_frsize)
}

/// Repeats `attempt` while it fails with [`LineError::NoRoom`].
///
/// # Errors
/// Other errors of `attempt`; [`LineError::Stopped`] if `is_stopped` becomes true.
pub fn retry_until_free<R>(
    is_stopped: &dyn Fn() -> bool,
    mut attempt: impl FnMut() -> Result<R, LineError>,
) -> Result<R, LineError> {
    let mut is_logged = false;
    loop {
        match attempt() {
            Err(error @ LineError::NoRoom { .. }) => {
                if is_stopped() {
                    return Err(LineError::Stopped { topic: "shared memory" });
                }
                if !std::mem::replace(&mut is_logged, true) {
                    tracing::error!("{error}; the line waits for it");
                }
                std::thread::sleep(RETRY_EVERY);
            }
            other => {
                if is_logged && other.is_ok() {
                    tracing::warn!("there is enough shared memory again");
                }
                return other;
            }
        }
    }
}

/// Reserves the memory of all present segments of the line, of every process: the layer only promises it. Returns how many
/// bytes they lacked.
///
/// Call it after a publisher is made, and again after a subscriber has joined, because each pair has a segment of its own. A
/// segment that is reserved already costs one system call.
///
/// # Errors
/// [`LineError::NoRoom`] if there is too little memory: then send nothing, and drop the publisher. [`LineError::File`] if a
/// segment cannot be used.
pub fn reserve(what: &str, address: &LineAddress) -> Result<u64, LineError> {
    let lacking: Vec<(PathBuf, u64)> =
        segments(address.prefix()).filter_map(|path| missing_bytes(&path).map(|bytes| (path, bytes))).collect();
    let bytes = lacking.iter().map(|(_, bytes)| bytes).sum();
    if bytes > 0 {
        compare(what, bytes, free_bytes()?)?;
    }
    for (path, _) in &lacking {
        match fill(path) {
            Ok(()) | Err(Errno::NOENT) => {} // its owner has gone meanwhile
            Err(Errno::NOSPC) => {
                return Err(LineError::NoRoom { what: what.to_owned(), need: bytes, free: free_bytes()? });
            }
            Err(error) => return Err(LineError::io(path, error)),
        }
    }
    Ok(bytes)
}

/// Bytes that the segment was promised and does not have; `None` if there are none.
fn missing_bytes(path: &Path) -> Option<u64> {
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
    retry_on_intr(|| rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, stat.st_size.unsigned_abs()))
}

/// Refuses more than is free, with both numbers.
pub(crate) fn compare(what: &str, need: u64, free: u64) -> Result<(), LineError> {
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
    fn too_little_free_memory_is_refused_with_both_numbers() {
        let error = compare("taps of station 1", 2_000_000, 1_999_999).unwrap_err().to_string();
        assert!(error.contains("taps of station 1"), "{error}");
        assert!(error.contains("2.0 MB") && error.contains("/dev/shm"), "{error}");
    }

    #[test]
    fn what_is_reserved_is_there_and_what_cannot_be_is_logged() {
        let address = LineAddress::fresh().unwrap();
        reserve("all", &address).unwrap();
        let path = Path::new(SHM).join(format!("{}data", address.prefix()));
        let file = File::create(&path).unwrap();
        file.set_len(1 << 20).unwrap();
        assert_eq!(reserve("all", &address).unwrap(), 1 << 20);
        assert_eq!(missing_bytes(&path), None);
        assert_eq!(reserve("all", &address).unwrap(), 0);
        file.set_len(1 << 50).unwrap();
        let error = reserve("all", &address).unwrap_err();
        assert!(matches!(&error, LineError::NoRoom { need, free, .. } if need > free), "{error}");
        assert!(address.clear().unwrap());
    }

    #[test]
    fn memory_is_waited_for_until_it_is_free_or_the_line_ends() {
        let attempts = Cell::new(0);
        let come = retry_until_free(&|| false, || {
            attempts.set(attempts.get() + 1);
            if attempts.get() < 3 { compare("it", 2, 1) } else { Ok(()) }
        });
        assert!(come.is_ok() && attempts.get() == 3);
        let ended = retry_until_free(&|| true, || compare("everything", u64::MAX, free_bytes()?)).unwrap_err();
        assert!(matches!(ended, LineError::Stopped { .. }), "{ended}");
    }
}
