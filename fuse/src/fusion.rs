//! The state machine: taps and ends of scans in, in any order; verdicts out.

use std::collections::BTreeMap;

use tapline_wire::{
    DamageCell, Discriminator, Discriminators, Judgement, Plan, Quality, Reasons, RecordKind, Serial, Stamp, TapId,
    Values,
};

use crate::condition::Conditions;
use crate::index::Shoulder;
use crate::map::{Comparison, IndexMap};
use crate::reference::Reading;
use crate::ring::Ring;
use crate::velocity::Normalisation;
use crate::verdict::{cells_of, verdict_of};
use crate::{Error, FuseConfig, IndexKind, Reference};

/// What came of one planned tap.
#[derive(Debug, Clone, Copy)]
struct Seen {
    attempt: u16,
    is_refused: bool,
    velocity_m_per_s: f64,
    values: Values,
}

/// Where one scan stands.
#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    seen_count: usize,
    is_ended: bool,
    is_judged: bool,
}

/// Collects taps and judges shoulders.
///
/// What it says depends on what it was told, not on the order in which it was told (law 4).
#[derive(Debug, Clone)]
pub struct Fusion {
    config: FuseConfig,
    plan: Plan,
    scan_of_tap: Vec<u32>,
    seen: Vec<Option<Seen>>,
    progress: Vec<Progress>,
    /// For each scan the scans that make its reference, ascending.
    references: Vec<Vec<usize>>,
    /// For each scan the scans whose verdict rests on it, itself first.
    dependents: Vec<Vec<usize>>,
}

impl Fusion {
    /// A fusion that waits for the taps of `plan`.
    ///
    /// # Errors
    /// What [`FuseConfig::validate`] refuses, and [`Error::ReferenceNotPlanned`].
    pub fn new(config: &FuseConfig, plan: &Plan) -> Result<Self, Error> {
        config.validate()?;
        let references = references_of(&config.reference, plan)?;
        Ok(Self {
            config: config.clone(),
            scan_of_tap: plan.scan_of_tap(),
            seen: vec![None; plan.taps().len()],
            progress: vec![Progress::default(); plan.scans().len()],
            dependents: dependents_of(&references),
            references,
            plan: plan.clone(),
        })
    }

    /// Takes in one tap's discriminators, or its refusal ([`Quality::REFUSED`]).
    ///
    /// One that is to be taken again ([`Quality::RETAKE`]) is as if it had not come. A later attempt replaces an earlier one; the same record twice counts once. A record that
    /// changes what a verdict was reached from makes its scans [`ready`](Self::ready) again.
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
            for &dependent in &self.dependents[scan] {
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
        self.progress[scan].is_ended = true;
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
        let is_ready = |&scan: &usize| !self.progress[scan].is_judged && self.involved(scan).all(|s| self.is_whole(s));
        (0..self.progress.len()).filter(is_ready).collect()
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
        let planned = &self.plan.scans()[scan];
        let (judged, map) = self.compare(&self.config, scan);
        let (cells, mut reasons) = cells_of(&judged.ring, &planned.locations, &map);
        reasons.insert(self.reasons_of(scan));
        let seen = planned.taps.iter().filter_map(|&row| self.seen[row as usize]);
        let (refused, received): (Vec<Seen>, Vec<Seen>) = seen.partition(|s| s.is_refused);
        let limit = |of: Option<f64>| of.unwrap_or(f64::NAN);
        let judgement = Judgement {
            stamp: Stamp {
                plan_digest: self.plan.digest(),
                kind: RecordKind::Data.code(),
                mark: scan as u64,
                ..Stamp::default()
            },
            verdict: verdict_of(reasons).code(),
            reasons,
            limit_re_inspect: limit(map.limits.map(|l| l.re_inspect)),
            limit_reject: limit(map.limits.map(|l| l.reject)),
            planned_count: count(planned.taps.len()),
            received_count: count(received.len()),
            refused_count: count(refused.len()),
            absent_count: cells.iter().fold(0, |sum: u32, cell| sum.saturating_add(cell.absent_count)),
        };
        Ok((judgement, cells))
    }

