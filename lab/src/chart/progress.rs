//! How far a chart is, and about how long it will take: a bar on a terminal, plain lines elsewhere.

use std::cell::{Cell, RefCell};
use std::io::{self, IsTerminal as _, Write as _};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Time between plain lines.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// Ticks of the bar.
const TICKS: u64 = 1000;

/// How far a chart is. Parts are weighed by the time that they are expected to take; what is left is judged by how that
/// compares with the time they took.
#[derive(Debug)]
pub(crate) struct Progress {
    begun: Instant,
    /// Seconds expected of all parts.
    total_s: f64,
    /// Seconds expected of those that are done.
    done_s: Cell<f64>,
    /// What is under way: its name, and the seconds expected of it.
    part: RefCell<(String, f64)>,
    printed: Cell<Instant>,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Of parts that are expected to take `total_s` together.
    pub(crate) fn new(total_s: f64) -> Self {
        let bar = io::stderr().is_terminal().then(|| ProgressBar::new(TICKS));
        if let Some(bar) = &bar
            && let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} % {msg}")
        {
            bar.set_style(style);
        }
        let now = Instant::now();
        Self {
            begun: now,
            total_s,
            done_s: Cell::new(0.0),
            part: RefCell::default(),
            printed: Cell::new(now - LINE_EVERY),
            bar,
        }
    }

    /// Begins the part called `name`, of which `expected_s` are expected; the one before is done.
    pub(crate) fn begin(&self, name: &str, expected_s: f64) {
        let (_, before_s) = self.part.replace((name.to_owned(), expected_s));
        self.done_s.set(self.done_s.get() + before_s);
        self.show(0.0);
    }

    /// Shows that `fraction` of the part under way is done.
    pub(crate) fn at(&self, fraction: f64) {
        self.show(fraction);
    }

    /// All is done.
    pub(crate) fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        say(&format!("chart: done in {}", duration(self.begun.elapsed().as_secs_f64())));
    }

    /// Prints something beside the progress.
    pub(crate) fn print(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| say(text)),
            None => say(text),
        }
    }

    fn show(&self, fraction: f64) {
        let part = self.part.borrow();
        let done = (self.done_s.get() + fraction.clamp(0.0, 1.0) * part.1) / self.total_s;
        let spent_s = self.begun.elapsed().as_secs_f64();
        let left = match done {
            done if done > 0.02 => format!(", {} left", duration(spent_s * (1.0 - done) / done)),
            _ => format!(", {} expected", duration(self.total_s)),
        };
        if let Some(bar) = &self.bar {
            bar.set_position((done.clamp(0.0, 1.0) * TICKS as f64) as u64);
            bar.set_message(format!("{}{left}", part.0));
        } else if self.printed.get().elapsed() >= LINE_EVERY || fraction <= 0.0 {
            self.printed.set(Instant::now());
            say(&format!("chart: {:3.0} %, {}{left}", 100.0 * done, part.0));
        }
    }
}

/// Prints a line to standard error; if that is closed, ignores it.
fn say(text: &str) {
    drop(writeln!(io::stderr(), "{text}"));
}

/// Seconds, as people say them.
fn duration(s: f64) -> String {
    match s {
        s if s < 90.0 => format!("{s:.0} s"),
        s => format!("{:.0} min", s / 60.0),
    }
}
