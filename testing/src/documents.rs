//! Files as tests read them: committed pages, and tables that a program wrote.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// A file or folder in `docs`.
pub fn docs(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name)
}

/// A file's text.
///
/// # Panics
/// If it cannot be read, with its path.
pub fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The rows of a CSV text, each by the names of its columns.
///
/// # Panics
/// If it is no table.
pub fn csv_rows(text: &str) -> Vec<BTreeMap<String, String>> {
    let mut table = csv::Reader::from_reader(text.as_bytes());
    table.deserialize().map(|row| row.unwrap_or_else(|error| panic!("{error}: {text}"))).collect()
}
