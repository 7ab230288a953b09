//! The index of the source, as printed: Eqs. 55 and 56.

use tapline_wire::Direction;

use crate::evidence::{ABSENT, Vector};
use crate::index::{Index, Scores, Setup};
use crate::shoulder::Shoulder;
use crate::stats::{mean, mean_and_sd};

/// Fewest sound places from which the scatter of the index is estimated.
const PLACES_MIN: usize = 8;

/// Largest score: a broken value must not make squares of scores overflow.
const SCORE_MAX: f64 = 1e6;

/// What a reference taught: the extremes of Eq. 55, and how the index of its sound places scatters.
#[derive(Debug, Clone)]
pub(crate) struct Extremes {
    setup: Setup,
    /// x_m and x_max - x_min by `[condition][discriminator]`; `None` of a constant, which Eq. 55 makes 0/0.
    extremes: Vec<Vec<Option<(f64, f64)>>>,
    mean: f64,
    sd: f64,
}

impl Extremes {
    /// The extremes of `shoulders`, damaged places among them: those are the other end of the scale.
    pub(crate) fn fit(setup: &Setup, shoulders: &[&Shoulder]) -> Option<Self> {
        let width = setup.discriminators.len();
        let mut values = vec![vec![Vec::new(); width]; setup.offset_of.len()];
        for averaged in shoulders.iter().flat_map(|shoulder| averaged(setup, shoulder)).flatten() {
            for (values, x) in values[averaged.condition].iter_mut().zip(averaged.x).filter(|(_, x)| x.is_finite()) {
                values.push(x);
            }
        }
        let of = |(values, (_, direction)): (Vec<f64>, &(_, Direction))| {
            let least = values.iter().copied().min_by(f64::total_cmp)?;
            let greatest = values.iter().copied().max_by(f64::total_cmp)?;
            let x_m = if *direction == Direction::Rises { least } else { greatest };
            (greatest > least).then_some((x_m, greatest - least))
        };
        let extremes = values.into_iter().map(|row| row.into_iter().zip(&setup.discriminators).map(of).collect());
        let mut index = Self { setup: setup.clone(), extremes: extremes.collect(), mean: 0.0, sd: 1.0 };
        let sound: Vec<f64> = shoulders
            .iter()
            .flat_map(|shoulder| index.values(shoulder).into_iter().zip(shoulder.sound()).filter(|(_, sound)| *sound))
            .filter_map(|(value, _)| value)
            .collect();
        (index.mean, index.sd) = mean_and_sd(&sound).filter(|(_, sd)| sound.len() >= PLACES_MIN && *sd > 1e-12)?;
        Some(index)
    }

    /// The damage index of each place (Eq. 56), the mean over its conditions; `None` where nothing was scaled.
    fn values(&self, shoulder: &Shoulder) -> Vec<Option<f64>> {
        // Over the discriminators and conditions that are there; Eq. 56 has all of them.
        let index = |of: &Averaged| mean(self.scaled(of).into_iter().flatten()); // Eq. 56
        let of = |conditions: Vec<Averaged>| mean(conditions.iter().filter_map(index));
        averaged(&self.setup, shoulder).into_iter().map(of).collect()
    }

    /// y of each discriminator.
    fn scaled(&self, of: &Averaged) -> Vec<Option<f64>> {
        let extremes = &self.extremes[of.condition];
        let y = |(x, extremes): (&f64, &Option<(f64, f64)>)| {
            let (x_m, range) = (*extremes)?;
            Some((x - x_m).abs() / range).filter(|y| y.is_finite()) // Eq. 55
        };
        of.x.iter().zip(extremes).map(y).collect()
    }
}

/// The discriminators of a place in one condition, each the mean of its repetitions ("the averaged values").
struct Averaged {
    condition: usize,
    x: Vec<f64>,
}

