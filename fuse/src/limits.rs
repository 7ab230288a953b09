//! What the reference's own index map says an index of a sound location may be.

use crate::stats::{Spread, t_quantile, t_tail};

/// A region reaches as far from what is suspect as the index stays above this part of the limit.
///
/// The mean of three lowers a crack's edge to two thirds of its middle, so a crack just at the limit
/// has its edges above a half.
const GROW_PART: f64 = 0.5;

/// Standard normal deviate of the guard band: an index that repeats as well as the reference's lies this many of its
/// standard deviations beside where it would lie without scatter in one case of twenty.
const GUARD_AT: f64 = 1.645;

/// Efficiency of the median absolute deviation of normal values: a spread from n of them is as good as a standard
/// deviation from 0.37 n (Hampel 1974).
const MAD_EFFICIENCY: f64 = 0.37;

/// Fewest degrees of freedom that a limit is taken from: below, Student's t has no variance.
const FREEDOM_MIN: f64 = 3.0;

/// Limits on the index, in its own units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limits {
    /// Centre and spread of the reference's index.
    pub(crate) spread: Spread,
    /// Degrees of freedom of that spread.
    pub(crate) freedom: f64,
    /// Index at and above which a location belongs to a region that has a suspect one.
    pub(crate) grow: f64,
    /// Index at and above which a location is suspect.
    pub(crate) re_inspect: f64,
    /// Half width of the guard band: an index that exceeds the limit by more is damage, whatever its scatter.
    pub(crate) guard: f64,
}

/// The reference's index, as limits are taken from it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Null {
    /// Index of sound locations.
    pub(crate) values: Vec<f64>,
    /// How many of them are worth as much as independent ones.
    pub(crate) effective_count: f64,
    /// Standard deviation of the index of a location that is measured again; `None` where nothing was repeated.
    pub(crate) repeat_sd: Option<f64>,
    /// The greatest index there is: no limit stands beyond.
    pub(crate) ceiling: f64,
}

impl Limits {
    /// Limits that a sound shoulder of `location_count` locations exceeds with a chance of `false_call_rate`, from what
    /// the reference's index was; `None` where there is too little of it or half of it is the same.
    ///
    /// The next value of a normal population of which only n are known exceeds their centre by t_v sqrt(1 + 1/n) spreads
    /// (the prediction limit of Student's t): a spread from few values may be too small by chance, and a limit that does
    /// not know it calls too many. The chance is shared out over the locations as if they were independent (Bonferroni),
    /// which neighbours are not: the true rate is the stated one at most.
    pub(crate) fn of(null: &mut Null, false_call_rate: f64, location_count: usize) -> Option<Self> {
        let spread = Spread::of(&mut null.values)?;
        let Spread { centre, sigma } = spread;
        let freedom = MAD_EFFICIENCY * null.effective_count - 1.0;
        let freedom = if freedom > FREEDOM_MIN { freedom } else { FREEDOM_MIN };
        let chance = false_call_rate / location_count as f64;
        let count = if null.effective_count > 1.0 { null.effective_count } else { 1.0 };
        let reach = t_quantile(chance, freedom) * (1.0 + 1.0 / count).sqrt() * sigma;
        let guard = GUARD_AT * null.repeat_sd.filter(|sd| sd.is_finite() && *sd > 0.0).unwrap_or(sigma);
        // Both limits must be such as an index can reach.
        let room = null.ceiling - centre;
        let shrink = if reach + guard > room && room > 0.0 { room / (reach + guard) } else { 1.0 };
        Some(Self {
            spread,
            freedom,
            grow: centre + GROW_PART * shrink * reach,
            re_inspect: centre + shrink * reach,
            guard: shrink * guard,
        })
    }

    /// Index at and above which a location with all its taps is damage.
    pub(crate) fn reject(&self) -> f64 {
        self.re_inspect + self.guard
    }

    /// Whether `index` lies as far below the centre as a suspect one lies above it.
    pub(crate) fn is_mirrored(&self, index: f64) -> bool {
        self.spread.centre - index >= self.re_inspect - self.spread.centre
    }

    /// How many of the reference's spreads `index` lies above its centre.
    pub(crate) fn standardised(&self, index: f64) -> f64 {
        (index - self.spread.centre) / self.spread.sigma
    }

    /// Chance of an index as high or higher on one sound location, were the reference's index normal.
    pub(crate) fn p_value(&self, index: f64) -> f64 {
        t_tail(self.standardised(index), self.freedom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn null(count: u32, step: f64) -> Null {
        let middle = f64::from(count / 2);
        Null {
            values: (0..count).map(|i| 0.3 + step * (f64::from(i) - middle)).collect(),
            effective_count: f64::from(count),
            repeat_sd: Some(0.01),
            ceiling: f64::INFINITY,
        }
    }

    #[test]
    fn limits_stand_on_the_reference() {
        // Catches limits that ignore the centre, the rate, the number of locations, or how much is known.
        let of =
            |count, rate, locations| Limits::of(&mut null(count, 0.1 / f64::from(count)), rate, locations).unwrap();
        let limits = of(1001, 1e-3, 100);
        let sigma = 1.4826 * 25.0 / 1001.0; // half the range is 50/1001, its middle deviation half of that
        // scipy.stats.t.isf(1e-5, 0.37*1001-1) = 4.321
        assert!((limits.standardised(limits.re_inspect) - 4.321).abs() < 0.01, "{limits:?}");
        assert!((limits.spread.sigma / sigma - 1.0).abs() < 0.01);
        assert!((limits.reject() - limits.re_inspect - 0.01645).abs() < 1e-12);
        assert!((limits.p_value(0.3) - 0.5).abs() < 1e-9);
        let reach = |limits: Limits| limits.standardised(limits.re_inspect);
        assert!(reach(of(101, 1e-3, 100)) > reach(limits) + 0.5, "fewer known");
        assert!(reach(of(1001, 1e-2, 100)) < reach(limits) - 0.3, "more calls allowed");
        assert!(reach(of(1001, 1e-3, 10)) < reach(limits) - 0.3, "fewer locations");
        assert!(limits.grow < limits.re_inspect && limits.p_value(limits.re_inspect) < 1.1e-5);
    }

    #[test]
    fn the_reject_limit_can_be_reached() {
        // Catches a limit beyond the clip: nothing could ever be rejected.
        let mut wide = Null { ceiling: 5.4, repeat_sd: None, ..null(101, 0.04) };
        let limits = Limits::of(&mut wide, 1e-3, 100).unwrap();
        assert!((limits.reject() - 5.4).abs() < 1e-12, "{limits:?}");
        assert!(limits.spread.centre < limits.grow && limits.grow < limits.re_inspect && limits.guard > 0.0);
        assert!(Limits::of(&mut null(7, 1.0), 1e-3, 100).is_none(), "too few");
    }
}
