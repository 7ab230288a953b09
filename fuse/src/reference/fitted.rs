//! What is learned from a reference: the index, the scatter of its arcs, and the limits.

use rayon::prelude::*;

use crate::arcs::limits::{Limits, of_whole_ring};
use crate::arcs::statistic::ArcStatistic;
use crate::arcs::white::{self, White};
use crate::evidence::has_value;
use crate::index::{self, Index, Scores, Setup};
use crate::reference::supported::supported_rate;
use crate::shoulder::Shoulder;
use crate::stats::mean_and_sd;
use crate::verdict::whole_shoulder::{SoundLevels, SoundPlaces};

/// Fewest values that give the scatter of sound places: with fewer, limits that pass sound shoulders pass strong cracks
/// (`docs/rates.md`).
const VALUES_MIN: usize = 8;

/// Most groups into which the casings of a reference are dealt; those of a group are judged by the others together. With no more casings
/// than this, each is judged by all others. One group for each casing of a large reference would take time by the square of their number.
const GROUPS_MAX: usize = 24;

/// A reference as it judges shoulders of one plan.
#[derive(Debug)]
pub(crate) struct FittedReference {
    pub setup: Setup,
    pub index: Box<dyn Index>,
    pub statistic: ArcStatistic,
    pub limits: Limits,
    /// Levels of whole shoulders; `None` where shoulders are their own reference.
    pub levels: Option<SoundLevels>,
    /// How many casings the limits rest on; none where shoulders are their own reference.
    pub casing_count: usize,
    /// Strongest arc of each of its shoulders, judged by other casings, and the number of its casing. Of a shoulder with known cracks, the
    /// one to expect if all of it were sound.
    pub strongest: Vec<(usize, f64)>,
    /// How far the places of its shoulders differ; `None` where shoulders are their own reference, or the index does not measure it.
    pub scatter_limits: Option<ScatterLimits>,
    /// Scores of its own shoulders, where these are what is judged; else none.
    pub own_scores: Vec<Scores>,
    /// What noise alone makes of arcs.
    pub white: White,
}

impl FittedReference {
    /// Fits `shoulders`, with those of a casing one after the other; `offsets` are the numbers of the offsets from the belt
    /// edge inwards. `None` if none of their values vary, or there are too few places.
    pub(crate) fn fit(setup: Setup, offsets: &[usize], shoulders: &[Shoulder]) -> Option<Self> {
        let all: Vec<&Shoulder> = shoulders.iter().collect();
        let Learned { index, statistic, own_scores, sound_scores: scores } = learn(&setup, offsets, &all)?;
        let casings: Vec<&[Shoulder]> = shoulders.chunk_by(|a, b| a.casing == b.casing).collect();
        let left_out: Vec<LeftOut> =
            if setup.is_own || casings.len() < 2 { Vec::new() } else { left_out(&setup, offsets, &casings) };
        // One that is cracked all round says nothing of sound arcs.
        let casing_count = match left_out.chunk_by(|a, b| a.casing == b.casing).count() {
            _ if setup.is_own => 0,
            0 => 1,
            count => count,
        };
        let place_count = shoulders.first()?.place_count();
        let scatter_limits = match casing_count {
            0 => None,
            1 => ScatterLimits::by(&scores.iter().collect::<Vec<_>>(), place_count, 1),
            count => ScatterLimits::by(&left_out.iter().map(|of| &of.scores).collect::<Vec<_>>(), place_count, count),
        };
        // For shoulders with labels, the one that shows most: another may have no sound place.
        let shown = |scores: &Scores| scores.by_offset.iter().flatten().filter(|scores| has_value(scores)).count();
        let rings = shoulders.iter().map(|shoulder| &shoulder.ring).zip(&scores);
        let (ring, pattern) = rings.rev().max_by_key(|(_, scores)| shown(scores))?;
        let place_count: usize = scores.iter().map(Scores::places_shown).sum();
        // A casing by itself has its scatter from values below the median: half of the places that do not stand out.
        let value_count = if setup.is_own { place_count / 2 } else { place_count };
        if value_count < VALUES_MIN {
            return None;
        }
        let white = white::strongest_arcs(&statistic, ring, pattern, value_count)?;
        let strongest: Vec<(usize, f64)> =
            left_out.iter().map(|of| (of.casing, of_whole_ring(of.strongest, of.part, white))).collect();
        let values: Vec<f64> = strongest.iter().map(|(_, value)| *value).collect();
        let limits = Limits::by(&values, casing_count, white);
        let sound =
            || all.iter().zip(&scores).map(|(shoulder, scores)| SoundPlaces::found(shoulder, &scores.is_inlier));
        let levels = (!setup.is_own).then(|| SoundLevels::fit(&setup, &sound().collect::<Vec<_>>()));
        Some(Self {
            setup,
            index,
            statistic,
            limits,
            levels,
            casing_count,
            strongest,
            scatter_limits,
            own_scores,
            white,
        })
    }

