//! The state machine: taps and ends of scans in, in any order; verdicts out.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use tapline_wire::{
    DamageCell, Discriminator, Discriminators, Geometry, Judgement, Plan, Quality, Reasons, RecordKind, Scan, Stamp,
    TapId, Values,
};

use crate::compare::{Cache, Compared};
use crate::condition::{distinct, name_number};
use crate::lacking::Lacking;
use crate::lateral::mark_regions;
use crate::panel::Panel;
use crate::ring::Ring;
use crate::shuffles::KnownShuffles;
use crate::verdict::verdict_of;
use crate::{Error, FuseConfig, Reference, ReferenceSet};

/// What came of one planned tap.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    attempt: u16,
    pub(crate) is_refused: bool,
    pub(crate) velocity_m_per_s: f64,
    pub(crate) values: Values,
}

/// A tap that enters the index of its scan if it comes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entering {
    /// Its row of the plan.
    pub(crate) row: u32,
    /// Which of the scan's locations, counted in their order.
    pub(crate) place: u32,
    /// Which of the scan's [names](Fusion::names) it has.
    pub(crate) name: u32,
}

/// Where one scan stands.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Progress {
    seen_count: usize,
    /// How often what came of it has changed.
    pub(crate) changes: u64,
    is_ended: bool,
    is_judged: bool,
    /// What [`Fusion::lacks_features`] found since the last change.
    lacks_features: Option<Lacking>,
}

/// Collects taps and judges shoulders.
///
/// What it says depends on what it was told, not on the order in which it was told (law 4).
#[derive(Debug, Clone)]
pub struct Fusion {
    pub(crate) config: FuseConfig,
    pub(crate) plan: Plan,
    scan_of_tap: Vec<u32>,
    pub(crate) seen: Vec<Option<Seen>>,
    pub(crate) progress: Vec<Progress>,
    pub(crate) panel: Panel,
    /// For each scan a tap of every offset and velocity that enters its index.
    pub(crate) names: Arc<[Vec<TapId>]>,
    /// For each scan the taps that enter its index, in plan order.
    pub(crate) taps: Arc<[Vec<Entering>]>,
    /// For each scan its locations.
    pub(crate) rings: Arc<[Ring]>,
    /// Shoulders of earlier runs that make the reference.
    pub(crate) set: Option<Arc<ReferenceSet>>,
    pub(crate) cache: Cache,
    shuffles: KnownShuffles,
}

impl Fusion {
    /// A fusion that waits for the taps of `plan`.
    ///
    /// # Errors
    /// What [`FuseConfig::validate`] refuses, [`Error::ReferenceNotNamed`], [`Error::ReferenceNotPlanned`], and
    /// [`Error::ReferenceNotRead`] for a reference in a file: [`Fusion::with_reference`] takes it.
    pub fn new(config: &FuseConfig, plan: &Plan) -> Result<Self, Error> {
        if let Some(Reference::File(path)) = &config.reference {
            return Err(Error::ReferenceNotRead { path: path.clone() });
        }
        Self::build(config, plan, None)
    }

    /// A fusion that compares every casing of `plan` with the shoulders of `set`, by the directions that are stored there
    /// and whatever reference the configuration names.
    ///
    /// # Errors
    /// What [`FuseConfig::validate`] refuses, and [`Error::NothingInCommon`] for a set that has no tap at any offset and
    /// velocity of the plan.
    pub fn with_reference(config: &FuseConfig, plan: &Plan, set: Arc<ReferenceSet>) -> Result<Self, Error> {
        let reference = Some(Reference::File(PathBuf::from(set.digest())));
        let config = FuseConfig { directions: set.directions, reference, ..config.clone() };
        set.check_conditions(plan)?;
        Self::build(&config, plan, Some(set))
    }

