//! The checksum of each row, by which a single changed bit is found and located.
//!
//! Rows and packed chunks are checked at every read, and have an XXH3. Samples also have a BLAKE3, to which results are
//! traced; it costs ten times as much.
#![expect(unsafe_code, reason = "a row is checked as the bytes that go to the file")]

use hdf5::H5Type;
use twox_hash::XxHash3_64;

use crate::format::layout::table;

/// A row that is stored as its bytes in memory.
///
/// # Safety
/// The type is `repr(C)`, without padding and without pointers: all of its bytes are defined.
pub(crate) unsafe trait PlainRow: H5Type + Copy {
    /// The bytes.
    fn bytes(&self) -> &[u8] {
        // SAFETY: the implementer has no padding, so every byte of the value is initialised; the slice borrows it.
        unsafe { std::slice::from_raw_parts(std::ptr::from_ref(self).cast(), size_of::<Self>()) }
    }
}

/// A row that carries a checksum of itself.
pub(crate) trait ChecksummedRow: PlainRow {
    /// Path of its table.
    const TABLE: &'static str;

    /// The field of the checksum.
    fn checksum(&mut self) -> &mut u64;

    /// The row with the checksum of row `number` of its table.
    fn with_checksum(mut self, number: usize) -> Self {
        *self.checksum() = 0;
        *self.checksum() = checksum(&[Self::TABLE.as_bytes(), &(number as u64).to_le_bytes(), self.bytes()]);
        self
    }

    /// Whether the checksum is that of row `number` of the table, as it was written.
    fn is_valid(mut self, number: usize) -> bool {
        let stored = *self.checksum();
        *self.with_checksum(number).checksum() == stored
    }
}

/// The XXH3 of `parts` one after another.
pub(crate) fn checksum(parts: &[&[u8]]) -> u64 {
    XxHash3_64::oneshot(&parts.concat())
}

macro_rules! checksummed {
    ($($row:ident in $table:ident),* $(,)?) => {$(
        // SAFETY: `layout` declares it `repr(C)` of numbers and byte arrays, and its tests check that it is not padded.
        unsafe impl PlainRow for crate::format::layout::$row {}

        impl ChecksummedRow for crate::format::layout::$row {
            const TABLE: &'static str = table::$table;

            fn checksum(&mut self) -> &mut u64 {
                &mut self.checksum
            }
        }
    )*};
}

checksummed! {
    PlanRow in PLAN,
    HeaderRow in HEADER,
    DiscriminatorsRow in DISCRIMINATORS,
    LedgerRow in LEDGER,
    ReasonRow in REFUSALS,
    ScanRow in SCANS,
    CellRow in DAMAGE,
}

// SAFETY: as above.
unsafe impl PlainRow for crate::format::layout::TruthRow {}

#[cfg(test)]
mod tests {
    use tapline_wire::TapState;

    use super::*;
    use crate::format::layout::LedgerRow;

    /// Catches a bit that the checksum does not cover, and a row that passes for another row.
    #[test]
    fn every_bit_of_a_row_is_covered() {
        let row = LedgerRow::new(TapState::Archived, 3).with_checksum(7);
        assert!(row.is_valid(7) && !row.is_valid(8));
        for bit in 0..8 * size_of::<LedgerRow>() {
            let mut bytes: [u8; size_of::<LedgerRow>()] = row.bytes().try_into().unwrap();
            bytes[bit / 8] ^= 1 << (bit % 8);
            // SAFETY: every pattern of bits is a row of integers.
            let bent: LedgerRow = unsafe { std::ptr::read_unaligned(bytes.as_ptr().cast()) };
            assert!(!bent.is_valid(7), "bit {bit}");
        }
    }
}
