//! Writes rows to a table as they are in memory.
#![expect(unsafe_code, reason = "the safe crate describes the row type to the library at every write")]

use std::marker::PhantomData;

use hdf5::sync::sync;
use hdf5::{Dataset, Dataspace, Datatype, Error};
use hdf5_sys::h5d::H5Dwrite;
use hdf5_sys::h5p::H5P_DEFAULT;

use crate::format::checksum::PlainRow;

/// The library's description of rows `R` in memory.
#[derive(Debug)]
pub(crate) struct InMemory<R>(Datatype, PhantomData<R>);

impl<R: PlainRow> InMemory<R> {
    /// Describes `R` to the library, which takes as long as writing dozens of rows.
    pub(crate) fn describe() -> hdf5::Result<Self> {
        Ok(Self(Datatype::from_type::<R>()?, PhantomData))
    }
}

/// Writes `rows` to the one-dimensional `dataset`, from row `first` on.
pub(crate) fn write_rows<R: PlainRow>(
    dataset: &Dataset,
    in_memory: &InMemory<R>,
    first: usize,
    rows: &[R],
) -> hdf5::Result<()> {
    let to = dataset.space()?.select(first..first + rows.len())?;
    let from = Dataspace::try_new(rows.len())?;
    sync(|| {
        // SAFETY: the lock of the library is held and the owners of all identifiers live. The type describes `R`, and `from`
        // and `to` have `rows.len()` rows, so the library reads `rows` and nothing beyond.
        let status =
            unsafe { H5Dwrite(dataset.id(), in_memory.0.id(), from.id(), to.id(), H5P_DEFAULT, rows.as_ptr().cast()) };
        if status < 0 { Err(Error::query()?) } else { Ok(()) }
    })
}
