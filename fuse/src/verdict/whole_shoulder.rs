//! The shoulder as a whole: damage all round leaves no sound place to stand out from.

use faer::Mat;
use faer::linalg::solvers::Solve as _;
use tapline_wire::Discriminator;

use crate::index::Setup;
use crate::shoulder::{Shoulder, Turn, value_of};
use crate::stats::{self, mean, median};

/// Independent of the microphone's gain.
const FREE_OF_GAIN: [Discriminator; 3] = [Discriminator::FMax, Discriminator::Tau, Discriminator::Pr];

/// Fewest casings that a covariance of levels is taken from. With fewer, so few degrees of freedom are left for three discriminators that
/// damage all round would pass: by 5 casings a level is rarer than 0.1 % only beyond 130 standard deviations, by 8 beyond 16.
pub(crate) const CASINGS_MIN: usize = 8;

/// At least one place in this many must give the level.
const PLACES_PART: usize = 5;

/// A shoulder with its sound places, which give its level.
#[derive(Debug)]
pub(crate) struct SoundPlaces<'a> {
    shoulder: &'a Shoulder,
    is_sound: Vec<bool>,
}

impl<'a> SoundPlaces<'a> {
    /// All places that are not known to be cracked.
    pub(crate) fn known(shoulder: &'a Shoulder) -> Self {
        Self { shoulder, is_sound: shoulder.sound() }
    }

    /// Those of them that do not stand out either, so that a crack does not shift the level; all of them where few would be left.
    pub(crate) fn found(shoulder: &'a Shoulder, is_inlier: &[bool]) -> Self {
        let known = Self::known(shoulder);
        let is_sound: Vec<bool> = known.is_sound.iter().zip(is_inlier).map(|(a, b)| *a && *b).collect();
        let is_enough = PLACES_PART * is_sound.iter().filter(|is| **is).count() >= is_sound.len();
        if is_enough { Self { shoulder, is_sound } } else { known }
    }
}

/// The levels of sound shoulders.
#[derive(Debug, Clone)]
pub(crate) struct SoundLevels {
    /// Mean of each discriminator by condition; NaN where there is none.
    means: Vec<[f64; Discriminator::COUNT]>,
    /// How they differ from shoulder to shoulder, where there are enough casings.
    spread: Option<LevelScatter>,
}

/// The spread of the levels of sound shoulders.
#[derive(Debug, Clone)]
struct LevelScatter {
    /// Those of [`FREE_OF_GAIN`] that the reference has.
    discriminators: Vec<Discriminator>,
    casing_count: usize,
    /// Mean square of the levels of a shoulder about their means.
    of_shoulder: Mat<f64>,
    /// Mean square of the difference of the two shoulders of a casing, and of how many, where enough have two.
    of_difference: Option<(Mat<f64>, usize)>,
}

impl SoundLevels {
    /// What the shoulders of a reference teach.
    ///
    /// A shoulder that is known to be cracked at more than half of its places does not show the level of a sound one.
    pub(crate) fn fit(setup: &Setup, shoulders: &[SoundPlaces<'_>]) -> Self {
        let is_mostly_sound = |of: &&SoundPlaces<'_>| {
            let sound = of.shoulder.sound();
            2 * sound.iter().filter(|is| **is).count() >= sound.len()
        };
        let shoulders: Vec<&SoundPlaces<'_>> = shoulders.iter().filter(is_mostly_sound).collect();
        let mean_of = |condition: usize, which: Discriminator| {
            let turns = shoulders.iter().flat_map(|of| of.shoulder.turns.iter().map(move |turn| (*of, turn)));
            let turns = turns.filter(|(_, turn)| turn.condition == condition);
            mean(turns.filter_map(|(of, turn)| level(of, turn, which))).unwrap_or(f64::NAN)
        };
        let means = (0..setup.offset_of.len()).map(|c| Discriminator::ALL.map(|which| mean_of(c, which))).collect();
        let mut levels = Self { means, spread: None };
        levels.spread = LevelScatter::fit(&levels, &shoulders);
        levels
    }

