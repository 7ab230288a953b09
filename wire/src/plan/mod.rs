//! The scan plan: every tap that must exist, and what its record will look like.

pub(crate) mod casing;
pub(crate) mod codec;
pub(crate) mod digest;
pub(crate) mod ledger;
pub(crate) mod limits;
mod nominal;
pub(crate) mod parts;

use rustc_hash::{FxBuildHasher, FxHashMap};

use crate::CHANNELS_MAX;
use crate::plan::digest::digest_of;
use crate::plan::nominal::nominal_velocities;
use crate::plan::parts::{PlannedTap, Recording, Scan, Truth};
use crate::record::id::{Geometry, Serial, TapId};

/// Every tap that must exist, in the order in which each station takes its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Shape of what is scanned.
    pub geometry: Geometry,
    /// Shape of the records.
    pub recording: Recording,
    taps: Vec<PlannedTap>,
    scans: Vec<Scan>,
    truth: Truth,
    /// The intended velocity of every tap, NaN if none is given.
    nominal_m_per_s: Nominal,
    source_digest: u64,
    digest: u64,
    /// Taps before any were added.
    begun_count: usize,
    /// The `digest` of those taps.
    begun_digest: u64,
}

/// Velocities by plan row. They follow from the taps, so plans with equal taps are equal even where one is NaN.
#[derive(Debug, Clone)]
struct Nominal(Vec<f64>);

impl PartialEq for Nominal {
    fn eq(&self, other: &Self) -> bool {
        self.0.len() == other.0.len()
    }
}

/// Why a list of taps is not a plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum PlanError {
    /// There are no taps.
    #[error("the scan plan has no taps")]
    Empty,
    /// Two rows name the same tap.
    #[error("plan rows {first} and {second} both name {id}")]
    Duplicate {
        id: TapId,
        /// Row of the first, from 0.
        first: usize,
        /// Row of the second, from 0.
        second: usize,
    },
    /// One shoulder is split over two stations.
    #[error("shoulder {shoulder} of tyre {tyre} is planned at station {first} and at station {second}")]
    TwoStations { tyre: Serial, shoulder: u16, first: u16, second: u16 },
    /// A recording that no tap can have.
    #[error("the recording has {what}; it must have {bound}")]
    Recording { what: String, bound: String },
    /// A tap was taken before it was planned.
    #[error("{id} is planned at attempt {}; a plan has attempt 0", id.attempt)]
    Attempt { id: TapId },
    /// Bytes that are not a plan.
    #[error("these bytes are not a plan: {what}")]
    Encoding { what: &'static str },
    /// A tap added to an open casing is at another station, or belongs to a scan that the casing does not have.
    #[error("{id} cannot be added to the plan: the plan has no such scan")]
    OtherScan { id: TapId },
}

impl Plan {
    /// The plan of `taps`; scans are formed by tyre and shoulder, in order of first appearance.
    ///
    /// # Errors
    /// [`PlanError`] when there are no taps, one is of a later attempt, two share a name, or a shoulder has two stations; also when the
    /// recording has a sample rate that is not above 0, more than [`CHANNELS_MAX`] channels, or one twice.
    pub fn new(
        geometry: Geometry,
        recording: Recording,
        taps: Vec<PlannedTap>,
        truth: Truth,
    ) -> Result<Self, PlanError> {
        Self::from_source(geometry, recording, taps, truth, 0)
    }

    /// The plan of `taps` for a source with this `source_digest`, which differs for equal taps with other recordings or
    /// scales. It becomes a part of [`Plan::digest`].
    ///
    /// # Errors
    /// As [`Plan::new`].
    pub fn from_source(
        geometry: Geometry,
        recording: Recording,
        taps: Vec<PlannedTap>,
        truth: Truth,
        source_digest: u64,
    ) -> Result<Self, PlanError> {
        if taps.is_empty() {
            return Err(PlanError::Empty);
        }
        check_recording(&recording)?;
        if let Some(tap) = taps.iter().find(|tap| tap.id.attempt > 0) {
            return Err(PlanError::Attempt { id: tap.id });
        }
        let mut first_row = FxHashMap::with_capacity_and_hasher(taps.len(), FxBuildHasher);
        for (second, tap) in taps.iter().enumerate() {
            if let Some(first) = first_row.insert(tap.id, second) {
                return Err(PlanError::Duplicate { id: tap.id, first, second });
            }
        }
        let scans = scans_of(&taps)?;
        let digest = digest_of(geometry, &recording, &taps, source_digest);
        let nominal_m_per_s = Nominal(nominal_velocities(&taps));
        let (begun_count, begun_digest) = (taps.len(), digest);
        Ok(Self {
            geometry,
            recording,
            taps,
            scans,
            truth,
            nominal_m_per_s,
            source_digest,
            digest,
            begun_count,
            begun_digest,
        })
    }

