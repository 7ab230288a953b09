//! Standard output, and whether writing to it failed.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::OnceLock;

/// Why standard output could not be written.
static FAULT: OnceLock<ErrorKind> = OnceLock::new();

/// Why standard output could not be written, if it could not.
pub fn fault() -> Option<ErrorKind> {
    FAULT.get().copied()
}

/// Standard output. Its write errors name it; otherwise they would look like errors of the data source.
#[derive(Debug, Clone, Copy)]
pub struct Stdout;

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        io::stdout().write(bytes).map_err(named)
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stdout().flush().map_err(named)
    }

    /// In one piece, because several threads may print at once.
    fn write_fmt(&mut self, text: fmt::Arguments<'_>) -> io::Result<()> {
        io::stdout().lock().write_fmt(text).map_err(named)
    }
}

fn named(error: io::Error) -> io::Error {
    // The caller retries after this one.
    if error.kind() == ErrorKind::Interrupted {
        return error;
    }
    let kind = *FAULT.get_or_init(|| error.kind());
    io::Error::new(kind, format!("cannot write to standard output: {error}"))
}
