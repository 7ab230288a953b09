//! The verdict on a shoulder, and the map of its damage.

use tapline_wire::{DamageCell, Discriminator, Geometry, Judgement, Reasons, RecordKind, Scan, Stamp};

use crate::arcs::regions::{arcs_above, damage_index};
use crate::arcs::statistic::{Arc, Maps};
use crate::evidence::{Sum, has_value};
use crate::fusion::Fusion;
use crate::fusion::compared::{Compared, Comparison};
use crate::index::Scores;
use crate::reference::fitted::FittedReference;
use crate::shoulder::Shoulder;
use crate::stats::mean;
use crate::verdict::verdict_of;
use crate::verdict::whole_shoulder::SoundPlaces;
use crate::{Error, FuseConfig};

/// Most places of an arc that are tapped again; a longer one shows at some of its places as well.
pub(super) const PLACES_MAX: usize = 12;

/// A region extends to every offset at which it shows at least this fraction of what it shows at the best offset.
const REACH_FRACTION: f64 = 0.5;

/// A suspect arc whose second reading alone stands out less is cleared.
const CLEARED_SD: f64 = 1.0;

/// One is rejected only if its second reading alone stands out this far: 1 % of readings of sound places do, and more of places
/// chosen by their first reading, part of which persists.
const CONFIRMED_SD: f64 = 2.33;

/// Offsets with this fraction of the maximum count as equal.
const ALIKE_FRACTION: f64 = 0.98;

/// A shoulder as a single offset shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct OffsetMap {
    /// Offset from the belt edge, mm.
    pub offset_mm: f64,
    /// Damage index by location, `None` where it has none there.
    pub index: Vec<Option<f64>>,
}

/// A shoulder as judged by its reference.
pub(super) struct View<'a> {
    pub(super) shoulder: &'a Shoulder,
    /// What it is compared with.
    pub(super) fitted: &'a FittedReference,
    /// The reference that was named, and the scores by it: others than `fitted` and `scores` where the scatter of the shoulder is off.
    named: (&'a FittedReference, &'a Scores),
    is_scatter_off: bool,
    pub(super) scores: &'a Scores,
    pub(super) maps: Maps,
    /// Without second readings; `None` where there are none.
    first_maps: Option<Maps>,
    /// Second readings alone.
    second: Option<&'a Scores>,
}

impl Compared {
    /// The shoulder of scan number `scan`, which is among those compared, as its reference judges it; one whose scatter is off, as its own
    /// casing does.
    pub(super) fn view(&self, scan: usize) -> Option<View<'_>> {
        let number = self.scans.iter().position(|&s| s == scan)?;
        let named = self.by_reference.as_ref()?;
        let is_scatter_off = self.is_scatter_off[number];
        let comparison = self.by_itself.as_ref().filter(|_| is_scatter_off).unwrap_or(named);
        let view = View::new(&self.shoulders[number], number, comparison);
        Some(View { named: (&named.fitted, &named.scores[number]), is_scatter_off, ..view })
    }

    /// The other shoulder of the casing of scan number `scan`.
    fn beside(&self, scan: usize) -> Option<SoundPlaces<'_>> {
        let number = self.scans.iter().position(|&other| other != scan)?;
        Some(SoundPlaces::found(&self.shoulders[number], &self.by_reference.as_ref()?.scores[number].is_inlier))
    }
}

