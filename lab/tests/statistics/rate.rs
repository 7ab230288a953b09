//! Rates and their intervals.

use tapline_lab::statistics::{Refusal, clopper_pearson};

use super::reference::RATES;

/// Count, all, level; the interval of Clopper and Pearson that statsmodels finds.
pub(crate) type RateCase = (usize, usize, f64, [f64; 2]);

#[test]
fn intervals_are_those_of_statsmodels() {
    // Catches a one-sided interval, an end that is off by one count, and a beta function that gives up on large counts.
    for &(count, all, level, expected) in RATES {
        let got = clopper_pearson(count, all, level).unwrap();
        for (got, expected) in [got.low, got.high].into_iter().zip(expected) {
            assert!((got - expected).abs() <= 1e-9 * expected + 1e-15, "{count} of {all}: {got} {expected}");
        }
        assert_eq!(got.rate.to_bits(), (count as f64 / all as f64).to_bits());
    }
}

#[test]
fn what_is_no_rate_is_refused() {
    // Catches 0/0, more than all, and a level that is none.
    assert_eq!(clopper_pearson(0, 0, 0.95).unwrap_err(), Refusal::TooFew("trials", 0, 1));
    assert!(matches!(clopper_pearson(3, 2, 0.95).unwrap_err(), Refusal::OutOfRange("count", ..)));
    for level in [0.0, 1.0, -0.5, f64::NAN] {
        assert!(matches!(clopper_pearson(1, 2, level).unwrap_err(), Refusal::OutOfRange("level", ..)));
    }
}
