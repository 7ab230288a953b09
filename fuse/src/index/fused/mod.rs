//! The default index: levels by turn, robust scales, and means of taps that no rogue tap decides.
//!
//! 1. The logarithm of a value is signed so that damage raises it, and taken relative to the level of its turn: a factor on
//!    a whole turn, such as a gain that has drifted, is no damage.
//! 2. It is divided by the scatter of the reference in its condition and clipped.
//! 3. The tap of a place that stands out most counts only as far as the next one there or nearby confirms: a crack shows in
//!    several.
//! 4. The taps of a place at one offset are averaged; each discriminator has standard deviation 1 over sound places.

mod level;
mod offset_scale;
mod taps;

use tapline_wire::{Direction, Discriminator};

use crate::evidence::{ABSENT, Scatter, Vector, has_value};
use crate::index::fused::level::{Level, Levels, QUARTILE_Z, START_FRACTION};
use crate::index::fused::offset_scale::OffsetScale;
use crate::index::fused::taps::{TapMeans, Taps};
use crate::index::{Index, Scores, Setup};
use crate::shoulder::{Shoulder, Turn};
use crate::stats::{self, Spread, mean_and_sd, median, quantile};

/// Part of sound places that are left out of the level of their turns because they and their neighbours stand out most: those
/// beyond two standard deviations of one score.
const OUTLIER_FRACTION: f64 = 0.0228;

/// How often outliers are sought.
const ROUNDS: usize = 2;

/// What a reference taught.
#[derive(Debug, Clone)]
pub(crate) struct Fused {
    setup: Setup,
    /// `[condition][discriminator]`; `None` where the reference has too few values, or they do not vary.
    scales: Vec<Vec<Option<Scale>>>,
    /// Scatter of the scores of one tap.
    tap_scatter: Scatter,
    /// `[offset][discriminator]`.
    offsets: Vec<Vec<Option<OffsetScale>>>,
    /// Scatter of the mean of a place and its neighbours, all offsets together.
    near_scatter: Scatter,
    /// The evidence of such a mean that [`OUTLIER_FRACTION`] of sound places exceed.
    near_limit: f64,
}

