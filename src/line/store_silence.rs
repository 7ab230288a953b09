//! Whether `store` still answers: if it hangs, the line has to wait, and people should know.

use std::time::{Duration, Instant};

/// `store` reports its progress twice a second while a casing is open: after so long without, its disk is slow or hangs.
const SILENT_AFTER: Duration = Duration::from_millis(1500);

/// How long `store` has reported nothing while it has a casing open.
#[derive(Debug, Default)]
pub(crate) struct StoreSilence {
    heard_at: Option<Instant>,
    is_reported: bool,
}

impl StoreSilence {
    /// Whether the silence has just become long; it is reported once.
    pub(crate) fn has_become_long(&mut self, is_expected: bool) -> bool {
        let is_long = is_expected && self.heard_at.is_some_and(|at| at.elapsed() > SILENT_AFTER);
        if is_long && !self.is_reported {
            tracing::error!("store does not answer: its disk is slow or hangs, or it is held up; the line waits");
            self.is_reported = true;
            return true;
        }
        false
    }

    /// Whether it has been long, and still lasts.
    pub(crate) fn is_long(&self) -> bool {
        self.is_reported
    }

    /// Ends the silence: `store` has reported.
    pub(crate) fn end(&mut self) {
        let now = Instant::now();
        let since = self.heard_at.replace(now).unwrap_or(now);
        if std::mem::take(&mut self.is_reported) {
            tracing::warn!("store answers again, after {:.1} s", (now - since).as_secs_f64());
        }
    }
}
