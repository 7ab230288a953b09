//! Medians, quantiles, robust spreads, and the tails of the normal and Student's distribution.

use statrs::distribution::{ChiSquared, ContinuousCDF as _, FisherSnedecor, Normal, StudentsT};

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
    pub centre: f64,
    /// 1.4826 x the median absolute deviation; above zero.
    pub sigma: f64,
}

impl Spread {
    /// The spread of `values`, which are reordered.
    ///
    /// `None` for fewer than 8 values, and for values of which half are the same: nothing can be standardised by a spread
    /// of zero.
    pub(crate) fn of(values: &mut [f64]) -> Option<Self> {
        let centre = median(values).filter(|_| values.len() >= VALUES_MIN)?;
        values.iter_mut().for_each(|value| *value = (*value - centre).abs());
        Self::checked(centre, SIGMA_PER_MAD * median(values)?)
    }

    /// The spread about 0 of `values` as those below 0 tell it: damage lies above, and may be more than half of them.
    pub(crate) fn below_zero(values: &mut [f64]) -> Option<Self> {
        let mut below: Vec<f64> = values.iter().copied().filter(|&x| x <= 0.0).map(f64::abs).collect();
        if below.len() < VALUES_MIN / 2 {
            return None;
        }
        Self::checked(0.0, SIGMA_PER_MAD * median(&mut below)?)
    }

    fn checked(centre: f64, sigma: f64) -> Option<Self> {
        (sigma.is_finite() && sigma > ROUNDING * centre.abs()).then_some(Self { centre, sigma })
    }
}

/// Median of `values`, which are reordered; the mean of the middle two for an even count. `None` of no values.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let is_even = values.len().is_multiple_of(2);
    let (lower, upper) = in_order(values, values.len().checked_sub(1)? / 2)?;
    Some(if is_even { 0.5 * lower + 0.5 * upper } else { lower })
}

/// The quantile of `values`, which are reordered, at `fraction` (0 to 1), linear between order statistics. `None` of no values.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a place within the values")]
pub(crate) fn quantile(values: &mut [f64], fraction: f64) -> Option<f64> {
    let place = fraction.clamp(0.0, 1.0) * values.len().checked_sub(1)? as f64;
    let (below, above) = in_order(values, place as usize)?;
    Some(below + (place - place.floor()) * (above - below))
}

/// Value number `number` of `values` in ascending order, and the next one; the last one is its own next. `None` of fewer values.
fn in_order(values: &mut [f64], number: usize) -> Option<(f64, f64)> {
    if number >= values.len() {
        return None;
    }
    // Integers in the order of `f64::total_cmp` are selected from at twice the speed.
    let keys: &mut [i64] = bytemuck::cast_slice_mut(values);
    keys.iter_mut().for_each(|key| *key = key_of(*key));
    let (_, &mut found, above) = keys.select_nth_unstable(number);
    let next = above.iter().copied().min().unwrap_or(found);
    keys.iter_mut().for_each(|key| *key = key_of(*key));
    let [found, next] = [found, next].map(|key| f64::from_bits(key_of(key).cast_unsigned()));
    Some((found, next))
}

/// The bits of a number as an integer that is ordered as the number is, and back.
fn key_of(bits: i64) -> i64 {
    // Magnitudes of negative numbers count down.
    bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed()
}

/// Mean and standard deviation (n - 1); `None` of fewer than two values.
pub(crate) fn mean_and_sd(values: &[f64]) -> Option<(f64, f64)> {
    if values.len() < 2 {
        return None;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    Some((mean, (squares / (values.len() - 1) as f64).sqrt()))
}

/// Probability that the sum of the squares of `dof` standard normal values exceeds `x`.
pub(crate) fn chi_squared_tail(x: f64, dof: f64) -> f64 {
    ChiSquared::new(dof).map_or(f64::NAN, |of| of.sf(x))
}

/// Probability that Fisher's F with `dof` and `below` degrees of freedom exceeds `f`.
pub(crate) fn f_tail(f: f64, dof: f64, below: f64) -> f64 {
    FisherSnedecor::new(dof, below).map_or(f64::NAN, |of| of.sf(f))
}

/// The z that a standard normal value exceeds with `probability`.
pub(crate) fn normal_quantile(probability: f64) -> f64 {
    -Normal::standard().inverse_cdf(probability.clamp(1e-300, 1.0))
}

/// The t that Student's t with `dof` degrees of freedom exceeds with `probability`.
pub(crate) fn t_quantile(probability: f64, dof: f64) -> f64 {
    StudentsT::new(0.0, 1.0, dof).map_or(f64::NAN, |t_of| -t_of.inverse_cdf(probability.clamp(1e-300, 1.0)))
}