/// The scale of one discriminator in one condition, in logarithms.
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
        let taps = self.taps(casing, &levels);
        let (uncut, means) = (self.means(casing, &taps), self.means(casing, &self.borne_out(casing, &taps)));
        let inliers = self.inliers(casing, &means);
        let of = |(number, is_inlier): (usize, Vec<bool>)| Scores {
            by_offset: self.by_offset(&means[number]),
            uncut: self.by_offset(&uncut[number]),
            by_discriminator: self.by_discriminator(casing[number], &taps[number]),
            is_inlier,
            scatter: self.scatter(casing[number], &levels[number]),
        };
        inliers.into_iter().enumerate().map(of).collect()
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
            tap_scatter: Scatter::default(),
            offsets: Vec::new(),
            near_scatter: Scatter::default(),
            near_limit: f64::INFINITY,
        };
        let mut kept = sound.to_vec();
        let mut levels = match setup.is_own {
            true => fused.first_levels(shoulders),
            false => fused.medians(shoulders, &kept, None),
        };
        let mut means = Vec::new();
        // A casing that is its own reference has to find out which of its places are sound.
        for round in 0..=if setup.is_own { ROUNDS } else { 0 } {
            if round > 0 {
                kept = fused.inliers(shoulders, &means);
                levels = fused.medians(shoulders, &kept, Some(&levels));
            }
            fused.scales = fused.scales_of(shoulders, &kept, &levels);
            means = fused.standardise(shoulders, &kept, &levels);
        }
        // The reference is looked at as a casing will be, so that both have the same level by the same rule.
        let mut levels = Vec::new();
        for casing in shoulders.chunk_by(|a, b| a.casing == b.casing) {
            levels.extend(fused.levels(casing));
        }
        fused.residuals(shoulders, &kept, &mut levels);
        fused.standardise(shoulders, &kept, &levels);
        fused.offsets.iter().flatten().any(Option::is_some).then_some(fused)
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

    /// Places that do not stand out by the `means` of their taps, by shoulder.
    fn inliers(&self, casing: &[&Shoulder], means: &[TapMeans]) -> Vec<Vec<bool>> {
        let is_inlier = |near: Vector| self.near_scatter.evidence_apart(&near) <= self.near_limit;
        let of = |(shoulder, means)| self.near_means(shoulder, means).into_iter().map(is_inlier).collect();
        casing.iter().copied().zip(means).map(of).collect()
    }

    /// The mean over offsets of each place and its neighbours.
    fn near_means(&self, shoulder: &Shoulder, means: &TapMeans) -> Vec<Vector> {
        let scores = self.by_offset(means);
        let mut near = vec![ABSENT; shoulder.place_count()];
        for d in 0..self.setup.discriminators.len() {
            let mean = |place: usize| {
                stats::mean(scores.iter().map(|of_offset| of_offset[place][d]).filter(|value| value.is_finite()))
            };
            let of_places: Vec<Option<f64>> = (0..shoulder.place_count()).map(mean).collect();
            for (of_place, mean) in near.iter_mut().zip(shoulder.ring.mean_of_3(&of_places)) {
                of_place[d] = mean.unwrap_or(f64::NAN);
            }
        }
        near
    }

    /// How far the taps of `shoulder` scatter about its `levels`, as a multiple of the reference's scale; by values below them, for damage
    /// lies above.
    fn scatter(&self, shoulder: &Shoulder, levels: &Levels) -> Vec<f64> {
        let of = |d: usize| {
            let mut values = Vec::new();
            for (turn, levels) in shoulder.turns.iter().zip(levels).filter(|(turn, _)| turn.controls.is_none()) {
                let Some(scale) = self.scales[turn.condition][d] else { continue };
                values.extend(self.above(turn, d, levels[d]).flatten().map(|y| y / scale.sigma));
            }
            Spread::below_zero(&mut values).map_or(f64::NAN, |spread| spread.sigma)
        };
        (0..self.setup.discriminators.len()).map(of).collect()
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

    /// Fits what comes after the scales; returns the means of the taps of each shoulder.
    fn standardise(&mut self, shoulders: &[&Shoulder], kept: &[Vec<bool>], levels: &[Levels]) -> Vec<TapMeans> {
        let taps = self.taps(shoulders, levels);
        let mut sound = Vec::new();
        for (turns, kept) in taps.iter().zip(kept) {
            // A turn of some places has no tap at the others.
            let of_turns = turns.iter().flat_map(|scores| scores.iter().zip(kept));
            sound.extend(of_turns.filter(|(scores, kept)| **kept && has_value(scores)).map(|(scores, _)| *scores));
        }
        self.tap_scatter = self.scatter_of(sound);

        let borne_out = self.borne_out(shoulders, &taps);
        let means = self.means(shoulders, &borne_out);
        let width = self.setup.discriminators.len();
        let deviations = self.within_variances(shoulders, kept, &borne_out, &means);
        self.offsets = (0..self.setup.offset_count)
            .map(|offset| {
                let of = |d: usize| {
                    let places = means.iter().zip(kept).flat_map(|(means, kept)| means[offset].iter().zip(kept));
                    let sound = places.filter(|(means, kept)| **kept && means[d].1 > 0).map(|(means, _)| means[d]);
                    OffsetScale::of(sound, deviations[offset][d], self.setup.is_own)
                };
                (0..width).map(of).collect()
            })
            .collect();
        let sound = (shoulders.iter().zip(&means).zip(kept)).flat_map(|((shoulder, means), kept)| {
            let near = self.near_means(shoulder, means).into_iter().zip(kept.clone());
            near.filter(|(_, kept)| *kept).map(|(near, _)| near)
        });
        self.near_scatter = self.scatter_of(sound.collect());
        // Apart from each other: by what two discriminators do together a level that is a little off would show everywhere.
        // 0 where nothing varies: no place is beyond it.
        self.near_limit = self.near_scatter.limit_apart(OUTLIER_FRACTION);
        means
    }

    fn scatter_of(&self, places: Vec<Vector>) -> Scatter {
        let places = places.into_iter();
        if self.setup.is_own { Scatter::of_own(places) } else { Scatter::of(places) }
    }

    /// Variance of each discriminator of taps about the mean of their place, by offset; `None` where no place has two.
    fn within_variances(
        &self,
        shoulders: &[&Shoulder],
        kept: &[Vec<bool>],
        borne_out: &[Taps],
        means: &[TapMeans],
    ) -> Vec<[Option<f64>; ABSENT.len()]> {
        let mut squares = vec![[(0.0, 0_u32); ABSENT.len()]; self.setup.offset_count];
        for (((shoulder, kept), borne_out), means) in shoulders.iter().zip(kept).zip(borne_out).zip(means) {
            for (turn, scores) in shoulder.turns.iter().zip(borne_out) {
                let offset = self.setup.offset_of[turn.condition];
                for ((scores, means), _) in scores.iter().zip(&means[offset]).zip(kept).filter(|(_, kept)| **kept) {
                    for ((sum, score), &(mean, count)) in squares[offset].iter_mut().zip(scores).zip(means) {
                        if score.is_finite() && count > 1 {
                            // Each place's taps have lost one degree of freedom to their mean.
                            let square = (score - mean).powi(2) * f64::from(count) / f64::from(count - 1);
                            *sum = (sum.0 + square, sum.1 + 1);
                        }
                    }
                }
            }
        }
        let variance = |(sum, count): (f64, u32)| (count > 0).then(|| sum / f64::from(count));
        squares.into_iter().map(|of_offset| of_offset.map(variance)).collect()
    }
}

/// Mean and standard deviation; where values above 0 may be damage (`is_own`), 0 and the deviation of those below.
fn centre_and_sd(mut values: Vec<f64>, is_own: bool) -> Option<(f64, f64)> {
    if !is_own {
        return mean_and_sd(&values);
    }
    Spread::below_zero(&mut values).map(|spread| (spread.centre, spread.sigma))
}
