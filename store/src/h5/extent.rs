//! A stretch of a file, such as a chunk of samples.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt as _;

/// A stretch of a file: its address and its length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Extent {
    pub begin: u64,
    pub bytes: u64,
}

impl Extent {
    /// The address behind its last byte.
    pub(crate) fn end(self) -> u64 {
        self.begin.saturating_add(self.bytes)
    }

    /// Reads it from `file` into `stored`, whose old contents are lost.
    pub(crate) fn read(self, file: &File, stored: &mut Vec<u8>) -> io::Result<()> {
        self.make_room(file, stored)?;
        file.read_exact_at(stored, self.begin)
    }

    /// Makes `stored` as long as it is; its bytes are read later.
    pub(crate) fn make_room(self, file: &File, stored: &mut Vec<u8>) -> io::Result<()> {
        // A damaged length must not allocate more memory than the file has bytes.
        if self.bytes > stored.capacity() as u64 && self.bytes > file.metadata()?.len() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        stored.resize(self.bytes as usize, 0);
        Ok(())
    }

    /// Reads the bytes `part` of it to their place in `stored`, which [has room](Self::make_room) for all of it.
    pub(crate) fn read_part(self, file: &File, stored: &mut [u8], part: Range<usize>) -> io::Result<()> {
        let address = self.begin + part.start as u64;
        file.read_exact_at(&mut stored[part], address)
    }
}