    /// Mean of `above` over the turns of a shoulder, given the level of `which` in a turn and the reference's; `None` where none has a
    /// level.
    fn mean(&self, of: &SoundPlaces<'_>, which: Discriminator, above: impl Fn(f64, f64) -> f64) -> Option<f64> {
        // A second reading has few places, and many of them stand out.
        let whole = of.shoulder.turns.iter().filter(|turn| turn.controls.is_none());
        mean(whole.filter_map(|turn| {
            let reference = self.means[turn.condition][which as usize];
            Some(above(level(of, turn, which)?, reference)).filter(|above| above.is_finite())
        }))
    }

    /// How far the levels of a shoulder lie above the reference's, as [`Turn::log`] has them; `None` where one has no level.
    fn above(&self, of: &SoundPlaces<'_>, discriminators: &[Discriminator]) -> Option<Vec<f64>> {
        discriminators.iter().map(|&which| self.mean(of, which, |level, mean| level - mean)).collect()
    }

    /// The level of each discriminator of a shoulder as a multiple of the reference's; NaN where it is not known.
    pub(crate) fn times(&self, of: &SoundPlaces<'_>) -> [f64; Discriminator::COUNT] {
        Discriminator::ALL.map(|which| {
            let above = |level, mean| (value_of(which, level) / value_of(which, mean)).ln();
            self.mean(of, which, above).map_or(f64::NAN, f64::exp)
        })
    }

    /// The probability that the levels of a sound shoulder lie as far off the reference's as those of this one. Where its casing has an
    /// `other` shoulder and the reference knows how two of a casing differ, their difference is tested too, and the result is twice the
    /// smaller of both probabilities. `None` without levels, or with too few casings.
    pub(crate) fn probability(&self, of: &SoundPlaces<'_>, other: Option<&SoundPlaces<'_>>) -> Option<f64> {
        let spread = self.spread.as_ref()?;
        let above = |of: &SoundPlaces<'_>| self.above(of, &spread.discriminators);
        let own = above(of)?;
        let difference = other.and_then(|other| Some(minus(&own, &above(other)?)));
        spread.probability(&own, difference.as_deref())
    }
}

impl LevelScatter {
    /// [`SoundLevels::probability`] of levels that lie `above` the reference's, with this `difference` from the other shoulder of the casing.
    fn probability(&self, above: &[f64], difference: Option<&[f64]>) -> Option<f64> {
        let (n, p) = (self.casing_count as f64, self.discriminators.len() as f64);
        // Hotelling's T^2 of a new observation, by a mean square about the mean. The shoulders of a casing are alike: casings count.
        let of_shoulder = f_tail(distance(&self.of_shoulder, above)? * (n - p) / (p * (n + 1.0)), p, n - p)?;
        // The mean of a difference is known: it is 0.
        let of_pair = self.of_difference.as_ref().zip(difference).and_then(|((mean_square, count), difference)| {
            let n = *count as f64;
            f_tail(distance(mean_square, difference)? * (n - p + 1.0) / (n * p), p, n - p + 1.0)
        });
        let Some(of_pair) = of_pair else { return Some(of_shoulder) };
        let least = if of_pair < of_shoulder { of_pair } else { of_shoulder };
        Some(if 2.0 * least < 1.0 { 2.0 * least } else { 1.0 })
    }

