//! Messages to people on standard error. It may be a full disk or a pipe without a reader; the program continues.

use std::error::Error;
use std::io::Write as _;

use crate::arguments::LogFormat;
use crate::log::{self, SAID};
use crate::similar::meant_instead;
use crate::stderr::Stderr;

/// Writes `text` and a newline.
pub fn print_line(text: &str) {
    // If standard error is closed or full, nothing can be done about it.
    drop(Stderr.write_all(format!("{text}\n").as_bytes()));
}

/// `count` and the noun: `one` for 1, else the plural `more`.
pub fn counted(count: usize, one: &str, more: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { more })
}

/// Prints `text` for people, or as an event into a log for programs, unless only errors are wanted.
pub fn say(text: &str) {
    match log::format() {
        _ if log::is_quiet() => {}
        LogFormat::Text => print_line(text),
        LogFormat::Json => tracing::info!(target: SAID, "{text}"),
    }
}

/// Prints a line that another program has written; a log for programs gets it as an event.
pub fn relay(line: &[u8]) {
    let line = String::from_utf8_lossy(line);
    match log::format() {
        LogFormat::Text => print_line(&line),
        LogFormat::Json => tracing::info!(target: SAID, "{line}"),
    }
}

/// Prints the error that ended the program called `program`.
pub fn print_failure(program: &str, error: &(dyn Error + 'static)) {
    let mut text = with_causes(error);
    if let Some(meant) = meant_instead(&text) {
        text = format!("{}\n{meant}", text.trim_end());
    }
    match log::format() {
        LogFormat::Text => {
            let is_coloured = crate::colour::is_shown(&std::io::stderr());
            let program = crate::colour::Colour::Bad.paint(program, is_coloured);
            print_line(&format!("{program}: {text}"));
        }
        LogFormat::Json => tracing::error!("{text}"),
    }
}

/// The error with its causes, each once: many messages already contain their cause.
pub fn with_causes(error: &(dyn Error + 'static)) -> String {
    std::iter::successors(Some(error), |&error| error.source()).fold(String::new(), |text, cause| {
        match cause.to_string() {
            cause if text.is_empty() => cause,
            cause if text.ends_with(&cause) => text,
            cause => format!("{text}: {cause}"),
        }
    })
}
