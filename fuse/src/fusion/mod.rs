//! The state machine: taps and ends of scans in, in any order; verdicts out.
//!
//! `compared` compares a casing with its reference; `judge` says which limits it reaches, from which `crate::verdict` makes PASS,
//! RE-INSPECT or REJECT; `reasons`, `coverage`, `force` and `drift` find what rules out PASS regardless of scores; `ask` requests
//! more taps.

pub(crate) mod ask;
mod compared;
mod coverage;
mod drift;
mod force;
mod judge;
mod reasons;

pub use judge::OffsetMap;
pub(crate) use judge::{count, empty_cells};

use std::path::PathBuf;
use std::sync::Arc;

use tapline_wire::{Discriminator, Discriminators, Plan, Quality, TapId, Values};

use crate::fusion::compared::{Compared, ScanGroups};
use crate::shoulder::conditions::{edge_distance_mm, name_as_planned};
use crate::shoulder::ring::Ring;
use crate::{Error, FuseConfig, Reference, ReferenceSet};

/// The result of one planned tap.
#[derive(Debug, Clone, Copy)]
struct Seen {
    attempt: u16,
    is_refused: bool,
    quality: Quality,
    velocity_m_per_s: f64,
    values: Values,
}

/// The progress of one scan.
#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    seen_count: usize,
    /// How often its data have changed.
    changes: u64,
    is_ended: bool,
}

/// The last casing that was compared, with the changes of each scan that it was computed from.
#[derive(Debug, Clone)]
struct Cache {
    changes: Vec<(usize, u64)>,
    compared: Arc<Compared>,
}

/// Collects taps and judges shoulders.
///
/// Its verdicts depend on the records that it was given, not on the order in which they came (law 4).
#[derive(Debug, Clone)]
pub struct Fusion {
    pub(crate) config: FuseConfig,
    pub(crate) plan: Plan,
    scan_of_tap: Vec<u32>,
    seen: Vec<Option<Seen>>,
    progress: Vec<Progress>,
    groups: ScanGroups,
    /// For each scan its locations.
    rings: Vec<Ring>,
    /// Shoulders of earlier runs that make the reference.
    set: Option<Arc<ReferenceSet>>,
    cache: Option<Cache>,
}

impl Fusion {
    /// A fusion that waits for the taps of `plan`, without shoulders of earlier runs.
    ///
    /// # Errors
    /// As [`Fusion::by`].
    pub fn new(config: &FuseConfig, plan: &Plan) -> Result<Self, Error> {
        Self::by(config, plan, None)
    }

    /// A fusion that waits for the taps of `plan`. Where there is a `set`, it compares every casing with the shoulders of it, by the
    /// directions that are stored there and whatever reference the configuration names.
    ///
    /// # Errors
    /// What [`FuseConfig::validate`] refuses. With a set [`Error::NothingInCommon`] if it has no tap at any offset and velocity
    /// of the plan, and [`Error::OtherLocations`] for rings of another number of locations. Without one
    /// [`Error::ReferenceNotNamed`], [`Error::ReferenceNotPlanned`], and [`Error::ReferenceNotRead`] for a reference in a file.
    pub fn by(config: &FuseConfig, plan: &Plan, set: Option<Arc<ReferenceSet>>) -> Result<Self, Error> {
        let config = match (&set, &config.reference) {
            (Some(set), _) => {
                set.check_conditions(plan)?;
                set.check_locations(plan)?;
                let reference = Some(Reference::File(PathBuf::from(set.digest())));
                FuseConfig { directions: set.directions, reference, ..config.clone() }
            }
            (None, Some(Reference::File(path))) => return Err(Error::ReferenceNotRead { path: path.clone() }),
            (None, _) => config.clone(),
        };
        config.validate()?;
        Ok(Self {
            scan_of_tap: plan.scan_of_tap(),
            seen: vec![None; plan.taps().len()],
            progress: vec![Progress::default(); plan.scans().len()],
            groups: ScanGroups::new(&config, plan)?,
            config,
            rings: (plan.scans().iter().enumerate())
                .map(|(scan, of)| Ring::of(plan.geometry, &of.locations, closing_location(plan, scan)))
                .collect(),
            plan: plan.clone(),
            set,
            cache: None,
        })
    }

