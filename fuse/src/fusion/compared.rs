//! Compares a casing with its reference.

use std::collections::BTreeMap;
use std::sync::Arc;

use tapline_wire::{Geometry, Plan, Purpose, Values};

use crate::fusion::judge::View;
use crate::fusion::{Cache, Fusion, entering};
use crate::index::{Scores, Setup};
use crate::reference::fitted::FittedReference;
use crate::reference::pattern::Pattern;
use crate::shoulder::conditions::{Conditions, distinct};
use crate::shoulder::velocity::{Normalisation, Struck};
use crate::shoulder::{Shoulder, Turn};
use crate::{Error, FuseConfig, Reference};

/// Of each scan, the scans of its casing and those of its reference in the same run.
#[derive(Debug, Clone)]
pub(super) struct Who {
    /// Scans of the same casing, ascending; the scan is among them.
    casings: Vec<Vec<usize>>,
    /// The scan that all are compared with, where the reference is one of the run.
    named: Option<usize>,
    /// Whether each casing is its own reference.
    pub(super) is_own: bool,
}

impl Who {
    pub(super) fn new(config: &FuseConfig, plan: &Plan) -> Result<Self, Error> {
        let scans = plan.scans();
        let of_casing = |tyre| (0..scans.len()).filter(|&other| scans[other].tyre == tyre).collect();
        let named = match config.reference.as_ref().ok_or(Error::ReferenceNotNamed)? {
            Reference::Own | Reference::File(_) => None,
            &Reference::Shoulder { tyre, shoulder } => {
                let found = scans.iter().position(|scan| scan.tyre == tyre && scan.shoulder == shoulder);
                Some(found.ok_or(Error::ReferenceNotPlanned { tyre, shoulder, scan_count: scans.len() })?)
            }
        };
        let is_own = config.reference == Some(Reference::Own);
        Ok(Self { casings: scans.iter().map(|scan| of_casing(scan.tyre)).collect(), named, is_own })
    }

    /// The scans of the casing of `scan`, ascending.
    pub(super) fn casing(&self, scan: usize) -> &[usize] {
        &self.casings[scan]
    }

    /// The scans of this run that `scan` is compared with.
    pub(super) fn reference(&self, scan: usize) -> &[usize] {
        if self.is_own { &self.casings[scan] } else { self.named.as_slice() }
    }

    /// All scans that the verdict on `scan` rests on, ascending.
    pub(super) fn involved(&self, scan: usize) -> Vec<usize> {
        let mut involved = [self.casing(scan), self.named.as_slice()].concat();
        involved.sort_unstable();
        involved.dedup();
        involved
    }
}

/// The shoulders of a casing next to their reference.
#[derive(Debug)]
pub(super) struct Compared {
    /// Their scans.
    pub scans: Vec<usize>,
    pub shoulders: Vec<Shoulder>,
    pub conditions: Conditions,
    /// `None` if nothing can be learned from the reference for such a scan.
    pub found: Option<Found>,
    /// By shoulder, whether its places differ more than those of the reference: on its scales noise looks like damage.
    pub is_scatter_off: Vec<bool>,
    /// What the casing says of itself, where there is such a shoulder.
    pub own: Option<Found>,
}

/// A casing as judged by a reference.
#[derive(Debug)]
pub(super) struct Found {
    pub fitted: Arc<FittedReference>,
    /// By shoulder, with all taps.
    pub scores: Vec<Scores>,
    /// The two readings, each alone; `None` where there is no second one.
    pub readings: Option<Readings>,
}

/// What each of two readings says alone, by shoulder.
#[derive(Debug)]
pub(super) struct Readings {
    pub first: Vec<Scores>,
    pub second: Vec<Scores>,
}

impl Fusion {
    /// The casing of scan number `scan` compared with its reference, from what has come so far.
    pub(super) fn compared(&mut self, scan: usize) -> Arc<Compared> {
        let changes: Vec<(usize, u64)> =
            self.who.involved(scan).into_iter().map(|involved| (involved, self.progress[involved].changes)).collect();
        if let Some(cache) = &self.cache
            && cache.changes == changes
        {
            return Arc::clone(&cache.compared);
        }
        let compared = Arc::new(self.compare(scan));
        self.cache = Some(Cache { changes, compared: Arc::clone(&compared) });
        compared
    }

