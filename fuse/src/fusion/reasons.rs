//! Reasons against PASS that do not depend on scores: what is missing, refused, unknown or not calibrated.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Arc;

use tapline_wire::{Discriminator, Geometry, Purpose, Quality, Reasons};

use crate::fusion::compared::Compared;
use crate::fusion::{Fusion, closing_location};
use crate::shoulder::conditions::edge_distance_mm;
use crate::shoulder::ring::Ring;

/// Fewest values that are alike in two taps and not by chance: each has 64 bits, but a stuck sensor gives some of them again and again.
const REPEATED_MIN: usize = 4;

impl Fusion {
    /// The reasons that follow from the state of the scan and of its reference.
    pub(super) fn reasons_of(&self, scan: usize, compared: &Arc<Compared>) -> Reasons {
        let mut reasons = Reasons::default();
        for involved in self.groups.involved(scan) {
            let progress = self.progress[involved];
            if !progress.is_ended {
                reasons.insert(Reasons::NOT_ENDED);
            }
            if progress.seen_count < self.plan.scans()[involved].taps.len() {
                reasons.insert(Reasons::TAPS_MISSING);
            }
        }
        // Only its own taps: a reference that lacks one says so in its own verdict, and leaves no blind spot here.
        let seen = || self.plan.scans()[scan].taps.iter().filter_map(|&row| self.seen[row as usize].as_ref());
        if seen().any(|seen| seen.is_refused) {
            reasons.insert(Reasons::TAPS_REFUSED);
        }
        // A fault of the whole shoulder stands out nowhere in it.
        if !Quality::on_most(seen().map(|seen| seen.quality)).is_empty() {
            reasons.insert(Reasons::FLAGGED);
        }
        if self.groups.reference(scan).contains(&scan) {
            reasons.insert(Reasons::SELF_REFERENCE);
        }
        if self.lacks_discriminators(scan) {
            reasons.insert(Reasons::DISCRIMINATORS_ABSENT);
        }
        // What another shoulder lacks does not matter here, unless this one is compared with it.
        if self.groups.reference(scan).iter().any(|&other| other != scan && self.lacks_discriminators(other)) {
            reasons.insert(Reasons::REFERENCE_INCOMPLETE);
        }
        let scans = self.plan.scans();
        if self.plan.geometry == Geometry::Ring {
            if self.is_coarse(scan) || !(self.rings[scan].is_whole() && self.has_whole_turns(scan)) {
                reasons.insert(Reasons::LOCATION_BLIND);
            }
            if scans.iter().filter(|of| of.tyre == scans[scan].tyre).count() == 1 {
                let has_both = self.set.as_ref().is_some_and(|set| set.has_both_shoulders());
                reasons.insert(if has_both { Reasons::SHOULDER_MISSING } else { Reasons::ONE_SHOULDER });
            }
        }
        if self.has_repeated(scan) {
            reasons.insert(Reasons::REPEATED);
        }
        if compared.is_force_off(scan) {
            reasons.insert(Reasons::FORCE_OFF);
        }
        if self.has_no_velocity(scan) {
            reasons.insert(Reasons::VELOCITY_UNKNOWN);
        }
        reasons.insert(self.calibration_reasons());
        if self.has_unknown_condition(scan, compared) {
            reasons.insert(Reasons::CONDITION_UNKNOWN);
        }
        reasons
    }

    /// Whether the ring of scan number `scan` leaves more between its locations than the reference's or its casing's longest one: there are
    /// fewer than half as many, at all or at the belt edge, or fewer without angles, of which only the other ring shows whether they go
    /// around.
    fn is_coarse(&self, scan: usize) -> bool {
        let located = &self.plan.scans()[scan].locations;
        let lengths = |&scan: &usize| {
            let at_edge: BTreeSet<u32> = self.at_edge(scan).into_iter().map(|(_, id)| id.location).collect();
            [self.plan.scans()[scan].locations.len(), at_edge.len()]
        };
        let others = self.groups.casing(scan).iter().chain(self.groups.reference(scan)).map(lengths);
        let others = others.chain(self.set.as_ref().map(|set| set.ring_lengths()));
        let own = lengths(&scan);
        let [most, most_at_edge] = others.fold(own, |most, other| [most[0].max(other[0]), most[1].max(other[1])]);
        let has_angles = located.iter().all(|(_, angle)| angle.is_some_and(f64::is_finite));
        2 * own[0] < most || 2 * own[1] < most_at_edge || !has_angles && own[0] < most
    }