impl Fusion {
    /// The verdict on scan number `scan` with its damage map, one cell a location in their order.
    ///
    /// It is available at any time. Until the scan [can be judged](Self::can_be_judged) it rests on what has come and is never PASS:
    /// [`Reasons::NOT_ENDED`] and [`Reasons::TAPS_MISSING`] then refer to the scan or its reference. The publisher fills
    /// in the stamp's sequence and sender.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn judge(&mut self, scan: usize) -> Result<(Judgement, Vec<DamageCell>), Error> {
        self.check(scan)?;
        let compared = self.compared(scan);
        let planned = &self.plan.scans()[scan];
        let mut cells = empty_cells(planned);
        self.count_taps(scan, &mut cells);
        let seen = || planned.taps.iter().filter_map(|&row| self.seen[row as usize].as_ref());
        let refused_count = seen().filter(|seen| seen.is_refused).count();
        let mut judgement = Judgement {
            stamp: Stamp { kind: RecordKind::Data.code(), mark: scan as u64, ..Stamp::default() },
            reasons: self.reasons_of(scan, &compared),
            re_inspect_rate: self.config.re_inspect_rate,
            reject_rate: self.config.reject_rate,
            drift: self.drift(scan),
            planned_count: count(planned.taps.len()),
            received_count: count(seen().count() - refused_count),
            refused_count: count(refused_count),
            ..Judgement::default()
        };
        match compared.view(scan) {
            Some(view) => {
                let other = compared.beside(scan);
                view.judge(&self.config, self.plan.geometry, other.as_ref(), &mut judgement, &mut cells);
                view.mark_offsets(&compared, &mut cells);
                if cells.iter().any(|cell| cell.damage_index.is_nan()) {
                    judgement.reasons.insert(Reasons::LOCATION_BLIND);
                }
            }
            None => judgement.reasons.insert(Reasons::NO_INDEX),
        }
        judgement.absent_count = cells.iter().fold(0, |sum: u32, cell| sum.saturating_add(cell.absent_count));
        judgement.verdict = verdict_of(judgement.reasons).code();
        Ok((judgement, cells))
    }

    /// Fills in how many taps of each location came with any discriminator, and what was absent from those that came.
    fn count_taps(&self, scan: usize, cells: &mut [DamageCell]) {
        let asked = count(self.config.discriminators.len());
        for (row, id) in self.entering(scan) {
            let seen = self.seen[row as usize].as_ref().filter(|seen| !seen.is_refused);
            let place = cells.binary_search_by_key(&id.location, |cell| cell.location);
            let (Some(seen), Ok(place)) = (seen, place) else { continue };
            let given = self.config.discriminators.iter().filter(|which| seen.values.get(**which).is_some()).count();
            cells[place].tap_count += u32::from(given > 0);
            cells[place].absent_count += asked - count(given);
        }
    }

    /// The damage index of every location of scan number `scan` at each offset that is known alone, in the order of the
    /// locations and of the offsets: the result of a scan at that offset only. From what has come so far.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn by_offset(&mut self, scan: usize) -> Result<Vec<OffsetMap>, Error> {
        self.check(scan)?;
        let compared = self.compared(scan);
        let offsets_mm = compared.conditions.offsets_mm();
        // An index that looks at all offsets at once has nothing to say of one.
        let Some(view) = compared.view(scan).filter(|view| view.scores.by_offset.len() == offsets_mm.len()) else {
            return Ok(Vec::new());
        };
        let map = |(number, mm): (usize, Option<f64>)| {
            let alone = view.fitted.statistic.alone(number);
            let index = damage_index(&alone, &view.shoulder.ring, &alone.maps(&view.scores.by_offset));
            Some(OffsetMap {
                offset_mm: mm?,
                index: index.into_iter().map(|x| Some(x).filter(|x| !x.is_nan())).collect(),
            })
        };
        let mut maps: Vec<OffsetMap> = offsets_mm.into_iter().enumerate().filter_map(map).collect();
        maps.retain(|map| map.index.iter().any(Option::is_some));
        maps.sort_by(|a, b| a.offset_mm.total_cmp(&b.offset_mm));
        Ok(maps)
    }

    /// The same taps, to be judged by another configuration of the same reference.
    pub(crate) fn reconfigured(&self, config: FuseConfig) -> Self {
        Self { config, cache: None, ..self.clone() }
    }

    /// The damage index of each location of `scan`; NaN where it has none.
    pub(crate) fn index_of(&mut self, scan: usize) -> Vec<f64> {
        let compared = self.compared(scan);
        match compared.view(scan) {
            Some(view) => damage_index(&view.fitted.statistic, &view.shoulder.ring, &view.maps),
            None => vec![f64::NAN; self.rings[scan].len()],
        }
    }

    /// What `which` alone says of each location of scan number `scan`: its mean score over the taps of the location and its
    /// neighbours, the greater the more it speaks for damage. NaN where it says nothing, and where it is not configured.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn alone(&mut self, scan: usize, which: Discriminator) -> Result<Vec<f64>, Error> {
        self.check(scan)?;
        let compared = self.compared(scan);
        let number = self.config.discriminators.iter().position(|&configured| configured == which);
        let Some((view, d)) = compared.view(scan).zip(number) else {
            return Ok(vec![f64::NAN; self.rings[scan].len()]);
        };
        let of_place = |scores: &Vec<f64>| Some(scores[d]).filter(|score| score.is_finite());
        let scores: Vec<Option<f64>> = view.scores.by_discriminator.iter().map(of_place).collect();
        Ok(view.shoulder.ring.mean_of_3(&scores).into_iter().map(|mean| mean.unwrap_or(f64::NAN)).collect())
    }

    /// The damage index of each location of scan number `scan` by Eqs. 55 and 56 as printed, 0 to 1 within the extremes of
    /// the reference; `None` where nothing was scaled, and everywhere unless [`crate::IndexKind::Dissertation`] is configured.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn dissertation_index(&mut self, scan: usize) -> Result<Vec<Option<f64>>, Error> {
        self.check(scan)?;
        let compared = self.compared(scan);
        let printed = compared.view(scan).and_then(|view| view.fitted.index.as_printed(view.shoulder));
        Ok(printed.unwrap_or_else(|| vec![None; self.rings[scan].len()]))
    }
}

