//! How high a casing's values lie as a whole, condition by condition: what its locations are measured against.

use tapline_wire::Discriminator;

use crate::Direction;
use crate::columns::Columns;
use crate::shoulder::Reading;
use crate::stats::median;

/// Medians of a casing's sound taps, `[condition][discriminator]`; `None` where there is no tap, or a median of zero.
///
/// What a tap gives is taken as a share of them: casings of other constructions, and microphones of other gains, differ by
/// factors.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Level {
    centres: Vec<Option<f64>>,
}

impl Level {
    /// The level of a casing with these `readings`.
    pub(crate) fn of<'a>(
        discriminators: &[(Discriminator, Direction)],
        condition_count: usize,
        readings: impl Iterator<Item = &'a Reading> + Clone,
    ) -> Self {
        let width = discriminators.len();
        let mut columns = Columns::of(readings.clone().map(|reading| reading.condition), condition_count, width);
        for reading in readings {
            for (slot, &(which, _)) in (reading.condition * width..).zip(discriminators) {
                if let Some(value) = reading.values.get(which) {
                    columns.push(slot, value);
                }
            }
        }
        let mut centres = vec![None; condition_count * width];
        columns.for_each(|slot, column| centres[slot] = median(column).filter(|&c| c.is_normal()));
        Self { centres }
    }

    /// The median of `levels`, slot by slot.
    pub(crate) fn pooled(levels: &[Self]) -> Self {
        let slot_count = levels.first().map_or(0, |level| level.centres.len());
        let pooled = |slot: usize| median(&mut levels.iter().filter_map(|l| l.centres[slot]).collect::<Vec<f64>>());
        Self { centres: (0..slot_count).map(pooled).collect() }
    }

    /// The median in slot `condition x width + discriminator`.
    pub(crate) fn centre(&self, slot: usize) -> Option<f64> {
        self.centres[slot]
    }

    /// `x` in slot `condition x width + discriminator` as a share of the level, 1 where it lies at it.
    pub(crate) fn share(&self, slot: usize, x: f64) -> Option<f64> {
        let centre = self.centres[slot]?;
        // The sign of a level that is below zero is kept: a share above 1 is a value above it.
        Some(1.0 + (x - centre) / centre.abs()).filter(|share| share.is_finite())
    }

    /// By how much of it this level lies above `other`, slot by slot.
    pub(crate) fn above(&self, other: &Self) -> Vec<Option<f64>> {
        let difference = |(slot, &own): (usize, &Option<f64>)| Some(other.share(slot, own?)? - 1.0);
        self.centres.iter().enumerate().map(difference).collect()
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::Values;

    use super::*;

    fn reading(condition: usize, pr: f64) -> Reading {
        let mut values = Values::default();
        values.set(Discriminator::Pr, Some(pr));
        Reading { place: 0, condition, values }
    }

    fn level(of: &[(usize, f64)]) -> Level {
        let readings: Vec<Reading> = of.iter().map(|&(condition, pr)| reading(condition, pr)).collect();
        Level::of(&[(Discriminator::Pr, Direction::Rises), (Discriminator::Tau, Direction::Rises)], 2, readings.iter())
    }

    #[test]
    fn a_level_is_of_each_condition() {
        // Catches conditions that share a median, an absent discriminator taken as zero, and a share of nothing.
        let level_1 = level(&[(0, 1.0), (0, 2.0), (0, 9.0), (1, -4.0)]);
        assert_eq!(level_1.centres, [Some(2.0), None, Some(-4.0), None]);
        assert_eq!((level_1.share(0, 3.0), level_1.share(1, 3.0)), (Some(1.5), None));
        assert_eq!(level_1.share(2, -2.0), Some(1.5), "above a level below zero");
        let level_2 = level(&[(0, 3.0), (1, 0.0)]);
        assert_eq!(level_2.above(&level_1), [Some(0.5), None, None, None], "a level of zero is none");
        assert_eq!(Level::pooled(&[level_1, level_2]).centres[..3], [Some(2.5), None, Some(-4.0)]);
        assert_eq!(Level::pooled(&[]).centres, []);
    }
}
