//! A file as memory: what is read of it is read where it lies, without a copy.
#![expect(unsafe_code, reason = "memory that stands for a file is what others make of the file")]

use std::fs::File;
use std::io;

use memmap2::Mmap;

use crate::h5::location::ChunkLocation;

/// The bytes of a file which nobody cuts short: who reads what is gone is ended by the system (`SIGBUS`).
#[derive(Debug)]
pub(crate) struct Mapped {
    bytes: Mmap,
}

impl Mapped {
    /// The bytes that `file` has now.
    ///
    /// # Errors
    /// What the system says.
    pub(crate) fn new(file: &File) -> io::Result<Self> {
        // SAFETY: nobody writes the file while the library's lock on it is held, which is as long as the archive is open. Who
        // does not heed the lock may give other bytes, of which whatever is read is checked, and which are unpacked by code that
        // stays within bounds whatever they say; where they are cut off there is no memory, and the system ends who reads it.
        Ok(Self { bytes: unsafe { Mmap::map(file)? } })
    }

    /// Those at `place`.
    ///
    /// # Errors
    /// Where the file has not so many.
    pub(crate) fn at(&self, place: ChunkLocation) -> io::Result<&[u8]> {
        let bytes = usize::try_from(place.address).ok().and_then(|begin| self.bytes.get(begin..)?.get(..place.length));
        bytes.ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
    }
}
