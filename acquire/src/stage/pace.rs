//! When a station is to be looked at again, and when its next tap is due.

use std::time::{Duration, Instant};

/// How long a proposal, a barrier or an end may go unanswered before it is sent again: its receiver may have died.
pub(crate) const SEND_AGAIN: Duration = Duration::from_secs(1);

/// When to call a station's step again if nothing wakes the process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Next {
    /// At once: it has made progress.
    Now,
    /// After this time at most.
    Within(Duration),
}

/// When the next tap of a station is due.
#[derive(Debug)]
pub(crate) struct Pace {
    pub period: Option<Duration>,
    pub next_due: Instant,
}

impl Pace {
    /// Time until the next tap is due; `None` if it is.
    pub(crate) fn time_left(&self) -> Option<Duration> {
        self.period?;
        self.next_due.checked_duration_since(Instant::now()).filter(|early| !early.is_zero())
    }

    /// Notes that a tap was taken. After a delay the next tap is due one period from now; missed taps are not made up for
    /// in a burst.
    pub(crate) fn taken(&mut self) {
        let Some(period) = self.period else { return };
        let now = Instant::now();
        self.next_due = if self.next_due + period > now { self.next_due } else { now } + period;
    }
}