impl<'a> View<'a> {
    /// The view of `shoulder`, which is number `number` of the casing of `comparison`.
    pub(super) fn new(shoulder: &'a Shoulder, number: usize, comparison: &'a Comparison) -> Self {
        let Comparison { fitted, scores, readings } = comparison;
        let maps = |scores: &Vec<Scores>| fitted.statistic.maps(&scores[number].by_offset);
        Self {
            shoulder,
            fitted,
            named: (fitted, &scores[number]),
            is_scatter_off: false,
            scores: &scores[number],
            maps: maps(scores),
            first_maps: readings.as_ref().map(|readings| maps(&readings.first)),
            second: readings.as_ref().map(|readings| &readings.second[number]),
        }
    }

    /// Whether the places of the shoulder differ from one another more than those of any sound one.
    pub(super) fn scatters_more(&self) -> bool {
        self.fitted.scatter_limits.as_ref().is_some_and(|limits| limits.are_exceeded(self.scores))
    }

    /// Whether they differ as those of few sound ones do, and an arc reaches the re-inspect limit, which may be due to that.
    pub(super) fn is_doubtful(&self, config: &FuseConfig) -> bool {
        let limits = &self.fitted.limits;
        let is_called = || !self.arcs(limits.at(config.re_inspect_rate), limits.at(config.reject_rate)).is_empty();
        self.fitted.scatter_limits.as_ref().is_some_and(|limits| limits.are_doubtful(self.scores)) && is_called()
    }

    /// Whether an arc is damage by the reject limit.
    pub(super) fn is_rejected(&self, config: &FuseConfig, geometry: Geometry) -> bool {
        let limit_reject = self.fitted.limits.at(config.reject_rate);
        self.arcs(limit_reject, limit_reject)
            .iter()
            .any(|(arc, second)| is_damage(arc, *second, geometry, limit_reject))
    }