    fn build(config: &FuseConfig, plan: &Plan, set: Option<Arc<ReferenceSet>>) -> Result<Self, Error> {
        config.validate()?;
        let names: Arc<[Vec<TapId>]> =
            (0..plan.scans().len()).map(|scan| distinct(entering(plan, scan).map(|(_, id)| id))).collect();
        Ok(Self {
            config: config.clone(),
            scan_of_tap: plan.scan_of_tap(),
            seen: vec![None; plan.taps().len()],
            progress: vec![Progress::default(); plan.scans().len()],
            panel: Panel::of(config, plan)?,
            taps: names.iter().enumerate().map(|(scan, names)| numbered(plan, scan, names)).collect(),
            names,
            rings: plan.scans().iter().map(|scan| ring(plan, scan)).collect(),
            plan: plan.clone(),
            set,
            cache: Cache::default(),
            shuffles: KnownShuffles::default(),
        })
    }

    /// The same taps, to be judged by another configuration of the same reference.
    pub(crate) fn reconfigured(&self, config: FuseConfig) -> Result<Self, Error> {
        let panel = Panel::of(&config, &self.plan)?;
        let mut again = Self { config, panel, cache: Cache::default(), ..self.clone() };
        // Other discriminators may be asked for.
        again.progress.iter_mut().for_each(|progress| progress.lacks_features = None);
        Ok(again)
    }

    /// Takes in one tap's discriminators, or its refusal ([`Quality::REFUSED`]).
    ///
    /// One that is to be taken again ([`Quality::RETAKE`]) is as if it had not come. A later attempt replaces an earlier
    /// one; the same record twice counts once. A record that changes what a verdict was reached from makes its scans
    /// [`ready`](Self::ready) again.
    ///
    /// # Errors
    /// [`Error::NoSuchRow`] or [`Error::OtherTap`] for a record of another plan; nothing has changed then.
    pub fn push(&mut self, record: &Discriminators) -> Result<(), Error> {
        let row = record.plan_index;
        let planned = self.plan.taps().get(row as usize);
        let planned = planned.ok_or(Error::NoSuchRow { got: row, tap_count: self.seen.len() })?;
        if record.id.planned() != planned.id.planned() {
            return Err(Error::OtherTap { row, planned: Box::new(planned.id), got: Box::new(record.id) });
        }
        if record.quality.contains(Quality::RETAKE) {
            return Ok(());
        }
        let is_refused = record.quality.contains(Quality::REFUSED);
        let velocity_m_per_s = record.velocity_measured_m_per_s;
        let new = Seen { attempt: record.id.attempt, is_refused, velocity_m_per_s, values: record.values };
        let scan = self.scan_of_tap[row as usize] as usize;
        let old = &mut self.seen[row as usize];
        self.progress[scan].seen_count += usize::from(old.is_none());
        if old.as_ref().is_none_or(|old| rank(old) < rank(&new)) {
            *old = Some(new);
            self.progress[scan].changes += 1;
            self.progress[scan].lacks_features = None;
            for &dependent in self.panel.dependents(scan) {
                self.progress[dependent].is_judged = false;
            }
        }
        Ok(())
    }

