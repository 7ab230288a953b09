//! The level of a turn: the common value of its sound places.

use crate::index::fused::{Fused, ROUNDS};
use crate::shoulder::{Shoulder, Turn};
use crate::stats::{median, quantile};

/// The quantile of a turn that its level is first guessed from: three quarters of a shoulder may be cracked.
pub(super) const START_FRACTION: f64 = 0.25;

/// The standard normal distribution: the magnitude of its lower quartile, and a quantile far enough below it to show the scatter.
pub(super) const QUARTILE_Z: f64 = 0.674_49;
const FAR_FRACTION: f64 = 0.066_807;
const FAR_Z: f64 = 1.5;

/// The levels of one shoulder, `[turn][discriminator]`.
pub(super) type Levels = Vec<Vec<Level>>;

/// The signed logarithm of a discriminator at sound places of a turn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Level {
    /// In the middle of the turn; NaN where the turn has none.
    pub middle: f64,
    /// What it rises by from the first to the last place: a gain may drift while the turn is made.
    pub drift: f64,
}

impl Level {
    pub(super) fn constant(middle: f64) -> Self {
        Self { middle, drift: 0.0 }
    }

    /// At `place` of `count`.
    pub(super) fn at(self, place: usize, count: usize) -> f64 {
        self.middle + self.drift * ((place as f64 + 0.5) / count as f64 - 0.5)
    }
}

/// Fewest sound places at either end of a turn from which its drift is found.
pub(super) const DRIFT_PLACES_MIN: usize = 8;

impl Fused {
    /// The turns of `casing` that have a level in common: shoulder and turn, by numbers.
    pub(super) fn groups(&self, casing: &[&Shoulder]) -> Vec<Vec<(usize, usize)>> {
        let all = || (0..casing.len()).flat_map(|s| (0..casing[s].turns.len()).map(move |t| (s, t)));
        if !self.setup.has_common_level {
            return all().map(|turn| vec![turn]).collect();
        }
        let of = |condition| all().filter(|&(s, t)| casing[s].turns[t].condition == condition).collect();
        (0..self.condition_count()).map(of).filter(|group: &Vec<_>| !group.is_empty()).collect()
    }

    /// A level for each turn and discriminator: what `level` makes of the values of its group at the places that are
    /// `kept`, or what it was `before`, or NaN.
    pub(super) fn levels_by(
        &self,
        casing: &[&Shoulder],
        kept: Option<&[Vec<bool>]>,
        before: Option<&[Levels]>,
        level: impl Fn(usize, usize, &mut [f64]) -> Option<f64>,
    ) -> Vec<Levels> {
        let width = self.setup.discriminators.len();
        let mut levels: Vec<Levels> =
            casing.iter().map(|s| vec![vec![Level::constant(f64::NAN); width]; s.turns.len()]).collect();
        let mut values = Vec::new();
        for group in self.groups(casing) {
            for (d, _) in self.setup.discriminators.iter().enumerate() {
                values.clear();
                let mut total = 0;
                for &(s, t) in &group {
                    let turn = &casing[s].turns[t];
                    let found = self.signed(turn, d).enumerate().filter(|(_, y)| y.is_finite());
                    for (place, y) in found.filter(|&(place, _)| turn.counts_for_level(place)) {
                        total += 1;
                        // Controls were chosen as sound, and stand alone: their neighbours say nothing of them.
                        if turn.controls.is_some() || kept.is_none_or(|kept| kept[s][place]) {
                            values.push(y);
                        }
                    }
                }
                let condition = casing[group[0].0].turns[group[0].1].condition;
                // Too few places that are left give no level.
                let found = if 5 * values.len() >= total { level(condition, d, &mut values) } else { None };
                for &(s, t) in &group {
                    let drift = kept.map_or(0.0, |kept| self.drift(&casing[s].turns[t], d, &kept[s]));
                    let found = found.map(|middle| Level { middle, drift });
                    let level = &mut levels[s][t][d];
                    *level = found.or_else(|| Some(before?[s][t][d])).unwrap_or(Level::constant(f64::NAN));
                }
            }
        }
        levels
    }

    /// What the sound places of `turn` rise by from its first third to its last, taken over all of it.
    pub(super) fn drift(&self, turn: &Turn, d: usize, kept: &[bool]) -> f64 {
        let third = turn.values.len() / 3;
        if self.setup.has_common_level || turn.controls.is_some() {
            return 0.0;
        }
        let end = |places: std::ops::Range<usize>| {
            let sound = self.signed(turn, d).enumerate().filter(|(place, y)| kept[*place] && y.is_finite());
            let mut values: Vec<f64> = sound.filter(|(place, _)| places.contains(place)).map(|(_, y)| y).collect();
            median(&mut values).filter(|_| values.len() >= DRIFT_PLACES_MIN)
        };
        let (first, last) = (end(0..third), end(turn.values.len() - third..turn.values.len()));
        // The middles of the outer thirds lie two thirds of the turn apart.
        first.zip(last).map_or(0.0, |(first, last)| 1.5 * (last - first))
    }

    pub(super) fn medians(&self, casing: &[&Shoulder], kept: &[Vec<bool>], before: Option<&[Levels]>) -> Vec<Levels> {
        self.levels_by(casing, Some(kept), before, |_, _, values| median(values))
    }

    /// Levels of shoulders of which nothing is known: from the scatter below the lower quartile follows how far above it the
    /// median of the sound places lies.
    pub(super) fn first_levels(&self, casing: &[&Shoulder]) -> Vec<Levels> {
        self.levels_by(casing, None, None, |_, _, values| {
            let (quartile, far) = (quantile(values, START_FRACTION)?, quantile(values, FAR_FRACTION)?);
            Some(quartile + QUARTILE_Z * (quartile - far) / (FAR_Z - QUARTILE_Z))
        })
    }

    /// The levels of the shoulders of one casing, any part of which may be cracked.
    pub(super) fn levels(&self, casing: &[&Shoulder]) -> Vec<Levels> {
        let gap = |condition: usize, d: usize| self.scales[condition][d].map_or(0.0, |scale| scale.gap);
        let mut levels = self.levels_by(casing, None, None, |condition, d, values| {
            Some(quantile(values, START_FRACTION)? + gap(condition, d))
        });
        for _ in 0..ROUNDS {
            let borne_out = self.borne_out(casing, &self.taps(casing, &levels));
            let kept = self.inliers(casing, &self.means(casing, &borne_out));
            levels = self.medians(casing, &kept, Some(&levels));
        }
        for (shoulder, levels) in casing.iter().zip(&mut levels) {
            for (turn, levels) in shoulder.turns.iter().zip(levels) {
                for (level, scale) in levels.iter_mut().zip(&self.scales[turn.condition]) {
                    level.middle += scale.map_or(0.0, |scale| scale.residual);
                }
            }
        }
        levels
    }
}
