//! Calls of the HDF5 library, and its structures read without it.
//!
//! - `file`, `table`, `rows`, `text`: files, tables, their rows and texts, through the library
//! - `samples`, `extent`: one chunk per tap, written and found without the library
//! - `chunk_index`: the index of chunks, read from the file
//! - `structure`, `seal`: digests of what must not change in an unfinished and in a finished file

pub(crate) mod chunk_index;
pub(crate) mod extent;
pub(crate) mod file;
pub(crate) mod rows;
pub(crate) mod samples;
pub(crate) mod seal;
pub(crate) mod structure;
pub(crate) mod table;
pub(crate) mod text;
