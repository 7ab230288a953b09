//! Which additional taps are needed: places that stand out are tapped again before they are judged.

use std::collections::{BTreeMap, BTreeSet};

use tapline_wire::{PlannedTap, Purpose};

use crate::Error;
use crate::arcs::regions::arcs_above;
use crate::arcs::statistic::Arc;
use crate::evidence::{Sum, has_value};
use crate::fusion::compared::Compared;
use crate::fusion::judge::{PLACES_MAX, View};
use crate::fusion::{Fusion, Seen};

/// Most arcs of a shoulder that are tapped again, the strongest first.
const ARCS_MAX: usize = 4;

/// Fewest controls: places that do not stand out, which give the level of a second reading. There are as many as suspects if
/// these are more; twice as many take time and decide no more (`docs/rates.md`).
const CONTROLS_MIN: usize = 24;

/// Places that are to be tapped again at one offset.
#[derive(Debug, Default)]
struct Wanted {
    suspects: BTreeSet<usize>,
    controls: BTreeSet<usize>,
}

impl Fusion {
    /// The additional taps that the casing of scan number `scan` needs before its verdict, `room` at most; none for a shoulder
    /// that was tapped again already. They repeat the taps of the scan at
    ///
    /// - arcs that sound shoulders reach at [`confirm_rate`](crate::FuseConfig::confirm_rate), where a tap that stands out alone
    ///   counts in full, at the offset where the arc stands out most;
    /// - places of which nothing is known;
    /// - controls.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn wanted(&mut self, scan: usize, room: usize) -> Result<Vec<PlannedTap>, Error> {
        self.check(scan)?;
        if room == 0 || !self.config.confirms() {
            return Ok(Vec::new());
        }
        // A casing that was taken away, or lacks taps for another reason, cannot pass even with a second reading.
        let is_refused = |seen: &Option<Seen>| seen.as_ref().is_some_and(|seen| seen.is_refused);
        let rows = |&scan: &usize| self.plan.scans()[scan].taps.iter();
        if self.groups.casing(scan).iter().flat_map(rows).any(|&row| is_refused(&self.seen[row as usize])) {
            return Ok(Vec::new());
        }
        let compared = self.compared(scan);
        let offset_count = compared.conditions.offsets_mm().len();
        let mut taps = Vec::new();
        for &scan in &compared.scans {
            let has_second =
                self.plan.scans()[scan].taps.iter().any(|&row| self.plan.taps()[row as usize].is_second_reading());
            // An index over all offsets at once does not say where to tap again.
            let is_by_offset = |view: &View<'_>| view.scores.by_offset.len() == offset_count;
            let Some(view) = compared.view(scan).filter(|view| !has_second && is_by_offset(view)) else { continue };
            let limit = view.fitted.limits.at(self.config.confirm_rate);
            let ring = &view.shoulder.ring;
            // A tap that stands out alone is cut before it is believed, but not before it is asked about: over a crack of one
            // location nothing else stands out, and what is cut does not reach the limit.
            let uncut = view.fitted.statistic.maps(&view.scores.uncut);
            let mut arcs = arcs_above(&view.fitted.statistic, ring, &uncut, limit);
            // Controls are none of them, also where not all are tapped again.
            let mut is_near = vec![false; ring.len()];
            for place in arcs.iter().flat_map(|arc| ring.from(arc.start).take(arc.length)) {
                ring.with_neighbours(place).for_each(|near| is_near[near] = true);
            }
            arcs.truncate(ARCS_MAX);
            loop {
                let asked = self.taps_again(scan, &compared, &view, &arcs, &is_near);
                if taps.len() + asked.len() <= room {
                    taps.extend(asked);
                    break;
                }
                // Where there is no room for all, the strongest come first.
                if arcs.pop().is_none() {
                    break;
                }
            }
        }
        Ok(taps)
    }

    fn taps_again(
        &self,
        scan: usize,
        compared: &Compared,
        view: &View<'_>,
        arcs: &[Arc],
        is_near: &[bool],
    ) -> Vec<PlannedTap> {
        let ring = &view.shoulder.ring;
        let is_known = |offset: usize, place: usize| has_value(&view.scores.by_offset[offset][place]);
        let mut by_offset: BTreeMap<usize, Wanted> = BTreeMap::new();
        for arc in arcs {
            let Some(offset) = strongest_offset(view, *arc) else { continue };
            let places: Vec<usize> = ring.from(arc.start).take(arc.length).filter(|&p| is_known(offset, p)).collect();
            by_offset.entry(offset).or_default().suspects.extend(spread(&places, PLACES_MAX));
        }
        // Places that gave nothing, or too little at the belt edge; a shoulder with many of them has another fault.
        if let Some(&edge) = view.fitted.statistic.offsets().first() {
            let lacks_edge = self.lacking(scan, true);
            let is_blind = |place: &usize| lacks_edge[*place] || view.maps.iter().all(|map| !has_value(&map[*place]));
            let blind: Vec<usize> = (0..ring.len()).filter(is_blind).collect();
            for &place in blind.iter().filter(|_| 10 * blind.len() <= ring.len()) {
                let tapped = || self.offset_tapped_at(scan, compared, place);
                let offset = if lacks_edge[place] { Some(edge) } else { tapped() };
                by_offset.entry(offset.unwrap_or(edge)).or_default().suspects.insert(place);
            }
        }
        for (&offset, wanted) in &mut by_offset {
            let is_sound =
                |place: &usize| !is_near[*place] && view.scores.is_inlier[*place] && is_known(offset, *place);
            let sound: Vec<usize> = (0..ring.len()).filter(is_sound).collect();
            wanted.controls.extend(spread(&sound, CONTROLS_MIN.max(wanted.suspects.len())));
        }
        self.planned(scan, compared, &by_offset)
    }

    /// The first offset at which a tap is planned at `place`.
    fn offset_tapped_at(&self, scan: usize, compared: &Compared, place: usize) -> Option<usize> {
        let location = self.plan.scans()[scan].locations[place].0;
        let mut offsets = self.entering(scan).filter(|(_, id)| id.location == location);
        offsets.find_map(|(_, id)| compared.conditions.offset_number(&id))
    }

    /// The places wanted at each offset as taps: every turn that the scan has made there once more.
    fn planned(&self, scan: usize, compared: &Compared, by_offset: &BTreeMap<usize, Wanted>) -> Vec<PlannedTap> {
        let locations = &self.plan.scans()[scan].locations;
        // By offset, velocity and repetition: the taps of the turn, by place.
        let mut turns: BTreeMap<(usize, usize, u16), BTreeMap<usize, PlannedTap>> = BTreeMap::new();
        let mut repetition_counts: BTreeMap<usize, u16> = BTreeMap::new();
        for (row, id) in self.entering(scan) {
            let place = locations.binary_search_by_key(&id.location, |&(location, _)| location);
            let conditions = &compared.conditions;
            let (Some(condition), Ok(place)) = (conditions.number(&id), place) else { continue };
            let count = repetition_counts.entry(condition).or_default();
            *count = (*count).max(id.repetition.saturating_add(1));
            let turn = turns.entry((conditions.offset_of(condition), condition, id.repetition)).or_default();
            turn.insert(place, self.plan.taps()[row as usize]);
        }
        let mut taps = Vec::new();
        for (&(offset, condition, repetition), turn) in &turns {
            let Some(wanted) = by_offset.get(&offset) else { continue };
            let again = |(place, tap): (&usize, &PlannedTap)| {
                let purpose = match place {
                    _ if wanted.suspects.contains(place) => Purpose::Suspect,
                    _ if wanted.controls.contains(place) => Purpose::Control,
                    _ => return None,
                };
                let mut id = tap.id;
                id.repetition = repetition_counts[&condition].saturating_add(repetition);
                Some(PlannedTap { id, purpose, ..*tap })
            };
            taps.extend(turn.iter().filter_map(again));
        }
        taps
    }
}

