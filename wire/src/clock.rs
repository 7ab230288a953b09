//! The time of day, read in one place.

use std::time::UNIX_EPOCH;

/// The time of day in ns since the Unix epoch.
///
/// `acquire` stamps taps with it; elsewhere it serves telemetry only (when a process started, how long a record took),
/// and enters no result.
pub fn now_ns() -> i64 {
    #[expect(clippy::disallowed_methods, reason = "this is the one place that reads the time of day")]
    let now = std::time::SystemTime::now();
    now.duration_since(UNIX_EPOCH).map_or(0, |d| i64::try_from(d.as_nanos()).unwrap_or(i64::MAX))
}
