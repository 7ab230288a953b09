//! What the bytes of an archive mean: names, rows, units, checksums. Nothing here opens a file.
//!
//! - `layout`: names and units of the tables, and what a row of each has
//! - `fields`, `tap_rows`, `scan_rows`: records of the stream as rows, and back
//! - `checksum`: the checksum of each row
//! - `lineage`: what results are computed from and with
//! - `lost`: where a missing tap was lost

pub(crate) mod checksum;
pub(crate) mod fields;
pub(crate) mod layout;
pub(crate) mod lineage;
pub(crate) mod lost;
pub(crate) mod scan_rows;
pub(crate) mod tap_rows;
