//! Medians, quantiles, robust spreads, the tails of distributions, and the area under the ROC curve.

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

    /// The spread of `values` about 0, from those below 0 alone: damage lies above, and may be more than half of them.
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

/// Median of `values`, which are reordered; the mean of the middle two for an even count. `None` without values.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let is_even = values.len().is_multiple_of(2);
    let (lower, upper) = in_order(values, values.len().checked_sub(1)? / 2)?;
    Some(if is_even { 0.5 * lower + 0.5 * upper } else { lower })
}

/// The quantile of `values`, which are reordered, at `fraction` (0 to 1), linear between order statistics. `None` without values.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a place within the values")]
pub(crate) fn quantile(values: &mut [f64], fraction: f64) -> Option<f64> {
    let place = fraction.clamp(0.0, 1.0) * values.len().checked_sub(1)? as f64;
    let (below, above) = in_order(values, place as usize)?;
    Some(below + (place - place.floor()) * (above - below))
}

/// Value number `number` of `values` in ascending order, and the next one; the last one is its own next. `None` if there are fewer.
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

/// Mean of `values`; `None` without any.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Mean and standard deviation (n - 1); `None` with fewer than two values.
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

/// Area under the ROC curve: the chance that a cracked location scores above a sound one, ties counting half.
///
/// NaN scores are left out with their labels (`true` is cracked). `None` if a class is then empty.
/// O(n log n): the Mann-Whitney statistic from mid-ranks.
///
/// # Panics
/// If there are not as many labels as scores.
pub fn auc(scores: &[f64], labels: &[bool]) -> Option<f64> {
    assert_eq!(scores.len(), labels.len(), "one label a score");
    let pairs = scores.iter().copied().zip(labels.iter().copied());
    // -0 + 0 = 0: the two zeros tie, though they sort apart.
    let mut pairs: Vec<(f64, bool)> = pairs.filter(|(score, _)| !score.is_nan()).map(|(s, l)| (s + 0.0, l)).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut sound_below, mut wins) = (0.0, 0.0);
    for tied in pairs.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq()) {
        let cracked = tied.iter().filter(|&&(_, is_cracked)| is_cracked).count() as f64;
        let sound = tied.len() as f64 - cracked;
        wins += cracked * (sound_below + 0.5 * sound);
        sound_below += sound;
    }
    let cracked_count = pairs.len() as f64 - sound_below;
    (cracked_count > 0.0 && sound_below > 0.0).then(|| wins / (cracked_count * sound_below))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The definition: every pair of a cracked and a sound location.
    fn auc_by_pairs(scores: &[f64], labels: &[bool]) -> Option<f64> {
        let class = |c: bool| scores.iter().zip(labels).filter(move |&(s, &l)| l == c && !s.is_nan()).map(|(&s, _)| s);
        let (mut wins, mut pairs) = (0.0, 0.0);
        for cracked in class(true) {
            for sound in class(false) {
                pairs += 1.0;
                wins += if cracked > sound {
                    1.0
                } else if cracked < sound {
                    0.0
                } else {
                    0.5
                };
            }
        }
        (pairs > 0.0).then(|| wins / pairs)
    }

    proptest! {
        #[test]
        fn auc_is_that_of_all_pairs(
            pairs in prop::collection::vec(
                (prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-0.0), (-4..4).prop_map(f64::from)], any::<bool>()), 0..60)
        ) {
            // Catches ties counted as wins, NaN entering, and the classes swapped.
            let (scores, labels): (Vec<f64>, Vec<bool>) = pairs.into_iter().unzip();
            let (got, expected) = (auc(&scores, &labels), auc_by_pairs(&scores, &labels));
            prop_assert_eq!(got.is_some(), expected.is_some());
            prop_assert!((got.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-12);
        }
    }
}