    /// [`supported_rate`] of its casings.
    pub(crate) fn supported_rate(&self) -> Option<f64> {
        supported_rate(self.casing_count)
    }
}

/// Limits beyond which a shoulder scatters more, or less, than those of a reference.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ScatterLimits {
    /// Limits of [`Scores::scatter`], by discriminator: one sound shoulder in 160 exceeds each.
    of_discriminators: Vec<f64>,
    /// Limit of [`Scores::mean_scatter`]: one in 40 exceeds it.
    mean: f64,
    /// Limit of the same that no sound shoulder exceeds.
    far: f64,
    /// Limit of the same that sound shoulders do not fall below; 0 if the reference has too few casings to show it.
    low: f64,
}

/// Fewest casings that show how little a sound shoulder may scatter.
const LOW_CASINGS_MIN: usize = 3;

impl ScatterLimits {
    /// The limits from the scatter of the shoulders of `casing_count` casings, with `place_count` places each; `None` if the index does
    /// not measure it.
    fn by(shoulders: &[&Scores], place_count: usize, casing_count: usize) -> Option<Self> {
        // From a few shoulders it may come out too small: one turn of so many places gives its scatter no better.
        let sd_min = 0.8 / (place_count as f64).sqrt();
        let mean_and_sd = |of: &dyn Fn(&Scores) -> f64| {
            let values: Vec<f64> = shoulders.iter().map(|scores| of(scores)).filter(|x| x.is_finite()).collect();
            let (mean, sd) = mean_and_sd(&values).or_else(|| Some((*values.first()?, 0.0)))?;
            Some((mean, if sd > sd_min { sd } else { sd_min }))
        };
        let (mean, sd) = mean_and_sd(&Scores::mean_scatter)?;
        let (half_more, rare) = (1.5 * mean, mean + 4.0 * sd);
        let of_discriminator = |d: usize| {
            mean_and_sd(&|scores: &Scores| scores.scatter[d]).map_or(f64::INFINITY, |(mean, sd)| mean + 2.5 * sd)
        };
        // By logarithms: a scatter is never below 0, whatever its standard deviation.
        let (half, rarely_less) = (0.5 * mean, mean * (-4.0 * sd / mean).exp());
        let low = if half < rarely_less { half } else { rarely_less };
        Some(Self {
            of_discriminators: (0..shoulders.first()?.scatter.len()).map(of_discriminator).collect(),
            mean: mean + 2.0 * sd,
            far: if half_more > rare { half_more } else { rare },
            low: if casing_count < LOW_CASINGS_MIN { 0.0 } else { low },
        })
    }

    /// Whether a shoulder with these `scores` scatters more than any sound one.
    pub(crate) fn are_exceeded(&self, scores: &Scores) -> bool {
        scores.mean_scatter() > self.far
    }

