//! How the library opens a file, and what this program does with an open one behind the library's back.
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

/// Page of memory and block of most file systems: samples that begin on one are written without touching a neighbour's.
const PAGE_BYTES: u64 = 4096;

/// Least size of what is put on a page boundary: rounding up smaller things would waste more than it gains.
const ALIGN_FROM_BYTES: u64 = 8 * PAGE_BYTES;

/// How archives are opened for writing, so that a writer may be killed at any time.
///
/// Nothing that tells where things lie reaches the file but by a flush: the library evicts none of it on its own. Nothing is
/// allotted ahead, so that the file is never shorter than it says.
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

/// How archives are opened for reading: by a descriptor, whatever driver the environment asks the library for.
pub(crate) fn files_to_read() -> FileBuilder {
    let mut files = FileBuilder::new();
    files.with_fapl(FileAccessBuilder::sec2);
    files
}

unsafe extern "C" {
    // Declared by HDF5 since 1.10, not by the crate of its declarations.
    fn H5Fincrement_filesize(file: hid_t, increment: hsize_t) -> herr_t;
}

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
