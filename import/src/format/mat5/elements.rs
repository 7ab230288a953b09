//! The elements that an array of a MATLAB file is written as.

use crate::error::{Fault, broken};

/// The elements of an array, one after the other.
pub(super) struct Elements<'a> {
    pub bytes: &'a [u8],
    pub is_big_endian: bool,
}

impl<'a> Elements<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        match self.bytes.split_at_checked(count) {
            Some((taken, rest)) => {
                self.bytes = rest;
                Ok(taken)
            }
            None => broken(format!("an array ends after {} bytes; its next element has {count}", self.bytes.len())),
        }
    }

    fn word(&self, bytes: &[u8]) -> u32 {
        let word = bytes.try_into().unwrap_or_default();
        if self.is_big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) }
    }

    /// Type and bytes of the next element.
    pub(super) fn next(&mut self) -> Result<(u32, &'a [u8]), Fault> {
        let first = self.take(4)?;
        let first = self.word(first);
        // Up to four bytes follow a short tag.
        if first >> 16 != 0 {
            let (kind, count) = (first & 0xffff, (first >> 16) as usize);
            let data = self.take(4)?;
            return match data.get(..count) {
                Some(data) => Ok((kind, data)),
                None => broken(format!("a short element of an array has {count} bytes; at most 4 fit")),
            };
        }
        let count = self.take(4)?;
        let count = self.word(count) as usize;
        let data = self.take(count)?;
        // The last element may end without its padding.
        let padding = (count.next_multiple_of(8) - count).min(self.bytes.len());
        self.take(padding)?;
        Ok((first, data))
    }

    /// Whole numbers of 32 bits.
    pub(super) fn words(&mut self, most: usize, what: &str) -> Result<Vec<u32>, Fault> {
        let (_, bytes) = self.next()?;
        if bytes.len() / 4 > most {
            return broken(format!("an array has {} {what}; at most {most} are read", bytes.len() / 4));
        }
        Ok(bytes.chunks_exact(4).map(|word| self.word(word)).collect())
    }
}
