//! From readings to the index maps of a casing and the limits on them: the whole computation, without state.

use crate::cells::Taps;
use crate::condition::Conditions;
use crate::fit::{Fit, Kept, LocationIndex};
use crate::kept_levels::{level_of, own_levels, whole_levels};
use crate::level::Level;
use crate::limits::{Limits, Null};
use crate::shoulder::Shoulder;
use crate::standing::{above, level_limit, stand_off};
use crate::stats::Spread;
use crate::{Centre, FuseConfig, IndexKind};

/// Spreads above its centre at which a location of a casing that is its own reference leaves it.
///
/// On a recorded slab of which 22 % is cracked it raises the part of the crack that is suspect from
/// 0.09 to 0.6; on simulated sound rings it costs at most 3 false calls in 10 000 shoulders. At 3.5 it
/// costs twice as many and gains nothing.
const TRIM_AT: f64 = 4.0;

/// The same for a location's index alone, without the step along the ring: only what is beyond doubt leaves.
const TRIM_ALONE_AT: f64 = 5.0;

/// Fewest locations below their reference that put it in doubt: as many as the least crack has.
const INVERTED_MIN: usize = 3;

/// Fewest values, each with all of its neighbours in the reference, that the limits are taken from alone; and fewest places
/// that a level is taken from alone.
pub(crate) const UNTOUCHED_MIN: usize = 16;

/// Most rounds of trimming. Recorded and simulated sets settle within six.
const TRIM_ROUNDS_MAX: usize = 10;

/// Fewest casings that tell how far levels scatter.
const LEVELS_MIN: usize = 3;

/// A reference, ready to judge casings.
#[derive(Debug)]
pub(crate) struct Standard {
    pub(crate) fit: Fit,
    /// The locations of the reference's shoulders; none where a casing is its own reference, whose maps have them.
    pub(crate) locations: Vec<Vec<LocationIndex>>,
    /// Levels of the reference's shoulders.
    pub(crate) levels: Vec<Level>,
    /// Levels of its casings, by their numbers.
    casing_levels: Vec<Level>,
    /// What the reference allows; `None` where it allows no statement.
    pub(crate) limits: Option<Limits>,
    /// Taps that a location of the reference usually has.
    pub(crate) usual_tap_count: f64,
    /// Standard deviation of the index of a location that is measured again; `None` where nothing was repeated.
    pub(crate) repeat_sd: Option<f64>,
    /// Mean score by which a sound casing may lie above the reference's; `None` where too few tell.
    level_limit: Option<f64>,
}

/// The index map of one shoulder.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct IndexMap {
    /// Location by location, before the step along the ring.
    pub(crate) locations: Vec<LocationIndex>,
    /// The damage index of each location.
    pub(crate) index: Vec<Option<f64>>,
}

impl IndexMap {
    fn of(config: &FuseConfig, shoulder: &Shoulder, locations: Vec<LocationIndex>) -> Self {
        let values: Vec<Option<f64>> = locations.iter().map(|l| l.value).collect();
        let index = indexed(config.index, Step::AlongRing, shoulder, &values);
        Self { locations, index }
    }
}

/// The index maps of one casing.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Casing {
    /// What each shoulder's values were measured against.
    pub(crate) levels: Vec<Level>,
    /// One a shoulder.
    pub(crate) maps: Vec<IndexMap>,
    /// For each shoulder whether it stands off as a whole.
    pub(crate) stands_off: Vec<bool>,
    /// Whether locations lie as far below the level as damage lies above: then what is cracked may be the rule, and what
    /// stands out the sound rest.
    pub(crate) is_inverted: bool,
}

/// A value a location, shoulder by shoulder.
type Maps = Vec<Vec<Option<f64>>>;

/// Whether the index is taken with or without the step along the ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Alone,
    AlongRing,
}

impl Standard {
    /// The reference of `shoulders` that are stated to be sound, but for the places that are labelled as cracked, for
    /// shoulders of up to `location_count` locations.
    pub(crate) fn stated(
        config: &FuseConfig,
        conditions: &Conditions,
        shoulders: &[Shoulder],
        location_count: usize,
    ) -> Self {
        let kept: Kept = shoulders.iter().map(Shoulder::sound).collect();
        let level_of = |is_meant: &dyn Fn(&Shoulder) -> bool| level_of(config, conditions, shoulders, &kept, is_meant);
        let tyre_count = shoulders.iter().map(|s| s.tyre + 1).max().unwrap_or(0);
        let casing_levels: Vec<Level> = (0..tyre_count).map(|tyre| level_of(&|s| s.tyre == tyre)).collect();
        let levels = match config.centre {
            Centre::Own => shoulders.iter().map(|own| level_of(&|s| std::ptr::eq(s, own))).collect(),
            Centre::Reference => vec![Level::pooled(&casing_levels); shoulders.len()],
        };
        let (fit, locations) = Fit::of(config, conditions, shoulders, &kept, &levels);
        let values = values_of(&locations);
        let standard =
            Self::of(config, fit, &values, (levels, casing_levels), shoulders, (&kept, &kept), location_count);
        Self { locations, ..standard }
    }