    /// The arcs that reach `limit`, each with what its second reading alone shows, but those that it clears; the strongest first.
    ///
    /// It does not clear several places that the first reading alone would reject: a casing that has slipped since, or a recorder that
    /// has lost its place, shows nothing there either.
    fn arcs(&self, limit: f64, limit_reject: f64) -> Vec<(Arc, Option<f64>)> {
        let of = |maps, limit| {
            let arcs = arcs_above(&self.fitted.statistic, &self.shoulder.ring, maps, limit).into_iter();
            arcs.map(|arc| (arc, self.second_value(arc)))
        };
        let is_cleared = |second: Option<f64>| second.is_some_and(|value| value < CLEARED_SD);
        let mut arcs: Vec<_> = of(&self.maps, limit).filter(|(_, second)| !is_cleared(*second)).collect();
        let strong = self.first_maps.iter().flat_map(|maps| of(maps, limit_reject));
        arcs.extend(strong.filter(|(arc, second)| arc.length > 1 && is_cleared(*second)));
        arcs.sort_by(|(a, _), (b, _)| b.value.total_cmp(&a.value));
        arcs
    }

    /// Fills in the damage index, and what arcs, scatter and level say of the shoulder.
    fn judge(
        &self,
        config: &FuseConfig,
        geometry: Geometry,
        other: Option<&SoundPlaces<'_>>,
        judgement: &mut Judgement,
        cells: &mut [DamageCell],
    ) {
        judgement.limit_re_inspect = self.fitted.limits.at(config.re_inspect_rate);
        judgement.limit_reject = self.fitted.limits.at(config.reject_rate);
        if self.fitted.supported_rate().is_none_or(|supported| config.reject_rate < supported) {
            judgement.reasons.insert(Reasons::EXTRAPOLATED);
        }
        self.fill_index(judgement, cells);
        self.judge_arcs(geometry, judgement, cells);
        self.judge_scatter(geometry, judgement);
        self.judge_level(config, geometry, other, judgement, cells);
    }

    /// Fills in the damage index of every place and the strongest arc, of all taps and of the first reading alone.
    fn fill_index(&self, judgement: &mut Judgement, cells: &mut [DamageCell]) {
        let (statistic, ring, limits) = (&self.fitted.statistic, &self.shoulder.ring, self.fitted.limits);
        for (cell, index) in cells.iter_mut().zip(damage_index(statistic, ring, &self.maps)) {
            cell.damage_index = index;
            cell.p_value = if index.is_nan() { f64::NAN } else { limits.probability(index) };
        }
        match statistic.strongest(ring, &self.maps) {
            Some(strongest) => {
                judgement.strongest_arc = strongest.value;
                judgement.p_value = limits.probability(strongest.value);
                judgement.evidence = self.discriminators_at(strongest);
            }
            None => judgement.reasons.insert(Reasons::NO_INDEX),
        }
        if let Some(first_maps) = &self.first_maps {
            let first = damage_index(statistic, ring, first_maps);
            cells.iter_mut().zip(first).for_each(|(cell, index)| cell.first_index = index);
            judgement.first_strongest_arc = statistic.strongest(ring, first_maps).map_or(f64::NAN, |arc| arc.value);
        }
    }

    /// Adds the reasons of the arcs that reach the re-inspect limit, and fills in the regions that they form.
    fn judge_arcs(&self, geometry: Geometry, judgement: &mut Judgement, cells: &mut [DamageCell]) {
        let ring = &self.shoulder.ring;
        let arcs = self.arcs(judgement.limit_re_inspect, judgement.limit_reject);
        // By the scales of a reference that scatters less nothing is damage.
        let can_be_damage = !self.is_scatter_off || self.fitted.setup.is_own;
        let mut is_inside = vec![false; ring.len()];
        for (arc, second) in &arcs {
            let is_damage = can_be_damage && is_damage(arc, *second, geometry, judgement.limit_reject);
            judgement.reasons.insert(if is_damage { Reasons::DAMAGE } else { Reasons::SUSPECT });
            ring.from(arc.start).take(arc.length).for_each(|place| is_inside[place] = true);
        }
        let regions = ring.numbered(|place| is_inside[place]);
        for (arc, _) in &arcs {
            let number = regions[arc.start];
            let p_value = self.fitted.limits.probability(arc.value);
            let of_region = cells.iter_mut().zip(&regions).filter(|(_, region)| **region == number);
            of_region.for_each(|(cell, _)| {
                cell.region = number;
                // The strongest arc of a region comes first.
                if cell.region_p_value.is_nan() {
                    (cell.region_index, cell.region_p_value) = (arc.value, p_value);
                }
            });
        }
        if 2 * is_inside.iter().filter(|&&inside| inside).count() > ring.len() {
            judgement.reasons.insert(Reasons::NO_SOUND_MAJORITY);
        }
    }

