//! Progress of a chart. Its parts are weighted by the time that they are expected to take.

use std::cell::{Cell, RefCell};

use tapline_host::progress::{self, Unit};

/// Steps of the whole.
const STEPS: f64 = 1000.0;

#[derive(Debug)]
pub(crate) struct Progress {
    shown: RefCell<progress::Progress>,
    /// Seconds expected of all parts.
    total_s: f64,
    /// Seconds expected of those that are done.
    done_s: Cell<f64>,
    /// Seconds expected of the one under way.
    part_s: Cell<f64>,
}

impl Progress {
    /// For parts that are expected to take `total_s` together.
    pub(crate) fn new(total_s: f64) -> Self {
        let shown = RefCell::new(progress::Progress::new(Some(STEPS as u64), Unit::Part));
        Self { shown, total_s, done_s: Cell::new(0.0), part_s: Cell::new(0.0) }
    }

    /// Begins the part called `name`, expected to take `expected_s`; the one before is done.
    pub(crate) fn begin(&self, name: &str, expected_s: f64) {
        self.done_s.set(self.done_s.get() + self.part_s.replace(expected_s));
        self.print(&format!("chart: {name}, {expected_s:.0} s expected"));
        self.at(0.0);
    }

    /// Shows that `fraction` of the part under way is done.
    pub(crate) fn at(&self, fraction: f64) {
        let done = (self.done_s.get() + fraction.clamp(0.0, 1.0) * self.part_s.get()) / self.total_s;
        self.shown.borrow_mut().update((STEPS * done) as u64);
    }

    pub(crate) fn end(&self) {
        self.shown.borrow().finish();
    }

    /// Prints something beside the progress.
    pub(crate) fn print(&self, text: &str) {
        self.shown.borrow().print(text);
    }
}
