//! What a reference says a value should be, condition by condition.

use tapline_wire::{Discriminator, Values};

use crate::stats::Spread;
use crate::{Direction, FuseConfig, IndexKind};

/// What one tap, or the mean of several at one place in one condition, gave.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    /// Which of the shoulder's locations, counted in their order.
    pub(crate) place: usize,
    /// Number of its condition.
    pub(crate) condition: usize,
    /// Its discriminators.
    pub(crate) values: Values,
}

/// How a value in one condition becomes a score.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Scale {
    Robust(Spread),
    /// x_m and x_max - x_min of Eq. 55.
    Extremes {
        x_m: f64,
        range: f64,
    },
}

/// The reference's scale of every discriminator in every condition.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Yardstick {
    discriminators: Vec<(Discriminator, Direction)>,
    z_clip: f64,
    /// `[condition][discriminator]`, `None` where the reference's values are too few or constant.
    scales: Vec<Option<Scale>>,
}

impl Yardstick {
    /// The yardstick that the configuration makes of the reference's `readings`.
    pub(crate) fn of<'a>(
        config: &FuseConfig,
        condition_count: usize,
        readings: impl Iterator<Item = &'a Reading>,
    ) -> Self {
        let discriminators = config.directed();
        let width = discriminators.len();
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); condition_count * width];
        for reading in readings {
            for (slot, &(which, _)) in discriminators.iter().enumerate() {
                columns[reading.condition * width + slot].extend(reading.values.get(which));
            }
        }
        let scale = |(number, column): (usize, &mut Vec<f64>)| match config.index {
            IndexKind::Robust => Spread::of(column).map(Scale::Robust),
            IndexKind::Dissertation => extremes(column, discriminators[number % width].1),
        };
        let scales = columns.iter_mut().enumerate().map(scale).collect();
        Self { discriminators, z_clip: config.z_clip, scales }
    }

    /// Scores of the discriminators of `reading`, in the order of the configuration.
    ///
    /// `None` where the value is absent or the reference has no scale for it. A robust score is signed
    /// so that damage raises it; that of the dissertation is a magnitude (Eq. 55).
    pub(crate) fn scores(&self, reading: &Reading) -> impl Iterator<Item = Option<f64>> {
        let width = self.discriminators.len();
        let scales = &self.scales[reading.condition * width..][..width];
        self.discriminators.iter().zip(scales).map(|(&(which, direction), scale)| {
            let x = reading.values.get(which)?;
            let score = match (*scale)? {
                Scale::Robust(Spread { centre, sigma }) => {
                    (direction.sign() * (x - centre) / sigma).clamp(-self.z_clip, self.z_clip)
                }
                Scale::Extremes { x_m, range } => (x - x_m).abs() / range, // Eq. 55
            };
            Some(score).filter(|s| s.is_finite())
        })
    }
}

/// x_m = x_max for a discriminator that falls with damage, x_min for one that rises (section 5.4.4).
fn extremes(values: &[f64], direction: Direction) -> Option<Scale> {
    let x_max = values.iter().copied().max_by(f64::total_cmp)?;
    let x_min = values.iter().copied().min_by(f64::total_cmp)?;
    let range = x_max - x_min;
    let x_m = match direction {
        Direction::Rises => x_min,
        Direction::Falls => x_max,
    };
    (range > 0.0 && range.is_finite()).then_some(Scale::Extremes { x_m, range })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(condition: usize, f_max: Option<f64>, pr: Option<f64>) -> Reading {
        let mut values = Values::default();
        values.set(Discriminator::FMax, f_max);
        values.set(Discriminator::Pr, pr);
        Reading { place: 0, condition, values }
    }

    fn config(index: IndexKind) -> FuseConfig {
        FuseConfig { discriminators: vec![Discriminator::FMax, Discriminator::Pr], index, ..FuseConfig::default() }
    }

    /// Condition 0: 10, 11, ..., 18. Condition 1: ten times that, and a constant PR.
    fn reference() -> Vec<Reading> {
        let step = |i: u32| f64::from(10 + i);
        let zero = (0..9).map(move |i| reading(0, Some(step(i)), Some(step(i))));
        let one = (0..9).map(move |i| reading(1, Some(10.0 * step(i)), Some(0.3)));
        zero.chain(one).collect()
    }

    fn scores(config: &FuseConfig, of: &Reading) -> Vec<Option<f64>> {
        Yardstick::of(config, 3, reference().iter()).scores(of).collect()
    }

    #[test]
    fn a_robust_score_is_signed_clipped_and_per_condition() {
        // Catches a wrong sign, a missing clip, and conditions that share a scale.
        let robust = config(IndexKind::Robust);
        let sigma = 1.4826 * 2.0;
        assert_eq!(scores(&robust, &reading(0, Some(13.0), Some(15.0))), [Some(1.0 / sigma), Some(1.0 / sigma)]);
        assert_eq!(scores(&robust, &reading(0, Some(1e308), Some(1e308))), [Some(-6.0), Some(6.0)]);
        assert_eq!(scores(&robust, &reading(1, Some(130.0), Some(0.3))), [Some(1.0 / sigma), None], "constant");
        assert_eq!(scores(&robust, &reading(2, Some(13.0), Some(15.0))), [None, None], "no reference there");
        assert_eq!(scores(&robust, &reading(0, None, Some(14.0))), [None, Some(0.0)], "absent is not zero");
    }

    #[test]
    fn a_score_of_the_dissertation_is_eq_55() {
        // Catches x_m taken at the wrong end, and a constant discriminator's 0/0.
        let faithful = config(IndexKind::Dissertation);
        assert_eq!(scores(&faithful, &reading(0, Some(16.0), Some(16.0))), [Some(0.25), Some(0.75)]);
        assert_eq!(scores(&faithful, &reading(0, Some(20.0), Some(8.0))), [Some(0.25), Some(0.25)], "the magnitude");
        assert_eq!(scores(&faithful, &reading(1, Some(180.0), Some(0.3))), [Some(0.0), None], "constant");
    }
}
