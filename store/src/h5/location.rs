//! Where a chunk of samples lies in the file.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;

/// Address and length of a chunk, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ChunkLocation {
    pub address: u64,
    pub length: usize,
}

impl ChunkLocation {
    /// Reads the chunk from `file` into `stored`, whose old contents are lost.
    ///
    /// # Errors
    /// What the system returns.
    pub(crate) fn read(self, file: &File, stored: &mut Vec<u8>) -> io::Result<()> {
        // A damaged length must not allocate more memory than the file has bytes.
        if self.length as u64 > file.metadata()?.len() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        stored.resize(self.length, 0);
        file.read_exact_at(stored, self.address)
    }
}