    /// The shoulder of scan number `scan` and its index map by `config`, with whatever has come so far.
    pub(crate) fn compare(&self, config: &FuseConfig, scan: usize) -> (Shoulder, IndexMap) {
        let reference = &self.references[scan];
        let conditions = Conditions::of(self.involved(scan).flat_map(|s| self.entering(s)).map(|(_, id)| id));
        let normalisation = self.normalisation(config, &conditions, reference);
        let shoulder = |&scan: &usize| self.shoulder(config.index, &conditions, &normalisation, scan);
        let judged = shoulder(&scan);
        let comparison = Comparison {
            reference: &reference.iter().map(shoulder).collect::<Vec<_>>(),
            judged: &judged,
            is_own: reference.contains(&scan),
            condition_count: conditions.count(),
        };
        let map = comparison.map(config);
        (judged, map)
    }

    /// Plan rows of a scan's taps that enter its index if they come, with their names; all but the closing ones.
    ///
    /// A name has the velocity that was meant: a tap that struck out is compared with those beside it, under its flag.
    fn entering(&self, scan: usize) -> impl Iterator<Item = (u32, TapId)> {
        let meant =
            |row: u32, id: TapId| id.with_velocity_m_per_s(self.plan.velocity_nominal_m_per_s(row)).unwrap_or(id);
        let planned = |&row: &u32| (row, &self.plan.taps()[row as usize]);
        self.plan.scans()[scan]
            .taps
            .iter()
            .map(planned)
            .filter(|(_, tap)| !tap.is_closing)
            .map(move |(row, tap)| (row, meant(row, tap.id)))
    }

    /// What the reference's taps tell of the velocity, those of an offset together.
    fn normalisation(&self, config: &FuseConfig, conditions: &Conditions, reference: &[usize]) -> Normalisation {
        if !config.normalise_velocity {
            return Normalisation::default();
        }
        let taps = reference.iter().flat_map(|&scan| self.entering(scan)).filter_map(|(row, id)| {
            let seen = self.seen[row as usize].as_ref().filter(|seen| !seen.is_refused)?;
            Some((conditions.offset_number(&id)?, seen.velocity_m_per_s, &seen.values))
        });
        Normalisation::fitted(&taps.collect::<Vec<_>>())
    }

    fn shoulder(
        &self,
        index: IndexKind,
        conditions: &Conditions,
        normalisation: &Normalisation,
        scan: usize,
    ) -> Shoulder {
        let planned = &self.plan.scans()[scan];
        let mut closing = planned.taps.iter().map(|&row| &self.plan.taps()[row as usize]).filter(|tap| tap.is_closing);
        let ring = Ring::of(self.plan.geometry, &planned.locations, closing.next().map(|tap| tap.id.location));
        let reading = |(row, id): (u32, TapId)| {
            let seen = self.seen[row as usize].filter(|seen| !seen.is_refused)?;
            let place = planned.locations.binary_search_by_key(&id.location, |&(location, _)| location).ok()?;
            let values = normalisation.applied(seen.values, id.velocity_m_per_s(), seen.velocity_m_per_s);
            Some(Reading { place, condition: conditions.number(&id)?, values })
        };
        let taps = self.entering(scan).filter_map(reading).collect();
        Shoulder::new(index, conditions.count(), ring, taps)
    }

