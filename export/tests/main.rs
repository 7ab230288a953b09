//! Exported tables, character by character, and read back by other programs.

#![expect(clippy::unwrap_used, reason = "a helper that fails fails its test")]

#[path = "../../store/tests/common.rs"]
#[allow(dead_code, reason = "what the tests of archives share with these")]
mod common;
#[cfg(feature = "parquet")]
mod parquet;
mod tables;

use std::io::Write;

use tapline_export::TableFile;
use tapline_store::Reader;

/// Writes the table of one archive.
fn write(mut file: TableFile<impl Write + Send>, reader: &Reader) {
    file.add(reader, None).unwrap();
    file.finish().unwrap();
}
