//! A signed scale between two percentiles of a reference, with a floor under which a discriminator says nothing.

use crate::Direction;

/// Percentiles of the reference that become 0 and 1; five points of a hundred may be outliers at either end.
const LOW: f64 = 0.05;
/// See [`LOW`].
const HIGH: f64 = 0.95;

/// Fewest values whose 5th and 95th percentiles are not their extremes again.
const VALUES_MIN: usize = 20;

/// A range below this many standard deviations of a repeated tap is one tap's scatter and not the casing's.
const REPEATS_MIN: f64 = 3.0;

/// A range at or below this part of the values is rounding.
const ROUNDING: f64 = 1e-12;

/// A discriminator's scale: 0 is the sound end of the reference and 1 its other end.
///
/// Deviations from Eq. 55: percentiles in place of extremes, so that one outlier does not set the scale; the signed
/// difference clipped at 0, so that a location better than the reference does not look damaged; a weight of 0 where the
/// reference's range is scatter, in place of 0/0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PercentileScale {
    zero: f64,
    range: f64,
    sign: f64,
    weight: f64,
}

/// Values on a scale, and what the scale could not show of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scaled {
    /// 0 to 1; `None` where the value was absent or not a number.
    pub values: Vec<Option<f64>>,
    /// Values sounder than the reference's sound end, shown as 0.
    pub clipped_low: usize,
    /// Values beyond the other end, shown as 1.
    pub clipped_high: usize,
}

impl PercentileScale {
    /// The scale that `reference` gives a discriminator that moves with damage as `direction` says, and whose repeated
    /// taps scatter by `repeat_sd`.
    ///
    /// Values that are no numbers are left out. `None` for fewer than 20 numbers, for a scatter that is none, and for a
    /// reference whose percentiles are further apart than numbers go.
    pub fn of(reference: &[Option<f64>], direction: Direction, repeat_sd: f64) -> Option<Self> {
        let mut numbers: Vec<f64> = reference.iter().copied().flatten().filter(|x| x.is_finite()).collect();
        if numbers.len() < VALUES_MIN || !repeat_sd.is_finite() || repeat_sd < 0.0 {
            return None;
        }
        numbers.sort_by(f64::total_cmp);
        let (low, high) = (percentile(&numbers, LOW), percentile(&numbers, HIGH));
        let (spread, floor) = (high - low, REPEATS_MIN * repeat_sd);
        let magnitude = if high.abs() > low.abs() { high.abs() } else { low.abs() };
        let is_scatter = spread < floor || spread <= ROUNDING * magnitude;
        let range = if is_scatter { floor } else { spread };
        let zero = if direction == Direction::Rises { low } else { high };
        let weight = if is_scatter { 0.0 } else { 1.0 };
        range.is_finite().then_some(Self { zero, range, sign: direction.sign(), weight })
    }

    /// What the discriminator counts in a mean: 1, or 0 where the reference's range is scatter.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// `x` on the scale, 0 to 1; `None` for what is no number and when the weight is 0.
    pub fn score(&self, x: f64) -> Option<f64> {
        self.unclipped(x).map(|y| y.clamp(0.0, 1.0))
    }

    fn unclipped(&self, x: f64) -> Option<f64> {
        (x.is_finite() && self.weight > 0.0).then(|| self.sign * (x - self.zero) / self.range).filter(|y| !y.is_nan())
    }

    /// `values` on the scale; all of them absent when the weight is 0.
    pub fn scaled(&self, values: &[Option<f64>]) -> Scaled {
        let mut scaled = Scaled::default();
        for value in values {
            let y = value.and_then(|x| self.unclipped(x));
            scaled.clipped_low += usize::from(y.is_some_and(|y| y < 0.0));
            scaled.clipped_high += usize::from(y.is_some_and(|y| y > 1.0));
            scaled.values.push(y.map(|y| y.clamp(0.0, 1.0)));
        }
        scaled
    }
}

/// The percentile `share` (0 to 1) of `sorted`, linear between order statistics.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a place within the values, checked by get"
)]
pub(crate) fn percentile(sorted: &[f64], share: f64) -> f64 {
    let place = share.clamp(0.0, 1.0) * sorted.len().saturating_sub(1) as f64;
    let below = sorted.get(place as usize).copied().unwrap_or(f64::NAN);
    let above = sorted.get(place as usize + 1).copied().unwrap_or(below);
    below + (place - place.floor()) * (above - below)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn some(values: impl IntoIterator<Item = f64>) -> Vec<Option<f64>> {
        values.into_iter().map(Some).collect()
    }

    #[test]
    fn percentiles_are_those_of_numpy() {
        // numpy.percentile([1, 2, 4, 8, 16], [5, 50, 95]); catches a place that is off by one.
        let values = [1.0, 2.0, 4.0, 8.0, 16.0];
        for (share, expected) in [(0.0, 1.0), (0.05, 1.2), (0.5, 4.0), (0.95, 14.4), (1.0, 16.0)] {
            assert!((percentile(&values, share) - expected).abs() < 1e-12, "{share}");
        }
        assert!(percentile(&[], 0.5).is_nan());
    }

    #[test]
    fn the_sign_is_kept_and_what_is_clipped_is_counted() {
        // Catches a magnitude, a wrong end for a falling discriminator, and clipped values that nobody hears of.
        let reference = some((0..=100).map(f64::from));
        let values = [Some(5.0), Some(50.0), Some(95.0), Some(-40.0), Some(130.0), None, Some(f64::NAN)];
        let rises = PercentileScale::of(&reference, Direction::Rises, 1.0).unwrap().scaled(&values);
        assert_eq!(rises.values, [Some(0.0), Some(0.5), Some(1.0), Some(0.0), Some(1.0), None, None]);
        assert_eq!((rises.clipped_low, rises.clipped_high), (1, 1));
        let falls = PercentileScale::of(&reference, Direction::Falls, 1.0).unwrap().scaled(&values);
        assert_eq!(falls.values, [Some(1.0), Some(0.5), Some(0.0), Some(1.0), Some(0.0), None, None]);
    }

    #[test]
    fn scatter_has_no_weight() {
        // Catches a floor that is not applied, or one that silences a discriminator just above it.
        let reference = some((0..=100).map(f64::from)); // 90 from percentile to percentile
        let weight = |sd| PercentileScale::of(&reference, Direction::Rises, sd).unwrap().weight();
        assert_eq!((weight(29.9), weight(30.1)), (1.0, 0.0));
        let constant = PercentileScale::of(&some([0.3; 100]), Direction::Rises, 0.0).unwrap();
        assert!(constant.weight() == 0.0 && constant.scaled(&[Some(0.3), Some(9.0)]).values == [None, None]);
        assert_eq!(PercentileScale::of(&reference[..19], Direction::Rises, 1.0), None, "too few");
        assert_eq!(PercentileScale::of(&reference, Direction::Rises, f64::NAN), None);
    }

    proptest! {
        #[test]
        fn every_score_lies_between_0_and_1(
            reference in prop::collection::vec(prop::option::of(any::<f64>()), 0..60),
            values in prop::collection::vec(prop::option::of(any::<f64>()), 0..20),
            sd in any::<f64>(),
        ) {
            // Catches NaN or an infinity that gets through, from any doubles.
            if let Some(scale) = PercentileScale::of(&reference, Direction::Falls, sd) {
                let scaled = scale.scaled(&values);
                prop_assert_eq!(scaled.values.len(), values.len());
                for y in scaled.values.into_iter().flatten() {
                    prop_assert!((0.0..=1.0).contains(&y), "{}", y);
                }
            }
        }
    }
}
