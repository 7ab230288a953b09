//! How long verdicts take.

use serde::{Deserialize, Serialize};

/// Upper bounds of all bins except the last, in seconds. A verdict is promised within a second.
const BOUNDS_S: [f64; 8] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 60.0];

/// Casings that waited longer were interrupted: the line or the machine was restarted in between.
const INTERRUPTED_S: f64 = 600.0;

/// Times from the last tap of a casing to its verdict.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Latency {
    /// [`BOUNDS_S`], for readers of the JSON.
    pub bounds_s: [f64; BOUNDS_S.len()],
    /// How many are in each bin: those of the bounds, and one above.
    pub counts: [u64; BOUNDS_S.len() + 1],
    /// Their sum, in seconds.
    pub sum_s: f64,
}

impl Default for Latency {
    fn default() -> Self {
        Self { bounds_s: BOUNDS_S, counts: [0; BOUNDS_S.len() + 1], sum_s: 0.0 }
    }
}

impl Latency {
    /// Counts a verdict that took this long, unless the casing was interrupted.
    pub(crate) fn note(&mut self, latency_s: f64) {
        if !(0.0..INTERRUPTED_S).contains(&latency_s) {
            return;
        }
        self.counts[BOUNDS_S.iter().filter(|&&bound_s| latency_s > bound_s).count()] += 1;
        self.sum_s += latency_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a time in the wrong bin, and one of a casing that was continued after a restart of the machine.
    #[test]
    fn a_time_is_in_the_bin_of_its_bound() {
        let mut latency = Latency::default();
        for latency_s in [0.1, 0.11, 60.0, 61.0, -3.0, 700.0, f64::NAN] {
            latency.note(latency_s);
        }
        assert_eq!(latency.counts, [1, 1, 0, 0, 0, 0, 0, 1, 1]);
        assert!((latency.sum_s - 121.21).abs() < 1e-9);
    }
}
