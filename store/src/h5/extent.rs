//! Where a chunk of samples lies in the file.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt as _;

/// Address and length of a chunk, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ChunkLocation {
    pub address: u64,
    pub length: usize,
}

impl ChunkLocation {
    /// Reads the chunk from `file` into `stored`, whose old contents are lost.
    pub(crate) fn read(self, file: &File, stored: &mut Vec<u8>) -> io::Result<()> {
        self.make_room(file, stored)?;
        file.read_exact_at(stored, self.address)
    }

    /// Makes `stored` as long as the chunk, whose bytes are read later.
    pub(crate) fn make_room(self, file: &File, stored: &mut Vec<u8>) -> io::Result<()> {
        // A damaged length must not allocate more memory than the file has bytes.
        if self.length > stored.capacity() && self.length as u64 > file.metadata()?.len() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        stored.resize(self.length, 0);
        Ok(())
    }

    /// Reads the bytes `part` of the chunk to their place in `stored`, which [has room](Self::make_room) for the whole chunk.
    pub(crate) fn read_part(self, file: &File, stored: &mut [u8], part: Range<usize>) -> io::Result<()> {
        let address = self.address + part.start as u64;
        file.read_exact_at(&mut stored[part], address)
    }
}
