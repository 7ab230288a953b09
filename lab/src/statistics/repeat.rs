//! How well two turns around a ring agree.

use std::f64::consts::FRAC_1_SQRT_2;

use tapline_draw::stats::{range, rmse, sd};

/// Nor_RMSE of the dissertation's Eq. 54: root mean square difference of two turns over the range of both.
///
/// The range is widened by a crack, so that a damaged ring looks better repeated than a sound one: see
/// [`within_over_all`]. Locations without a value in either turn, or with one that is no number, are left out.
/// `None` when none is left or the range is 0.
///
/// # Panics
/// If the turns differ in length.
pub fn nor_rmse(first: &[Option<f64>], second: &[Option<f64>]) -> Option<f64> {
    let (pairs, values) = pairs(first, second);
    Some(rmse(&pairs)? / range(&values)?).filter(|value| value.is_finite())
}

/// Standard deviation of a reading about its location's mean, sqrt(sum of (y_i1 - y_i2)^2/(2 N)), over that of all readings about
/// theirs, by the count less one.
///
/// Of sound locations no crack widens it: near 1 the scatter of a sound casing is all the rig's; near 0 it is the casing's own. Missing
/// values as for [`nor_rmse`]; `None` for fewer than two locations or values without scatter.
///
/// # Panics
/// If the turns differ in length.
pub fn within_over_all(first: &[Option<f64>], second: &[Option<f64>]) -> Option<f64> {
    let (pairs, values) = pairs(first, second);
    Some(FRAC_1_SQRT_2 * rmse(&pairs)? / sd(&values)?).filter(|value| value.is_finite() && pairs.len() > 1)
}

/// The values of locations that have one in both turns, and all of these values.
fn pairs(first: &[Option<f64>], second: &[Option<f64>]) -> (Vec<(f64, f64)>, Vec<f64>) {
    assert_eq!(first.len(), second.len(), "two turns around one ring");
    let pairs = first.iter().zip(second).filter_map(|(&first, &second)| first.zip(second));
    let pairs: Vec<(f64, f64)> = pairs.filter(|(first, second)| first.is_finite() && second.is_finite()).collect();
    let values = pairs.iter().flat_map(|&(first, second)| [first, second]).collect();
    (pairs, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ratios_are_what_hands_compute() {
        // Catches a range of one turn alone, a missing 2, n for n - 1, and a hole that shifts the pairs.
        let first = [Some(1.0), Some(2.0), None, Some(3.0), Some(9.0)];
        let second = [Some(2.0), Some(2.0), Some(5.0), Some(3.0), Some(10.0)];
        // Differences 1, 0, 0, 1 over four pairs; range 1 to 10.
        let expected = (2.0_f64 / 4.0).sqrt() / 9.0;
        assert!((nor_rmse(&first, &second).unwrap() - expected).abs() < 1e-15);
        // Values 1, 2, 2, 2, 3, 3: mean 13/6, squares 31 - 169/6 = 17/6, over 5; within 1/6.
        let expected = ((1.0_f64 / 6.0) / (17.0 / 30.0)).sqrt();
        let got = within_over_all(&first[..4], &second[..4]).unwrap();
        assert!((got - expected).abs() < 1e-15, "{got}");
    }

    #[test]
    fn nothing_is_made_up() {
        // Catches 0/0 of a constant, and a NaN that passes for a value.
        let (same, nan) = ([Some(1.0); 5], [Some(f64::NAN); 5]);
        assert_eq!((nor_rmse(&same, &same), nor_rmse(&nan, &same), nor_rmse(&[], &[])), (None, None, None));
        assert_eq!(within_over_all(&same, &same), None);
        let ramp: Vec<Option<f64>> = (0..5).map(|i| Some(f64::from(i))).collect();
        assert_eq!(within_over_all(&ramp[..1], &ramp[1..2]), None);
        assert_eq!(within_over_all(&ramp, &ramp), Some(0.0));
        let (huge, other) = ([Some(f64::MAX), Some(-f64::MAX)], [Some(-f64::MAX), Some(f64::MAX)]);
        assert_eq!((nor_rmse(&huge, &other), within_over_all(&huge, &other)), (None, None));
    }
}
