//! Room in shared memory, checked before anything is created: a full `/dev/shm` kills a writer with SIGBUS later on.

use crate::LineError;

/// Where shared memory lives.
const SHM: &str = "/dev/shm";

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
    enough(what, need_bytes, free_bytes()?)
}

fn enough(what: &str, need_bytes: usize, free: u64) -> Result<(), LineError> {
    let need = need_bytes as u64;
    if need > free {
        return Err(LineError::NoRoom { what: what.to_owned(), need, free });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
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
}
