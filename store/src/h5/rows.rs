//! Rows written to a table as they lie in memory.
#![expect(unsafe_code, reason = "the safe crate describes a row to the library each time it writes one")]

use std::marker::PhantomData;

use hdf5::sync::sync;
use hdf5::{Dataset, Dataspace, Datatype, Error};
use hdf5_sys::h5d::H5Dwrite;
use hdf5_sys::h5p::H5P_DEFAULT;

use crate::format::checksum::PlainRow;

/// The type of rows `R` in memory, as the library knows it.
#[derive(Debug)]
pub(crate) struct InMemory<R>(Datatype, PhantomData<R>);

impl<R: PlainRow> InMemory<R> {
    /// Describes it to the library, which takes as long as to write some dozens of rows.
    ///
    /// # Errors
    /// What the library says.
    pub(crate) fn describe() -> hdf5::Result<Self> {
        Ok(Self(Datatype::from_type::<R>()?, PhantomData))
    }
}

/// Writes `rows` to a one-dimensional `dataset`, from row `first` on. The safe crate would describe them anew each time.
///
/// # Errors
/// What the library says.
pub(crate) fn write_rows<R: PlainRow>(
    dataset: &Dataset,
    in_memory: &InMemory<R>,
    first: usize,
    rows: &[R],
) -> hdf5::Result<()> {
    let to = dataset.space()?.select(first..first + rows.len())?;
    let from = Dataspace::try_new(rows.len())?;
    sync(|| {
        // SAFETY: the lock of the library is held and all identifiers are valid while what they are of lives. The type is that
        // of `R`, so that the library reads as many of them as `from` and `to` have, which is all of `rows`.
        let status =
            unsafe { H5Dwrite(dataset.id(), in_memory.0.id(), from.id(), to.id(), H5P_DEFAULT, rows.as_ptr().cast()) };
        if status < 0 { Err(Error::query()?) } else { Ok(()) }
    })
}
