//! The discriminators of a tap as shares of its casing's level, side by side.

use tapline_wire::Discriminator;

use crate::Direction;
use crate::level::Level;
use crate::shoulder::Reading;

/// One lane a discriminator, and one more to make eight.
pub(crate) const LANES: usize = Discriminator::ALL.len() + 1;

/// [`Level::share`] of the discriminators of a tap, with a NaN for what is absent.
///
/// What the level is in a condition is looked up once and not tap by tap. A slot without a level is NaN, and so is what is
/// measured against it.
pub(crate) struct Shares {
    /// The level in each condition, and its magnitude.
    levels: Vec<([f64; LANES], [f64; LANES])>,
    /// Place in [`Discriminator::ALL`] of each configured discriminator; `LANES`, which is no place, in spare lanes.
    columns: [usize; LANES],
}

impl Shares {
    /// Shares of `level` in so many conditions.
    pub(crate) fn of(level: &Level, discriminators: &[(Discriminator, Direction)], condition_count: usize) -> Self {
        let width = discriminators.len();
        let centre = |condition: usize, lane: usize| {
            if lane < width { level.centre(condition * width + lane).unwrap_or(f64::NAN) } else { f64::NAN }
        };
        let centres = |condition: usize| std::array::from_fn(|lane| centre(condition, lane));
        let levels = (0..condition_count).map(centres).map(|centres| (centres, centres.map(f64::abs))).collect();
        let columns = std::array::from_fn(|lane| discriminators.get(lane).map_or(LANES, |&(which, _)| which as usize));
        Self { levels, columns }
    }

    /// Shares of the discriminators of `reading`, in the order of the configuration; NaN behind the last.
    #[inline] // once a tap
    pub(crate) fn of_reading(&self, reading: &Reading) -> [f64; LANES] {
        let (levels, units) = &self.levels[reading.condition];
        let values = Discriminator::ALL.map(|which| reading.values.get(which).unwrap_or(f64::NAN));
        let mut shares = self.columns.map(|column| values.get(column).copied().unwrap_or(f64::NAN));
        for ((share, level), unit) in shares.iter_mut().zip(levels).zip(units) {
            let of_level = 1.0 + (*share - level) / unit; // Level::share
            *share = if of_level.is_finite() { of_level } else { f64::NAN };
        }
        shares
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tapline_wire::Values;

    use super::*;

    proptest! {
        #[test]
        fn shares_side_by_side_are_those_one_by_one(
            taps in prop::collection::vec(
                (0_usize..3, prop::array::uniform3(prop::option::weighted(0.8, prop_oneof![-9.0..9.0_f64, Just(1e308), Just(0.0)]))),
                1..30,
            ),
        ) {
            // Catches a level of another condition or discriminator, one of zero, a share that is no number, and an order
            // other than the configuration's.
            let discriminators = [Discriminator::Tau, Discriminator::FMax, Discriminator::Pr].map(|d| (d, Direction::Rises));
            let reading = |&(condition, values): &(usize, [Option<f64>; 3])| {
                let mut of = Values::default();
                discriminators.iter().zip(values).for_each(|(&(which, _), value)| of.set(which, value));
                Reading { place: 0, condition, values: of }
            };
            let readings: Vec<Reading> = taps.iter().map(reading).collect();
            let level = Level::of(&discriminators, 3, readings.iter().step_by(2));
            let shares = Shares::of(&level, &discriminators, 3);
            for reading in &readings {
                let slow = |lane: usize| {
                    let &(which, _) = discriminators.get(lane)?;
                    level.share(3 * reading.condition + lane, reading.values.get(which)?)
                };
                let expected: [Option<u64>; LANES] = std::array::from_fn(|lane| slow(lane).map(f64::to_bits));
                let found = shares.of_reading(reading).map(|share| (!share.is_nan()).then(|| share.to_bits()));
                prop_assert_eq!(found, expected);
            }
        }
    }
}
