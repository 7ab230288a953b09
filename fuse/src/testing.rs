//! Casings made up for tests: Gaussian scatter of taps and locations, smooth change along the ring, cracks.

use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tapline_wire::{
    Discriminator, Discriminators, Geometry, Plan, PlannedTap, Purpose, Recording, SampleFormat, Serial, TapId, Truth,
    Values,
};

use crate::{Built, FuseConfig, Fusion, KnownShoulder, Reference, ReferenceSet, Score, ScorePool, build_reference};

/// A casing, its scan and its scatter; standard deviations are in percent of a level.
#[derive(Debug, Clone)]
pub(crate) struct Casing {
    pub shoulder_count: u16,
    pub location_count: u32,
    pub offsets_mm: Vec<f64>,
    pub velocities_m_per_s: Vec<f64>,
    pub repetition_count: u16,
    /// Scatter from tap to tap.
    pub tap_sd: f64,
    /// Scatter from location to location.
    pub location_sd: f64,
    /// Height of the smooth change along the ring.
    pub smooth: f64,
    /// Part of the scatter that the discriminators share.
    pub correlation: f64,
    /// Shoulder and locations of each crack.
    pub cracks: Vec<(u16, Range<u32>)>,
    /// How far a crack moves a discriminator, in its direction.
    pub shift: f64,
    /// Which discriminators a crack moves.
    pub shifted: Vec<Discriminator>,
}

impl Default for Casing {
    fn default() -> Self {
        Self {
            shoulder_count: 1,
            location_count: 100,
            offsets_mm: vec![0.0, 10.0],
            velocities_m_per_s: vec![1.0, 1.5],
            repetition_count: 2,
            tap_sd: 1.0,
            location_sd: 0.5,
            smooth: 0.3,
            correlation: 0.6,
            cracks: vec![],
            shift: 0.0,
            shifted: Discriminator::ALL.to_vec(),
        }
    }
}

/// The score of `fusion` by `records`.
pub(crate) fn scored(fusion: Fusion, records: &[Discriminators]) -> Score {
    let mut pool = ScorePool::default();
    pool.add(fusion, records).unwrap();
    pool.score()
}

/// `records` pushed and all scans ended; compared with `set`, where there is one.
pub(crate) fn whole_by(
    config: &FuseConfig,
    plan: &Plan,
    set: Option<&Arc<ReferenceSet>>,
    records: &[Discriminators],
) -> Fusion {
    let mut fusion = Fusion::by(config, plan, set.cloned()).unwrap();
    records.iter().for_each(|record| fusion.push(record).unwrap());
    (0..plan.scans().len()).for_each(|scan| fusion.end(scan).unwrap());
    fusion
}

/// What a reference is made of beside its shoulders.
pub(crate) fn built() -> Built {
    Built { config: file(), process: "f_c_hz = 550.0\n".to_owned(), ..Built::default() }
}

/// The reference that `shoulders` make.
pub(crate) fn set_of(shoulders: Vec<KnownShoulder>) -> ReferenceSet {
    build_reference(&built(), shoulders).unwrap()
}

/// A configuration whose reference is a file.
pub(crate) fn file() -> FuseConfig {
    FuseConfig::by(Reference::File("sound.json".into()))
}

/// The shoulders of `casing` for a reference, by the records of `seed`.
pub(crate) fn shoulders_of(casing: &Casing, seed: u64, with_labels: bool, serial: &str) -> Vec<KnownShoulder> {
    let plan = casing.plan();
    let found = records(casing, &plan, seed);
    let known = (0..plan.scans().len())
        .map(|scan| KnownShoulder::of(&plan, &found, scan, with_labels.then(|| plan.truth())).unwrap());
    known.map(|shoulder| KnownShoulder { tyre: serial.to_owned(), ..shoulder }).collect()
}

/// The shoulders of `count` sound casings like `casing` for a reference: A0, A1, ...
pub(crate) fn shoulders_of_all(casing: &Casing, count: u64) -> Vec<KnownShoulder> {
    (0..count).flat_map(|k| shoulders_of(casing, 100 + k, false, &format!("A{k}"))).collect()
}

pub(crate) fn tyre() -> Serial {
    Serial::new("T1").unwrap()
}

