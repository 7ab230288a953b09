//! The default index: levels by turn, robust scales, and weights that know repeatability and correlation.
//!
//! 1. The logarithm of a value is signed so that damage raises it, and taken against the level of its turn: what multiplies
//!    a whole turn, as a gain that has drifted, is no damage.
//! 2. It is divided by the scatter of the reference in its condition and clipped.
//! 3. The discriminators of a tap are summed by weights, and the sum is standardised by its condition and clipped again.
//! 4. The taps of a place at one offset become their mean, of standard deviation 1 over sound places.

mod level;
mod offset_scale;

use tapline_wire::{Direction, Discriminator};

use crate::index::fused::level::{Level, Levels, QUARTILE_Z, START_FRACTION};
use crate::index::fused::offset_scale::OffsetScale;
use crate::index::weights::weights;
use crate::index::{Index, Scores, Setup};
use crate::shoulder::{Shoulder, Turn};
use crate::stats::{Spread, mean_and_sd, median, quantile};

/// Greatest score of a single discriminator.
const SCORE_HIGH: f64 = 6.0;

/// Least score of a single discriminator: a value sounder than its level says nothing. A crack may move one of them the other
/// way, as P_f where it lowers the force more than it raises the sound, and that is not to outweigh what the others say.
const SCORE_LOW: f64 = -1.0;

/// Largest magnitude of a single tap's score: one rogue tap is no damage.
const TAP_CLIP: f64 = 4.0;

/// A place is left out of its turn's level when the mean of it and its neighbours exceeds this many standard deviations.
const OUTLIER_SD: f64 = 2.0;

/// How often outliers are sought.
const ROUNDS: usize = 2;

/// What a reference taught.
#[derive(Debug, Clone)]
pub(crate) struct Fused {
    setup: Setup,
    /// `[condition][discriminator]`; `None` where the reference has too few values, or they do not vary.
    scales: Vec<Vec<Option<Scale>>>,
    weights: Vec<f64>,
    /// Of the weighted sum of a tap, by condition.
    taps: Vec<Option<Spread>>,
    /// By offset.
    offsets: Vec<Option<OffsetScale>>,
    /// Standard deviation of the mean of a place and its neighbours, all offsets together.
    neighbours_sd: f64,
}

/// Of one discriminator in one condition, in logarithms.
#[derive(Debug, Clone, Copy)]
struct Scale {
    /// Robust standard deviation of a tap about its turn's level.
    sigma: f64,
    /// From a turn's lower quartile to its median.
    gap: f64,
    /// Median of sound places above the level that [`Fused::levels`] finds.
    residual: f64,
}

impl Index for Fused {
    fn scores(&self, casing: &[&Shoulder]) -> Vec<Scores> {
        let levels = self.levels(casing);
        let inliers = self.inliers(casing, &levels);
        let of = |((shoulder, levels), inliers): ((&&Shoulder, &Levels), Vec<bool>)| {
            self.scores_by(shoulder, levels, inliers)
        };
        casing.iter().zip(&levels).zip(inliers).map(of).collect()
    }

    fn weights(&self) -> Vec<f64> {
        self.weights.clone()
    }

    fn sigma(&self, condition: usize, d: usize) -> Option<f64> {
        Some(self.scales[condition][d]?.sigma)
    }
}

impl Fused {
    /// What the `sound` places of `shoulders` teach; `None` where no discriminator varies.
    pub(crate) fn fit(setup: &Setup, shoulders: &[&Shoulder], sound: &[Vec<bool>]) -> Option<Self> {
        let mut fused = Self {
            setup: setup.clone(),
            scales: Vec::new(),
            weights: Vec::new(),
            taps: Vec::new(),
            offsets: Vec::new(),
            neighbours_sd: 1.0,
        };
        let mut kept = sound.to_vec();
        let mut levels = match setup.is_own {
            true => fused.first_levels(shoulders),
            false => fused.medians(shoulders, &kept, None),
        };
        // What is its own reference finds out which of its places are sound.
        for round in 0..=if setup.is_own { ROUNDS } else { 0 } {
            if round > 0 {
                kept = fused.inliers(shoulders, &levels);
                levels = fused.medians(shoulders, &kept, Some(&levels));
            }
            fused.scales = fused.scales_of(shoulders, &kept, &levels);
            let rows: Vec<Vec<f64>> = (shoulders.iter().zip(&kept).zip(&levels))
                .flat_map(|((shoulder, kept), levels)| {
                    let means = fused.by_discriminator(shoulder, levels);
                    (0..kept.len()).filter(|&place| kept[place]).map(|p| means[p].clone()).collect::<Vec<_>>()
                })
                .collect();
            fused.weights = weights(&rows, setup.discriminators.len());
            fused.standardise(shoulders, &kept, &levels);
        }
        // The reference is looked at as a casing will be, so that both have the same level by the same rule.
        let mut levels = Vec::new();
        for_casings(shoulders, |casing| levels.extend(fused.levels(casing)));
        fused.residuals(shoulders, &kept, &mut levels);
        fused.standardise(shoulders, &kept, &levels);
        fused.part_by_repeats(shoulders, &kept);
        fused.offsets.iter().any(Option::is_some).then_some(fused)
    }

