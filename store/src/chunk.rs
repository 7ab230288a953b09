//! Samples and rows straight from where they lie to the disk, and samples back: the one place that calls the C library itself.
#![expect(
    unsafe_code,
    reason = "the safe crate has no direct chunk access, and describes a row each time it writes one"
)]

use std::ffi::{c_int, c_uint, c_ulong, c_void};
use std::fs::File;
use std::io;
use std::marker::PhantomData;
use std::mem::ManuallyDrop;
use std::os::fd::{AsRawFd as _, BorrowedFd, FromRawFd as _, OwnedFd};
use std::os::unix::fs::FileExt as _;

use hdf5::{Dataset, Dataspace, Datatype, Error, H5Type, sync::sync};
use hdf5_sys::h5::{haddr_t, herr_t, hsize_t};
use hdf5_sys::h5d::{H5Dget_chunk_info_by_coord, H5Dwrite, H5Dwrite_chunk};
use hdf5_sys::h5f::H5Fget_vfd_handle;
use hdf5_sys::h5i::hid_t;
use hdf5_sys::h5p::H5P_DEFAULT;
use ndarray::{ArrayView2, s};
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::io::{DupFlags, FdFlags, dup3};

use crate::chunk_index::{Chunk, chunks};
use crate::codec::Codec;
use crate::sealed::PlainRow;

unsafe extern "C" {
    // Declared by HDF5 since 1.10, not by the crate of its declarations.
    fn H5Fincrement_filesize(file: hid_t, increment: hsize_t) -> herr_t;
    // Since 1.10.3; the crate declares it for some versions alone.
    fn H5Oget_info2(object: hid_t, info: *mut ObjectInfo, fields: c_uint) -> herr_t;
}

/// What [`H5Oget_info2`] writes: the number of the file, the address of the object's header, and more.
#[repr(C)]
struct ObjectInfo {
    file: c_ulong,
    address: haddr_t,
    more: [u64; 64],
}

/// Asks [`H5Oget_info2`] for the address alone.
const BASIC: c_uint = 1;

/// Has the library take all of a file that a killed writer left for used: chunks of that writer which lie behind the end
/// that it last wrote down must not be given away again.
///
/// # Errors
/// What the library says.
pub(crate) fn take_whole_file(file: &hdf5::File) -> hdf5::Result<()> {
    // SAFETY: the lock of the library is held and the file's identifier is valid while `file` lives.
    sync(|| if unsafe { H5Fincrement_filesize(file.id(), 0) } < 0 { Err(Error::query()?) } else { Ok(()) })
}

/// Has processes that this one starts not inherit the open file, and with it the lock on it.
///
/// # Errors
/// What the library or the system says.
pub(crate) fn close_in_children(file: &hdf5::File) -> hdf5::Result<()> {
    with_descriptor(file, |descriptor| Ok(rustix::io::fcntl_setfd(descriptor, FdFlags::CLOEXEC)?))
}

/// The open file once more, to read only, without the lock on it, and whatever has become of its name.
///
/// # Errors
/// What the library or the system says.
pub(crate) fn read_handle(file: &hdf5::File) -> hdf5::Result<File> {
    with_descriptor(file, |descriptor| File::open(format!("/proc/self/fd/{}", descriptor.as_raw_fd())))
}

/// Lets go of a file that could not be written, its lock with it: nothing more is written to it, neither by the library when
/// the file is closed nor when the program ends.
///
/// After a failed write the library has parts of the index in memory that tell of what is not in the file. It cannot forget
/// them: closing writes them, and closing fails where writing does, with the file left open. So what it still has to write
/// goes into memory that nobody reads.
///
/// # Errors
/// What the library or the system says; the file is then as it was.
pub(crate) fn abandon(file: &hdf5::File) -> hdf5::Result<()> {
    with_descriptor(file, |descriptor| {
        let nowhere = memfd_create("let go", MemfdFlags::CLOEXEC)?;
        // SAFETY: the number is the library's own descriptor, which is open, and is not closed when this is dropped.
        let mut descriptor = ManuallyDrop::new(unsafe { OwnedFd::from_raw_fd(descriptor.as_raw_fd()) });
        Ok(dup3(&nowhere, &mut descriptor, DupFlags::CLOEXEC)?)
    })
}

/// What `act` says of the descriptor of `file`, under the library's lock.
fn with_descriptor<T>(file: &hdf5::File, act: impl FnOnce(BorrowedFd<'_>) -> io::Result<T>) -> hdf5::Result<T> {
    let mut handle: *mut c_void = std::ptr::null_mut();
    sync(|| {
        // SAFETY: the lock of the library is held and the file's identifier is valid while `file` lives; it was opened by the
        // driver that keeps a descriptor (`create::files_to_read`), for which the handle points to that number.
        let status = unsafe { H5Fget_vfd_handle(file.id(), H5P_DEFAULT, &raw mut handle) };
        if status < 0 || handle.is_null() {
            return Err(Error::query()?);
        }
        // SAFETY: as above; the descriptor stays open as long as `file`, which outlives the borrow.
        let descriptor = unsafe { BorrowedFd::borrow_raw(*handle.cast::<c_int>()) };
        act(descriptor).map_err(|error| Error::from(error.to_string()))
    })
}

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

/// Where a row lies in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Span {
    pub(crate) address: u64,
    pub(crate) length: usize,
}

