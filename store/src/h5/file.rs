//! How files are opened through the library, and what is done with their descriptors without it.
#![expect(unsafe_code, reason = "the safe crate gives no access to the descriptor and the size of an open file")]

use std::ffi::{c_int, c_void};
use std::fs::File;
use std::io;
use std::mem::ManuallyDrop;
use std::os::fd::{AsRawFd as _, BorrowedFd, FromRawFd as _, OwnedFd};

use hdf5::plist::file_access::{
    CacheDecreaseMode, CacheIncreaseMode, FileAccessBuilder, FlashIncreaseMode, MetadataCacheConfig,
};
use hdf5::sync::sync;
use hdf5::{Error, FileBuilder};
use hdf5_sys::h5::{herr_t, hsize_t};
use hdf5_sys::h5f::H5Fget_vfd_handle;
use hdf5_sys::h5i::hid_t;
use hdf5_sys::h5p::H5P_DEFAULT;
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::io::{DupFlags, FdFlags, dup3};

/// A page of memory, and a block of most file systems: writing samples that begin on one touches no other samples.
const PAGE_BYTES: u64 = 4096;

/// Least size of what is aligned to a page: for smaller objects alignment wastes more than it gains.
const ALIGN_FROM_BYTES: u64 = 8 * PAGE_BYTES;

/// How archives are opened for writing, so that a writer may be killed at any time.
///
/// Metadata reaches the file only at a flush: the library's cache evicts nothing itself. Nothing is allocated ahead,
/// so the file is never shorter than its superblock says.
pub(crate) fn files() -> FileBuilder {
    let cache = MetadataCacheConfig {
        evictions_enabled: false,
        incr_mode: CacheIncreaseMode::Off,
        flash_incr_mode: FlashIncreaseMode::Off,
        decr_mode: CacheDecreaseMode::Off,
        ..MetadataCacheConfig::default()
    };
    let mut files = files_to_read();
    files.with_fapl(|plist| {
        plist.alignment(ALIGN_FROM_BYTES, PAGE_BYTES).mdc_config(&cache).meta_block_size(0).small_data_block_size(0)
    });
    files
}

/// How archives are opened for reading: with a descriptor, even if the environment names another driver.
pub(crate) fn files_to_read() -> FileBuilder {
    let mut files = FileBuilder::new();
    files.with_fapl(FileAccessBuilder::sec2);
    files
}

unsafe extern "C" {
    // In HDF5 since 1.10; hdf5-sys does not declare it.
    fn H5Fincrement_filesize(file: hid_t, increment: hsize_t) -> herr_t;
}

/// Makes the library treat the whole file as used: a killed writer may have left chunks after the end in the
/// superblock, and their space must not be allocated again.
pub(crate) fn take_whole_file(file: &hdf5::File) -> hdf5::Result<()> {
    // SAFETY: the lock of the library is held and the file's identifier is valid while `file` lives.
    sync(|| if unsafe { H5Fincrement_filesize(file.id(), 0) } < 0 { Err(Error::query()?) } else { Ok(()) })
}

/// Keeps processes that this one starts from inheriting the open file, and with it the lock.
pub(crate) fn close_in_children(file: &hdf5::File) -> hdf5::Result<()> {
    with_descriptor(file, |descriptor| Ok(rustix::io::fcntl_setfd(descriptor, FdFlags::CLOEXEC)?))
}

/// Another handle of the open file, for reading, without the lock; it works even if the file was renamed.
pub(crate) fn read_handle(file: &hdf5::File) -> hdf5::Result<File> {
    with_descriptor(file, |descriptor| File::open(format!("/proc/self/fd/{}", descriptor.as_raw_fd())))
}

/// Abandons a file after a failed write, and releases its lock: nothing more is written to it, not even when the library closes
/// the file or the program ends.
///
/// After a failed write the library holds metadata of data that is not in the file, and cannot discard it: closing the file
/// writes it, or fails and leaves the file open. So the library's descriptor is redirected to memory that nobody reads.
///
/// # Errors
/// What the library or the system returns; the file is then as it was.
pub(crate) fn abandon(file: &hdf5::File) -> hdf5::Result<()> {
    with_descriptor(file, |descriptor| {
        let nowhere = memfd_create("abandoned", MemfdFlags::CLOEXEC)?;
        // SAFETY: the number is the library's own descriptor, which is open, and is not closed when this is dropped.
        let mut descriptor = ManuallyDrop::new(unsafe { OwnedFd::from_raw_fd(descriptor.as_raw_fd()) });
        Ok(dup3(&nowhere, &mut descriptor, DupFlags::CLOEXEC)?)
    })
}

/// Calls `act` with the descriptor of `file`, under the library's lock.
fn with_descriptor<T>(file: &hdf5::File, act: impl FnOnce(BorrowedFd<'_>) -> io::Result<T>) -> hdf5::Result<T> {
    let mut handle: *mut c_void = std::ptr::null_mut();
    sync(|| {
        // SAFETY: the lock of the library is held and the file's identifier is valid while `file` lives; it was opened by the
        // driver that keeps a descriptor (`files_to_read`), for which the handle points to that number.
        let status = unsafe { H5Fget_vfd_handle(file.id(), H5P_DEFAULT, &raw mut handle) };
        if status < 0 || handle.is_null() {
            return Err(Error::query()?);
        }
        // SAFETY: as above; the descriptor stays open as long as `file`, which outlives the borrow.
        let descriptor = unsafe { BorrowedFd::borrow_raw(*handle.cast::<c_int>()) };
        act(descriptor).map_err(|error| Error::from(error.to_string()))
    })
}
