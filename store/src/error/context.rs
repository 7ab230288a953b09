//! Errors of the system and of the HDF5 library, with the file and the action that failed.

use std::io;
use std::path::Path;

use super::{Error, Result};

/// Adds the action and the file to an error.
pub(crate) trait Context<T> {
    /// The result, its error naming `action` and `path`.
    fn context(self, action: &'static str, path: &Path) -> Result<T>;
}

impl<T> Context<T> for hdf5::Result<T> {
    fn context(self, action: &'static str, path: &Path) -> Result<T> {
        self.map_err(|source| match system_error(&source) {
            Some(source) => Error::Io { action, path: path.to_owned(), source },
            None => Error::Hdf5 { action, path: path.to_owned(), source },
        })
    }
}

impl<T> Context<T> for io::Result<T> {
    fn context(self, action: &'static str, path: &Path) -> Result<T> {
        self.map_err(|source| Error::Io { action, path: path.to_owned(), source })
    }
}

/// The error of the system that HDF5 quotes in its own, which fills a page.
fn system_error(error: &hdf5::Error) -> Option<io::Error> {
    let stack = error.stack()?;
    let number = |text: &str| text.split_once("errno = ")?.1.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok();
    stack.iter().find_map(|frame| number(frame.desc())).filter(|&errno| errno != 0).map(io::Error::from_raw_os_error)
}