    /// The reference that a casing is to itself, and its maps: what stands out of it leaves it, round by round.
    pub(crate) fn own(config: &FuseConfig, conditions: &Conditions, shoulders: &[Shoulder]) -> (Self, Casing) {
        let (mut kept, mut calm) = (everything(shoulders), everything(shoulders));
        let mut pooled = once(|kept| level_of(config, conditions, shoulders, kept, |_| true));
        if config.index != IndexKind::Dissertation {
            let mut values = once(|now| {
                let levels = vec![pooled(now); shoulders.len()];
                Fit::values_of(config, conditions, shoulders, now, &levels)
            });
            // Location by location first: the step along the ring makes five cracked ones of three, and many narrow
            // cracks would be the majority.
            for step in [Step::Alone, Step::AlongRing] {
                calm = kept.clone();
                kept = trimmed(&calm, step, |now, calm| {
                    let maps = maps_of(config.index, &values(now), shoulders, step);
                    let spread = Spread::of(&mut sound_values(shoulders, &maps, now, calm, step))?;
                    Some((maps, spread))
                });
            }
        }
        let whole = whole_levels(config, conditions, shoulders);
        let levels = own_levels(config, conditions, shoulders, &kept, &whole, &mut pooled);
        let (fit, locations) = Fit::of(config, conditions, shoulders, &kept, &levels);
        let values = values_of(&locations);
        let all_levels = (levels.clone(), vec![pooled(&kept)]);
        let standard = Self::of(config, fit, &values, all_levels, shoulders, (&kept, &calm), 0);
        let own = shoulders.iter().zip(locations);
        let maps: Vec<IndexMap> = own.map(|(shoulder, locations)| IndexMap::of(config, shoulder, locations)).collect();
        let is_inverted = standard.is_inverted(config, &maps);
        let stands_off = stand_off(config, conditions.count(), shoulders, &whole);
        (standard, Casing { levels, maps, stands_off, is_inverted })
    }

    /// The maps of another casing; `stated_level` is that of a shoulder of it that is stated to be sound, if there is one.
    pub(crate) fn casing(
        &self,
        config: &FuseConfig,
        conditions: &Conditions,
        shoulders: &[Shoulder],
        stated_level: Option<&Level>,
    ) -> Casing {
        let mut casing_level = None;
        let whole = whole_levels(config, conditions, shoulders);
        let levels = match (config.centre, stated_level) {
            (Centre::Reference, _) => vec![Level::pooled(&self.casing_levels); shoulders.len()],
            (Centre::Own, Some(level)) => vec![level.clone(); shoulders.len()],
            (Centre::Own, None) => {
                let mut pooled = once(|kept| level_of(config, conditions, shoulders, kept, |_| true));
                let kept = self.kept_of(config, shoulders, &mut pooled);
                casing_level = Some(pooled(&kept));
                own_levels(config, conditions, shoulders, &kept, &whole, &mut pooled)
            }
        };
        let maps = self.maps(config, &levels, shoulders);
        let is_own = config.centre == Centre::Own && stated_level.is_none() && config.index != IndexKind::Dissertation;
        let is_inverted = is_own && self.is_inverted(config, &maps);
        let mut stands_off = stand_off(config, conditions.count(), shoulders, &whole);
        if casing_level.is_some_and(|level| is_own && self.is_above(&level)) {
            stands_off.fill(true);
        }
        Casing { levels, maps, stands_off, is_inverted }
    }

    /// Those places of a casing that do not stand out of it, by this reference's scales; `pooled` is the level of all its
    /// shoulders together.
    fn kept_of(&self, config: &FuseConfig, shoulders: &[Shoulder], pooled: &mut impl FnMut(&Kept) -> Level) -> Kept {
        let mut kept = everything(shoulders);
        let Some(limits) = self.limits else { return kept };
        let mut values = once(|now| {
            let level = pooled(now);
            shoulders.iter().map(|s| self.fit.values(&level, s, Taps::All)).collect()
        });
        for step in [Step::Alone, Step::AlongRing] {
            let calm = kept.clone();
            kept = trimmed(&calm, step, |now, _| {
                let maps = maps_of(config.index, &values(now), shoulders, step);
                // Alone, a location scatters more than with its neighbours: by how much, its own casing says.
                let spread = match step {
                    Step::Alone => Spread::of(&mut selected(&maps, now))?,
                    Step::AlongRing => limits.spread,
                };
                Some((maps, spread))
            });
        }
        kept
    }

