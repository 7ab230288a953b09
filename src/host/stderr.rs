//! Messages to people on standard error, which may be a full disk or a pipe whose reader has gone: that ends nothing.

use std::io::Write as _;

/// Writes `text` and a line's end.
pub(crate) fn print_line(text: &str) {
    // If standard error is closed or full, nothing can be done about it.
    drop(writeln!(std::io::stderr(), "{text}"));
}

/// The error with its causes, each once: many errors name their cause themselves.
pub(crate) fn with_causes(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |text, cause| match cause.to_string() {
        cause if text.is_empty() => cause,
        cause if text.ends_with(&cause) => text,
        cause => format!("{text}: {cause}"),
    })
}
