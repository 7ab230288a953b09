//! The elements that an array of a MATLAB file is written as, one after the other.

use crate::error::{Fault, broken};
use crate::format::bytes::Bytes;

impl<'a> Bytes<'a> {
    /// Type and bytes of the next element.
    pub(super) fn element(&mut self) -> Result<(u32, &'a [u8]), Fault> {
        let first = self.u32()?;
        // Up to four bytes follow a short tag.
        if first >> 16 != 0 {
            let (kind, count) = (first & 0xffff, (first >> 16) as usize);
            let data = self.take(4)?;
            return match data.get(..count) {
                Some(data) => Ok((kind, data)),
                None => broken(format!("a short element of an array has {count} bytes; at most 4 fit")),
            };
        }
        let count = self.u32()? as usize;
        let data = self.take(count)?;
        // The last element may end without its padding.
        let padding = (count.next_multiple_of(8) - count).min(self.left.len());
        self.take(padding)?;
        Ok((first, data))
    }

    /// The next element, which has whole numbers of 32 bits.
    pub(super) fn words(&mut self, most: usize, what: &str) -> Result<Vec<u32>, Fault> {
        let (_, left) = self.element()?;
        if left.len() / 4 > most {
            return broken(format!("an array has {} {what}; at most {most} are read", left.len() / 4));
        }
        let mut words = Bytes { left, is_big_endian: self.is_big_endian };
        (0..left.len() / 4).map(|_| words.u32()).collect()
    }
}
