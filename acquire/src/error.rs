//! Why a source of taps cannot be opened.

use std::path::PathBuf;

/// A structural fault: nothing can be acquired until it is fixed.
///
/// A fault of a single recording is not an `Error`: it is a [`crate::Refusal`] of that tap.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read at all.
    #[error("{}: cannot be read: {source}", file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A folder cannot be watched.
    #[error("station {station} cannot watch its folder: {} cannot be made: {source}", part.display())]
    Unwatchable {
        /// The station.
        station: u16,
        /// What cannot be made: the folder, or one within it.
        part: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file is not text.
    #[error("{} line {line}: is not UTF-8 text", file.display())]
    NotText {
        /// The file.
        file: PathBuf,
        /// Line of the first byte that is no text, from 1.
        line: usize,
    },
    /// A file breaks the rules of TOML or CSV.
    #[error("{}{}: {reason}", file.display(), line.map_or_else(String::new, |line| format!(" line {line}")))]
    Syntax {
        /// The file.
        file: PathBuf,
        /// Line, from 1; `None` where something is missing.
        line: Option<usize>,
        /// What the parser says.
        reason: String,
    },
    /// The value of a key is out of bounds.
    #[error("{} line {line}: {key} is {value}; it must be {bound}", file.display())]
    Key {
        /// The file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The key.
        key: &'static str,
        /// What was given.
        value: String,
        /// What it must be.
        bound: String,
    },
    /// The header of a table does not have exactly the required columns.
    #[error("{} line {line}: {fault} column {column:?}; the columns are {known}, in any order", file.display())]
    Column {
        /// The file.
        file: PathBuf,
        /// Line of the header, from 1.
        line: usize,
        /// `unknown`, `missing` or `repeated`.
        fault: &'static str,
        /// The column.
        column: String,
        /// The columns there must be.
        known: String,
    },
    /// A cell of a table is out of bounds or of the wrong kind.
    #[error("{} line {line}: {column} is {value:?}; it must be {bound}", file.display())]
    Cell {
        /// The file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The column.
        column: &'static str,
        /// What was given.
        value: String,
        /// What it must be.
        bound: String,
    },
    /// Two rows of a table are about the same thing.
    #[error("{} line {second}: names {what} again; line {first} has it already", file.display())]
    Duplicate {
        /// The file.
        file: PathBuf,
        /// What both name.
        what: String,
        /// Line of the first, from 1.
        first: usize,
        /// Line of the second, from 1.
        second: usize,
    },
    /// The taps of a casing are at two stations, although a casing can only lie on one.
    #[error("{}: {what} is at station {} (line {}) and at station {} (line {})", file.display(), first.0, first.1, second.0, second.1)]
    TwoStations {
        /// The list of taps.
        file: PathBuf,
        /// The casing.
        what: String,
        /// One station, and the line that names it, from 1.
        first: (u16, usize),
        /// The other, and the line that names it.
        second: (u16, usize),
    },
    /// A table without rows.
    #[error("{}: has no rows below its header", file.display())]
    NoRows {
        /// The file.
        file: PathBuf,
    },
    /// Not one recording of the set can be used.
    #[error("{}: none of the {tap_count} taps can be used: {reasons}", folder.display())]
    NoUsableTap {
        /// The folder of the set.
        folder: PathBuf,
        /// Taps listed.
        tap_count: usize,
        /// The first few refusals.
        reasons: String,
    },
    /// A setting of the configuration, or an argument, is out of bounds.
    #[error("{key} is {value}; it must be {bound}")]
    Setting {
        /// The key, with its table.
        key: String,
        /// What was given.
        value: String,
        /// What it must be.
        bound: String,
    },
    /// The simulated rig or one of its tyres is impossible.
    #[error("simulation: {0}")]
    Model(#[from] tapline_model::Error),
    /// A thread cannot be started.
    #[error("cannot start a thread for {what}: {source}")]
    Thread {
        /// What it is for.
        what: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// Communication with a simulated rig failed.
    #[error("the simulated rig: {0}")]
    Rig(std::io::Error),
    /// The taps do not form a plan.
    #[error(transparent)]
    Plan(#[from] tapline_wire::PlanError),
}

impl Error {
    /// The refusal of the value of `key`.
    pub(crate) fn setting(key: impl Into<String>, value: impl ToString, bound: impl Into<String>) -> Self {
        Self::Setting { key: key.into(), value: value.to_string(), bound: bound.into() }
    }
}
