//! What the bytes of an archive mean: names, rows, units, checksums. Nothing here opens a file.

pub(crate) mod checksum;
pub(crate) mod convert;
pub(crate) mod layout;
pub(crate) mod lineage;
pub(crate) mod lost;