    fn of(
        config: &FuseConfig,
        fit: Fit,
        values: &Maps,
        (levels, casing_levels): (Vec<Level>, Vec<Level>),
        shoulders: &[Shoulder],
        (kept, calm): (&Kept, &Kept),
        location_count: usize,
    ) -> Self {
        let along = |values: &Maps| maps_of(config.index, values, shoulders, Step::AlongRing);
        let each = |which| along(&shoulders.iter().zip(&levels).map(|(s, l)| fit.values(l, s, which)).collect());
        let maps = along(values);
        let (odd, even) = (each(Taps::Odd), each(Taps::Even));
        let mut null = Null {
            values: sound_values(shoulders, &maps, kept, calm, Step::AlongRing),
            effective_count: selected(&maps, kept).len() as f64 / likeness(config.index),
            repeat_sd: repeat_sd(&odd, &even, kept),
            ceiling: fit.ceiling(config),
        };
        let of_reference = shoulders.iter().map(|s| s.ring.len()).max().unwrap_or(0);
        let location_count = if location_count > of_reference { location_count } else { of_reference };
        let limits = Limits::of(&mut null, config.false_call_rate, location_count);
        let mut tap_counts: Vec<f64> = Vec::new();
        for (shoulder, kept) in shoulders.iter().zip(kept) {
            let mut counts = vec![0_u32; shoulder.ring.len()];
            shoulder.taps.iter().for_each(|tap| counts[tap.place] += 1);
            tap_counts.extend(counts.iter().zip(kept).filter(|&(_, &kept)| kept).map(|(&count, _)| f64::from(count)));
        }
        let usual_tap_count = crate::stats::median(&mut tap_counts).unwrap_or(0.0);
        let level_limit = level_limit(&casing_levels, fit.yardstick(), config.false_call_rate);
        let (locations, repeat_sd) = (Vec::new(), null.repeat_sd);
        Self { fit, locations, levels, casing_levels, limits, usual_tap_count, repeat_sd, level_limit }
    }

    /// Median of the casings' levels in `slot`.
    pub(crate) fn pooled_level(&self, slot: usize) -> Option<f64> {
        Level::pooled(&self.casing_levels).centre(slot)
    }

    /// Standard deviation of the casings' levels in `slot`, as a share of their median; `None` of fewer than three.
    pub(crate) fn level_spread(&self, slot: usize) -> Option<f64> {
        let pooled = Level::pooled(&self.casing_levels);
        let above: Vec<f64> = self.casing_levels.iter().filter_map(|level| level.above(&pooled)[slot]).collect();
        let n = above.len() as f64;
        let mean = above.iter().sum::<f64>() / n;
        let squares: f64 = above.iter().map(|a| (a - mean).powi(2)).sum();
        (above.len() >= LEVELS_MIN).then(|| (squares / (n - 1.0)).sqrt())
    }

    fn maps(&self, config: &FuseConfig, levels: &[Level], shoulders: &[Shoulder]) -> Vec<IndexMap> {
        let map = |(shoulder, level): (&Shoulder, &Level)| {
            IndexMap::of(config, shoulder, self.fit.locations(level, shoulder, Taps::All))
        };
        shoulders.iter().zip(levels).map(map).collect()
    }

    /// Whether `level` lies higher than those of the reference's casings do.
    fn is_above(&self, level: &Level) -> bool {
        let score = above(level, &Level::pooled(&self.casing_levels), self.fit.yardstick());
        matches!((score, self.level_limit), (Some(score), Some(limit)) if score > limit)
    }

    fn is_inverted(&self, config: &FuseConfig, maps: &[IndexMap]) -> bool {
        let is_below = |value: &f64| self.limits.is_some_and(|limits| limits.is_mirrored(*value));
        let below = maps.iter().flat_map(|map| map.index.iter().flatten()).filter(|&value| is_below(value)).count();
        config.index != IndexKind::Dissertation && below >= INVERTED_MIN
    }
}

/// How many index values are worth one independent one for a spread.
///
/// Means over three neighbours are alike by 2/3 with the next and by 1/3 with the next but one, and a spread from n values
/// of which those k apart are alike by r_k is as good as one from n/(1 + 2 sum r_k^2) (Bayley and Hammersley 1946). What
/// changes smoothly around the ring makes neighbours alike too; it is bounded and has no tail, so it is left out.
fn likeness(kind: IndexKind) -> f64 {
    if kind == IndexKind::Dissertation { 1.0 } else { 1.0 + 2.0 * (4.0 + 1.0) / 9.0 }
}