    /// Takes in the end of scan number `scan`.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn end(&mut self, scan: usize) -> Result<(), Error> {
        self.check(scan)?;
        if !self.progress[scan].is_ended {
            self.progress[scan].is_ended = true;
            for &dependent in self.panel.dependents(scan) {
                self.progress[dependent].is_judged = false;
            }
        }
        Ok(())
    }

    /// Plan rows of scan number `scan` of which nothing has come yet, ascending; none for a scan that is not planned.
    pub fn missing(&self, scan: usize) -> Vec<u32> {
        let rows = self.plan.scans().get(scan).map_or(&[][..], |s| &s.taps);
        rows.iter().copied().filter(|&row| self.seen[row as usize].is_none()).collect()
    }

    /// Scans that can be judged, ascending: they and their reference have ended, every tap of them has
    /// come or was refused, and they have not been judged since.
    pub fn ready(&self) -> Vec<usize> {
        (0..self.progress.len()).filter(|&scan| !self.progress[scan].is_judged && self.can_be_judged(scan)).collect()
    }

    /// Whether scan number `scan` and its reference have ended, and every tap of them has come or was refused.
    pub fn can_be_judged(&self, scan: usize) -> bool {
        self.panel.involved(scan).into_iter().all(|involved| self.is_whole(involved))
    }

    /// The verdict on scan number `scan` with its damage map, one cell a location in their order.
    ///
    /// It can be had at any time. Before the scan is [`ready`](Self::ready) it rests on what has come,
    /// and is never PASS: [`Reasons::NOT_ENDED`] and [`Reasons::TAPS_MISSING`] then speak of the scan
    /// or of its reference. The publisher fills in the stamp's sequence and sender.
    ///
    /// A cell's `p_value` is that location's alone; the least of a hundred is not the chance of a false call.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn judge(&mut self, scan: usize) -> Result<(Judgement, Vec<DamageCell>), Error> {
        self.check(scan)?;
        self.progress[scan].is_judged = true;
        let compared = self.compared(scan);
        for involved in self.panel.involved(scan) {
            let lacks = self.progress[involved].lacks_features.unwrap_or_else(|| self.lacks_features(involved));
            self.progress[involved].lacks_features = Some(lacks);
        }
        let planned = &self.plan.scans()[scan];
        let view = compared.view(&planned.locations);
        let regions = view.regions(self.config.extent);
        let mut cells = view.cells(&regions);
        let p_value = mark_regions(&compared, &regions, &mut cells, &mut self.shuffles);
        let mut reasons = view.reasons(&regions);
        reasons.insert(self.reasons_of(scan, &compared));
        let seen = || planned.taps.iter().filter_map(|&row| self.seen[row as usize].as_ref());
        let refused_count = seen().filter(|s| s.is_refused).count();
        let limits = compared.standard.limits;
        let limit = |of: Option<f64>| of.unwrap_or(f64::NAN);
        let judgement = Judgement {
            stamp: Stamp { kind: RecordKind::Data.code(), mark: scan as u64, ..Stamp::default() },
            verdict: verdict_of(reasons).code(),
            reasons,
            limit_re_inspect: limit(limits.map(|l| l.re_inspect)),
            limit_reject: limit(limits.map(|l| l.reject())),
            false_call_rate: self.config.false_call_rate,
            p_value: limit(p_value),
            evidence: compared.evidence(),
            drift: self.drift(scan, &compared),
            planned_count: count(planned.taps.len()),
            received_count: count(seen().count() - refused_count),
            refused_count: count(refused_count),
            absent_count: cells.iter().fold(0, |sum: u32, cell| sum.saturating_add(cell.absent_count)),
        };
        Ok((judgement, cells))
    }

    /// What was asked for and could not be learned from the reference of scan number `scan`, each with why and what stands
    /// in its place, for people to read. Empty unless [`judge`](Self::judge) gives [`Reasons::FELL_BACK`]; with whatever
    /// has come.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn fallbacks(&mut self, scan: usize) -> Result<Vec<String>, Error> {
        self.check(scan)?;
        Ok(self.compared(scan).standard.fit.fallbacks.clone())
    }

    /// [`entering`], of this plan.
    pub(crate) fn entering(&self, scan: usize) -> impl Iterator<Item = (u32, TapId)> {
        entering(&self.plan, scan)
    }

    /// What the state of the scan and of its reference gives reason for.
    fn reasons_of(&self, scan: usize, compared: &Compared) -> Reasons {
        let mut reasons = Reasons::default();
        let all_involved = self.panel.involved(scan);
        for &involved in &all_involved {
            let progress = self.progress[involved];
            if !progress.is_ended {
                reasons.insert(Reasons::NOT_ENDED);
            }
            if progress.seen_count < self.plan.scans()[involved].taps.len() {
                reasons.insert(Reasons::TAPS_MISSING);
            }
        }
        // Only its own: a reference may lack a tap, as its verdict says, but it has no blind spot here.
        let mut seen = self.plan.scans()[scan].taps.iter().filter_map(|&row| self.seen[row as usize].as_ref());
        if seen.any(|s| s.is_refused) {
            reasons.insert(Reasons::TAPS_REFUSED);
        }
        if self.panel.reference(scan).contains(&scan) {
            reasons.insert(Reasons::SELF_REFERENCE);
        }
        // The other shoulder lends its level: values that are stuck would bend it, those that are not there do not.
        let is_spoilt = |&involved: &usize| {
            let is_asked = involved == scan || self.panel.reference(scan).contains(&involved);
            let lacking = self.progress[involved].lacks_features;
            lacking.is_some_and(|lacking| lacking.is_stuck || (is_asked && lacking.is_absent))
        };
        if all_involved.iter().any(is_spoilt) {
            reasons.insert(Reasons::FEATURES_ABSENT);
        }
        if self.plan.geometry == Geometry::Ring && !compared.ring.is_whole() {
            reasons.insert(Reasons::LOCATION_BLIND);
        }
        if self.has_unknown_condition(scan, compared) {
            reasons.insert(Reasons::CONDITION_UNKNOWN);
        }
        if compared.casing.stands_off[compared.number] {
            reasons.insert(Reasons::LEVEL_OFF);
        }
        if !compared.standard.fit.fallbacks.is_empty() {
            reasons.insert(Reasons::FELL_BACK);
        }
        reasons
    }

    /// Whether taps are planned at an offset and velocity of which the reference has none.
    fn has_unknown_condition(&self, scan: usize, compared: &Compared) -> bool {
        let conditions = &compared.conditions;
        let known: BTreeSet<usize> = match &self.set {
            None => {
                let of_run = self.panel.reference(scan).iter().flat_map(|&s| &self.names[s]);
                of_run.filter_map(|id| conditions.number(id)).collect()
            }
            Some(set) => set.taps().filter_map(|id| conditions.number(&id)).collect(),
        };
        self.names[scan].iter().any(|id| conditions.number(id).is_none_or(|number| !known.contains(&number)))
    }

    fn is_whole(&self, scan: usize) -> bool {
        let progress = self.progress[scan];
        progress.is_ended && progress.seen_count == self.plan.scans()[scan].taps.len()
    }

    pub(crate) fn check(&self, scan: usize) -> Result<(), Error> {
        let scan_count = self.progress.len();
        if scan < scan_count { Ok(()) } else { Err(Error::NoSuchScan { got: scan, scan_count }) }
    }
}

