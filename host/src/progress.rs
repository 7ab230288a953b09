//! Progress of a verb: a bar with the time left on a terminal, plain lines at long intervals elsewhere.

use std::fmt;
use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::arguments::LogFormat;
use crate::log;
use crate::messages::{print_line, say};

/// Time between plain lines.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Work that ends sooner shows no progress.
const SHOWN_AFTER: Duration = Duration::from_secs(1);

/// What is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Things with this name.
    Things(&'static str),
    /// Bytes, which are shown as megabytes.
    Bytes,
    /// Parts of the whole, which are shown as a percentage.
    Part,
}

/// Progress of a verb. When dropped it ends, and leaves nothing on a terminal.
#[derive(Debug)]
pub struct Progress {
    unit: Unit,
    /// How many there will be, where that is known.
    total: Option<u64>,
    last: Option<u64>,
    bar: Option<ProgressBar>,
    begun_at: Instant,
    printed_at: Instant,
}

impl Progress {
    /// Of `total` things.
    pub fn new(total: Option<u64>, unit: Unit) -> Self {
        let is_drawn = std::io::stderr().is_terminal() && log::format() == LogFormat::Text && !log::is_quiet();
        let bar = total.filter(|_| is_drawn).map(bar);
        let now = Instant::now();
        Self { unit, total, last: None, bar, begun_at: now, printed_at: now }
    }

    /// Adds `count` to the total.
    pub fn more(&mut self, count: u64) {
        self.total = self.total.map(|total| total + count);
        if let (Some(bar), Some(total)) = (&self.bar, self.total) {
            bar.set_length(total);
        }
    }

    /// Prints `text` without disturbing the bar.
    pub fn print(&self, text: &str) {
        match &self.bar {
            Some(_) => self.beside(|| print_line(text)),
            None => say(text),
        }
    }

    /// Has `write` write something else to the terminal.
    pub fn beside<R>(&self, write: impl FnOnce() -> R) -> R {
        match &self.bar {
            Some(bar) => bar.suspend(write),
            None => write(),
        }
    }

    /// Shows that `position` things are done, since the beginning; returns whether `position` is new.
    pub fn update(&mut self, position: u64) -> bool {
        self.update_since(position, position, self.begun_at)
    }

    /// Shows that `position` things are done, `done` of them since `since`; returns whether `position` is new.
    pub fn update_since(&mut self, position: u64, done: u64, since: Instant) -> bool {
        let is_news = self.last.replace(position) != Some(position);
        let Some(total) = self.total else { return is_news };
        if let Some(bar) = &self.bar {
            bar.set_position(position);
            if self.begun_at.elapsed() >= SHOWN_AFTER {
                if bar.is_hidden() {
                    bar.set_draw_target(ProgressDrawTarget::stderr());
                }
                bar.set_message(self.state(position, total, done, since));
            }
        } else if self.printed_at.elapsed() >= LINE_EVERY {
            self.printed_at = Instant::now();
            say(&self.state(position, total, done, since));
        }
        is_news
    }

    /// Counts, rate and time left, in words.
    fn state(&self, position: u64, total: u64, done: u64, since: Instant) -> String {
        #[expect(clippy::cast_precision_loss, reason = "a rate for people to read")]
        let (rate, left) = {
            let rate = done as f64 / since.elapsed().as_secs_f64().clamp(1e-3, f64::INFINITY);
            (rate, total.saturating_sub(position) as f64 / rate)
        };
        let counts = match self.unit {
            Unit::Things(name) => format!("{position} of {total} {name}, {} {name}/s", Rate(rate)),
            Unit::Part => format!("{} %", 100 * position / total.max(1)),
            Unit::Bytes => format!("{} of {} MB, {} MB/s", position / 1_000_000, total / 1_000_000, Rate(rate / 1e6)),
        };
        format!("{counts}{}", TimeLeft(left))
    }

    /// Takes the bar off the terminal.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}

/// A rate with at least two digits.
struct Rate(f64);

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 < 10.0 { write!(f, "{:.2}", self.0) } else { write!(f, "{:.0}", self.0) }
    }
}

/// Seconds that are left, as people say it.
struct TimeLeft(f64);

impl fmt::Display for TimeLeft {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = self.0;
        match s {
            _ if !s.is_finite() => Ok(()),
            _ if s < 99.5 => write!(f, ", {s:.0} s left"),
            _ if s < 5970.0 => write!(f, ", {:.0} min left", s / 60.0),
            _ => write!(f, ", {:.1} h left", s / 3600.0),
        }
    }
}

fn bar(total: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:20} {msg}").unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::hidden()).with_style(style)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a time without its unit, one that nobody can read, and one of nothing.
    #[test]
    fn times_have_units() {
        let texts = [0.4, 59.0, 120.0, 7200.0, f64::INFINITY].map(|s| TimeLeft(s).to_string());
        assert_eq!(texts, [", 0 s left", ", 59 s left", ", 2 min left", ", 2.0 h left", ""]);
        let mut progress = Progress::new(Some(8), Unit::Things("taps"));
        assert!(progress.update(3) && !progress.update(3));
        let since = Instant::now().checked_sub(Duration::from_secs(3)).unwrap_or_else(Instant::now);
        assert!(progress.state(3, 8, 3, since).starts_with("3 of 8 taps, "), "{}", progress.state(3, 8, 3, since));
    }
}