    /// This plan with `taps` appended: additional taps for an open casing. Rows and scans keep their numbers.
    ///
    /// # Errors
    /// [`PlanError::OtherScan`] for a tap whose scan the plan lacks, and as [`Plan::new`].
    pub fn grown(&self, taps: &[PlannedTap]) -> Result<Self, PlanError> {
        let is_ours = |tap: &PlannedTap| {
            let id = &tap.id;
            self.scans.iter().any(|s| (s.station, s.tyre, s.shoulder) == (id.station, id.tyre, id.shoulder))
        };
        if let Some(other) = taps.iter().find(|tap| !is_ours(tap)) {
            return Err(PlanError::OtherScan { id: other.id });
        }
        let taps = [&self.taps, taps].concat();
        let grown =
            Self::from_source(self.geometry, self.recording.clone(), taps, self.truth.clone(), self.source_digest)?;
        Ok(Self { begun_count: self.begun_count, begun_digest: self.begun_digest, ..grown })
    }

    /// The plan before any taps were added to it.
    pub fn begun(&self) -> Self {
        let taps = self.taps[..self.begun_count].to_vec();
        let begun =
            Self::from_source(self.geometry, self.recording.clone(), taps, self.truth.clone(), self.source_digest);
        begun.unwrap_or_else(|_error| self.clone()) // a plan's first taps are a plan
    }

    /// The taps that were added to it.
    pub fn added(&self) -> &[PlannedTap] {
        &self.taps[self.begun_count..]
    }

    /// The [digest](Plan::digest) before any taps were added: it identifies the casing's scan as long as that lasts.
    pub fn begun_digest(&self) -> u64 {
        self.begun_digest
    }

    /// Digest that distinguishes the plan's source from others with the same taps; 0 if there is none.
    pub fn source_digest(&self) -> u64 {
        self.source_digest
    }

    /// The planned taps; a tap's place here is its plan index.
    pub fn taps(&self) -> &[PlannedTap] {
        &self.taps
    }

    /// Intended velocity of the tap in plan row `row`, in m/s; `None` if the plan gives none.
    ///
    /// It is the planned one, unless half a turn or more of the same ring was struck at another: then the list of taps
    /// states how fast this tap was, not how fast it should have been.
    pub fn velocity_nominal_m_per_s(&self, row: u32) -> Option<f64> {
        self.nominal_m_per_s.0.get(row as usize).copied().filter(|v| v.is_finite())
    }

    /// The scans, in order of their first tap.
    pub fn scans(&self) -> &[Scan] {
        &self.scans
    }

    /// The known crack locations, for scoring; empty if nothing is known.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// A number that differs between plans: stages and archives with different digests refuse each other.
    pub fn digest(&self) -> u64 {
        self.digest
    }

    /// The stations, ascending.
    pub fn stations(&self) -> Vec<u16> {
        let mut stations: Vec<u16> = self.scans.iter().map(|s| s.station).collect();
        stations.sort_unstable();
        stations.dedup();
        stations
    }

    /// For every plan row, the number of its scan.
    pub fn scan_of_tap(&self) -> Vec<u32> {
        let mut scan_of_tap = vec![0; self.taps.len()];
        for (number, scan) in (0..).zip(&self.scans) {
            for &row in &scan.taps {
                scan_of_tap[row as usize] = number;
            }
        }
        scan_of_tap
    }
}

/// The scans of `taps`, in order of their first tap.
///
/// # Errors
/// [`PlanError::TwoStations`].
pub fn scans_of(taps: &[PlannedTap]) -> Result<Vec<Scan>, PlanError> {
    let mut scans: Vec<Scan> = Vec::new();
    let mut number_of: FxHashMap<(Serial, u16), usize> = FxHashMap::default();
    for (row, tap) in (0..).zip(taps) {
        let TapId { station, tyre, shoulder, .. } = tap.id;
        let number = *number_of.entry((tyre, shoulder)).or_insert_with(|| {
            scans.push(Scan { station, tyre, shoulder, taps: Vec::new(), locations: Vec::new() });
            scans.len() - 1
        });
        let scan = &mut scans[number];
        if scan.station != station {
            return Err(PlanError::TwoStations { tyre, shoulder, first: scan.station, second: station });
        }
        scan.taps.push(row);
        if !tap.is_closing() {
            scan.locations.push((tap.id.location, tap.angle_deg));
        }
    }
    for scan in &mut scans {
        scan.locations.sort_by_key(|&(location, _)| location);
        scan.locations.dedup_by_key(|&mut (location, _)| location);
    }
    Ok(scans)
}

