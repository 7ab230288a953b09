//! The protocol between a station and its rig: lines of UTF-8 text, described in `docs/rig-protocol.md`.

use std::io::{self, Read};

use tapline_wire::{Serial, is_unseen};

/// Version of the protocol.
pub(crate) const VERSION: u32 = 1;

/// Longest line, its end left out.
pub(crate) const LINE_BYTES_MAX: usize = 256;

/// Longest reason, in bytes.
const REASON_BYTES_MAX: usize = 160;

/// Greatest velocity of an impact.
pub(crate) const VELOCITY_MAX_M_PER_S: f64 = 1000.0;

/// The serial of a casing whose serial could not be read.
pub(crate) const UNKNOWN: &str = "?";

/// A message from a rig.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum RigMessage {
    /// Its name and the version it speaks.
    Hello { name: String, version: u32 },
    /// A casing is on it; its serial as it was read.
    Casing(String),
    /// The casing was taken away.
    Removed,
    /// The impactor is in position.
    Ready,
    /// The impactor has hit, at this velocity in m/s.
    Hit(f64),
    /// The command failed, for this reason.
    Error(String),
    /// It is stopped, for this reason, and does nothing until it says that it continues.
    Stopped(String),
    /// It continues.
    Running,
    /// It has found the zero of its angles.
    Homed,
    /// Answer to a ping.
    Pong,
}

impl RigMessage {
    /// The message in `line`; `None` if it is not one of the protocol.
    pub(crate) fn parse(line: &str) -> Option<Self> {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        match (word, rest) {
            ("hello", _) => {
                let (name, version) = rest.rsplit_once(' ')?;
                Serial::new(name).ok()?;
                Some(Self::Hello { name: name.to_owned(), version: version.parse().ok()? })
            }
            ("casing", serial) if !serial.is_empty() => Some(Self::Casing(serial.to_owned())),
            ("removed", "") => Some(Self::Removed),
            ("ready", "") => Some(Self::Ready),
            ("stopped", why) => Some(Self::Stopped(one_line(why))),
            ("running", "") => Some(Self::Running),
            ("homed", "") => Some(Self::Homed),
            ("pong", "") => Some(Self::Pong),
            ("hit", velocity) => {
                velocity.parse().ok().filter(|v| (0.0..=VELOCITY_MAX_M_PER_S).contains(v)).map(Self::Hit)
            }
            ("error", why) => Some(Self::Error(one_line(why))),
            _ => None,
        }
    }
}

/// `text` without control and format characters, cut to the longest reason.
pub(crate) fn one_line(text: &str) -> String {
    let mut line: String = text.chars().map(|c| if c.is_control() || is_unseen(c) { ' ' } else { c }).collect();
    line.truncate(line.floor_char_boundary(REASON_BYTES_MAX));
    line
}

/// Splits a byte stream into lines.
#[derive(Debug, Default)]
pub(crate) struct LineReader {
    bytes: Vec<u8>,
}

/// What reading a line gave.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum ReadLine {
    /// A line, its end left out.
    Text(String),
    /// Nothing came within the read timeout.
    Nothing,
    /// The other side has closed the connection.
    End,
    /// A line that is not UTF-8 text.
    NotText,
    /// More bytes than a line has.
    TooLong,
}

impl LineReader {
    /// The next line of `from`; reads from it once at most, and not at all if a line is buffered.
    pub(crate) fn read(&mut self, from: &mut impl Read) -> io::Result<ReadLine> {
        loop {
            if let Some(end) = self.bytes.iter().position(|&byte| byte == b'\n') {
                let line: Vec<u8> = self.bytes.drain(..=end).take(end).collect();
                return Ok(text_of(line));
            }
            if self.bytes.len() > LINE_BYTES_MAX {
                return Ok(ReadLine::TooLong);
            }
            let mut some = [0; LINE_BYTES_MAX];
            match from.read(&mut some) {
                Ok(0) => return Ok(ReadLine::End),
                Ok(count) => self.bytes.extend(&some[..count]),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                    return Ok(ReadLine::Nothing);
                }
                Err(e) => return Err(e),
            }
        }
    }
}

fn text_of(mut line: Vec<u8>) -> ReadLine {
    if line.last() == Some(&b'\r') {
        line.pop();
    }
    if line.len() > LINE_BYTES_MAX {
        return ReadLine::TooLong;
    }
    String::from_utf8(line).map_or(ReadLine::NotText, ReadLine::Text)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Catches a word taken for another, and a number or name that nothing can be done with.
    #[test]
    fn what_a_rig_may_say() {
        for (line, want) in [
            ("hello rig 1 1", RigMessage::Hello { name: "rig 1".to_owned(), version: 1 }),
            ("casing T 1", RigMessage::Casing("T 1".to_owned())),
            ("casing ?", RigMessage::Casing("?".to_owned())),
            ("removed", RigMessage::Removed),
            ("ready", RigMessage::Ready),
            ("hit 1.85", RigMessage::Hit(1.85)),
            ("error no\u{7}air", RigMessage::Error("no air".to_owned())),
            ("pong", RigMessage::Pong),
            ("stopped door open", RigMessage::Stopped("door open".to_owned())),
            ("running", RigMessage::Running),
            ("homed", RigMessage::Homed),
        ] {
            assert_eq!(RigMessage::parse(line), Some(want));
        }
        for line in
            ["", "hello", "hello rig", "hello  1", "casing", "casing ", "ready 1", "hit", "hit nan", "hit -1", "HIT 1"]
        {
            assert_eq!(RigMessage::parse(line), None, "{line:?}");
        }
    }

    proptest! {
        /// Catches lines that depend on how they come, and more held than a line.
        #[test]
        fn lines_come_in_any_pieces(text in "[a-c\r\n]{0,40}", cut in 1usize..9) {
            struct Pieces<'a>(&'a [u8], usize);
            impl Read for Pieces<'_> {
                fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
                    let count = self.1.min(self.0.len()).min(to.len());
                    to[..count].copy_from_slice(&self.0[..count]);
                    self.0 = &self.0[count..];
                    Ok(count)
                }
            }
            let (mut pieces, mut lines, mut got) = (Pieces(text.as_bytes(), cut), LineReader::default(), Vec::new());
            while let ReadLine::Text(line) = lines.read(&mut pieces).unwrap() {
                got.push(line);
            }
            let whole = text.rsplit_once('\n').map_or("", |(whole, _)| whole);
            let want: Vec<&str> = if text.contains('\n') {
                whole.split('\n').map(|line| line.strip_suffix('\r').unwrap_or(line)).collect()
            } else {
                Vec::new()
            };
            prop_assert_eq!(got, want);
        }
    }
}
