//! Standard output, and whether it could be written.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::OnceLock;

/// Why standard output could not be written.
static FAULT: OnceLock<ErrorKind> = OnceLock::new();

/// Why standard output could not be written, if it could not.
pub fn fault() -> Option<ErrorKind> {
    FAULT.get().copied()
}

/// Standard output. An error of writing it says so, or it would be taken for one of what is written.
#[derive(Debug, Clone, Copy)]
pub struct Stdout;

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        io::stdout().write(bytes).map_err(named)
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stdout().flush().map_err(named)
    }

    /// In one piece, where threads print beside each other.
    fn write_fmt(&mut self, text: fmt::Arguments<'_>) -> io::Result<()> {
        io::stdout().lock().write_fmt(text).map_err(named)
    }
}

fn named(error: io::Error) -> io::Error {
    // Who writes tries that again.
    if error.kind() == ErrorKind::Interrupted {
        return error;
    }
    let kind = *FAULT.get_or_init(|| error.kind());
    io::Error::new(kind, format!("cannot write to standard output: {error}"))
}
