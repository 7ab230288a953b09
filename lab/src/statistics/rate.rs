//! A rate from a count, with its interval: of false calls, or of finds at one size.

use statrs::distribution::{Beta, ContinuousCDF as _};

use super::Refusal;

/// Halvings of 0 to 1: the last is below the rounding of any rate that a count can give.
const HALVINGS: usize = 64;

/// A rate and its two-sided interval, all 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Count over all.
    pub rate: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// `count` of `all`, with the interval that holds the true rate at least as often as `level` (Clopper and Pearson
/// 1934).
///
/// It is never too narrow, and somewhat wide for few. The trials are to be independent: of false calls take one per
/// casing or per arc of a ring, not one per location, whose neighbours are alike.
///
/// # Errors
/// [`Refusal::TooFew`] of no trials; [`Refusal::OutOfRange`] for a count above all, or a level that is not between 0
/// and 1.
pub fn clopper_pearson(count: usize, all: usize, level: f64) -> Result<Rate, Refusal> {
    mean_count(count as f64, all, level)
}

/// The same of a `count` that is the mean of several looks at the same trials, and so need not be whole.
///
/// # Errors
/// As [`clopper_pearson`].
pub fn mean_count(count: f64, all: usize, level: f64) -> Result<Rate, Refusal> {
    if all == 0 {
        return Err(Refusal::TooFew("trials", 0, 1));
    }
    let (k, n, tail) = (count, all as f64, 0.5 * (1.0 - level));
    if !(k >= 0.0 && k <= n) {
        return Err(Refusal::OutOfRange("count", k, 0.0, n));
    }
    if !(level > 0.0 && level < 1.0) {
        return Err(Refusal::OutOfRange("level", level, 0.0, 1.0));
    }
    // Only shapes that are not above 0 are refused: those of no count, and of all.
    let end = |a, b, probability| Beta::new(a, b).ok().map(|beta| quantile(&beta, probability));
    let low = end(k, n - k + 1.0, tail).unwrap_or(0.0);
    let high = end(k + 1.0, n - k, 1.0 - tail).unwrap_or(1.0);
    Ok(Rate { rate: k / n, low, high })
}

/// The value at which `beta` reaches `probability`. The library's own finds it to seven digits; bisection needs no start, and
/// cannot fail.
fn quantile(beta: &Beta, probability: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if beta.cdf(middle) < probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}
