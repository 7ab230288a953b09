//! Text files, and the lines with faults.

use std::fs;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::Error;

/// Largest text file of a tap set, a list of some ten million taps.
const TEXT_BYTES_MAX: u64 = 1 << 30;

/// The byte-order mark.
const MARK: char = '\u{feff}';

/// The text of `file`.
///
/// # Errors
/// [`Error::Unreadable`] and [`Error::NotText`].
pub fn read_text(file: &Path) -> Result<String, Error> {
    let missing = || std::io::Error::new(std::io::ErrorKind::NotFound, "there is no such file");
    read(file)?.ok_or_else(|| Error::Unreadable { file: file.to_owned(), source: missing() })
}

/// Reads the TOML file `file`.
///
/// # Errors
/// [`Error::Unreadable`], [`Error::NotText`] and [`Error::Syntax`].
pub fn read_toml<T: DeserializeOwned>(file: &Path) -> Result<T, Error> {
    toml(file, &read_text(file)?)
}

/// The text of `file`; `None` if there is no such file.
pub(crate) fn read(file: &Path) -> Result<Option<String>, Error> {
    let unreadable = |source| Error::Unreadable { file: file.to_owned(), source };
    let about = match fs::metadata(file) {
        Ok(about) => about,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(unreadable(e)),
    };
    // A pipe would block for ever, and a device may never end.
    if !about.is_file() {
        return Err(unreadable(std::io::Error::other("it is not a file")));
    }
    if about.len() > TEXT_BYTES_MAX {
        let reason = format!("it has {} bytes; at most {TEXT_BYTES_MAX} are read", about.len());
        return Err(unreadable(std::io::Error::other(reason)));
    }
    let bytes = fs::read(file).map_err(unreadable)?;
    decode(file, bytes).map(Some)
}

/// `bytes` as text, without the byte-order mark that some editors put before it.
pub(crate) fn decode(file: &Path, bytes: Vec<u8>) -> Result<String, Error> {
    let mut text = String::from_utf8(bytes).map_err(|e| {
        let line = 1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        Error::NotText { file: file.to_owned(), line }
    })?;
    if text.starts_with(MARK) {
        text.drain(..MARK.len_utf8());
    }
    Ok(text)
}

/// Longest part of a line that an error shows.
const SHOWN_MAX: usize = 80;

/// Parses the TOML `text` of `file`.
pub(crate) fn toml<T: DeserializeOwned>(file: &Path, text: &str) -> Result<T, Error> {
    toml::from_str(text).map_err(|error| syntax(file, text, &error))
}

/// The `error` in the TOML `text` of `file`. The faulty line is shown, because it names the key; a missing key has no line.
fn syntax(file: &Path, text: &str, error: &toml::de::Error) -> Error {
    let line = error.span().filter(|at| at.end > 0).map(|at| line_at(text, at.start));
    let written = line.and_then(|line| text.lines().nth(line - 1)).map_or_else(String::new, |written| {
        format!("`{}`: ", written.trim().chars().take(SHOWN_MAX).collect::<String>())
    });
    let reason = format!("{written}{}", toml_in_words(error.message()).replace('\n', ", "));
    // A terminal would obey the file's control codes.
    let reason = reason.chars().map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect();
    Error::Syntax { file: file.to_owned(), line, reason }
}

/// Plain words for the types that an error expects.
const TYPES: [(&str, &str); 9] = [
    ("u8", "a whole number from 0 to 255"),
    ("u16", "a whole number from 0 to 65535"),
    ("u32", "a whole number from 0 to 4294967295"),
    ("u64", "a whole number, not below 0"),
    ("usize", "a whole number, not below 0"),
    ("i64", "a whole number"),
    ("f64", "a number"),
    ("a sequence", "a list"),
    ("a map", "a table"),
];

/// The `error` of a TOML parser with its type names in plain words; they are in its last line.
pub fn toml_in_words(error: &str) -> String {
    let error = error.trim_end().replace(
        "invalid socket address syntax",
        "it must be an IP address with a port, like 127.0.0.1:PORT, not a host name",
    );
    let (place, what) = error.rsplit_once('\n').map_or(("", &*error), |(place, what)| (place, what));
    let Some((found, expected)) = what.rsplit_once("expected ") else { return error };
    let of_type = || TYPES.iter().find(|(name, _)| *name == expected).map(|(_, words)| *words);
    let expected = if expected.starts_with("struct ") { "a table" } else { of_type().unwrap_or(expected) };
    let found = found.replace("invalid type: map", "invalid type: table");
    let found = found.replace("invalid type: sequence", "invalid type: list");
    format!("{place}\n{found}expected {expected}").trim_start_matches('\n').to_owned()
}

/// Number of the line with byte `at` of `text`, from 1.
pub(crate) fn line_at(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|&b| b == b'\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a byte-order mark that becomes part of the first column's name, and a wrong line for bad bytes.
    #[test]
    fn text_is_decoded_and_faults_are_placed() {
        let file = Path::new("taps.csv");
        assert_eq!(decode(file, b"\xef\xbb\xbffile\n".to_vec()).unwrap(), "file\n");
        let error = decode(file, b"a\nb\n\xff".to_vec()).unwrap_err().to_string();
        assert_eq!(error, "taps.csv line 3: is not UTF-8 text");
        assert_eq!(line_at("a\nb\nc", 4), 3);
    }

    /// Catches a fault of TOML without its line, and text of a file that a terminal would obey.
    #[test]
    fn a_fault_shows_its_line_without_control_characters() {
        let error = toml::<toml::Table>(Path::new("s.toml"), "a = 1\nb = \u{1b}[31m\n").unwrap_err().to_string();
        assert!(error.starts_with("s.toml line 2: `b = \u{fffd}[31m`: "), "{error}");
        assert!(!error.chars().any(char::is_control), "{error:?}");
    }
}
