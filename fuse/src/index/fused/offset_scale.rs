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
    /// Most taps of a place of the reference.
    count_max: f64,
}

impl OffsetScale {
    /// The scale from the means of sound places, each with its number of taps, and the variance of a tap about the mean of its place, which
    /// is `None` where no place has two taps.
    pub(super) fn of(
        places: impl Iterator<Item = (f64, u32)>,
        tap_variance: Option<f64>,
        is_own: bool,
    ) -> Option<Self> {
        let places: Vec<(f64, u32)> = places.collect();
        let (mean, sd) = centre_and_sd(places.iter().map(|place| place.0).collect(), is_own)?;
        let inverse = places.iter().map(|place| 1.0 / f64::from(place.1)).sum::<f64>() / places.len() as f64;
        let tap_variance = tap_variance.unwrap_or(0.0);
        let of_taps = tap_variance * inverse;
        let (place_variance, tap_variance) =
            if of_taps < sd * sd { (sd * sd - of_taps, tap_variance) } else { (0.0, sd * sd / inverse) };
        let count_max = f64::from(places.iter().map(|place| place.1).max()?);
        (sd > 1e-9).then_some(Self { mean, place_variance, tap_variance, count_max })
    }

    /// How far a `mean` of `count` taps stands out; NaN of none.
    ///
    /// The mean of fewer taps than the reference has scatters more. That of more, as after a second reading, scatters less, but counts as
    /// if it did not: sound places differ from their neighbours, and on a finer scale what stays with them would look like damage.
    pub(super) fn score(self, mean: f64, count: u32) -> f64 {
        let count = f64::from(count);
        let taps = if count < self.count_max { count } else { self.count_max };
        match taps > 0.0 {
            true => (mean - self.mean) / (self.place_variance + self.tap_variance / taps).sqrt(),
            false => f64::NAN,
        }
    }
}