/// A tap of unknown offset and velocity.
pub(crate) fn tap_id(shoulder: u16, location: u32) -> TapId {
    TapId::new(0, tyre(), shoulder, location)
}

impl Casing {
    fn is_cracked(&self, shoulder: u16, location: u32) -> bool {
        self.cracks.iter().any(|(s, arc)| *s == shoulder && arc.contains(&(location % self.location_count)))
    }

    /// The plan: shoulder by shoulder, condition by condition, ring by ring, each closed.
    pub(crate) fn plan(&self) -> Plan {
        let mut taps = Vec::new();
        for shoulder in 1..=self.shoulder_count {
            for &offset in &self.offsets_mm {
                for &velocity in &self.velocities_m_per_s {
                    for repetition in 0..self.repetition_count {
                        for location in 0..=self.location_count {
                            let mut id = tap_id(shoulder, location);
                            id.repetition = repetition;
                            let id = id.with_offset_mm(Some(offset)).unwrap();
                            taps.push(PlannedTap {
                                id: id.with_velocity_m_per_s(Some(velocity)).unwrap(),
                                angle_deg: Some(360.0 * f64::from(location) / f64::from(self.location_count)),
                                purpose: Purpose::closing_if(location == self.location_count),
                            });
                        }
                    }
                }
            }
        }
        let each = |shoulder| (0..self.location_count).map(move |location| (shoulder, location));
        let truth: Truth = (1..=self.shoulder_count)
            .flat_map(each)
            .map(|(shoulder, location)| ((tyre(), shoulder, location), self.is_cracked(shoulder, location)))
            .collect();
        Plan::new(Geometry::Ring, recording(), taps, truth).unwrap()
    }
}

pub(crate) fn recording() -> Recording {
    Recording {
        sample_rate_hz: 40_960.0,
        pre_trigger_samples: 512,
        sample_count_max: 16_384,
        sample_format: SampleFormat::I16,
        channels: vec![],
        calibration: tapline_wire::Calibration::stated(),
    }
}

/// One record a planned tap, in plan order.
///
/// Each discriminator has a level and a spread of its own in every condition; a closing tap is far off,
/// so that a test notices if it enters anything.
pub(crate) fn records(casing: &Casing, plan: &Plan, seed: u64) -> Vec<Discriminators> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let shared = casing.correlation.sqrt();
    let own = (1.0 - casing.correlation).sqrt();
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let mut seven = || {
        let common = normal();
        [0; 7].map(|_| shared * common + own * normal())
    };
    let mut level = Vec::new();
    for _ in 0..casing.shoulder_count {
        let phases = seven();
        for location in 0..casing.location_count {
            let angle = TAU * f64::from(location) / f64::from(casing.location_count);
            let scatter = seven();
            level.push([0, 1, 2, 3, 4, 5, 6].map(|d| {
                casing.location_sd * scatter[d]
                    + casing.smooth * ((angle + TAU * phases[d]).cos() + (2.0 * angle).cos() / 2.0)
            }));
        }
    }
    let mut record = |(plan_index, tap): (u32, &PlannedTap)| {
        let ring = (usize::from(tap.id.shoulder) - 1) * casing.location_count as usize;
        let level = &level[ring + (tap.id.location % casing.location_count) as usize];
        let is_cracked = casing.is_cracked(tap.id.shoulder, tap.id.location);
        let condition = 1.0 + tap.id.offset_mm().unwrap_or(0.0) + 10.0 * tap.id.velocity_m_per_s().unwrap_or(0.0);
        let mut values = Values::default();
        for (which, noise) in Discriminator::ALL.into_iter().zip(seven()) {
            let sign = if which == Discriminator::FMax { -1.0 } else { 1.0 };
            let damage = if is_cracked && casing.shifted.contains(&which) { sign * casing.shift } else { 0.0 };
            let drift = if tap.is_closing() { 1e6 } else { 0.0 };
            let deviation = level[which as usize] + casing.tap_sd * noise + damage + drift;
            // PR is a part of a whole; what has a unit has another level in every condition.
            let level = if which == Discriminator::Pr { 0.003 } else { condition * 10_f64.powi(which as i32 - 3) };
            values.set(which, Some(level * (100.0 + deviation)));
        }
        Discriminators { id: tap.id, plan_index, values, ..Discriminators::default() }
    };
    (0..).zip(plan.taps()).map(&mut record).collect()
}
