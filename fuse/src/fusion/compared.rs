//! Compares a casing with its reference.

use std::collections::BTreeMap;
use std::sync::Arc;

use tapline_wire::{Geometry, Plan, Purpose, Values};

use crate::fusion::judge::View;
use crate::fusion::{Cache, Fusion};
use crate::index::{Scores, Setup};
use crate::reference::fitted::FittedReference;
use crate::reference::pattern::Pattern;
use crate::shoulder::conditions::{Conditions, distinct};
use crate::shoulder::velocity::{Normalisation, Struck};
use crate::shoulder::{Shoulder, Turn};
use crate::{Error, FuseConfig, Reference};

/// Which scans are compared with which.
#[derive(Debug, Clone)]
pub(super) struct ScanGroups {
    /// For each scan those of its casing, ascending; it is one of them.
    casings: Vec<Vec<usize>>,
    /// The scan that all are compared with, where the reference is one of the run.
    named: Option<usize>,
    /// Whether each casing is its own reference.
    is_own: bool,
}

impl ScanGroups {
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
    /// As the reference judges them; `None` if nothing can be learned from it for such a scan.
    pub by_reference: Option<Comparison>,
    /// By shoulder, whether its places differ more than those of the reference: on its scales noise looks like damage.
    pub is_scatter_off: Vec<bool>,
    /// As the casing itself judges them, where there is such a shoulder.
    pub by_itself: Option<Comparison>,
}

/// The shoulders of a casing as one reference judges them.
#[derive(Debug)]
pub(super) struct Comparison {
    pub fitted: Arc<FittedReference>,
    /// By shoulder, with all taps.
    pub scores: Vec<Scores>,
    /// The two readings, each alone; `None` where there is no second one.
    pub readings: Option<Readings>,
}

/// The scores of each of two readings alone, by shoulder.
#[derive(Debug)]
pub(super) struct Readings {
    pub first: Vec<Scores>,
    pub second: Vec<Scores>,
}

impl Comparison {
    fn new(fitted: Arc<FittedReference>, shoulders: &[Shoulder]) -> Self {
        let scores = |shoulders: &[Shoulder]| fitted.index.scores(&shoulders.iter().collect::<Vec<_>>());
        let has_second = shoulders.iter().any(|shoulder| shoulder.turns.iter().any(|turn| turn.controls.is_some()));
        // A casing that is its own reference was scored when that was fitted, without second readings.
        let is_scored = fitted.setup.is_own && !has_second;
        let of_all = if is_scored { fitted.own_scores.clone() } else { scores(shoulders) };
        let readings = has_second.then(|| {
            let second: Vec<Shoulder> = shoulders.iter().map(Shoulder::second_reading).collect();
            Readings { first: scores(&first_readings(shoulders)), second: scores(&second) }
        });
        Self { fitted, scores: of_all, readings }
    }
}

fn first_readings(shoulders: &[Shoulder]) -> Vec<Shoulder> {
    shoulders.iter().map(Shoulder::first_reading).collect()
}

impl Fusion {
    /// The casing of scan number `scan` compared with its reference, from what has come so far.
    pub(super) fn compared(&mut self, scan: usize) -> Arc<Compared> {
        let involved = self.groups.involved(scan).into_iter();
        let changes: Vec<(usize, u64)> = involved.map(|scan| (scan, self.progress[scan].changes)).collect();
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
        let scans = self.groups.casing(scan).to_vec();
        let pattern = self.pattern(scan);
        let conditions = pattern.conditions.clone();
        let normalisation = self.normalisation(&conditions, scan);
        let shoulders_of = |scans: &[usize]| -> Vec<Shoulder> {
            scans.iter().map(|&scan| self.shoulder(&conditions, &normalisation, scan)).collect()
        };
        let shoulders = shoulders_of(&scans);
        let setup = |is_own| Setup::new(&self.config, &conditions, is_own, self.plan.geometry == Geometry::Line);
        let offsets = conditions.offsets_inwards();
        let fitted_to = |shoulders: &[Shoulder], is_own| {
            FittedReference::fit(setup(is_own), &offsets, &first_readings(shoulders)).map(Arc::new)
        };
        let fitted = match &self.set {
            Some(set) => set.fitted(&setup(false), &offsets, &pattern, &normalisation),
            None if self.groups.is_own => fitted_to(&shoulders, true),
            None => fitted_to(&shoulders_of(self.groups.reference(scan)), false),
        };
        let by_reference = fitted.map(|fitted| Comparison::new(fitted, &shoulders));
        let holds = |by: &Option<Comparison>, of: &dyn Fn(View<'_>) -> bool| -> Vec<bool> {
            let view = |number| by.as_ref().map(|comparison| View::new(&shoulders[number], number, comparison));
            (0..shoulders.len()).map(|number| view(number).is_some_and(of)).collect()
        };
        let mut is_scatter_off = holds(&by_reference, &|view| view.scatters_more());
        let is_doubtful = holds(&by_reference, &|view| view.is_doubtful(&self.config));
        let is_any = is_scatter_off.contains(&true) || is_doubtful.contains(&true);
        let itself = if is_any { fitted_to(&shoulders, true) } else { None };
        let by_itself = itself.map(|fitted| Comparison::new(fitted, &shoulders));
        // What both comparisons reject is damage, and stays on the scales of the reference, which are those of all other shoulders.
        let [by_one, by_other] =
            [&by_reference, &by_itself].map(|by| holds(by, &|view| view.is_rejected(&self.config, self.plan.geometry)));
        for (number, is_off) in is_scatter_off.iter_mut().enumerate() {
            *is_off |= is_doubtful[number] && !(by_one[number] && by_other[number]);
        }
        Compared { scans, shoulders, conditions, by_reference, is_scatter_off, by_itself }
    }

    /// The taps that scan number `scan` has, under the conditions of its casing and of its reference.
    fn pattern(&self, scan: usize) -> Pattern {
        let planned: Vec<_> = self
            .groups
            .involved(scan)
            .iter()
            .flat_map(|&scan| distinct(self.entering(scan).map(|(_, id)| id)))
            .collect();
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

    /// The velocity's power laws as the reference's taps show them, those of an offset together.
    fn normalisation(&self, conditions: &Conditions, scan: usize) -> Normalisation {
        if !self.config.normalise_velocity {
            return Normalisation::default();
        }
        let of_run =
            self.groups.reference(scan).iter().flat_map(|&scan| self.entering(scan)).filter_map(|(row, id)| {
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
        for (row, id) in self.entering(scan) {
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