/// The averages of each place, `[place][condition]`.
fn averaged(setup: &Setup, shoulder: &Shoulder) -> Vec<Vec<Averaged>> {
    let of = |place: usize| {
        let same_condition = shoulder.turns.chunk_by(|a, b| a.condition == b.condition);
        let average = same_condition.map(|turns| Averaged {
            condition: turns[0].condition,
            x: (setup.discriminators.iter())
                .map(|(which, _)| {
                    mean(turns.iter().filter_map(|turn| turn.values[place].get(*which))).unwrap_or(f64::NAN)
                })
                .collect(),
        });
        average.collect()
    };
    (0..shoulder.place_count()).map(of).collect()
}

impl Index for Extremes {
    fn scores(&self, casing: &[&Shoulder]) -> Vec<Scores> {
        let of = |shoulder: &&Shoulder| {
            let place_count = shoulder.place_count();
            let standardised = |value: Option<f64>| -> Vector {
                let mut scores = ABSENT;
                scores[0] =
                    value.map_or(f64::NAN, |value| ((value - self.mean) / self.sd).clamp(-SCORE_MAX, SCORE_MAX));
                scores
            };
            let width = self.setup.discriminators.len();
            let by_offset: Vec<Vec<Vector>> = vec![self.values(shoulder).into_iter().map(standardised).collect()];
            let mut scores = Scores {
                by_offset: by_offset.clone(),
                uncut: by_offset,
                by_discriminator: vec![vec![f64::NAN; width]; place_count],
                is_inlier: vec![true; place_count],
                scatter: Vec::new(),
            };
            for (place, conditions) in averaged(&self.setup, shoulder).into_iter().enumerate() {
                for (d, mean_score) in scores.by_discriminator[place].iter_mut().enumerate() {
                    *mean_score = mean(conditions.iter().filter_map(|c| self.scaled(c)[d])).unwrap_or(f64::NAN);
                }
            }
            scores
        };
        casing.iter().map(of).collect()
    }

    fn as_printed(&self, shoulder: &Shoulder) -> Option<Vec<Option<f64>>> {
        Some(self.values(shoulder))
    }

    fn sigma(&self, _: usize, _: usize) -> Option<f64> {
        None
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::{Discriminator, Geometry, Values};

    use super::*;
    use crate::IndexKind;
    use crate::shoulder::Turn;
    use crate::shoulder::ring::Ring;

    #[test]
    fn the_index_is_that_of_its_equations() {
        // Catches a step along the ring, a sign, or a mean over taps in the faithful form: worked by hand.
        let values = (0..11).map(|place| {
            let mut values = Values::default();
            values.set(Discriminator::FMax, Some(20.0 - f64::from(place))); // falls: x_m is 20
            values.set(Discriminator::Tau, Some(if place == 10 { 3.0 } else { 1.0 })); // rises: x_m is 1
            values.set(Discriminator::Pr, Some(0.5)); // constant: left out
            values
        });
        let locations: Vec<_> = (0..11).map(|location| (location, None)).collect();
        let shoulder = Shoulder {
            ring: Ring::of(Geometry::Line, &locations, None),
            casing: 0,
            turns: vec![Turn::new(0, values.collect())],
            is_cracked: vec![None; 11],
        };
        let setup = Setup {
            kind: IndexKind::Dissertation,
            discriminators: [Discriminator::FMax, Discriminator::Tau, Discriminator::Pr]
                .map(|d| (d, d.direction()))
                .to_vec(),
            offset_of: vec![0],
            offset_count: 1,
            is_own: true,
            has_common_level: false,
        };
        let index = Extremes::fit(&setup, &[&shoulder]).unwrap();
        for (place, value) in index.values(&shoulder).into_iter().enumerate() {
            let expected = if place == 10 { 1.0 } else { place as f64 / 20.0 }; // Eq. 56 of y = place/10 and 0 or 1
            assert!((value.unwrap() - expected).abs() < 1e-12, "{place} {value:?}");
        }
    }
}
