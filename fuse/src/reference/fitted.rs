//! What a reference teaches: the index, how its arcs scatter, and the limits.

use rayon::prelude::*;

use crate::arcs::limits::Limits;
use crate::arcs::statistic::ArcStatistic;
use crate::arcs::white::{self, White};
use crate::evidence::has_value;
use crate::index::{self, Index, Scores, Setup};
use crate::shoulder::Shoulder;
use crate::shoulder::ring::Ring;
use crate::stats::mean_and_sd;
use crate::verdict::supported::supported_rate;
use crate::verdict::whole_shoulder::Levels;

/// Fewest values that tell how sound places scatter: by fewer, limits that pass sound shoulders pass strong cracks too
/// (`docs/rates.md`).
const VALUES_MIN: usize = 8;

/// A reference as it judges shoulders of one plan.
#[derive(Debug)]
pub(crate) struct FittedReference {
    pub setup: Setup,
    pub index: Box<dyn Index>,
    pub statistic: ArcStatistic,
    pub limits: Limits,
    /// Of whole shoulders; `None` where too few casings tell.
    pub levels: Option<Levels>,
    /// How many casings the limits rest on; none where shoulders are their own reference.
    pub casing_count: usize,
    /// Strongest arc of each of its shoulders, judged by the other casings, and the number of its casing.
    pub strongest: Vec<(usize, f64)>,
    /// How far the places of its shoulders differ; `None` where shoulders are their own reference, or the index does not look.
    pub scatter: Option<UsualScatter>,
    /// What the index says of its own shoulders, where they are what is judged; none of others.
    pub own_scores: Vec<Scores>,
    /// What noise alone makes of arcs.
    pub white: White,
}

impl FittedReference {
    /// What `shoulders` teach, those of a casing one after the other; `offsets` are the numbers of the offsets from the belt
    /// edge inwards. `None` where nothing of them varies, or too few places tell how they do.
    pub(crate) fn fit(setup: Setup, offsets: &[usize], shoulders: &[Shoulder]) -> Option<Self> {
        let all: Vec<&Shoulder> = shoulders.iter().collect();
        let Learned { index, statistic, own_scores, sound_scores: scores } = learn(&setup, offsets, &all)?;
        let casings: Vec<&[Shoulder]> = shoulders.chunk_by(|a, b| a.casing == b.casing).collect();
        let casing_count = if setup.is_own { 0 } else { casings.len() };
        let left_out: Vec<LeftOut> = match casing_count {
            0 | 1 => Vec::new(),
            _ => (casings.par_iter()).flat_map_iter(|casing| left_out(&setup, offsets, shoulders, casing)).collect(),
        };
        let strongest: Vec<(usize, f64)> = left_out.iter().map(|of| (of.casing, of.strongest)).collect();
        let scatter: Vec<f64> = match casing_count {
            0 => Vec::new(),
            1 => scores.iter().filter_map(Scores::mean_scatter).collect(),
            _ => left_out.iter().filter_map(|of| of.scatter).collect(),
        };
        let scatter = UsualScatter::of(&scatter, shoulders.first()?.place_count());
        // Of shoulders with labels the one that shows most: another may have no sound place.
        let shown = |scores: &Scores| scores.by_offset.iter().flatten().filter(|scores| has_value(scores)).count();
        let rings = shoulders.iter().map(|shoulder| &shoulder.ring).zip(&scores);
        let (ring, pattern) = rings.rev().max_by_key(|(_, scores)| shown(scores))?;
        let place_count: usize = scores.iter().map(Scores::places_shown).sum();
        // Of a casing by itself what lies below the median tells the scatter: half of the places that do not stand out.
        let value_count = if setup.is_own { place_count / 2 } else { place_count };
        if value_count < VALUES_MIN {
            return None;
        }
        let white = white::strongest_arcs(&statistic, ring, pattern, value_count)?;
        let values: Vec<f64> = strongest.iter().map(|(_, value)| *value).collect();
        let limits = Limits::by(&values, casing_count, white);
        let levels = if setup.is_own { None } else { Levels::fit(&setup, &all) };
        Some(Self { setup, index, statistic, limits, levels, casing_count, strongest, scatter, own_scores, white })
    }

    /// Whether the places of a shoulder on `ring` differ from one another more than those of sound ones do.
    ///
    /// Less tells so of one that would not pass: it is compared with its own casing then, which makes nothing of it a PASS.
    pub(crate) fn is_scatter_off(&self, re_inspect_rate: f64, ring: &Ring, scores: &Scores) -> bool {
        let Some((usual, scatter)) = self.scatter.zip(scores.mean_scatter()) else { return false };
        let is_called = || {
            let limit = self.limits.at(re_inspect_rate).next_down();
            self.statistic.strongest_above(limit, ring, &self.statistic.maps(&scores.by_offset)).is_some()
        };
        scatter > usual.far_off() || scatter > usual.off() && is_called()
    }

