//! The words between a station and its rig: lines of UTF-8 text, described in `docs/rig-protocol.md`.

use std::io::{self, Read};

use tapline_wire::Serial;

/// Version of the protocol.
pub(crate) const VERSION: u32 = 1;

/// Longest line, its end left out.
pub(crate) const LINE_BYTES_MAX: usize = 256;

/// Longest reason that is given or taken.
const REASON_BYTES_MAX: usize = 160;

/// How a casing is called whose serial could not be read.
pub(crate) const UNKNOWN: &str = "?";

/// What a rig says.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum RigSays {
    /// Its name and the version it speaks.
    Hello { name: String, version: u32 },
    /// A casing is on it; its serial as it was read.
    Casing(String),
    /// The casing was taken away.
    Removed,
    /// The impactor stands where it was told to.
    Ready,
    /// It has hit, at this velocity in m/s.
    Hit(f64),
    /// What it was told cannot be done.
    Error(String),
    /// It is there.
    Pong,
}

impl RigSays {
    /// What `line` says; `None` when it is nothing that a rig may say.
    pub(crate) fn of(line: &str) -> Option<Self> {
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
            ("pong", "") => Some(Self::Pong),
            ("hit", velocity) => velocity.parse().ok().filter(|v| (0.0..=1000.0).contains(v)).map(Self::Hit),
            ("error", why) => Some(Self::Error(one_line(why))),
            _ => None,
        }
    }
}

/// `text` without what would break its line, and not longer than a reason may be.
pub(crate) fn one_line(text: &str) -> String {
    let mut line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    line.truncate(line.floor_char_boundary(REASON_BYTES_MAX));
    line
}

/// Takes lines out of what is read, however it comes.
#[derive(Debug, Default)]
pub(crate) struct Lines {
    bytes: Vec<u8>,
}

/// What reading a line gave.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Line {
    /// A line, its end left out.
    Text(String),
    /// Nothing came for as long as the connection waits.
    Nothing,
    /// The other side has gone.
    End,
    /// What came is no line of the protocol, for the reason given.
    Garbage(String),
}

impl Lines {
    /// The next line of `from`, at most one read away.
    pub(crate) fn next(&mut self, from: &mut impl Read) -> io::Result<Line> {
        loop {
            if let Some(end) = self.bytes.iter().position(|&byte| byte == b'\n') {
                let line: Vec<u8> = self.bytes.drain(..=end).take(end).collect();
                return Ok(text_of(line));
            }
            if self.bytes.len() > LINE_BYTES_MAX {
                return Ok(Line::Garbage(format!("a line of more than {LINE_BYTES_MAX} bytes")));
            }
            let mut some = [0; LINE_BYTES_MAX];
            match from.read(&mut some) {
                Ok(0) => return Ok(Line::End),
                Ok(count) => self.bytes.extend(&some[..count]),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                    return Ok(Line::Nothing);
                }
                Err(e) => return Err(e),
            }
        }
    }
}

fn text_of(mut line: Vec<u8>) -> Line {
    if line.last() == Some(&b'\r') {
        line.pop();
    }
    if line.len() > LINE_BYTES_MAX {
        return Line::Garbage(format!("a line of more than {LINE_BYTES_MAX} bytes"));
    }
    String::from_utf8(line).map_or_else(|_| Line::Garbage("a line that is not UTF-8 text".to_owned()), Line::Text)
}

/// A name for a casing whose serial could not be read, seen at `now_ns`: another than `last`.
pub(super) fn unknown_name(station: u16, now_ns: i64, last: &str) -> String {
    let mut second = now_ns.div_euclid(1_000_000_000);
    loop {
        let name = format!("unknown-{station}-{}", utc(second));
        // Never two of one name, however fast they come or whatever the clock does.
        if name.as_str() > last || name.len() != last.len() {
            return name;
        }
        second += 1;
    }
}

/// A time of day in UTC, from seconds since the Unix epoch: `20261123T064628Z`.
fn utc(second: i64) -> String {
    let time = jiff::Timestamp::from_second(second).unwrap_or(jiff::Timestamp::UNIX_EPOCH);
    time.strftime("%Y%m%dT%H%M%SZ").to_string()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Catches a word taken for another, and a number or name that nothing can be done with.
    #[test]
    fn what_a_rig_may_say() {
        for (line, want) in [
            ("hello rig 1 1", RigSays::Hello { name: "rig 1".to_owned(), version: 1 }),
            ("casing T 1", RigSays::Casing("T 1".to_owned())),
            ("casing ?", RigSays::Casing("?".to_owned())),
            ("removed", RigSays::Removed),
            ("ready", RigSays::Ready),
            ("hit 1.85", RigSays::Hit(1.85)),
            ("error no\u{7}air", RigSays::Error("no air".to_owned())),
            ("pong", RigSays::Pong),
        ] {
            assert_eq!(RigSays::of(line), Some(want));
        }
        for line in
            ["", "hello", "hello rig", "hello  1", "casing", "casing ", "ready 1", "hit", "hit nan", "hit -1", "HIT 1"]
        {
            assert_eq!(RigSays::of(line), None, "{line:?}");
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
            let (mut pieces, mut lines, mut got) = (Pieces(text.as_bytes(), cut), Lines::default(), Vec::new());
            while let Line::Text(line) = lines.next(&mut pieces).unwrap() {
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
