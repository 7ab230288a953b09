//! Colour in output for people: on a terminal, unless `NO_COLOR` is set.

use anstream::stream::RawStream;
use anstream::{AutoStream, ColorChoice};

/// What a colour means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// All is well.
    Good,
    /// Somebody should look.
    Doubtful,
    /// Something failed, or is to be rejected.
    Bad,
}

impl Colour {
    /// `text` in this colour, if colours are shown.
    pub fn paint(self, text: &str, is_shown: bool) -> String {
        let code = match self {
            Self::Good => "32",
            Self::Doubtful => "33",
            Self::Bad => "1;31",
        };
        if is_shown { format!("\x1b[{code}m{text}\x1b[0m") } else { text.to_owned() }
    }

    /// `text` in this colour for standard output.
    pub fn on_stdout(self, text: &str) -> String {
        self.paint(text, is_shown(&std::io::stdout()))
    }
}

/// Whether colours are shown on `stream`: it is a terminal, and neither `NO_COLOR` nor `TERM=dumb` is set.
pub fn is_shown<S: RawStream>(stream: &S) -> bool {
    AutoStream::choice(stream) != ColorChoice::Never
}
