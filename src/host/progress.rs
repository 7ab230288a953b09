//! How far a run is: a bar on a terminal, plain lines elsewhere.

use std::io::IsTerminal as _;
use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::host::log::{self, LogFormat};
use crate::host::stderr::print_line;

/// Time between plain lines.
const LINE_EVERY: Duration = Duration::from_secs(5);

#[derive(Debug)]
pub(crate) struct Progress {
    /// Taps there will be, where that is known.
    total: Option<usize>,
    last: Option<usize>,
    bar: Option<ProgressBar>,
    printed_at: Instant,
}

impl Progress {
    pub(crate) fn new(total: Option<usize>, out: &Path) -> Self {
        let what = match total {
            Some(total) => format!("scanning {total} taps into {}", out.display()),
            None => format!("waiting for casings; results go into {}", out.display()),
        };
        Self::begin(total, &what)
    }

    /// Of `total` taps, after printing what begins.
    pub(crate) fn begin(total: Option<usize>, what: &str) -> Self {
        let is_drawn = std::io::stderr().is_terminal() && log::format() == LogFormat::Text;
        let bar = total.filter(|_| is_drawn).map(bar);
        let progress = Self { total, last: None, bar, printed_at: Instant::now() };
        progress.print(what);
        progress
    }

    /// Prints something beside the progress.
    pub(crate) fn print(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| print_line(text)),
            None => say(text),
        }
    }

    /// Has `write` write something else to the terminal.
    pub(crate) fn beside<R>(&self, write: impl FnOnce() -> R) -> R {
        match &self.bar {
            Some(bar) => bar.suspend(write),
            None => write(),
        }
    }

    /// Shows that `settled` taps are settled, `done` of them since `since`; whether that is news.
    pub(crate) fn update(&mut self, settled: usize, done: usize, since: Instant) -> bool {
        let is_news = self.last.replace(settled) != Some(settled);
        #[expect(clippy::cast_precision_loss, reason = "a rate for people to read")]
        let rate = done as f64 / since.elapsed().as_secs_f64().clamp(1e-3, f64::INFINITY);
        let Some(total) = self.total else { return is_news };
        #[expect(clippy::cast_precision_loss, reason = "a rate for people to read")]
        let left_s = total.saturating_sub(settled) as f64 / rate;
        if let Some(bar) = &self.bar {
            bar.set_position(settled as u64);
            bar.set_message(format!("{rate:.0} taps/s{}", left(left_s)));
        } else if self.printed_at.elapsed() >= LINE_EVERY {
            self.printed_at = Instant::now();
            say(&format!("{settled} of {total} taps, {rate:.0} taps/s{}", left(left_s)));
        }
        is_news
    }

    pub(crate) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Prints a line; into a log for programs as an event.
fn say(text: &str) {
    match log::format() {
        LogFormat::Text => print_line(text),
        LogFormat::Json => tracing::info!(target: log::SAID, "{text}"),
    }
}

fn left(left_s: f64) -> String {
    if left_s.is_finite() { format!(", {left_s:.0} s left") } else { String::new() }
}

fn bar(total: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} taps  {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(total as u64).with_style(style)
}