    /// Whether two taps of the casing of scan number `scan`, one of them of that scan, have the same values, and no fewer than
    /// [`REPEATED_MIN`]. Closing taps do not count: they enter no index.
    fn has_repeated(&self, scan: usize) -> bool {
        let values_of = |row: u32| {
            let values = &self.seen[row as usize].as_ref().filter(|seen| !seen.is_refused)?.values;
            let bits = Discriminator::ALL.map(|which| values.get(which).map(f64::to_bits));
            (bits.iter().flatten().count() >= REPEATED_MIN).then_some(bits)
        };
        let rows = |scan: usize| self.rows_entering(scan).filter_map(values_of);
        let mut there = HashSet::new();
        let others = self.groups.casing(scan).iter().copied().filter(|&other| other != scan);
        there.extend(others.flat_map(rows));
        rows(scan).any(|values| !there.insert(values))
    }

    /// Whether the first reading leaves no gap at the belt edge, where cracks begin, nor at another offset that it goes around: at
    /// every location, or every second, third, ...
    fn has_whole_turns(&self, scan: usize) -> bool {
        let mut by_offset: BTreeMap<Option<u64>, (f64, BTreeSet<u32>)> = BTreeMap::new();
        for (row, id) in self.entering(scan) {
            if self.plan.taps()[row as usize].purpose == Purpose::Scan {
                let offset_mm = id.offset_mm();
                let turn = by_offset.entry(offset_mm.map(f64::to_bits)).or_default();
                turn.0 = edge_distance_mm(offset_mm);
                turn.1.insert(id.location);
            }
        }
        let all = &self.plan.scans()[scan].locations;
        let mut turns: Vec<_> = by_offset.into_values().collect();
        turns.sort_by(|a, b| a.0.total_cmp(&b.0));
        turns.iter().enumerate().all(|(number, (_, tapped))| {
            let there: Vec<_> = all.iter().copied().filter(|(location, _)| tapped.contains(location)).collect();
            // A few taps farther in are a bonus.
            let goes_around = number == 0 || 2 * there.len() > all.len();
            !goes_around || Ring::of(Geometry::Ring, &there, closing_location(&self.plan, scan)).is_whole()
        })
    }

    /// The reasons that follow from the calibration of the channels.
    fn calibration_reasons(&self) -> Reasons {
        let recording = &self.plan.recording;
        let mut reasons = Reasons::default();
        if !recording.calibration.is_certified(&recording.channels) {
            reasons.insert(Reasons::NOT_CALIBRATED);
        }
        if recording.calibration.is_out_of_date(&recording.channels) {
            reasons.insert(Reasons::CALIBRATION_OUT_OF_DATE);
        }
        if self.config.requires_calibration && !reasons.is_empty() {
            reasons.insert(Reasons::CALIBRATION_REQUIRED);
        }
        reasons
    }

    /// Whether taps are planned at an offset and velocity of which the reference has none.
    fn has_unknown_condition(&self, scan: usize, compared: &Compared) -> bool {
        let conditions = &compared.conditions;
        let known: BTreeSet<usize> = match &self.set {
            None => {
                let of_run = self.groups.reference(scan).iter().flat_map(|&scan| self.entering(scan));
                of_run.filter_map(|(_, id)| conditions.number(&id)).collect()
            }
            Some(set) => set.taps().filter_map(|id| conditions.number(&id)).collect(),
        };
        self.entering(scan).any(|(_, id)| conditions.number(&id).is_none_or(|number| !known.contains(&number)))
    }
}