/// The offset at which `arc` stands out most.
fn strongest_offset(view: &View<'_>, arc: Arc) -> Option<usize> {
    let scatter = view.fitted.statistic.of_places().next()?;
    let of_offset = |&offset: &usize| {
        let mut sum = Sum::default();
        view.shoulder.ring.from(arc.start).take(arc.length).for_each(|p| sum.add(&view.scores.uncut[offset][p]));
        Some((offset, scatter.evidence(&sum.over_root()))).filter(|(_, evidence)| !evidence.is_nan())
    };
    let each = view.fitted.statistic.offsets().iter().filter_map(of_offset);
    each.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(offset, _)| offset)
}

/// At most `most` of `places`, evenly spread.
fn spread(places: &[usize], most: usize) -> impl Iterator<Item = usize> {
    let count = places.len().min(most);
    (0..count).map(move |k| places[(2 * k + 1) * places.len() / (2 * count)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_spread_over_all() {
        // Catches places that come twice, are left out where there is room for all, or come from one end.
        let places: Vec<usize> = (10..40).collect();
        assert_eq!(spread(&places, 100).collect::<Vec<_>>(), places);
        assert_eq!(spread(&places, 3).collect::<Vec<_>>(), [15, 25, 35]);
        assert_eq!(spread(&[], 3).count(), 0);
    }
}