fn values_of(locations: &[Vec<LocationIndex>]) -> Maps {
    locations.iter().map(|locations| locations.iter().map(|location| location.value).collect()).collect()
}

fn everything(shoulders: &[Shoulder]) -> Kept {
    shoulders.iter().map(|s| vec![true; s.ring.len()]).collect()
}

/// Those of `calm` that stay when the ones that stand out of them leave, round by round, as `measure` sees those that
/// stayed so far.
fn trimmed(calm: &Kept, step: Step, mut measure: impl FnMut(&Kept, &Kept) -> Option<(Maps, Spread)>) -> Kept {
    let at = if step == Step::Alone { TRIM_ALONE_AT } else { TRIM_AT };
    let mut now = calm.clone();
    for _ in 0..TRIM_ROUNDS_MAX {
        let Some((maps, spread)) = measure(&now, calm) else { break };
        let is_calm = |value: &Option<f64>| value.is_none_or(|v| (v - spread.centre) / spread.sigma <= at);
        let stays = |(&calm, value): (&bool, &Option<f64>)| calm && is_calm(value);
        let next: Kept = calm.iter().zip(&maps).map(|(calm, map)| calm.iter().zip(map).map(stays).collect()).collect();
        if next == now || !is_majority(&next) {
            break;
        }
        now = next;
    }
    now
}

/// A reference of less than half its locations is none: then the cracks are the rule.
fn is_majority(kept: &Kept) -> bool {
    let count = kept.iter().flatten().count();
    2 * kept.iter().flatten().filter(|&&k| k).count() >= count
}

/// `of` what is kept; that of the last time where the same is kept again, as where one step of trimming begins with what
/// the one before it ended with.
fn once<T: Clone>(mut of: impl FnMut(&Kept) -> T) -> impl FnMut(&Kept) -> T {
    let mut last: Option<(Kept, T)> = None;
    move |now| {
        if let Some((_, found)) = last.as_ref().filter(|(kept, _)| kept == now) {
            return found.clone();
        }
        let found = of(now);
        last = Some((now.clone(), found.clone()));
        found
    }
}

fn maps_of(kind: IndexKind, values: &Maps, shoulders: &[Shoulder], step: Step) -> Maps {
    shoulders.iter().zip(values).map(|(s, values)| indexed(kind, step, s, values)).collect()
}

fn indexed(kind: IndexKind, step: Step, shoulder: &Shoulder, values: &[Option<f64>]) -> Vec<Option<f64>> {
    match (kind, step) {
        (IndexKind::Dissertation, _) | (_, Step::Alone) => values.to_vec(),
        (_, Step::AlongRing) => shoulder.ring.mean_of_3(values),
    }
}

/// Values of the places that are `kept`.
fn selected(maps: &[Vec<Option<f64>>], kept: &Kept) -> Vec<f64> {
    let of_kept = maps.iter().zip(kept).flat_map(|(map, kept)| map.iter().zip(kept));
    of_kept.filter(|&(_, &kept)| kept).filter_map(|(&value, _)| value).collect()
}

/// Values of the `kept` places that limits are taken from.
///
/// Along the ring only those give limits whose neighbours are all among `calm`: one that is cracked speaks in the
/// mean of three.
fn sound_values(shoulders: &[Shoulder], maps: &[Vec<Option<f64>>], kept: &Kept, calm: &Kept, step: Step) -> Vec<f64> {
    if step == Step::AlongRing {
        let amid = shoulders.iter().zip(calm).map(|(shoulder, calm)| shoulder.ring.amid(calm));
        let untouched: Kept =
            amid.zip(kept).map(|(amid, kept)| amid.into_iter().zip(kept).map(|(a, &k)| a && k).collect()).collect();
        let values = selected(maps, &untouched);
        if values.len() >= UNTOUCHED_MIN {
            return values;
        }
    }
    selected(maps, kept)
}

/// Standard deviation of the index of a place that is measured again, from its two halves: their mean is the index, and
/// their difference is twice as uncertain as that.
fn repeat_sd(odd: &[Vec<Option<f64>>], even: &[Vec<Option<f64>>], kept: &Kept) -> Option<f64> {
    let mut differences = Vec::new();
    for ((odd, even), kept) in odd.iter().zip(even).zip(kept) {
        let both = odd.iter().zip(even).zip(kept).filter(|&(_, &kept)| kept);
        differences.extend(both.filter_map(|((&odd, &even), _)| Some(odd? - even?)));
    }
    Spread::of(&mut differences).map(|spread| 0.5 * spread.sigma)
}

#[cfg(test)]
#[path = "standard_tests.rs"]
mod tests;