    /// The least rate of false calls that it supports without assuming a distribution; `None` of fewer than two casings.
    pub(crate) fn supported_rate(&self) -> Option<f64> {
        supported_rate(self.casing_count)
    }
}

/// How far the places of a reference's shoulders differ from one another: mean and standard deviation of [`Scores::mean_scatter`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct UsualScatter {
    mean: f64,
    sd: f64,
}

impl UsualScatter {
    /// Of the `scatter` of shoulders with `place_count` places each.
    fn of(scatter: &[f64], place_count: usize) -> Option<Self> {
        let (mean, sd) = mean_and_sd(scatter).or_else(|| Some((*scatter.first()?, 0.0)))?;
        // By a few shoulders it may come out too small: so many places tell one turn's scatter no better.
        let sd_min = 0.8 / (place_count as f64).sqrt();
        Some(Self { mean, sd: if sd > sd_min { sd } else { sd_min } })
    }

    /// A shoulder that would not pass scatters too much from here on; 1 in 40 that are like the reference's does.
    fn off(self) -> f64 {
        self.mean + 2.0 * self.sd
    }

    /// Any shoulder does from here on.
    fn far_off(self) -> f64 {
        let (half_more, rare) = (1.5 * self.mean, self.mean + 4.0 * self.sd);
        if half_more > rare { half_more } else { rare }
    }
}

/// What shoulders teach.
struct Learned {
    index: Box<dyn Index>,
    statistic: ArcStatistic,
    /// As in [`FittedReference`].
    own_scores: Vec<Scores>,
    /// By shoulder, of the places that teach.
    sound_scores: Vec<Scores>,
}

fn learn(setup: &Setup, offsets: &[usize], shoulders: &[&Shoulder]) -> Option<Learned> {
    let sound: Vec<Vec<bool>> = shoulders.iter().map(|shoulder| shoulder.sound()).collect();
    let index = index::fit(setup, shoulders, &sound)?;
    let mut scores = Vec::new();
    for casing in shoulders.chunk_by(|a, b| a.casing == b.casing) {
        scores.extend(index.scores(casing));
    }
    let own_scores = if setup.is_own { scores.clone() } else { Vec::new() };
    for (scores, sound) in scores.iter_mut().zip(&sound) {
        scores.hide(sound);
        if setup.is_own {
            let is_inlier = scores.is_inlier.clone();
            scores.hide(&is_inlier);
        }
    }
    let rings: Vec<_> = shoulders.iter().map(|shoulder| &shoulder.ring).zip(scores.iter().cloned()).collect();
    // An index that looks at all offsets at once has one score a place.
    let is_one = scores.iter().all(|scores| scores.by_offset.len() == 1);
    let mut offsets = if is_one { vec![0] } else { offsets.to_vec() };
    offsets.retain(|&offset| scores.iter().any(|scores| scores.by_offset[offset].iter().any(has_value)));
    let statistic = ArcStatistic::fit(offsets, &rings, setup.is_own);
    Some(Learned { index, statistic, own_scores, sound_scores: scores })
}

/// What the other casings of a reference say of a shoulder.
struct LeftOut {
    /// Number of its casing.
    casing: usize,
    /// How far its strongest arc stands out.
    strongest: f64,
    /// [`Scores::mean_scatter`].
    scatter: Option<f64>,
}

/// What all casings but itself say of the shoulders of `casing`.
fn left_out(setup: &Setup, offsets: &[usize], shoulders: &[Shoulder], casing: &[Shoulder]) -> Vec<LeftOut> {
    let others: Vec<&Shoulder> = shoulders.iter().filter(|shoulder| shoulder.casing != casing[0].casing).collect();
    let Some(Learned { index, statistic, .. }) = learn(setup, offsets, &others) else { return Vec::new() };
    let own: Vec<&Shoulder> = casing.iter().collect();
    let of = |(shoulder, mut scores): (&Shoulder, Scores)| {
        scores.hide(&shoulder.sound());
        let strongest = statistic.strongest(&shoulder.ring, &statistic.maps(&scores.by_offset))?.value;
        Some(LeftOut { casing: shoulder.casing, strongest, scatter: scores.mean_scatter() })
    };
    casing.iter().zip(index.scores(&own)).filter_map(of).collect()
}
