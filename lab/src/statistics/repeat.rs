//! How well two turns around a ring agree.

/// Nor_RMSE of the dissertation's Eq. 54: root mean square difference of two turns over the range of both.
///
/// The range is widened by a crack, so that a damaged ring looks better repeated than a sound one: see
/// [`within_over_healthy`]. Locations without a value in either turn, or with one that is no number, are left out.
/// `None` when none is left or the range is 0.
///
/// # Panics
/// If the turns differ in length.
pub fn nor_rmse(first: &[Option<f64>], second: &[Option<f64>]) -> Option<f64> {
    let pairs = pairs(first, second);
    let values = || pairs.iter().flat_map(|&(_, first, second)| [first, second]);
    let range = values().max_by(f64::total_cmp)? - values().min_by(f64::total_cmp)?;
    Some(mean_square_difference(&pairs)?.sqrt() / range).filter(|value| value.is_finite())
}

/// Standard deviation of a reading about its location's mean, over that of sound locations' readings about theirs.
///
/// The first is over all locations, sqrt(sum of (y_i1 - y_i2)^2/(2 N)); the second is over those marked in
/// `is_healthy`, both turns together, by the count less one, and no crack widens it. Near 1 the scatter of a sound
/// casing is all the rig's; near 0 it is the casing's own. Missing values as for [`nor_rmse`]; `None` for fewer than
/// two sound locations or sound values without scatter.
///
/// # Panics
/// If the turns and the marks differ in length.
pub fn within_over_healthy(first: &[Option<f64>], second: &[Option<f64>], is_healthy: &[bool]) -> Option<f64> {
    assert_eq!(first.len(), is_healthy.len(), "as many marks as locations");
    let pairs = pairs(first, second);
    let healthy: Vec<f64> = pairs.iter().filter(|pair| is_healthy[pair.0]).flat_map(|pair| [pair.1, pair.2]).collect();
    if healthy.len() < 4 {
        return None;
    }
    let mean = healthy.iter().sum::<f64>() / healthy.len() as f64;
    let variance = healthy.iter().map(|y| (y - mean) * (y - mean)).sum::<f64>() / (healthy.len() - 1) as f64;
    Some((0.5 * mean_square_difference(&pairs)? / variance).sqrt()).filter(|value| value.is_finite())
}

/// Locations that have a value in both turns, with them.
fn pairs(first: &[Option<f64>], second: &[Option<f64>]) -> Vec<(usize, f64, f64)> {
    assert_eq!(first.len(), second.len(), "two turns around one ring");
    let number = |value: Option<f64>| value.filter(|value| value.is_finite());
    let pair = |(place, (&first, &second))| Some((place, number(first)?, number(second)?));
    first.iter().zip(second).enumerate().filter_map(pair).collect()
}

fn mean_square_difference(pairs: &[(usize, f64, f64)]) -> Option<f64> {
    let sum: f64 = pairs.iter().map(|&(_, first, second)| (first - second) * (first - second)).sum();
    (!pairs.is_empty()).then(|| sum / pairs.len() as f64)
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
        // Healthy 1, 2, 2, 2, 3, 3: mean 13/6, squares 31 - 169/6 = 17/6, over 5; within 2/8.
        let expected = (0.25_f64 / (17.0 / 30.0)).sqrt();
        let got = within_over_healthy(&first, &second, &[true, true, true, true, false]).unwrap();
        assert!((got - expected).abs() < 1e-15, "{got}");
    }

    #[test]
    fn a_crack_flatters_the_dissertations_number_alone() {
        // Catches the healthy scatter taken over the whole ring: two turns with the same noise, without and with a
        // crack.
        let noise = |i: usize, turn: usize| ((i * 37 + turn * 53) % 101) as f64 / 101.0;
        let turn = |turn: usize, crack: f64| -> Vec<Option<f64>> {
            (0..100).map(|i| Some(noise(i, turn) + if i < 10 { crack } else { 0.0 })).collect()
        };
        let is_healthy: Vec<bool> = (0..100).map(|i| i >= 10).collect();
        let both = |crack: f64| {
            let (first, second) = (turn(0, crack), turn(1, crack));
            (nor_rmse(&first, &second).unwrap(), within_over_healthy(&first, &second, &is_healthy).unwrap())
        };
        let (sound, cracked) = (both(0.0), both(9.0));
        assert!(cracked.0 < 0.2 * sound.0 && (cracked.1 / sound.1 - 1.0).abs() < 1e-9, "{sound:?} {cracked:?}");
    }

    #[test]
    fn nothing_is_made_up() {
        // Catches 0/0 of a constant, and a NaN that passes for a value.
        let (same, nan) = ([Some(1.0); 5], [Some(f64::NAN); 5]);
        assert_eq!((nor_rmse(&same, &same), nor_rmse(&nan, &same), nor_rmse(&[], &[])), (None, None, None));
        assert_eq!(within_over_healthy(&same, &same, &[true; 5]), None);
        let ramp: Vec<Option<f64>> = (0..5).map(|i| Some(f64::from(i))).collect();
        assert_eq!(within_over_healthy(&ramp, &ramp, &[false, false, true, false, false]), None);
        assert_eq!(within_over_healthy(&ramp, &ramp, &[true; 5]), Some(0.0));
        let (huge, other) = ([Some(f64::MAX), Some(-f64::MAX)], [Some(-f64::MAX), Some(f64::MAX)]);
        assert_eq!((nor_rmse(&huge, &other), within_over_healthy(&huge, &other, &[true; 2])), (None, None));
    }
}