    /// Fills in how far the places of the shoulder differ, compared with those of the reference.
    fn judge_scatter(&self, geometry: Geometry, judgement: &mut Judgement) {
        let (reference, scores) = self.named;
        // A casing that is its own reference has the scatter of that.
        for (&(which, _), &scatter) in reference.setup.discriminators.iter().zip(&scores.scatter) {
            judgement.scatter[which as usize] = if reference.setup.is_own { f64::NAN } else { scatter };
        }
        if self.is_scatter_off {
            judgement.reasons.insert(Reasons::SCATTER_OFF);
        }
        // A line does not turn.
        let is_low = || reference.scatter_limits.as_ref().is_some_and(|limits| limits.are_undercut(scores));
        if geometry == Geometry::Ring && is_low() {
            judgement.reasons.insert(Reasons::SCATTER_LOW);
        }
        if self.is_scatter_off && self.fitted.setup.is_own {
            judgement.reasons.insert(Reasons::SELF_REFERENCE);
        }
    }

    /// Fills in the level of the shoulder as a whole, compared with the reference's: damage all round shows in nothing else.
    fn judge_level(
        &self,
        config: &FuseConfig,
        geometry: Geometry,
        other: Option<&SoundPlaces<'_>>,
        judgement: &mut Judgement,
        cells: &[DamageCell],
    ) {
        let (reference, scores) = self.named;
        let sound = SoundPlaces::found(self.shoulder, &scores.is_inlier);
        if let Some(levels) = &reference.levels {
            judgement.level = levels.times(&sound);
        }
        let probability = reference.levels.as_ref().and_then(|levels| levels.probability(&sound, other));
        if probability.is_some_and(|probability| probability < config.reject_rate) {
            judgement.reasons.insert(Reasons::LEVEL_OFF);
        }
        // A casing that is its own reference has another reason, and locations in a line have no level in common; a shoulder of which
        // nothing came has no level.
        let should_have_level = reference.casing_count > 0
            && geometry == Geometry::Ring
            && cells.iter().any(|cell| !cell.damage_index.is_nan());
        if probability.is_none() && should_have_level {
            judgement.reasons.insert(Reasons::LEVEL_UNKNOWN);
        }
    }

    /// How many standard deviations the second reading of `arc` alone lies above that of its controls; `None` where it was
    /// not tapped again.
    fn second_value(&self, arc: Arc) -> Option<f64> {
        let second = self.second?;
        let second_turns =
            || self.shoulder.turns.iter().filter_map(|turn| Some((turn.condition, turn.controls.as_ref()?)));
        let is_control = |place: &usize| second_turns().any(|(_, controls)| controls[*place]);
        let places: Vec<usize> =
            self.shoulder.ring.from(arc.start).take(arc.length).filter(|place| !is_control(place)).collect();
        // The first reading alone chooses what is looked at in the second one.
        let statistic = &self.fitted.statistic;
        let weights = statistic.weights(&self.shoulder.ring, self.first_maps.as_ref()?, arc);
        let mut sum = Sum::default();
        let mut control_count_min = None;
        for &offset in statistic.offsets() {
            let scores = &second.by_offset[offset];
            if !places.iter().any(|&place| has_value(&scores[place])) {
                continue;
            }
            places.iter().for_each(|&place| sum.add(&scores[place]));
            let of_offset = second_turns().filter(|(condition, _)| self.fitted.setup.offset_of[*condition] == offset);
            let counts = of_offset.map(|(_, controls)| controls.iter().filter(|is| **is).count());
            // A turn without controls has no level, and so no scores.
            control_count_min = counts.filter(|count| *count > 0).chain(control_count_min).min();
        }
        let count = (0..weights.len()).map(|d| sum.count(d)).max()? as usize;
        // An arc of which only a small part was tapped again was not requested.
        let asked = arc.length.min(PLACES_MAX);
        // The median of the controls is only as certain as their number allows.
        let of_controls = count as f64 / control_count_min? as f64;
        let value = statistic.of_places().next()?.along(&weights, &sum.over_root(), of_controls);
        (2 * count >= asked && asked > 0 && !value.is_nan()).then_some(value)
    }