    /// Takes in one tap's discriminators, or its refusal ([`Quality::REFUSED`]).
    ///
    /// One that is to be taken again ([`Quality::RETAKE`]) counts as missing. A later attempt replaces an earlier
    /// one; the same record twice counts once.
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
        let quality = record.quality;
        let is_refused = quality.contains(Quality::REFUSED);
        let velocity_m_per_s = record.velocity_measured_m_per_s;
        let new = Seen { attempt: record.id.attempt, is_refused, quality, velocity_m_per_s, values: record.values };
        let scan = self.scan_of_tap[row as usize] as usize;
        let old = &mut self.seen[row as usize];
        self.progress[scan].seen_count += usize::from(old.is_none());
        if old.as_ref().is_none_or(|old| rank(old) < rank(&new)) {
            *old = Some(new);
            self.progress[scan].changes += 1;
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

    /// Whether scan number `scan`, its casing and its reference have ended, and every tap of them has come or was refused. Not of a scan that
    /// there is not.
    pub fn can_be_judged(&self, scan: usize) -> bool {
        self.check(scan).is_ok()
            && self.groups.involved(scan).iter().all(|&involved| {
                let progress = self.progress[involved];
                progress.is_ended && progress.seen_count == self.plan.scans()[involved].taps.len()
            })
    }

    fn check(&self, scan: usize) -> Result<(), Error> {
        let scan_count = self.progress.len();
        if scan < scan_count { Ok(()) } else { Err(Error::NoSuchScan { got: scan, scan_count }) }
    }

    /// Plan rows of the taps of scan number `scan` that enter its index if they come, with their names: all but the closing
    /// ones.
    ///
    /// A name has the planned velocity: a tap that missed it is compared with its neighbours, and keeps its flag.
    fn entering(&self, scan: usize) -> impl Iterator<Item = (u32, TapId)> {
        self.rows_entering(scan).map(|row| (row, name_as_planned(&self.plan, row)))
    }

    /// Those of them that lie nearest to the belt edge.
    fn at_edge(&self, scan: usize) -> Vec<(u32, TapId)> {
        let distance_mm = |tap: &(u32, TapId)| edge_distance_mm(tap.1.offset_mm());
        let mut taps: Vec<_> = self.entering(scan).collect();
        let least_mm = taps.iter().map(distance_mm).min_by(f64::total_cmp).unwrap_or(f64::INFINITY);
        taps.retain(|tap| distance_mm(tap) <= least_mm);
        taps
    }

    /// The rows alone.
    fn rows_entering(&self, scan: usize) -> impl Iterator<Item = u32> {
        let rows = self.plan.scans()[scan].taps.iter().copied();
        rows.filter(|&row| !self.plan.taps()[row as usize].is_closing())
    }
}

/// The location of the closing tap of a scan of `plan`.
fn closing_location(plan: &Plan, scan: usize) -> Option<u32> {
    let mut taps = plan.scans()[scan].taps.iter().map(|&row| &plan.taps()[row as usize]);
    taps.find(|tap| tap.is_closing()).map(|tap| tap.id.location)
}

/// Of two records of one tap the one with the higher rank counts. The attempt decides; by the rest, two different records of one attempt
/// give the same choice in either order.
fn rank(seen: &Seen) -> (u16, bool, [Option<u64>; Discriminator::COUNT], u64, u32) {
    (
        seen.attempt,
        !seen.is_refused,
        Discriminator::ALL.map(|d| seen.values.get(d).map(f64::to_bits)),
        seen.velocity_m_per_s.to_bits(),
        seen.quality.bits(),
    )
}

#[cfg(test)]
mod tests;
