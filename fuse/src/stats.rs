//! Medians, robust spreads and the tail of the normal distribution.

use std::f64::consts::{PI, SQRT_2};

use statrs::function::beta::beta_reg;
use statrs::function::erf::erfc_inv;

/// Standard deviations of a normal distribution per median absolute deviation.
const SIGMA_PER_MAD: f64 = 1.4826;

/// Fewest values that give a centre and a spread worth standardising by.
const VALUES_MIN: usize = 8;

/// A spread at or below this part of the centre is rounding, not scatter.
const ROUNDING: f64 = 1e-12;

/// Where values lie and how far they scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spread {
    /// Median.
    pub(crate) centre: f64,
    /// 1.4826 x the median absolute deviation; above zero.
    pub(crate) sigma: f64,
}

impl Spread {
    /// Spread of `values`, which are reordered.
    ///
    /// `None` for fewer than [`VALUES_MIN`] values, and for values of which half are the same (a
    /// constant, or ties): nothing can be standardised by a spread of zero.
    pub(crate) fn of(values: &mut [f64]) -> Option<Self> {
        if values.len() < VALUES_MIN {
            return None;
        }
        let centre = median(values)?;
        for value in values.iter_mut() {
            *value = (*value - centre).abs();
        }
        let sigma = SIGMA_PER_MAD * median(values)?;
        (sigma.is_finite() && sigma > ROUNDING * centre.abs()).then_some(Self { centre, sigma })
    }
}

/// Median of `values`, which are reordered; the mean of the middle two for an even count.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let is_even = values.len().is_multiple_of(2);
    // Integers in the order of `f64::total_cmp` are selected from at twice the speed.
    let keys: &mut [i64] = bytemuck::cast_slice_mut(values);
    keys.iter_mut().for_each(|key| *key = in_order(*key));
    let (below, &mut upper, _) = keys.select_nth_unstable(middle);
    let lower = if is_even { below.iter().copied().max()? } else { upper };
    keys.iter_mut().for_each(|key| *key = in_order(*key));
    let [lower, upper] = [lower, upper].map(|key| f64::from_bits(in_order(key).cast_unsigned()));
    Some(if is_even { 0.5 * lower + 0.5 * upper } else { upper })
}

/// The bits of a number as an integer that is ordered as the number is, and back.
fn in_order(bits: i64) -> i64 {
    // Magnitudes of negative numbers count down.
    bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed()
}

/// Probability that a standard normal value exceeds each of `z`, written in its place.
///
/// Below |z| = 3 the series Phi(z) = 1/2 + phi(z) (z + z^3/3 + z^5/15 + ...) (Abramowitz and Stegun
/// 26.2.11), beyond it the continued fraction 26.2.14, so that small probabilities keep their digits.
pub(crate) fn upper_tails(z: &mut [f64]) {
    for z in z.chunks_mut(LANES) {
        // Lanes without a value, and those whose tail is no series, are at no one's expense.
        let mut x = [0.0; LANES];
        for (x, magnitude) in x.iter_mut().zip(z.iter().map(|z| z.abs())) {
            *x = if magnitude < SERIES_END { magnitude } else { 0.0 };
        }
        for (z, series) in z.iter_mut().zip(odd_series(x)) {
            let density = (-0.5 * *z * *z).exp() / (SQRT_2 * PI.sqrt());
            let magnitude = z.abs();
            let tail = if magnitude < SERIES_END {
                0.5 - density * series
            } else if magnitude.is_finite() {
                density / continued_fraction(magnitude)
            } else {
                0.0
            };
            *z = if *z < 0.0 { 1.0 - tail } else { tail };
        }
    }
}

/// Values whose tails are found side by side.
const LANES: usize = 8;

/// Where the series ends and the continued fraction begins.
const SERIES_END: f64 = 3.0;

/// The series x + x^3/3 + x^5/15 + ... of each `x` of 0 to 3.
fn odd_series<const N: usize>(x: [f64; N]) -> [f64; N] {
    let (mut sum, mut term) = (x, x);
    // 60 terms: the last is below 1e-25 at 3.
    for n in 1..60_u32 {
        let divisor = f64::from(2 * n + 1);
        let mut has_changed = false;
        for ((sum, term), x) in sum.iter_mut().zip(&mut term).zip(x) {
            *term = *term * x * x / divisor;
            let next = *sum + *term;
            has_changed |= next.to_bits() != sum.to_bits();
            *sum = next;
        }
        // Terms rise before they fall, but none that still rises is lost in the sum of those before it: what follows one
        // that is lost is smaller still.
        if !has_changed {
            break;
        }
    }
    sum
}