/// Plan rows of the taps of scan number `scan` that enter its index if they come, with their names; all but the closing
/// ones.
///
/// A name has the velocity that was meant: a tap that struck out is compared with those beside it, under its flag.
fn entering(plan: &Plan, scan: usize) -> impl Iterator<Item = (u32, TapId)> {
    let meant = |row: u32, id: TapId| id.with_velocity_m_per_s(plan.velocity_nominal_m_per_s(row)).unwrap_or(id);
    let planned = |&row: &u32| (row, &plan.taps()[row as usize]);
    let taps = plan.scans()[scan].taps.iter().map(planned).filter(|(_, tap)| !tap.is_closing);
    taps.map(move |(row, tap)| (row, meant(row, tap.id)))
}

/// The locations of a scan of `plan`.
fn ring(plan: &Plan, scan: &Scan) -> Ring {
    let mut closing = scan.taps.iter().map(|&row| &plan.taps()[row as usize]).filter(|tap| tap.is_closing);
    Ring::of(plan.geometry, &scan.locations, closing.next().map(|tap| tap.id.location))
}

/// The taps of [`entering`], by the numbers of their locations and of their `names`, of which each has one.
fn numbered(plan: &Plan, scan: usize, names: &[TapId]) -> Vec<Entering> {
    let locations = &plan.scans()[scan].locations;
    let number = |(row, id): (u32, TapId)| {
        let place = locations.binary_search_by_key(&id.location, |&(location, _)| location).ok()?;
        let name = name_number(names, &id)?;
        Some(Entering { row, place: u32::try_from(place).ok()?, name: u32::try_from(name).ok()? })
    };
    let mut taps = Vec::with_capacity(plan.scans()[scan].taps.len());
    taps.extend(entering(plan, scan).filter_map(number));
    taps
}

/// Of two records of one tap the one with the higher rank holds. The attempt decides; the rest makes
/// the choice the same in whichever order two different records of one attempt come.
fn rank(seen: &Seen) -> (u16, bool, [Option<u64>; Discriminator::COUNT], u64) {
    (
        seen.attempt,
        !seen.is_refused,
        Discriminator::ALL.map(|d| seen.values.get(d).map(f64::to_bits)),
        seen.velocity_m_per_s.to_bits(),
    )
}

fn count(of: usize) -> u32 {
    u32::try_from(of).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests;