    /// Whether it scatters as only few sound ones do.
    pub(crate) fn are_doubtful(&self, scores: &Scores) -> bool {
        scores.mean_scatter() > self.mean
            || scores.scatter.iter().zip(&self.of_discriminators).any(|(x, limit)| x > limit)
    }

    /// Whether it scatters less than sound ones do: perhaps one place was tapped again and again.
    pub(crate) fn are_undercut(&self, scores: &Scores) -> bool {
        scores.mean_scatter() < self.low
    }
}

/// What shoulders teach.
struct Learned {
    index: Box<dyn Index>,
    statistic: ArcStatistic,
    /// As in [`FittedReference`].
    own_scores: Vec<Scores>,
    /// By shoulder, the scores of the places that teach.
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

/// A shoulder judged by other casings of its reference.
struct LeftOut {
    /// Number of its casing.
    casing: usize,
    /// How far its strongest arc stands out.
    strongest: f64,
    /// The part of its places that could have such an arc: those that have scores and are not known to be cracked.
    part: f64,
    scores: Scores,
}

/// What other casings say of the shoulders of each of `casings`, in their order.
fn left_out(setup: &Setup, offsets: &[usize], casings: &[&[Shoulder]]) -> Vec<LeftOut> {
    let of_group = |(group, others): (Vec<&[Shoulder]>, Vec<&[Shoulder]>)| -> Vec<LeftOut> {
        let Some(learned) = learn(setup, offsets, &others.into_iter().flatten().collect::<Vec<_>>()) else {
            return Vec::new();
        };
        group.into_iter().flat_map(|casing| judged_by(&learned, casing)).collect()
    };
    let mut all: Vec<LeftOut> = dealt(casings).into_par_iter().flat_map_iter(of_group).collect();
    all.sort_by_key(|of| of.casing);
    all
}

/// `casings` dealt into groups, each with the casings that are not in it.
pub(super) fn dealt<T: Copy>(casings: &[T]) -> Vec<(Vec<T>, Vec<T>)> {
    let count = casings.len().min(GROUPS_MAX);
    let split = |group: usize| {
        let (own, others): (Vec<_>, Vec<_>) =
            casings.iter().zip(0..).partition(|&(_, number): &(&T, usize)| number % count == group);
        let without_numbers = |of: Vec<(&T, usize)>| of.into_iter().map(|(casing, _)| *casing).collect();
        (without_numbers(own), without_numbers(others))
    };
    (0..count).map(split).collect()
}

/// The shoulders of `casing`, judged by what others taught.
fn judged_by(learned: &Learned, casing: &[Shoulder]) -> Vec<LeftOut> {
    let Learned { index, statistic, .. } = learned;
    let own: Vec<&Shoulder> = casing.iter().collect();
    let of = |(shoulder, mut scores): (&Shoulder, Scores)| {
        scores.hide(&shoulder.sound());
        let strongest = statistic.strongest(&shoulder.ring, &statistic.maps(&scores.by_offset))?.value;
        let part = scores.places_shown() as f64 / shoulder.place_count() as f64;
        Some(LeftOut { casing: shoulder.casing, strongest, part, scores })
    };
    casing.iter().zip(index.scores(&own)).filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a casing that is judged by itself, twice or never, and more groups than a large reference has time for.
    #[test]
    fn each_casing_is_judged_by_others() {
        for (count, groups) in [(2, 2), (24, 24), (25, 24), (100, 24)] {
            let casings: Vec<usize> = (0..count).collect();
            let dealt = dealt(&casings);
            assert_eq!(dealt.len(), groups);
            for (own, others) in &dealt {
                let mut all = [own.as_slice(), others].concat();
                all.sort_unstable();
                assert_eq!(all, casings);
                assert!(own.len() <= count.div_ceil(groups), "{own:?}");
            }
            let mut all: Vec<usize> = dealt.into_iter().flat_map(|(own, _)| own).collect();
            all.sort_unstable();
            assert_eq!(all, casings);
        }
    }
}
