//! Bytes of a file, read from start to end.

use crate::error::{Fault, broken};

/// What is left of some bytes, whose numbers are in one order.
pub(super) struct Bytes<'a> {
    pub left: &'a [u8],
    pub is_big_endian: bool,
}

impl<'a> Bytes<'a> {
    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        match self.left.split_at_checked(count) {
            Some((taken, left)) => {
                self.left = left;
                Ok(taken)
            }
            None => broken(format!("a part of it ends after {} bytes; {count} are needed", self.left.len())),
        }
    }

    /// The bytes of a number, the lowest first.
    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if self.is_big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    pub(super) fn u32(&mut self) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(super) fn u64(&mut self) -> Result<u64, Fault> {
        Ok(u64::from_le_bytes(self.array()?))
    }
}
