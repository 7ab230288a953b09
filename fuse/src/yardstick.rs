//! What a reference says a share of a casing's level should be, condition by condition.

use tapline_wire::Discriminator;

use crate::columns::Columns;
use crate::level::Level;
use crate::shares::{LANES, Shares};
use crate::shoulder::Reading;
use crate::stats::Spread;
use crate::{Direction, FuseConfig, IndexKind, PercentileScale};

/// How a value in one condition becomes a score.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Scale {
    /// Centre and spread of the shares of the level.
    Robust(Spread),
    /// 5th and 95th percentile of the shares of the level.
    Percentile(PercentileScale),
    /// x_m and x_max - x_min of Eq. 55, of the values themselves.
    Extremes { x_m: f64, range: f64 },
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
    /// The yardstick that the configuration makes of the reference's `readings`, each with the level of its casing.
    ///
    /// `repeat_sds` are standard deviations of a repeated tap's share of the level, by slot; only percentiles ask for them.
    pub(crate) fn of<'a>(
        config: &FuseConfig,
        condition_count: usize,
        readings: impl Iterator<Item = (&'a Level, &'a Reading)> + Clone,
        repeat_sds: &[Option<f64>],
    ) -> Self {
        let discriminators = config.directed();
        let width = discriminators.len();
        let conditions = readings.clone().map(|(_, reading)| reading.condition);
        let mut columns = Columns::of(conditions, condition_count, width);
        for (level, reading) in readings {
            let slots = reading.condition * width..;
            for (slot, &(which, _)) in slots.zip(&discriminators) {
                let value = reading.values.get(which);
                let value = match config.index {
                    IndexKind::Dissertation => value,
                    _ => value.and_then(|x| level.share(slot, x)),
                };
                if let Some(value) = value {
                    columns.push(slot, value);
                }
            }
        }
        let scale = |slot: usize, column: &mut [f64]| {
            let direction = discriminators[slot % width].1;
            match config.index {
                IndexKind::Dissertation => extremes(column, direction),
                IndexKind::Percentile => {
                    let shares: Vec<Option<f64>> = column.iter().copied().map(Some).collect();
                    let repeat_sd = repeat_sds.get(slot).copied().flatten().unwrap_or(0.0);
                    let scale = PercentileScale::of(&shares, direction, repeat_sd)?;
                    (scale.weight() > 0.0).then_some(Scale::Percentile(scale))
                }
                _ => Spread::of(column).map(Scale::Robust),
            }
        };
        let mut scales = vec![None; condition_count * width];
        columns.for_each(|slot, column| scales[slot] = scale(slot, column));
        Self { discriminators, z_clip: config.z_clip, scales }
    }

    /// How many discriminators there are.
    pub(crate) fn width(&self) -> usize {
        self.discriminators.len()
    }

    /// The discriminators, each with its direction, in the order of the configuration.
    pub(crate) fn discriminators(&self) -> &[(Discriminator, Direction)] {
        &self.discriminators
    }

    /// Robust spread of the shares of the level in `slot`, where scores are robust z values.
    pub(crate) fn sigma(&self, slot: usize) -> Option<f64> {
        match self.scales[slot]? {
            Scale::Robust(spread) => Some(spread.sigma),
            _ => None,
        }
    }

    /// Scores of the discriminators of `reading`, in the order of the configuration.
    ///
    /// `None` where the value is absent or the reference has no scale for it. A score is signed so that damage raises
    /// it; that of the dissertation is a magnitude (Eq. 55).
    pub(crate) fn scores(&self, level: &Level, reading: &Reading) -> impl Iterator<Item = Option<f64>> {
        let first = reading.condition * self.width();
        self.discriminators.iter().zip(first..).map(move |(&(which, direction), slot)| {
            let x = reading.values.get(which)?;
            let score = match self.scales[slot]? {
                Scale::Robust(Spread { centre, sigma }) => {
                    let z = direction.sign() * (level.share(slot, x)? - centre) / sigma;
                    z.clamp(-self.z_clip, self.z_clip)
                }
                Scale::Percentile(scale) => scale.score(level.share(slot, x)?)?,
                Scale::Extremes { x_m, range } => (x - x_m).abs() / range, // Eq. 55
            };
            Some(score).filter(|s| s.is_finite())
        })
    }
}

/// Robust scores of readings of one casing: [`Yardstick::scores`], with a NaN for what is absent.
///
/// What the reference says of a slot is looked up once and not tap by tap, and the discriminators of a tap are scored side by
/// side. A slot without a scale is full of NaN, and so is what it scores.
pub(crate) struct Scorer {
    shares: Shares,
    conditions: Vec<Slots>,
    z_clip: f64,
}

/// What is known of the slots of one condition.
#[derive(Clone)]
struct Slots {
    centre: [f64; LANES],
    sigma: [f64; LANES],
    sign: [f64; LANES],
}

impl Scorer {
    /// `None` where scores are no robust z values.
    pub(crate) fn of(yardstick: &Yardstick, level: &Level) -> Option<Self> {
        let is_robust = |scale: &Option<Scale>| matches!(scale, None | Some(Scale::Robust(_)));
        if !yardstick.scales.iter().all(is_robust) {
            return None;
        }
        let width = yardstick.width();
        let unknown = [f64::NAN; LANES];
        let nothing = Slots { centre: unknown, sigma: unknown, sign: unknown };
        let mut conditions = vec![nothing; yardstick.scales.len() / width];
        for (slot, scale) in yardstick.scales.iter().enumerate() {
            let Some(Scale::Robust(spread)) = scale else { continue };
            let (slots, lane) = (&mut conditions[slot / width], slot % width);
            (slots.centre[lane], slots.sigma[lane]) = (spread.centre, spread.sigma);
            slots.sign[lane] = yardstick.discriminators[lane].1.sign();
        }
        let shares = Shares::of(level, &yardstick.discriminators, conditions.len());
        Some(Self { shares, conditions, z_clip: yardstick.z_clip })
    }