/// Checks that a tap can be recorded so.
fn check_recording(recording: &Recording) -> Result<(), PlanError> {
    let refuse = |what: String, bound: String| Err(PlanError::Recording { what, bound });
    let Recording { sample_rate_hz: rate, channels, .. } = recording;
    if !(rate.is_finite() && *rate > 0.0) {
        return refuse(format!("a sample rate of {rate} Hz"), "one above 0".to_owned());
    }
    let count = channels.len();
    if count > CHANNELS_MAX || (1..count).any(|k| channels[..k].contains(&channels[k])) {
        return refuse(format!("the channels {channels:?}"), format!("at most {CHANNELS_MAX}, each once"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::parts::recording;
    use crate::{Channel, Purpose};

    fn tap(station: u16, tyre: &str, shoulder: u16, location: u32) -> PlannedTap {
        let id = TapId::new(station, Serial::new(tyre).unwrap(), shoulder, location);
        PlannedTap { id, angle_deg: Some(f64::from(location) * 3.6), purpose: Purpose::closing_if(location == 100) }
    }

    fn plan(taps: Vec<PlannedTap>) -> Result<Plan, PlanError> {
        Plan::new(Geometry::Ring, recording(), taps, Truth::new())
    }

    #[test]
    fn scans_are_formed_by_tyre_and_shoulder() {
        let plan = plan(vec![tap(2, "B", 1, 5), tap(1, "A", 2, 0), tap(2, "B", 1, 3), tap(2, "B", 1, 100)]).unwrap();
        assert_eq!(plan.scans().len(), 2);
        assert_eq!(plan.scans()[0].taps, [0, 2, 3]);
        assert_eq!(plan.scans()[0].locations.iter().map(|l| l.0).collect::<Vec<_>>(), [3, 5], "sorted, no closing tap");
        assert_eq!(plan.scan_of_tap(), [0, 1, 0, 0]);
        assert_eq!(plan.stations(), [1, 2]);
    }

    #[test]
    fn what_is_no_plan_is_refused() {
        assert_eq!(plan(vec![]), Err(PlanError::Empty));
        let error = plan(vec![tap(1, "A", 1, 0), tap(1, "A", 1, 1), tap(1, "A", 1, 0)]).unwrap_err();
        assert!(matches!(error, PlanError::Duplicate { first: 0, second: 2, .. }), "{error}");
        let error = plan(vec![tap(1, "A", 1, 0), tap(2, "A", 1, 1)]).unwrap_err();
        assert!(matches!(error, PlanError::TwoStations { first: 1, second: 2, .. }), "{error}");
        let mut later = tap(1, "A", 1, 0);
        later.id.attempt = 2;
        assert_eq!(plan(vec![later]), Err(PlanError::Attempt { id: later.id }));
        let recorded = |change: &dyn Fn(&mut Recording)| {
            let mut recording = recording();
            change(&mut recording);
            Plan::new(Geometry::Ring, recording, vec![tap(1, "A", 1, 0)], Truth::new()).unwrap_err().to_string()
        };
        for rate in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
            let said = recorded(&|recording| recording.sample_rate_hz = rate);
            assert_eq!(said, format!("the recording has a sample rate of {rate} Hz; it must have one above 0"));
        }
        for channels in [vec![Channel::Sound; 9], vec![Channel::Force, Channel::Force]] {
            let said = recorded(&|recording| recording.channels.clone_from(&channels));
            assert!(said.ends_with("it must have at most 4, each once"), "{said}");
        }
    }

    /// Catches a source that passes for another: `digest` has a test of all else in which plans differ.
    #[test]
    fn another_source_has_another_digest() {
        let plan = plan(vec![tap(1, "A", 1, 0)]).unwrap();
        let (recording, taps) = (plan.recording.clone(), plan.taps().to_vec());
        let other = Plan::from_source(plan.geometry, recording, taps, Truth::new(), 1).unwrap();
        assert_ne!(other.digest(), plan.digest());
    }
}
