//! Where a chunk of samples lies in the file.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;

/// Where a row lies in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ChunkLocation {
    pub address: u64,
    pub length: usize,
}

impl ChunkLocation {
    /// Reads the row's bytes from `file` into `stored`, whose old contents are lost.
    ///
    /// # Errors
    /// What the system says.
    pub(crate) fn read(self, file: &File, stored: &mut Vec<u8>) -> io::Result<()> {
        // A length that is damaged must not ask for memory that no file has.
        if self.length as u64 > file.metadata()?.len() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        stored.resize(self.length, 0);
        file.read_exact_at(stored, self.address)
    }
}