    /// Mean score of each discriminator in `arc`, NaN where it says nothing.
    fn discriminators_at(&self, arc: Arc) -> [f64; Discriminator::COUNT] {
        let mut means = [f64::NAN; Discriminator::COUNT];
        for (d, &(which, _)) in self.fitted.setup.discriminators.iter().enumerate() {
            let places = self.shoulder.ring.from(arc.start).take(arc.length);
            let scores = places.map(|place| self.scores.by_discriminator[place][d]).filter(|score| score.is_finite());
            means[which as usize] = mean(scores).unwrap_or(f64::NAN);
        }
        means
    }

    /// Fills in at which offsets each region shows: best, and from the least to the greatest that has half of it.
    ///
    /// If several offsets show it alike, the one nearest to the belt edge counts: that is where such cracks begin.
    fn mark_offsets(&self, compared: &Compared, cells: &mut [DamageCell]) {
        let offsets_mm = compared.conditions.offsets_mm();
        for region in 1..=cells.iter().map(|cell| cell.region).max().unwrap_or(0) {
            let shown = self.fitted.statistic.offsets().iter().filter_map(|&offset| {
                let mut sum = Sum::default();
                let of_region = cells.iter().zip(self.scores.by_offset.get(offset)?);
                of_region.filter(|(cell, _)| cell.region == region).for_each(|(_, scores)| sum.add(scores));
                let evidence = self.fitted.statistic.of_places().next()?.evidence(&sum.over_root());
                Some((offsets_mm[offset]?, evidence)).filter(|_| !evidence.is_nan())
            });
            let mut shown: Vec<(f64, f64)> = shown.collect();
            shown.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
            let Some(most) = shown.iter().map(|&(_, value)| value).max_by(f64::total_cmp) else { continue };
            let Some(&(best, _)) = shown.iter().find(|(_, value)| *value >= ALIKE_FRACTION * most) else { continue };
            let reached = || shown.iter().filter(|(_, value)| *value >= REACH_FRACTION * most).map(|&(mm, _)| mm);
            for cell in cells.iter_mut().filter(|cell| cell.region == region) {
                cell.offset_best_mm = best;
                cell.offset_low_mm = reached().min_by(f64::total_cmp).unwrap_or(best);
                cell.offset_high_mm = reached().max_by(f64::total_cmp).unwrap_or(best);
            }
        }
    }
}

/// Whether an arc that reaches the re-inspect limit is damage; `second` is what its second reading alone shows.
fn is_damage(arc: &Arc, second: Option<f64>, geometry: Geometry, limit_reject: f64) -> bool {
    // A location on a line is isolated between distant ones: it is inspected again before it leads to REJECT.
    let is_alone = geometry == Geometry::Line && arc.length < 2;
    arc.value >= limit_reject && second.is_none_or(|value| value >= CONFIRMED_SD) && !is_alone
}

/// A damage map of `planned` in which nothing is known but the locations, in their order.
pub(crate) fn empty_cells(planned: &Scan) -> Vec<DamageCell> {
    let cell = |&(location, angle_deg): &(u32, Option<f64>)| DamageCell {
        location,
        angle_deg: angle_deg.unwrap_or(f64::NAN),
        ..DamageCell::default()
    };
    planned.locations.iter().map(cell).collect()
}

/// `of` as a number of a record.
pub(crate) fn count(of: usize) -> u32 {
    u32::try_from(of).unwrap_or(u32::MAX)
}
