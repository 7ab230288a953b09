//! How fast taps are settled.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Time over which the rate is measured.
const MEASURED_OVER: Duration = Duration::from_secs(10);

/// Shortest time over which a rate is computed.
const MEASURED_OVER_MIN: Duration = Duration::from_millis(200);

/// How many taps were settled when.
#[derive(Debug, Default)]
pub(crate) struct ProgressRate {
    /// When the count was first noted, and when it last changed.
    span: Option<(Instant, Instant)>,
    /// The counts of the last seconds, each when it was first noted.
    recent: VecDeque<(Instant, usize)>,
}

impl ProgressRate {
    /// Notes how many taps are settled by now; since when they are counted.
    pub(crate) fn note(&mut self, settled: usize) -> Instant {
        let now = Instant::now();
        let (since, last) = self.span.get_or_insert((now, now));
        if self.recent.back().is_none_or(|&(_, last)| last != settled) {
            self.recent.push_back((now, settled));
            *last = now;
        }
        while self.recent.len() > 2 && self.recent.front().is_some_and(|&(at, _)| at.elapsed() > MEASURED_OVER) {
            self.recent.pop_front();
        }
        *since
    }

    /// Taps settled per second, recently.
    pub(crate) fn taps_per_s(&self) -> f64 {
        match (self.recent.front(), self.recent.back()) {
            (Some(&(from, first)), Some(&(_, last))) if last > first => {
                (last - first) as f64 / from.elapsed().max(MEASURED_OVER_MIN).as_secs_f64()
            }
            _ => 0.0,
        }
    }

    /// Time from the first count to its last change, in seconds.
    pub(crate) fn elapsed_s(&self) -> f64 {
        self.span.map_or(0.0, |(first, last)| (last - first).as_secs_f64())
    }
}
