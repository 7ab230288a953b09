//! What is asked of the HDF5 library, and what is read of its structures without it.

pub(crate) mod chunk_index;
pub(crate) mod file;
pub(crate) mod location;
pub(crate) mod rows;
pub(crate) mod samples;
pub(crate) mod seal;
pub(crate) mod structure;
pub(crate) mod table;
pub(crate) mod text;