/// The continued fraction x + 1/(x + 2/(x + 3/(x + ...))) for `x` of 3 and more.
fn continued_fraction(x: f64) -> f64 {
    // 200 levels reach 1e-14 at 3 and less beyond.
    const LEVELS: u32 = 200;
    const FEWER: [u32; 2] = [20, 60];
    let level = |n: u32, below: f64| x + f64::from(n) / below;
    for fewer in FEWER {
        // What the levels below these give lies between x and this, and rounding keeps the order of numbers: where both
        // ends come to one and the same number, all levels do.
        let ends = (x, level(fewer + 1, x));
        let (low, high) = (1..=fewer).rev().fold(ends, |(low, high), n| (level(n, high), level(n, low)));
        if low.to_bits() == high.to_bits() {
            return low;
        }
    }
    (1..=LEVELS).rev().fold(x, |below, n| level(n, below))
}

/// Chance that a value of Student's t with `freedom` degrees of freedom, above 0, exceeds `t`.
pub(crate) fn t_tail(t: f64, freedom: f64) -> f64 {
    // The symmetric tail is a regularised incomplete beta function (Abramowitz and Stegun 26.7.1).
    let half = if t.is_finite() { 0.5 * beta_reg(0.5 * freedom, 0.5, freedom / (freedom + t * t)) } else { 0.0 };
    if t > 0.0 { half } else { 1.0 - half }
}

