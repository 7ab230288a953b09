//! How far the mean of a place's taps at one offset stands out: some of its scatter stays with the place, some comes with the tap.

use crate::index::fused::centre_and_sd;

/// How the mean of a place's taps at one offset scatters.
#[derive(Debug, Clone, Copy)]
pub(super) struct OffsetScale {
    mean: f64,
    /// Variance that stays with the place.
    place_variance: f64,
    /// Variance of one tap.
    tap_variance: f64,
    /// Whether that was told by repetitions, rather than supposed.
    is_parted: bool,
}

impl OffsetScale {
    /// Of the means of sound places, each of so many taps, and the variance of a tap about the mean of its place.
    pub(super) fn of(
        places: impl Iterator<Item = (f64, u32)>,
        tap_variance: Option<f64>,
        is_own: bool,
    ) -> Option<Self> {
        let places: Vec<(f64, u32)> = places.collect();
        let (mean, sd) = centre_and_sd(places.iter().map(|place| place.0).collect(), is_own)?;
        let inverse = places.iter().map(|place| 1.0 / f64::from(place.1)).sum::<f64>() / places.len() as f64;
        // Of places with one tap each nobody can tell what stays with the place: half of the variance is taken to.
        let is_parted = tap_variance.is_some();
        let tap_variance = tap_variance.unwrap_or(0.5 * sd * sd / inverse);
        let of_taps = tap_variance * inverse;
        let (place_variance, tap_variance) =
            if of_taps < sd * sd { (sd * sd - of_taps, tap_variance) } else { (0.0, sd * sd / inverse) };
        (sd > 1e-9).then_some(Self { mean, place_variance, tap_variance, is_parted })
    }

    /// Takes `tap_variance` for that of one tap where repetitions of the scan have not told it.
    pub(super) fn part(&mut self, tap_variance: f64) {
        if !self.is_parted {
            let all = self.place_variance + self.tap_variance;
            self.tap_variance = if tap_variance < all { tap_variance } else { all };
            self.place_variance = all - self.tap_variance;
        }
    }

    pub(super) fn score(self, mean: f64, count: u32) -> f64 {
        match count {
            0 => f64::NAN,
            _ => (mean - self.mean) / (self.place_variance + self.tap_variance / f64::from(count)).sqrt(),
        }
    }
}
