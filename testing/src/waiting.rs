//! Waiting for what other processes and threads do.

use std::time::{Duration, Instant};

/// How long anything may take, so that a test fails instead of hanging.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Waits until `is_so`.
///
/// # Panics
/// If that takes longer than [`PATIENCE`]; `what` says what never happened.
pub fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < PATIENCE, "never: {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}
