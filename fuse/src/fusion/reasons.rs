//! What speaks against PASS before any score is looked at: what is missing, refused, unknown or not calibrated.

use std::collections::BTreeSet;
use std::sync::Arc;

use tapline_wire::{Geometry, Quality, Reasons};

use crate::fusion::Fusion;
use crate::fusion::compared::Compared;

impl Fusion {
    /// What the state of the scan and of its reference gives reason for.
    pub(super) fn reasons_of(&self, scan: usize, compared: &Arc<Compared>) -> Reasons {
        let mut reasons = Reasons::default();
        for involved in self.who.involved(scan) {
            let progress = self.progress[involved];
            if !progress.is_ended {
                reasons.insert(Reasons::NOT_ENDED);
            }
            if progress.seen_count < self.plan.scans()[involved].taps.len() {
                reasons.insert(Reasons::TAPS_MISSING);
            }
        }
        // Only its own: a reference may lack a tap, as its verdict says, but it has no blind spot here.
        let seen = || self.plan.scans()[scan].taps.iter().filter_map(|&row| self.seen[row as usize].as_ref());
        if seen().any(|seen| seen.is_refused) {
            reasons.insert(Reasons::TAPS_REFUSED);
        }
        // What is wrong with all of a shoulder stands out nowhere in it.
        if !Quality::on_most(seen().map(|seen| seen.quality)).is_empty() {
            reasons.insert(Reasons::FLAGGED);
        }
        if self.who.reference(scan).contains(&scan) {
            reasons.insert(Reasons::SELF_REFERENCE);
        }
        if self.lacks_features(scan) {
            reasons.insert(Reasons::FEATURES_ABSENT);
        }
        // What another shoulder lacks is its own affair, unless this one is compared with it.
        if self.who.reference(scan).iter().any(|&other| other != scan && self.lacks_features(other)) {
            reasons.insert(Reasons::REFERENCE_LACKS_FEATURES);
        }
        if self.plan.geometry == Geometry::Ring && !self.rings[scan].is_whole() {
            reasons.insert(Reasons::LOCATION_BLIND);
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

    /// What the calibration of the channels gives reason for.
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
                let of_run = self.who.reference(scan).iter().flat_map(|&scan| self.entering(scan));
                of_run.filter_map(|(_, id)| conditions.number(&id)).collect()
            }
            Some(set) => set.taps().filter_map(|id| conditions.number(&id)).collect(),
        };
        self.entering(scan).any(|(_, id)| conditions.number(&id).is_none_or(|number| !known.contains(&number)))
    }
}
