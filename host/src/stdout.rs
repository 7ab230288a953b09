//! Standard output, and whether writing to it failed.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Why standard output could not be written.
static FAULT: OnceLock<ErrorKind> = OnceLock::new();

/// Whether what nobody reads any more is dropped.
static DROPS_UNREAD: AtomicBool = AtomicBool::new(false);

/// Drops what is printed after the reader has gone, as `head` does: for work whose product is files.
pub fn drop_unread() {
    DROPS_UNREAD.store(true, Ordering::Relaxed);
}

/// Why standard output could not be written, if it could not.
pub fn fault() -> Option<ErrorKind> {
    FAULT.get().copied()
}

/// Standard output. Its write errors name it; otherwise they would look like errors of the data source.
#[derive(Debug, Clone, Copy)]
pub struct Stdout;

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        io::stdout().write(bytes).or_else(|error| dropped(error, bytes.len()))
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stdout().flush().or_else(|error| dropped(error, ()))
    }

    /// In one piece, because several threads may print at once.
    fn write_fmt(&mut self, text: fmt::Arguments<'_>) -> io::Result<()> {
        io::stdout().lock().write_fmt(text).or_else(|error| dropped(error, ()))
    }
}

/// `all` if nobody reads what was to be written, and that may be dropped; else the error.
fn dropped<T>(error: io::Error, all: T) -> io::Result<T> {
    if error.kind() == ErrorKind::BrokenPipe && DROPS_UNREAD.load(Ordering::Relaxed) {
        Ok(all)
    } else {
        Err(named(error))
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