impl Span {
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

/// Rows of a `[row, channel, sample]` dataset whose chunks are one row each.
#[derive(Debug, Clone)]
pub(crate) struct ChunkRows {
    dataset: Dataset,
    codec: Codec,
    row_bytes: usize,
}

impl ChunkRows {
    /// The rows of `dataset`, of `row_bytes` bytes each, packed by `codec`; `None` when it has another layout.
    pub(crate) fn new(dataset: Dataset, codec: Codec, row_bytes: usize) -> Option<Self> {
        let &[_, channels, samples] = dataset.shape().as_slice() else { return None };
        let element_bytes = dataset.dtype().ok()?.size();
        let is_known = dataset.chunk()? == [1, channels, samples]
            && dataset.filters().is_empty() == (codec == Codec::None)
            && channels.checked_mul(samples).and_then(|n| n.checked_mul(element_bytes)) == Some(row_bytes);
        is_known.then_some(Self { dataset, codec, row_bytes })
    }

    /// The dataset, for what the library must unpack.
    pub(crate) fn dataset(&self) -> &Dataset {
        &self.dataset
    }

    /// What packs the rows.
    pub(crate) fn codec(&self) -> Codec {
        self.codec
    }

    /// Bytes of a row when it is unpacked.
    pub(crate) fn row_bytes(&self) -> usize {
        self.row_bytes
    }

    /// Writes `stored`, packed as the codec does, as row `row`, without a copy.
    ///
    /// # Errors
    /// What the library says, for one when `row` does not exist or the disk is full.
    pub(crate) fn write(&self, row: u32, stored: &[u8]) -> hdf5::Result<()> {
        let offset: [hsize_t; 3] = [row.into(), 0, 0];
        sync(|| {
            // SAFETY: the lock of the library is held; the dataset's identifier is valid while `self.dataset` lives;
            // `offset` has one entry for each of the three dimensions checked in `new`; `stored` is readable for its
            // length during the call, which keeps no pointer.
            let status = unsafe {
                H5Dwrite_chunk(self.dataset.id(), H5P_DEFAULT, 0, offset.as_ptr(), stored.len(), stored.as_ptr().cast())
            };
            if status < 0 { Err(Error::query()?) } else { Ok(()) }
        })
    }

    /// Writes row `row` of samples `T` through the library, which packs it.
    ///
    /// # Errors
    /// What the library says.
    pub(crate) fn write_unpacked<T: H5Type + bytemuck::Pod>(&self, row: u32, samples: &[u8]) -> hdf5::Result<()> {
        let samples: Vec<T> = samples.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect();
        let &[_, channels, count] = self.dataset.shape().as_slice() else { return Err("a row has no shape".into()) };
        let samples = ArrayView2::from_shape((channels, count), &samples).map_err(|error| error.to_string())?;
        self.dataset.write_slice(samples, s![row as usize, .., ..])
    }

    /// Where every row lies, as [`ChunkRows::place`] says of one; `file` is the one that has them, which nobody writes.
    ///
    /// # Errors
    /// What the library says.
    pub(crate) fn places(&self, file: &File) -> hdf5::Result<Vec<Option<Span>>> {
        match self.index(file) {
            Some(chunks) => Ok(chunks.into_iter().map(|(span, mask)| self.known(span, mask)).collect()),
            None => (0..).take(self.row_count()).map(|row| self.place(row)).collect(),
        }
    }

    /// How many there are.
    pub(crate) fn row_count(&self) -> usize {
        self.dataset.shape().first().copied().unwrap_or(0)
    }

    /// The index as it lies in `file`, where it is of a known kind.
    pub(crate) fn index(&self, file: &File) -> Option<Vec<Chunk>> {
        chunks(file, self.header_address()?, self.row_count(), self.dataset.ndim())
    }

    /// Where the dataset's object header lies, where the library says so.
    pub(crate) fn header_address(&self) -> Option<u64> {
        let mut info = ObjectInfo { file: 0, address: haddr_t::MAX, more: [0; 64] };
        // SAFETY: the lock of the library is held; the dataset's identifier is valid while `self.dataset` lives; the library
        // writes no more than its own structure, which begins as this one does and is shorter.
        let status = sync(|| unsafe { H5Oget_info2(self.dataset.id(), &raw mut info, BASIC) });
        (status >= 0).then_some(info.address)
    }

    /// `span`, where the chunk there was put through the filters that are undone here.
    fn known(&self, span: Span, mask: u32) -> Option<Span> {
        // The library leaves out a filter that gains nothing, and undoes what it did when it reads.
        let is_known = mask == 0 || self.codec == Codec::Gzip;
        Some(span).filter(|span| span.address != haddr_t::MAX && is_known)
    }

    /// Where row `row` lies; `None` where it was never written, or was by another filter.
    ///
    /// # Errors
    /// What the library says.
    pub(crate) fn place(&self, row: u32) -> hdf5::Result<Option<Span>> {
        let offset: [hsize_t; 3] = [row.into(), 0, 0];
        let (mut mask, mut address, mut length): (u32, haddr_t, hsize_t) = (0, haddr_t::MAX, 0);
        sync(|| {
            // SAFETY: as in `write`; the three results are written before the call returns.
            let status = unsafe {
                H5Dget_chunk_info_by_coord(
                    self.dataset.id(),
                    offset.as_ptr(),
                    &raw mut mask,
                    &raw mut address,
                    &raw mut length,
                )
            };
            if status < 0 { Err(Error::query()?) } else { Ok(()) }
        })?;
        let span = usize::try_from(length).ok().map(|length| Span { address, length });
        Ok(span.and_then(|span| self.known(span, mask)))
    }
}
