//! The normal distribution's tail.

use statrs::distribution::{ContinuousCDF as _, Normal};

/// The probability that a standard normal value exceeds `z`.
pub(super) fn upper_tail(z: f64) -> f64 {
    Normal::standard().sf(z)
}
