//! The numbers of an array of a MATLAB file.

use crate::error::{Fault, broken};

/// Numbers as they are in the file, which may be narrower than the class of their array.
pub(super) struct Numbers<'a> {
    pub kind: u32,
    pub bytes: &'a [u8],
    pub is_big_endian: bool,
}

impl Numbers<'_> {
    /// `count` numbers at the places that `place` gives.
    pub(super) fn each<const N: usize, T>(
        &self,
        count: usize,
        place: impl Fn(usize) -> usize,
        number: impl Fn([u8; N]) -> T,
    ) -> Result<Vec<T>, Fault> {
        let (numbers, _) = self.bytes.as_chunks::<N>();
        let got = numbers.len();
        let one = |k: usize| {
            let mut bytes = *numbers
                .get(place(k))
                .ok_or_else(|| Fault::Broken(format!("an array has {got} numbers; its shape asks for more")))?;
            if self.is_big_endian {
                bytes.reverse();
            }
            Ok(number(bytes))
        };
        // Checked before memory is asked for.
        if count > 0 {
            one(count - 1)?;
        }
        (0..count).map(one).collect()
    }

    pub(super) fn doubles(&self, count: usize, place: impl Fn(usize) -> usize) -> Result<Vec<f64>, Fault> {
        match self.kind {
            9 => self.each(count, place, f64::from_le_bytes),
            7 => self.each(count, place, |bytes| f32::from_le_bytes(bytes).into()),
            #[expect(clippy::cast_precision_loss, reason = "doubles that were stored as integers")]
            _ => Ok(self.integers(count, place)?.into_iter().map(|integer| integer as f64).collect()),
        }
    }

    pub(super) fn integers(&self, count: usize, place: impl Fn(usize) -> usize) -> Result<Vec<i64>, Fault> {
        match self.kind {
            1 => self.each(count, place, |bytes| i8::from_le_bytes(bytes).into()),
            2 => self.each(count, place, |bytes| u8::from_le_bytes(bytes).into()),
            3 => self.each(count, place, |bytes| i16::from_le_bytes(bytes).into()),
            4 => self.each(count, place, |bytes| u16::from_le_bytes(bytes).into()),
            5 => self.each(count, place, |bytes| i32::from_le_bytes(bytes).into()),
            6 => self.each(count, place, |bytes| u32::from_le_bytes(bytes).into()),
            12 => self.each(count, place, i64::from_le_bytes),
            13 => self.each(count, place, |bytes| i64::try_from(u64::from_le_bytes(bytes)).unwrap_or(i64::MAX)),
            kind => broken(format!("an array of integers holds data of type {kind}")),
        }
    }
}