    fn compare(&self, scan: usize) -> Compared {
        let scans = self.who.casing(scan).to_vec();
        let pattern = self.pattern(scan);
        let conditions = pattern.conditions.clone();
        let normalisation = self.normalisation(&conditions, scan);
        let all = |&scan: &usize| self.shoulder(&conditions, &normalisation, scan);
        let first = |&scan: &usize| all(&scan).without_second_readings();
        let shoulders: Vec<Shoulder> = scans.iter().map(all).collect();
        let setup = |is_own| setup(&self.config, &conditions, is_own, self.plan.geometry == Geometry::Line);
        let offsets = conditions.offsets_inwards();
        let fitted_to_itself = || {
            let firsts: Vec<Shoulder> = scans.iter().map(first).collect();
            FittedReference::fit(setup(true), &offsets, &firsts).map(Arc::new)
        };
        let fitted = match &self.set {
            Some(set) => set.fitted(&setup(false), &offsets, &pattern, &normalisation),
            None if self.who.is_own => fitted_to_itself(),
            None => {
                let named: Vec<Shoulder> = self.who.reference(scan).iter().map(first).collect();
                FittedReference::fit(setup(false), &offsets, &named).map(Arc::new)
            }
        };
        let found = |fitted: Arc<FittedReference>| {
            let casing: Vec<&Shoulder> = shoulders.iter().collect();
            let has_second = casing.iter().any(|shoulder| shoulder.turns.iter().any(|turn| turn.controls.is_some()));
            // A casing that is its own reference was scored when that was fitted, without second readings.
            let is_scored = fitted.setup.is_own && !has_second;
            let scores = if is_scored { fitted.own_scores.clone() } else { fitted.index.scores(&casing) };
            let readings = has_second.then(|| {
                let alone = |which: &dyn Fn(&usize) -> Shoulder| {
                    let shoulders: Vec<Shoulder> = scans.iter().map(which).collect();
                    fitted.index.scores(&shoulders.iter().collect::<Vec<_>>())
                };
                Readings { first: alone(&first), second: alone(&|scan| all(scan).of_second_readings()) }
            });
            Found { fitted, scores, readings }
        };
        let by_reference = fitted.map(&found);
        let scatters_more = (0..shoulders.len()).map(|number| {
            let view = by_reference.as_ref().map(|by_reference| View::new(&shoulders[number], number, by_reference));
            view.is_some_and(|view| view.scatters_more(self.config.re_inspect_rate))
        });
        let is_scatter_off: Vec<bool> = scatters_more.collect();
        let own = if is_scatter_off.contains(&true) { fitted_to_itself().map(&found) } else { None };
        Compared { scans, shoulders, conditions, found: by_reference, is_scatter_off, own }
    }

    /// The taps that scan number `scan` has, under the conditions of its casing and of its reference.
    fn pattern(&self, scan: usize) -> Pattern {
        let planned: Vec<_> =
            self.who.involved(scan).iter().flat_map(|&scan| distinct(self.entering(scan).map(|(_, id)| id))).collect();
        let conditions = Conditions::of(planned.into_iter().chain(self.set.iter().flat_map(|set| set.taps())));
        let mut by_repetition: BTreeMap<(usize, u16), Vec<u32>> = BTreeMap::new();
        let first_readings =
            self.entering(scan).filter(|(row, _)| !self.plan.taps()[*row as usize].is_second_reading());
        for (_, id) in first_readings {
            if let Some(condition) = conditions.number(&id) {
                by_repetition.entry((condition, id.repetition)).or_default().push(id.location);
            }
        }
        let mut turns = BTreeMap::new();
        for ((condition, _), mut locations) in by_repetition {
            locations.sort_unstable();
            let rank = turns.range((condition, 0)..=(condition, usize::MAX)).count();
            turns.insert((condition, rank), locations);
        }
        Pattern { conditions, turns }
    }

    /// What the reference's taps tell of the velocity, those of an offset together.
    fn normalisation(&self, conditions: &Conditions, scan: usize) -> Normalisation {
        if !self.config.normalise_velocity {
            return Normalisation::default();
        }
        let of_run = self.who.reference(scan).iter().flat_map(|&scan| self.entering(scan)).filter_map(|(row, id)| {
            let seen = self.seen[row as usize].as_ref().filter(|seen| !seen.is_refused)?;
            Some((conditions.offset_number(&id)?, seen.velocity_m_per_s, seen.values))
        });
        let of_set = self.set.iter().flat_map(|set| set.struck(conditions));
        let taps: Vec<Struck> = of_run.chain(of_set).collect();
        Normalisation::fitted(&taps)
    }

    fn shoulder(&self, conditions: &Conditions, normalisation: &Normalisation, scan: usize) -> Shoulder {
        let planned = &self.plan.scans()[scan];
        let place_count = planned.locations.len();
        let mut turns: BTreeMap<(usize, u16), Vec<Values>> = BTreeMap::new();
        // Second readings are repetitions of their own.
        let mut controls: BTreeMap<(usize, u16), Vec<bool>> = BTreeMap::new();
        for (row, id) in entering(&self.plan, scan) {
            let place = planned.locations.binary_search_by_key(&id.location, |&(location, _)| location);
            let seen = self.seen[row as usize].as_ref().filter(|seen| !seen.is_refused);
            let (Some(condition), Ok(place), Some(seen)) = (conditions.number(&id), place, seen) else { continue };
            let values = normalisation.applied(seen.values, id.velocity_m_per_s(), seen.velocity_m_per_s);
            let turn = turns.entry((condition, id.repetition)).or_insert_with(|| vec![Values::default(); place_count]);
            turn[place] = values;
            let planned = &self.plan.taps()[row as usize];
            if planned.is_second_reading() {
                let controls = controls.entry((condition, id.repetition)).or_insert_with(|| vec![false; place_count]);
                controls[place] = planned.purpose == Purpose::Control;
            }
        }
        let turn = |(key, values): ((usize, u16), Vec<Values>)| match controls.remove(&key) {
            Some(controls) => Turn::second_reading(key.0, values, controls),
            None => Turn::new(key.0, values),
        };
        Shoulder {
            ring: self.rings[scan].clone(),
            casing: 0,
            turns: turns.into_iter().map(turn).collect(),
            is_cracked: vec![None; place_count],
        }
    }
}

/// What an index is to be fitted for.
pub(crate) fn setup(config: &FuseConfig, conditions: &Conditions, is_own: bool, is_line: bool) -> Setup {
    Setup {
        kind: config.index,
        discriminators: config.directed(),
        offset_of: (0..conditions.count()).map(|condition| conditions.offset_of(condition)).collect(),
        offset_count: conditions.offsets_mm().len(),
        is_own,
        has_common_level: is_own && is_line,
    }
}