    /// The spread of the levels of `shoulders`, whose means are in `levels`; `None` with fewer than [`CASINGS_MIN`] casings, or where their
    /// levels do not vary.
    fn fit(levels: &SoundLevels, shoulders: &[&SoundPlaces<'_>]) -> Option<Self> {
        let has = |which: &Discriminator| {
            shoulders.iter().all(|of| of.shoulder.turns.iter().any(|turn| level(of, turn, *which).is_some()))
        };
        let discriminators: Vec<Discriminator> = FREE_OF_GAIN.into_iter().filter(has).collect();
        let width = discriminators.len();
        let casings: Vec<&[&SoundPlaces<'_>]> =
            shoulders.chunk_by(|a, b| a.shoulder.casing == b.shoulder.casing).collect();
        if casings.len() < CASINGS_MIN || width == 0 {
            return None;
        }
        let above = |of: &SoundPlaces<'_>| levels.above(of, &discriminators);
        let of_shoulders: Option<Vec<Vec<f64>>> = shoulders.iter().map(|of| above(of)).collect();
        let of_shoulder = mean_square(&of_shoulders?, width)?;
        let pairs = casings.iter().filter_map(|casing| <[&SoundPlaces<'_>; 2]>::try_from(*casing).ok());
        let differences: Option<Vec<Vec<f64>>> = pairs.map(|[a, b]| Some(minus(&above(a)?, &above(b)?))).collect();
        let of_difference = differences
            .filter(|differences| differences.len() >= CASINGS_MIN)
            .and_then(|differences| Some((mean_square(&differences, width)?, differences.len())));
        Some(Self { casing_count: casings.len(), discriminators, of_shoulder, of_difference })
    }
}

/// The median of `which` over the sound places of a turn.
fn level(of: &SoundPlaces<'_>, turn: &Turn, which: Discriminator) -> Option<f64> {
    let known = turn.log(which).iter().zip(&of.is_sound).filter(|(log, is_sound)| log.is_finite() && **is_sound);
    median(&mut known.map(|(log, _)| *log).collect::<Vec<f64>>())
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// The mean of the outer squares of `rows`; `None` where a column does not vary.
fn mean_square(rows: &[Vec<f64>], width: usize) -> Option<Mat<f64>> {
    let count = rows.len() as f64;
    let square = Mat::from_fn(width, width, |i, j| rows.iter().map(|row| row[i] * row[j]).sum::<f64>() / count);
    (0..width).all(|i| square[(i, i)] > 1e-18).then_some(square)
}

/// x' S^-1 x.
fn distance(covariance: &Mat<f64>, x: &[f64]) -> Option<f64> {
    let column = Mat::from_fn(x.len(), 1, |i, _| x[i]);
    let solved = covariance.llt(faer::Side::Lower).ok()?.solve(&column);
    Some((0..x.len()).map(|i| x[i] * solved[(i, 0)]).sum())
}

fn f_tail(f: f64, p: f64, q: f64) -> Option<f64> {
    (f.is_finite() && f >= 0.0).then(|| stats::f_tail(f, p, q)).filter(|tail| !tail.is_nan())
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

    #[test]
    fn levels_of_sound_shoulders_are_as_rare_as_stated() {
        // Catches a covariance with the divisor of a known mean, and a probability of one test that is doubled as if there were two.
        const WIDTH: usize = FREE_OF_GAIN.len();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut draw = || -> Vec<f64> { StandardNormal.sample_iter(&mut rng).take(WIDTH).collect() };
        for (count, has_other) in [(8, false), (12, false), (8, true)] {
            let mut below = 0;
            for _ in 0..4000 {
                let casings: Vec<Vec<f64>> = (0..count).map(|_| draw()).collect();
                let mean: Vec<f64> =
                    (0..WIDTH).map(|d| casings.iter().map(|c| c[d]).sum::<f64>() / count as f64).collect();
                let rows: Vec<Vec<f64>> = casings.iter().map(|casing| minus(casing, &mean)).collect();
                let differences: Vec<Vec<f64>> = (0..count).map(|_| draw()).collect();
                let spread = LevelScatter {
                    discriminators: FREE_OF_GAIN.to_vec(),
                    casing_count: count,
                    of_shoulder: mean_square(&rows, WIDTH).unwrap(),
                    of_difference: has_other.then(|| (mean_square(&differences, WIDTH).unwrap(), count)),
                };
                let difference = draw();
                let p = spread.probability(&minus(&draw(), &mean), Some(&difference)).unwrap();
                below += u32::from(p < 0.05);
            }
            // Four standard deviations of the part are 0.014.
            let part = f64::from(below) / 4000.0;
            assert!((part - 0.05).abs() < 0.014, "{count} casings, with another shoulder: {has_other}: {part}");
        }
    }
}