    /// Scores of the discriminators of `reading`, in the order of the configuration; NaN behind the last.
    pub(crate) fn scores(&self, reading: &Reading) -> [f64; LANES] {
        let slots = &self.conditions[reading.condition];
        let mut scores = self.shares.of_reading(reading);
        for (lane, score) in scores.iter_mut().enumerate() {
            let z = slots.sign[lane] * (*score - slots.centre[lane]) / slots.sigma[lane];
            let z = z.clamp(-self.z_clip, self.z_clip);
            // The clip may be infinite.
            *score = if z.is_finite() { z } else { f64::NAN };
        }
        scores
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
    use tapline_wire::Values;

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
        let reference = reference();
        let level = Level::of(&config.directed(), 3, reference.iter());
        let yardstick = Yardstick::of(config, 3, reference.iter().map(|r| (&level, r)), &[]);
        yardstick.scores(&level, of).collect()
    }

    #[test]
    fn a_robust_score_is_signed_clipped_and_per_condition() {
        // Catches a wrong sign, a missing clip, and conditions that share a scale.
        let robust = config(IndexKind::Robust);
        let is = |got: Vec<Option<f64>>, expected: [Option<f64>; 2], why: &str| {
            for (got, expected) in got.into_iter().zip(expected) {
                assert_eq!(got.is_some(), expected.is_some(), "{why}");
                assert!((got.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-12, "{why}: {got:?} {expected:?}");
            }
        };
        let unit = 1.0 / (1.4826 * 2.0);
        is(scores(&robust, &reading(0, Some(13.0), Some(15.0))), [Some(unit), Some(unit)], "signed");
        is(scores(&robust, &reading(0, Some(1e300), Some(1e300))), [Some(-6.0), Some(6.0)], "clipped");
        is(scores(&robust, &reading(1, Some(130.0), Some(0.3))), [Some(unit), None], "constant");
        is(scores(&robust, &reading(2, Some(13.0), Some(15.0))), [None, None], "no reference there");
        is(scores(&robust, &reading(0, None, Some(14.0))), [None, Some(0.0)], "absent is not zero");
    }

    #[test]
    fn a_score_of_the_dissertation_is_eq_55() {
        // Catches x_m taken at the wrong end, and a constant discriminator's 0/0.
        let faithful = config(IndexKind::Dissertation);
        assert_eq!(scores(&faithful, &reading(0, Some(16.0), Some(16.0))), [Some(0.25), Some(0.75)]);
        assert_eq!(scores(&faithful, &reading(0, Some(20.0), Some(8.0))), [Some(0.25), Some(0.25)], "the magnitude");
        assert_eq!(scores(&faithful, &reading(1, Some(180.0), Some(0.3))), [Some(0.0), None], "constant");
    }

    #[test]
    fn scores_side_by_side_are_those_one_by_one() {
        // Catches another slot's scale, an absent value that is scored, a share that overflows and becomes the clip, and a
        // score that overflows where there is no clip.
        let robust = config(IndexKind::Robust);
        let fine = |i: u32| 1.0 + 1e-3 * f64::from(i);
        let mut reference = reference();
        reference.extend((0..9).map(|i| reading(2, Some(fine(i)), Some(0.5 * fine(i)))));
        let level = Level::of(&robust.directed(), 4, reference.iter());
        let values = [None, Some(0.0), Some(13.3), Some(-14.1), Some(1e300), Some(f64::MAX), Some(f64::MIN)];
        for z_clip in [robust.z_clip, f64::INFINITY] {
            let robust = FuseConfig { z_clip, ..robust.clone() };
            let yardstick = Yardstick::of(&robust, 4, reference.iter().map(|r| (&level, r)), &[]);
            let scorer = Scorer::of(&yardstick, &level).unwrap();
            let pairs = values.into_iter().flat_map(|a| values.into_iter().map(move |b| (a, b)));
            for (f_max, pr) in pairs {
                for condition in 0..4 {
                    let reading = reading(condition, f_max, pr);
                    let slow = yardstick.scores(&level, &reading).chain(std::iter::repeat(None));
                    for (fast, slow) in scorer.scores(&reading).into_iter().zip(slow) {
                        let fast = Some(fast).filter(|score| !score.is_nan());
                        assert_eq!(fast.map(f64::to_bits), slow.map(f64::to_bits), "{z_clip} {reading:?}");
                    }
                }
            }
        }
        let share = config(IndexKind::Dissertation);
        let extremes = Yardstick::of(&share, 3, reference.iter().map(|r| (&level, r)), &[]);
        assert!(Scorer::of(&extremes, &level).is_none());
    }

    #[test]
    fn a_casing_is_measured_against_its_own_level() {
        // Catches the reference's level used for another casing: twice as loud is not damaged.
        let robust = config(IndexKind::Robust);
        let reference = reference();
        let level = Level::of(&robust.directed(), 3, reference.iter());
        let yardstick = Yardstick::of(&robust, 3, reference.iter().map(|r| (&level, r)), &[]);
        let loud = [26.0, 28.0, 30.0].map(|pr| reading(0, Some(14.0), Some(pr)));
        let its_own = Level::of(&robust.directed(), 3, loud.iter());
        let score = |level, of: &Reading| yardstick.scores(level, of).nth(1).unwrap().unwrap();
        assert!(score(&its_own, &loud[1]).abs() < 1e-12 && score(&level, &loud[1]) > 4.0);
        assert!((score(&its_own, &loud[2]) - 1.0 / (1.4826 * 2.0)).abs() < 1e-12, "of the same share");
    }
}