/// The t that Student's t with `freedom` degrees of freedom exceeds with `chance` (0 to 0.5), by halving.
pub(crate) fn t_quantile(chance: f64, freedom: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    // With 3 degrees of freedom and a chance of 1e-12 it is 6000; 2^40 is beyond any that is asked for.
    for _ in 0..40 {
        if t_tail(high, freedom) <= chance {
            break;
        }
        high *= 2.0;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if t_tail(middle, freedom) > chance { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The z that a standard normal value exceeds with `chance`, [`in_reach`].
pub(crate) fn upper_quantile(chance: f64) -> f64 {
    let z = SQRT_2 * erfc_inv(2.0 * chance);
    if z.is_nan() { 0.0 } else { in_reach(z) }
}

/// `z` within -9 to 38, beyond which the chances that a standard normal value exceeds it are 1 or 0.
pub(crate) fn in_reach(z: f64) -> f64 {
    z.clamp(-9.0, 38.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn upper_tail(z: f64) -> f64 {
        let mut tail = [z];
        upper_tails(&mut tail);
        tail[0]
    }

    fn median_by_sorting(values: &[f64]) -> f64 {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        if n % 2 == 1 { sorted[n / 2] } else { 0.5 * sorted[n / 2 - 1] + 0.5 * sorted[n / 2] }
    }

    proptest! {
        #[test]
        fn the_median_is_that_of_the_sorted_values(values in prop::collection::vec(-1e3..1e3, 1..40)) {
            // Catches the wrong middle for even or odd counts.
            let expected = median_by_sorting(&values);
            prop_assert_eq!(median(&mut values.clone()).unwrap().to_bits(), expected.to_bits());
        }
    }

    proptest! {
        #[test]
        fn a_series_cut_short_is_the_whole_one(x in prop_oneof![0.0..3.0_f64, 0.0..1e-6_f64, Just(0.0)]) {
            // Catches terms left out that would still have counted: all 60 of them.
            let (whole, _) = (1..60_u32).fold((x, x), |(sum, term), n| {
                let next = term * x * x / f64::from(2 * n + 1);
                (sum + next, next)
            });
            prop_assert_eq!(odd_series([x])[0].to_bits(), whole.to_bits());
        }

        #[test]
        fn tails_side_by_side_are_those_one_by_one(z in prop::collection::vec(prop_oneof![-3.5..3.5_f64, -40.0..40.0_f64], 0..30)) {
            // Catches a lane that is left out, a neighbour's tail, and a lane whose sum is changed by the terms of another.
            let mut tails = z.clone();
            upper_tails(&mut tails);
            let bits = |of: Vec<f64>| of.into_iter().map(f64::to_bits).collect::<Vec<_>>();
            prop_assert_eq!(bits(tails), bits(z.into_iter().map(upper_tail).collect()));
        }
    }

    proptest! {
        #[test]
        fn a_fraction_of_fewer_levels_is_the_whole_one(x in prop_oneof![3.0..4.0_f64, 3.0..40.0_f64, 3.0..1e300_f64]) {
            // Catches ends that do not hold the lower levels between them: all 200 of them.
            let whole = (1..=200_u32).rev().fold(x, |below, n| x + f64::from(n) / below);
            prop_assert_eq!(continued_fraction(x).to_bits(), whole.to_bits());
        }
    }

    #[test]
    fn a_spread_of_zero_is_none() {
        // Catches a division by zero one step later.
        assert_eq!(Spread::of(&mut [3.0; 20]), None);
        let mut rounding: Vec<f64> = (0..20).map(|i| 3.0 + f64::from(i) * 4.5e-16).collect();
        assert_eq!(Spread::of(&mut rounding), None);
        assert_eq!(Spread::of(&mut [0.0, 1.0, 2.0]), None, "too few");
        let mut huge = [f64::MAX, -f64::MAX, f64::MAX, -f64::MAX, f64::MAX, -f64::MAX, f64::MAX, -f64::MAX];
        assert_eq!(Spread::of(&mut huge), None, "overflow");
        let mut ramp: Vec<f64> = (0..9).map(f64::from).collect();
        assert_eq!(Spread::of(&mut ramp), Some(Spread { centre: 4.0, sigma: 2.0 * SIGMA_PER_MAD }));
    }

    #[test]
    fn a_quantile_is_the_tail_read_backwards() {
        // Catches a wrong bracket or direction; above z = 8 below the mean a chance of 1 has lost its digits.
        for z in [-5.0, -1.0, 0.0, 0.3, 3.0, 12.0, 30.0] {
            assert!((upper_quantile(upper_tail(z)) - z).abs() < 1e-7, "{z}: {}", upper_quantile(upper_tail(z)));
        }
        assert!(upper_quantile(1.0) < -8.0 && upper_quantile(0.0) > 37.0 && upper_quantile(f64::NAN).is_finite());
    }

    #[test]
    fn student_has_the_tail_of_tables() {
        // scipy.stats.t.sf; catches a tail that is doubled, the wrong side, and digits lost.
        for (t, freedom, expected) in [
            (2.0, 3.0, 0.069_662_984_279_421_6),
            (-1.0, 10.0, 0.829_553_433_848_970_1),
            (4.320_912_7, 369.37, 1.000_042e-5),
            (6.0, 12.0, 3.108_369_432_4e-5),
        ] {
            let got = t_tail(t, freedom);
            assert!((got / expected - 1.0).abs() < 1e-6, "{t} {freedom}: {got} {expected}");
            if t > 0.0 {
                assert!((t_quantile(got, freedom) - t).abs() < 1e-6 * t);
            }
        }
        assert!((t_tail(1.5, 1e7) - upper_tail(1.5)).abs() < 1e-7, "the normal distribution in the limit");
        assert!(t_tail(f64::INFINITY, 5.0) < 1e-300 && t_quantile(0.5, 5.0).abs() < 1e-9);
    }

    #[test]
    fn the_tail_is_that_of_tables() {
        // scipy.stats.norm.sf; catches a wrong branch, and digits lost by 1 - Phi.
        for (z, expected) in [
            (-3.5, 0.999_767_370_920_964_5),
            (-1.0, 0.841_344_746_068_542_9),
            (0.0, 0.5),
            (1.0, 0.158_655_253_931_457_05),
            (2.999, 0.001_354_336_533_727_105_7),
            (3.001, 0.001_345_472_825_084_965_3),
            (5.5, 1.898_956_246_588_768e-8),
            (7.0, 1.279_812_543_885_835e-12),
            (30.0, 4.906_713_927_147_908e-198),
        ] {
            let got = upper_tail(z);
            assert!((got / expected - 1.0).abs() < 1e-9, "{z}: {got} {expected}");
        }
        assert_eq!(upper_tail(1e9).to_bits(), 0.0_f64.to_bits());
        assert_eq!(upper_tail(f64::INFINITY).to_bits(), 0.0_f64.to_bits());
    }
}
