//! Why recordings cannot be imported.

use std::path::PathBuf;

/// Why nothing can be imported.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum Error {
    /// The example cannot be written.
    #[error("{}: cannot be written: {reason}", file.display())]
    Unwritable { file: PathBuf, reason: String },
    /// The configuration, the table or the name of a recording breaks the rules of its form, or has a value out of bounds;
    /// lines count from 1.
    #[error("{}{}: {reason}", file.display(), line.map(|line| format!(" line {line}")).unwrap_or_default())]
    Text { file: PathBuf, line: Option<usize>, reason: String },
    /// Not one tap can be imported.
    #[error("{what}")]
    NoTap { what: String },
    /// The tap set cannot be written.
    #[error(transparent)]
    Export(#[from] tapline_export::Error),
    /// A text cannot be read, or what was written is no tap set.
    #[error(transparent)]
    Acquire(#[from] tapline_acquire::Error),
}

/// What is wrong with a recording, or a channel of it.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Fault {
    /// The system refuses.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// The file breaks the rules of its format, or is valid and nothing that is read here.
    #[error("{0}")]
    Broken(String),
    /// There is no such channel, or part.
    #[error("has no {what} {name}; it has {known}")]
    Missing { what: &'static str, name: String, known: String },
    /// It has no samples.
    #[error("has no samples")]
    Empty,
    /// It has, or says it has, more than are taken.
    #[error("has {samples} samples per channel; at most {most} are read")]
    TooMany { samples: u64, most: u64 },
    /// A sample is no number that a tap set can hold.
    #[error("sample {sample} (from 0) is {value}; it must be a finite 32-bit float")]
    NotFinite { sample: usize, value: String },
    /// What it says contradicts the configuration, or the taps before it.
    #[error("{what} is {value}; {bound}")]
    Contradiction { what: &'static str, value: String, bound: String },
}

/// What a fallible call of this crate returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// The fault that is `what`: of a file that breaks its format, or that is not read here.
pub(crate) fn broken<T>(what: impl Into<String>) -> Result<T, Fault> {
    Err(Fault::Broken(what.into()))
}

/// The first names of a list, for an error.
pub(crate) fn some_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    listed(names.into_iter().map(|name| format!("{name:?}")))
}

/// The first of `texts`, which are quoted where they have to be, and how many there are besides.
pub(crate) fn listed(texts: impl IntoIterator<Item = String>) -> String {
    const MOST: usize = 12;
    let mut names = texts.into_iter();
    let mut text = names.by_ref().take(MOST).collect::<Vec<_>>().join(", ");
    let more = names.count();
    if more > 0 {
        text += &format!(" and {more} more");
    }
    if text.is_empty() { "none".to_owned() } else { text }
}
