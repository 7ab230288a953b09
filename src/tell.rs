//! What people are told on standard error, which may be a full disk or a pipe whose reader has gone: that ends nothing.

use std::io::Write as _;

/// Writes `text` and a line's end.
pub(crate) fn tell(text: &str) {
    // Where it cannot be said it cannot be said that it cannot.
    drop(writeln!(std::io::stderr(), "{text}"));
}