    /// What the state of the scan and of its reference gives reason for.
    fn reasons_of(&self, scan: usize) -> Reasons {
        let mut reasons = Reasons::default();
        for involved in self.involved(scan) {
            let progress = self.progress[involved];
            if !progress.is_ended {
                reasons.insert(Reasons::NOT_ENDED);
            }
            if progress.seen_count < self.plan.scans()[involved].taps.len() {
                reasons.insert(Reasons::TAPS_MISSING);
            }
        }
        // Only its own: a reference may lack a tap, as its verdict says, but it has no blind spot here.
        let mut seen = self.plan.scans()[scan].taps.iter().filter_map(|&row| self.seen[row as usize]);
        if seen.any(|s| s.is_refused) {
            reasons.insert(Reasons::TAPS_REFUSED);
        }
        if self.references[scan].contains(&scan) {
            reasons.insert(Reasons::SELF_REFERENCE);
        }
        if self.involved(scan).any(|involved| self.lacks_features(involved)) {
            reasons.insert(Reasons::FEATURES_ABSENT);
        }
        reasons
    }

    /// Whether a discriminator that the index asks for is absent from more than half of the planned taps of a scan,
    /// refused ones included, although its channels are recorded: a sensor that is dead, or taps that never came.
    fn lacks_features(&self, scan: usize) -> bool {
        let channels = &self.plan.recording.channels;
        let rows: Vec<u32> = self.entering(scan).map(|(row, _)| row).collect();
        let has = |row: &&u32, which| self.seen[**row as usize].is_some_and(|seen| seen.values.get(which).is_some());
        let recorded = |which: &&Discriminator| which.channels().iter().all(|channel| channels.contains(channel));
        let asked = self.config.discriminators.iter().filter(recorded);
        asked.copied().any(|which| 2 * rows.iter().filter(|row| has(row, which)).count() < rows.len())
    }

    /// The scan and those of its reference, the scan perhaps twice.
    fn involved(&self, scan: usize) -> impl Iterator<Item = usize> {
        self.references[scan].iter().copied().chain([scan])
    }

    fn is_whole(&self, scan: usize) -> bool {
        let progress = self.progress[scan];
        progress.is_ended && progress.seen_count == self.plan.scans()[scan].taps.len()
    }

    fn check(&self, scan: usize) -> Result<(), Error> {
        let scan_count = self.progress.len();
        if scan < scan_count { Ok(()) } else { Err(Error::NoSuchScan { got: scan, scan_count }) }
    }
}

/// Of two records of one tap the one with the higher rank holds. The attempt decides; the rest makes
/// the choice the same in whichever order two different records of one attempt come.
fn rank(seen: &Seen) -> (u16, bool, [Option<u64>; 7]) {
    (seen.attempt, !seen.is_refused, Discriminator::ALL.map(|d| seen.values.get(d).map(f64::to_bits)))
}

/// For each scan the scans that make its reference.
fn references_of(reference: &Reference, plan: &Plan) -> Result<Vec<Vec<usize>>, Error> {
    let scans = plan.scans();
    match *reference {
        Reference::Own => {
            let mut of_tyre: BTreeMap<Serial, Vec<usize>> = BTreeMap::new();
            for (number, scan) in scans.iter().enumerate() {
                of_tyre.entry(scan.tyre).or_default().push(number);
            }
            Ok(scans.iter().map(|scan| of_tyre.get(&scan.tyre).cloned().unwrap_or_default()).collect())
        }
        Reference::Shoulder { tyre, shoulder } => {
            let named = scans.iter().position(|s| s.tyre == tyre && s.shoulder == shoulder);
            let named = named.ok_or(Error::ReferenceNotPlanned { tyre, shoulder, scan_count: scans.len() })?;
            Ok(vec![vec![named]; scans.len()])
        }
    }
}

/// For each scan the scans whose verdict rests on it.
fn dependents_of(references: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut dependents: Vec<Vec<usize>> = (0..references.len()).map(|scan| vec![scan]).collect();
    for (number, reference) in references.iter().enumerate() {
        for &scan in reference.iter().filter(|&&scan| scan != number) {
            dependents[scan].push(number);
        }
    }
    dependents
}

fn count(of: usize) -> u32 {
    u32::try_from(of).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests;
