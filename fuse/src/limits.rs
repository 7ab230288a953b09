//! What the reference's own index map says an index of a sound location may be.

use crate::stats::{Spread, upper_tail};
use crate::{FuseConfig, IndexKind};

/// A region reaches as far from what is suspect as the index stays above this part of the limit.
///
/// The mean of three lowers a crack's edge to two thirds of its middle, so a crack just at the limit
/// has its edges above a half.
const GROW_PART: f64 = 0.5;

/// Part of the clip at which an index is damage however wide the reference scatters: with one
/// discriminator and one tap a location, seven spreads may lie beyond the clip, where no index gets.
const CLIP_PART: f64 = 0.9;

/// Limits on the index, in its own units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limits {
    /// Centre and spread of the reference's index.
    pub(crate) spread: Spread,
    /// Index at and above which a location belongs to a region that has a suspect one.
    pub(crate) grow: f64,
    /// Index at and above which a location is suspect.
    pub(crate) re_inspect: f64,
    /// Index at and above which a region is damage.
    pub(crate) reject: f64,
}

impl Limits {
    /// Limits from the reference's own `index` values, which are reordered; `None` where they are too
    /// few or half of them are the same.
    pub(crate) fn of(config: &FuseConfig, index: &mut [f64]) -> Option<Self> {
        let spread = Spread::of(index)?;
        let Spread { centre, sigma } = spread;
        let reachable = (CLIP_PART * config.z_clip - centre) / config.reject_at;
        let is_capped = config.index == IndexKind::Robust && reachable > 0.0 && reachable < sigma;
        let unit = if is_capped { reachable } else { sigma };
        let at = |count: f64| centre + count * unit;
        Some(Self {
            spread,
            grow: at(GROW_PART * config.re_inspect_at),
            re_inspect: at(config.re_inspect_at),
            reject: at(config.reject_at),
        })
    }

    /// Whether `index` lies as far below the centre as a suspect one lies above it.
    pub(crate) fn is_mirrored(&self, index: f64) -> bool {
        self.spread.centre - index >= self.re_inspect - self.spread.centre
    }

    /// How many of the reference's spreads `index` lies above its centre.
    pub(crate) fn standardised(&self, index: f64) -> f64 {
        (index - self.spread.centre) / self.spread.sigma
    }

    /// Chance of an index as high or higher on a sound location, were the reference's index normal.
    pub(crate) fn p_value(&self, index: f64) -> f64 {
        upper_tail(self.standardised(index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_stand_on_the_reference() {
        // Catches limits that ignore the centre, or whose order is lost.
        let mut index: Vec<f64> = (0..101).map(|i| 0.3 + 0.001 * f64::from(i - 50)).collect();
        let limits = Limits::of(&FuseConfig::default(), &mut index).unwrap();
        let sigma = 1.4826 * 0.025;
        assert!((limits.re_inspect - (0.3 + 5.5 * sigma)).abs() < 1e-12);
        assert!((limits.reject - (0.3 + 7.0 * sigma)).abs() < 1e-12);
        assert!((limits.p_value(0.3) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn the_reject_limit_can_be_reached() {
        // Catches a limit beyond the clip: nothing could ever be rejected.
        let wide: Vec<f64> = (0..101).map(|i| 0.04 * f64::from(i - 50)).collect();
        let limits = Limits::of(&FuseConfig::default(), &mut wide.clone()).unwrap();
        assert!((limits.reject - 5.4).abs() < 1e-12, "{limits:?}");
        assert!(limits.grow < limits.re_inspect && limits.re_inspect < limits.reject);
        let unclipped = FuseConfig { index: IndexKind::Dissertation, ..FuseConfig::default() };
        assert!(Limits::of(&unclipped, &mut wide.clone()).unwrap().reject > 6.0);
    }
}
