//! What was tried when the system or the library said no, and on which file.

use std::io;
use std::path::Path;

use crate::Error;

/// Adds to an HDF5 error what was tried and on which file.
pub(crate) trait Context<T> {
    /// The result, its error naming `action` and `path`.
    fn context(self, action: &'static str, path: &Path) -> Result<T, Error>;
}

impl<T> Context<T> for hdf5::Result<T> {
    fn context(self, action: &'static str, path: &Path) -> Result<T, Error> {
        self.map_err(|source| match system_error(&source) {
            Some(source) => Error::Io { action, path: path.to_owned(), source },
            None => Error::Hdf5 { action, path: path.to_owned(), source },
        })
    }
}

impl<T> Context<T> for io::Result<T> {
    fn context(self, action: &'static str, path: &Path) -> Result<T, Error> {
        self.map_err(|source| Error::Io { action, path: path.to_owned(), source })
    }
}

/// What the system said to the library, which says it on within a page of its own.
fn system_error(error: &hdf5::Error) -> Option<io::Error> {
    let stack = error.stack()?;
    let number = |text: &str| text.split_once("errno = ")?.1.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok();
    stack.iter().find_map(|frame| number(frame.desc())).filter(|&errno| errno != 0).map(io::Error::from_raw_os_error)
}
