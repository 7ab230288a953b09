//! The clocks, read in one place.

use std::time::UNIX_EPOCH;

/// The time of day in ns since the Unix epoch.
///
/// It distinguishes the runs of a process and dates taps; outside `acquire` it enters no result.
pub fn now_ns() -> i64 {
    #[expect(clippy::disallowed_methods, reason = "this is the one place that reads the time of day")]
    let now = std::time::SystemTime::now();
    now.duration_since(UNIX_EPOCH).map_or(0, |d| i64::try_from(d.as_nanos()).unwrap_or(i64::MAX))
}

/// Time on a clock that all processes of the machine share and that never jumps, in ns: for latencies, which are
/// telemetry and enter no result.
pub fn monotonic_ns() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec.saturating_mul(1_000_000_000).saturating_add(now.tv_nsec)
}
