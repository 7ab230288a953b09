//! Why a source of taps cannot be opened.

use std::path::PathBuf;

/// A structural fault: nothing can be acquired until it is fixed.
///
/// A fault of a single recording is not an `Error`: it is a [`crate::Refusal`] of that tap.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read at all.
    #[error("{}: cannot be read: {source}", file.display())]
    Unreadable { file: PathBuf, source: std::io::Error },
    /// A folder cannot be watched.
    #[error("station {station} cannot watch its folder: {} cannot be made: {source}", part.display())]
    Unwatchable {
        station: u16,
        /// What cannot be made: the folder, or one within it.
        part: PathBuf,
        source: std::io::Error,
    },
    /// Another line watches a folder, or its lock cannot be made.
    #[error("station {station} cannot watch {}: {source}", folder.display())]
    Watched { station: u16, folder: PathBuf, source: std::io::Error },
    /// A file is not text.
    #[error("{} line {line}: is not UTF-8 text", file.display())]
    NotText { file: PathBuf, line: usize },
    /// A file breaks the rules of TOML or CSV.
    #[error("{}{}: {reason}", file.display(), line.map_or_else(String::new, |line| format!(" line {line}")))]
    Syntax {
        file: PathBuf,
        /// Line, from 1; `None` where something is missing.
        line: Option<usize>,
        reason: String,
    },
    /// The value of a key is out of bounds.
    #[error("{} line {line}: {key} is {value}; it must be {bound}", file.display())]
    Key { file: PathBuf, line: usize, key: &'static str, value: String, bound: String },
    /// The header of a table does not have exactly the required columns.
    #[error("{} line {line}: {fault} column {column:?}; the columns are {known}, in any order", file.display())]
    Column {
        file: PathBuf,
        line: usize,
        /// `unknown`, `missing` or `repeated`.
        fault: &'static str,
        column: String,
        known: String,
    },
    /// A cell of a table is out of bounds or of the wrong kind.
    #[error("{} line {line}: {column} is {value:?}; it must be {bound}", file.display())]
    Cell { file: PathBuf, line: usize, column: &'static str, value: String, bound: String },
    /// Two rows of a table are about the same thing.
    #[error("{} line {second}: names {what} again; line {first} has it already", file.display())]
    Duplicate { file: PathBuf, what: String, first: usize, second: usize },
    /// The taps of a casing are at two stations, although a casing can only lie on one.
    #[error("{}: {what} is at station {} (line {}) and at station {} (line {})", file.display(), first.0, first.1, second.0, second.1)]
    TwoStations { file: PathBuf, what: String, first: (u16, usize), second: (u16, usize) },
    /// A table without rows.
    #[error("{}: has no rows below its header", file.display())]
    NoRows { file: PathBuf },
    /// Not one recording of the set can be used.
    #[error("{}: {what}", folder.display())]
    NoUsableTap { folder: PathBuf, what: String },
    /// A setting of the configuration, or an argument, is out of bounds.
    #[error("{key} is {value}; it must be {bound}")]
    Setting {
        /// The key, with its table.
        key: String,
        value: String,
        bound: String,
    },
    /// The simulated rig or one of its tyres is impossible.
    #[error("simulation: {0}")]
    Model(#[from] tapline_model::Error),
    /// A thread cannot be started.
    #[error("cannot start a thread for {what}: {source}")]
    Thread { what: String, source: std::io::Error },
    /// Communication with a simulated rig failed.
    #[error("the simulated rig: {0}")]
    Rig(std::io::Error),
    /// The taps do not form a plan.
    #[error(transparent)]
    Plan(#[from] tapline_wire::PlanError),
}

/// Says that none of `tap_count` taps can be `done`, with the first of the `reasons`.
pub fn none_can(tap_count: usize, done: &str, reasons: impl IntoIterator<Item = String>) -> String {
    const REASONS_MAX: usize = 3;
    let mut reasons = reasons.into_iter();
    let first = reasons.by_ref().take(REASONS_MAX).collect::<Vec<_>>().join("; ");
    let more = if reasons.next().is_some() { "; ..." } else { "" };
    match tap_count {
        1 => format!("the only tap cannot be {done}: {first}"),
        _ => format!("none of the {tap_count} taps can be {done}: {first}{more}"),
    }
}

impl Error {
    /// The refusal of the value of `key`.
    pub(crate) fn setting(key: impl Into<String>, value: impl ToString, bound: impl Into<String>) -> Self {
        Self::Setting { key: key.into(), value: value.to_string(), bound: bound.into() }
    }
}