    fn condition_count(&self) -> usize {
        self.setup.offset_of.len()
    }

    /// The signed logarithms of discriminator number `d` in `turn`.
    fn signed<'a>(&self, turn: &'a Turn, d: usize) -> impl Iterator<Item = f64> + use<'a> {
        let (which, direction): (Discriminator, Direction) = self.setup.discriminators[d];
        let sign = direction.sign();
        turn.log(which).iter().map(move |log| sign * log)
    }

    /// What discriminator number `d` is above `level`, by place; `None` where one of them is absent.
    fn above<'a>(&self, turn: &'a Turn, d: usize, level: Level) -> impl Iterator<Item = Option<f64>> + use<'a> {
        let count = turn.values.len();
        let above = move |(place, y): (usize, f64)| Some(y - level.at(place, count)).filter(|y| y.is_finite());
        self.signed(turn, d).enumerate().map(above)
    }

    /// Places that do not stand out, by shoulder.
    fn inliers(&self, casing: &[&Shoulder], levels: &[Levels]) -> Vec<Vec<bool>> {
        let limit = OUTLIER_SD * self.neighbours_sd;
        let of = |(shoulder, levels): (&&Shoulder, &Levels)| {
            let near = self.near_means(shoulder, levels);
            near.into_iter().map(|value| value.is_none_or(|value| value <= limit)).collect()
        };
        casing.iter().zip(levels).map(of).collect()
    }

    /// The mean over offsets of each place and its neighbours.
    fn near_means(&self, shoulder: &Shoulder, levels: &Levels) -> Vec<Option<f64>> {
        let scores = self.by_offset(shoulder, levels);
        let mean = |place: usize| {
            let values = scores.iter().map(|of_offset| of_offset[place]).filter(|value| value.is_finite());
            let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
            (count > 0).then(|| sum / f64::from(count))
        };
        let means: Vec<Option<f64>> = (0..shoulder.place_count()).map(mean).collect();
        shoulder.ring.mean_of_3(&means)
    }

    fn scales_of(&self, shoulders: &[&Shoulder], kept: &[Vec<bool>], levels: &[Levels]) -> Vec<Vec<Option<Scale>>> {
        let of = |condition: usize, d: usize| {
            let (mut above, mut gaps) = (Vec::new(), Vec::new());
            for ((shoulder, kept), levels) in shoulders.iter().zip(kept).zip(levels) {
                for (turn, levels) in shoulder.turns.iter().zip(levels).filter(|(t, _)| t.condition == condition) {
                    let first = above.len();
                    above.extend(
                        self.above(turn, d, levels[d]).zip(kept).filter(|(_, kept)| **kept).filter_map(|(y, _)| y),
                    );
                    gaps.extend(quantile(&mut above[first..], START_FRACTION).map(|quartile| -quartile));
                }
            }
            let sigma = if self.setup.is_own { Spread::below_zero(&mut above) } else { Spread::of(&mut above) };
            let sigma = sigma?.sigma;
            let gap = if self.setup.is_own { QUARTILE_Z * sigma } else { median(&mut gaps)? };
            (sigma > 1e-9).then_some(Scale { sigma, gap, residual: 0.0 })
        };
        let width = self.setup.discriminators.len();
        (0..self.condition_count()).map(|condition| (0..width).map(|d| of(condition, d)).collect()).collect()
    }

    /// Finds the median of sound places above the `levels`, and takes it into them.
    fn residuals(&mut self, shoulders: &[&Shoulder], kept: &[Vec<bool>], levels: &mut [Levels]) {
        for condition in 0..self.condition_count() {
            for d in 0..self.setup.discriminators.len() {
                let mut above = Vec::new();
                for ((shoulder, kept), levels) in shoulders.iter().zip(kept).zip(levels.iter()) {
                    for (turn, levels) in shoulder.turns.iter().zip(levels).filter(|(t, _)| t.condition == condition) {
                        let sound = self.above(turn, d, levels[d]).zip(kept).filter(|(_, kept)| **kept);
                        above.extend(sound.filter_map(|(y, _)| y));
                    }
                }
                let residual = median(&mut above).unwrap_or(0.0);
                if let Some(scale) = &mut self.scales[condition][d] {
                    scale.residual = residual;
                    for (shoulder, levels) in shoulders.iter().zip(levels.iter_mut()) {
                        for (turn, levels) in shoulder.turns.iter().zip(levels) {
                            levels[d].middle += if turn.condition == condition { residual } else { 0.0 };
                        }
                    }
                }
            }
        }
    }

    /// Scores of the discriminators of the taps of a turn, `[discriminator][place]`.
    fn turn_scores(&self, turn: &Turn, levels: &[Level]) -> Vec<Vec<f64>> {
        // Where a shoulder is its own reference, what lies below the level tells how what lies above scatters.
        let low = if self.setup.is_own { -SCORE_HIGH } else { SCORE_LOW };
        let of = |d: usize| match self.scales[turn.condition][d] {
            Some(scale) => {
                let z = |y: Option<f64>| y.map_or(f64::NAN, |y| (y / scale.sigma).clamp(low, SCORE_HIGH));
                self.above(turn, d, levels[d]).map(z).collect()
            }
            None => vec![f64::NAN; turn.values.len()],
        };
        (0..self.setup.discriminators.len()).map(of).collect()
    }

    /// Mean score of each discriminator over the taps of a place, `[place][discriminator]`.
    fn by_discriminator(&self, shoulder: &Shoulder, levels: &Levels) -> Vec<Vec<f64>> {
        let width = self.setup.discriminators.len();
        let mut sums = vec![vec![(0.0, 0_u32); width]; shoulder.place_count()];
        for (turn, levels) in shoulder.turns.iter().zip(levels) {
            for (d, scores) in self.turn_scores(turn, levels).iter().enumerate() {
                for (sums, score) in sums.iter_mut().zip(scores).filter(|(_, score)| score.is_finite()) {
                    sums[d] = (sums[d].0 + score, sums[d].1 + 1);
                }
            }
        }
        let mean = |(sum, count): (f64, u32)| if count > 0 { sum / f64::from(count) } else { f64::NAN };
        sums.into_iter().map(|sums| sums.into_iter().map(mean).collect()).collect()
    }

    /// The weighted sum of each tap of a turn, by place; NaN where every discriminator that counts is absent.
    fn weighted(&self, turn: &Turn, levels: &[Level]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); turn.values.len()];
        for (scores, &weight) in self.turn_scores(turn, levels).iter().zip(&self.weights) {
            for (sum, score) in sums.iter_mut().zip(scores).filter(|(_, score)| score.is_finite()) {
                *sum = (sum.0 + weight * score, sum.1 + weight);
            }
        }
        // What is there fills up the weight of what is not.
        sums.into_iter().map(|(sum, weight)| if weight > 0.0 { sum / weight } else { f64::NAN }).collect()
    }

    /// Mean of the standardised taps of each place at each offset and how many they are, `[offset][place]`.
    fn tap_means(&self, shoulder: &Shoulder, levels: &Levels) -> Vec<Vec<(f64, u32)>> {
        let mut sums = vec![vec![(0.0, 0_u32); shoulder.place_count()]; self.setup.offset_count];
        for (turn, levels) in shoulder.turns.iter().zip(levels) {
            let Some(spread) = self.taps[turn.condition] else { continue };
            let sums = &mut sums[self.setup.offset_of[turn.condition]];
            for (sum, value) in sums.iter_mut().zip(self.weighted(turn, levels)).filter(|(_, v)| v.is_finite()) {
                let score = ((value - spread.centre) / spread.sigma).clamp(-TAP_CLIP, TAP_CLIP);
                *sum = (sum.0 + score, sum.1 + 1);
            }
        }
        for sum in sums.iter_mut().flatten() {
            sum.0 /= f64::from(sum.1);
        }
        sums
    }

    /// `[offset][place]`, as [`Scores::by_offset`].
    fn by_offset(&self, shoulder: &Shoulder, levels: &Levels) -> Vec<Vec<f64>> {
        let means = self.tap_means(shoulder, levels);
        let of = |(means, scale): (Vec<(f64, u32)>, &Option<OffsetScale>)| {
            let score = |(mean, count): (f64, u32)| scale.map_or(f64::NAN, |scale| scale.score(mean, count));
            means.into_iter().map(score).collect()
        };
        means.into_iter().zip(&self.offsets).map(of).collect()
    }

    /// Fits what comes after the weights.
    fn standardise(&mut self, shoulders: &[&Shoulder], kept: &[Vec<bool>], levels: &[Levels]) {
        let mut by_condition = vec![Vec::new(); self.condition_count()];
        for ((shoulder, kept), levels) in shoulders.iter().zip(kept).zip(levels) {
            for (turn, levels) in shoulder.turns.iter().zip(levels) {
                let values =
                    self.weighted(turn, levels).into_iter().zip(kept).filter(|(v, kept)| **kept && v.is_finite());
                by_condition[turn.condition].extend(values.map(|(value, _)| value));
            }
        }
        let spread = if self.setup.is_own { Spread::below_zero } else { Spread::of };
        self.taps = by_condition.iter_mut().map(|values| spread(values)).collect();

        let means: Vec<Vec<Vec<(f64, u32)>>> =
            shoulders.iter().zip(levels).map(|(shoulder, levels)| self.tap_means(shoulder, levels)).collect();
        self.offsets = (0..self.setup.offset_count)
            .map(|offset| {
                let places = || {
                    means.iter().zip(kept).flat_map(|(means, kept)| {
                        means[offset]
                            .iter()
                            .zip(kept)
                            .filter(|(mean, kept)| **kept && mean.1 > 0)
                            .map(|(mean, _)| *mean)
                    })
                };
                let deviations = self.within_variance(shoulders, kept, levels, &means, offset);
                OffsetScale::of(places(), deviations, self.setup.is_own)
            })
            .collect();
        let near: Vec<f64> = (shoulders.iter().zip(levels).zip(kept))
            .flat_map(|((shoulder, levels), kept)| {
                let near = self.near_means(shoulder, levels);
                near.into_iter().zip(kept).filter(|(_, kept)| **kept).filter_map(|(value, _)| value).collect::<Vec<_>>()
            })
            .collect();
        self.neighbours_sd = centre_and_sd(near, self.setup.is_own).map_or(1.0, |(_, sd)| sd);
    }

    /// Parts the variance of places that the scan taps once into what stays with the place and what comes with the tap, by the
    /// repetitions that the reference has besides.
    fn part_by_repeats(&mut self, shoulders: &[&Shoulder], kept: &[Vec<bool>]) {
        if shoulders.iter().all(|shoulder| shoulder.repeats.is_empty()) {
            return;
        }
        let all: Vec<Shoulder> = shoulders.iter().map(|shoulder| shoulder.with_repeats()).collect();
        let all: Vec<&Shoulder> = all.iter().collect();
        let mut levels = Vec::new();
        for_casings(&all, |casing| levels.extend(self.levels(casing)));
        let means: Vec<_> =
            all.iter().zip(&levels).map(|(shoulder, levels)| self.tap_means(shoulder, levels)).collect();
        for offset in 0..self.offsets.len() {
            let tap_variance = self.within_variance(&all, kept, &levels, &means, offset);
            if let Some((scale, tap_variance)) = self.offsets[offset].as_mut().zip(tap_variance) {
                scale.part(tap_variance);
            }
        }
    }

    /// Variance of taps about the mean of their place at one offset; `None` where no place has two.
    fn within_variance(
        &self,
        shoulders: &[&Shoulder],
        kept: &[Vec<bool>],
        levels: &[Levels],
        means: &[Vec<Vec<(f64, u32)>>],
        offset: usize,
    ) -> Option<f64> {
        let (mut squares, mut tap_count) = (0.0, 0_u32);
        for (((shoulder, kept), levels), means) in shoulders.iter().zip(kept).zip(levels).zip(means) {
            for (turn, levels) in shoulder.turns.iter().zip(levels) {
                let Some(spread) = self.taps[turn.condition] else { continue };
                if self.setup.offset_of[turn.condition] != offset {
                    continue;
                }
                for ((value, &(mean, count)), _) in
                    self.weighted(turn, levels).into_iter().zip(&means[offset]).zip(kept).filter(|(_, kept)| **kept)
                {
                    if value.is_finite() && count > 1 {
                        let score = ((value - spread.centre) / spread.sigma).clamp(-TAP_CLIP, TAP_CLIP);
                        // Each place's taps have lost one degree of freedom to their mean.
                        squares += (score - mean).powi(2) * f64::from(count) / f64::from(count - 1);
                        tap_count += 1;
                    }
                }
            }
        }
        (tap_count > 0).then(|| squares / f64::from(tap_count))
    }

    fn scores_by(&self, shoulder: &Shoulder, levels: &Levels, is_inlier: Vec<bool>) -> Scores {
        Scores {
            by_offset: self.by_offset(shoulder, levels),
            by_discriminator: self.by_discriminator(shoulder, levels),
            is_inlier,
        }
    }
}

/// Mean and standard deviation; 0, and as what lies below it tells, where what lies above may be damage.
fn centre_and_sd(mut values: Vec<f64>, is_own: bool) -> Option<(f64, f64)> {
    if !is_own {
        return mean_and_sd(&values);
    }
    Spread::below_zero(&mut values).map(|spread| (spread.centre, spread.sigma))
}

/// Calls `see` with the shoulders of each casing; those of one follow each other.
fn for_casings<'a>(shoulders: &[&'a Shoulder], mut see: impl FnMut(&[&'a Shoulder])) {
    shoulders.chunk_by(|a, b| a.casing == b.casing).for_each(&mut see);
}
