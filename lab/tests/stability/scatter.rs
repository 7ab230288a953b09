//! Artificial rings for the cases: normal scatter, planned scans, and the plain reading of Eqs. 55 and 56.

use std::sync::Arc;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use tapline_fuse::{
    Built, Direction, Directions, FuseConfig, Fusion, KnownShoulder, Reference, ReferenceSet, build_reference,
};
use tapline_wire::{
    DamageCell, Discriminator, Discriminators, Geometry, Judgement, Plan, PlannedTap, Purpose, Recording, SampleFormat,
    Serial, TapId, Truth, Values,
};

/// Normal numbers, the same for the same seed.
pub(crate) struct Normal(ChaCha8Rng);

impl Normal {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub(crate) fn next(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    pub(crate) fn take(&mut self, count: usize) -> Vec<f64> {
        (0..count).map(|_| self.next()).collect()
    }
}

pub(crate) fn tyre(serial: &str) -> Serial {
    Serial::new(serial).unwrap()
}

fn recording() -> Recording {
    Recording {
        sample_rate_hz: 40_960.0,
        pre_trigger_samples: 512,
        sample_count_max: 16_384,
        sample_format: SampleFormat::I16,
        channels: vec![],
        calibration: tapline_wire::Calibration::computed(),
    }
}

pub(crate) fn plan_of(taps: Vec<PlannedTap>, truth: Truth) -> Plan {
    Plan::new(Geometry::Ring, recording(), taps, truth).unwrap()
}

/// A tap of a ring of `count` locations, which number `count` closes.
pub(crate) fn planned(tyre: Serial, shoulder: u16, location: u32, count: u32) -> PlannedTap {
    let mut id = TapId::default();
    (id.tyre, id.shoulder, id.location) = (tyre, shoulder, location);
    let angle_deg = Some(360.0 * f64::from(location) / f64::from(count));
    PlannedTap { id, angle_deg, purpose: Purpose::closing_if(location == count) }
}

/// Closed rings of `count` locations, one tap a location.
pub(crate) fn ring_plan(tyres: &[Serial], shoulders: u16, count: u32) -> Plan {
    let rings = tyres.iter().flat_map(|&tyre| (1..=shoulders).map(move |shoulder| (tyre, shoulder)));
    let taps = rings.flat_map(|(tyre, shoulder)| (0..=count).map(move |l| planned(tyre, shoulder, l, count)));
    plan_of(taps.collect(), Truth::new())
}

/// One record per planned tap, with the discriminators that `values` gives it, in plan order.
pub(crate) fn records(
    plan: &Plan,
    mut values: impl FnMut(&PlannedTap) -> Vec<(Discriminator, f64)>,
) -> Vec<Discriminators> {
    let record = |(plan_index, tap): (u32, &PlannedTap)| {
        let mut of = Values::default();
        for (which, value) in values(tap) {
            of.set(which, Some(value));
        }
        Discriminators { id: tap.id, plan_index, values: of, ..Discriminators::default() }
    };
    (0..).zip(plan.taps()).map(record).collect()
}

/// What `which` reads where its logarithm lies `z` hundredths above its level; of PR, its logit.
pub(crate) fn value(which: Discriminator, z: f64) -> f64 {
    if which == Discriminator::Pr { 1.0 / (1.0 + (-0.01 * z).exp()) } else { 100.0 * (0.01 * z).exp() }
}

/// The reference that all shoulders of `plan` make, stated to be sound.
pub(crate) fn reference(plan: &Plan, records: &[Discriminators]) -> Arc<ReferenceSet> {
    let shoulders = (0..plan.scans().len()).map(|scan| KnownShoulder::of(plan, records, scan, None).unwrap());
    Arc::new(build_reference(&Built::default(), shoulders.collect()).unwrap())
}

/// Judges every scan of `plan` from `records`.
pub(crate) fn judge(config: &FuseConfig, plan: &Plan, records: &[Discriminators]) -> Vec<(Judgement, Vec<DamageCell>)> {
    judge_by(Fusion::new(config, plan).unwrap(), plan, records)
}

/// Judges every scan of `plan` from `records`, compared with the shoulders of `set`.
pub(crate) fn judge_by_file(
    config: &FuseConfig,
    set: &Arc<ReferenceSet>,
    plan: &Plan,
    records: &[Discriminators],
) -> Vec<(Judgement, Vec<DamageCell>)> {
    let config = FuseConfig { reference: Some(Reference::File("sound.json".into())), ..config.clone() };
    judge_by(Fusion::by(&config, plan, Some(set.clone())).unwrap(), plan, records)
}

fn judge_by(mut fusion: Fusion, plan: &Plan, records: &[Discriminators]) -> Vec<(Judgement, Vec<DamageCell>)> {
    for record in records {
        fusion.push(record).unwrap();
    }
    for scan in 0..plan.scans().len() {
        fusion.end(scan).unwrap();
    }
    (0..plan.scans().len()).map(|scan| fusion.judge(scan).unwrap()).collect()
}

/// The six discriminators of the index with its level and the sign in which each moves with damage.
pub(crate) fn directed() -> Vec<(Discriminator, f64)> {
    let directions = Directions::default();
    let signed = |which: Discriminator| (which, directions.of(which).sign());
    FuseConfig::default().discriminators.into_iter().map(signed).collect()
}

/// Eq. 55 as printed: |x - x_m|/(x_max - x_min) with the extremes of `reference`, reduced as numpy reduces.
pub(crate) fn naive_eq_55(values: &[f64], reference: &[f64], direction: Direction) -> Vec<f64> {
    let extreme = |is_better: fn(f64, f64) -> bool| {
        reference.iter().copied().fold(reference[0], |m, x| {
            if m.is_nan() || x.is_nan() {
                f64::NAN
            } else if is_better(x, m) {
                x
            } else {
                m
            }
        })
    };
    let (low, high) = (extreme(|x, m| x < m), extreme(|x, m| x > m));
    let x_m = if direction == Direction::Rises { low } else { high };
    values.iter().map(|x| (x - x_m).abs() / (high - low)).collect()
}

/// Eq. 56: the mean of the columns' scores, location by location.
pub(crate) fn naive_eq_56(columns: &[Vec<f64>]) -> Vec<f64> {
    let count = columns.len() as f64;
    (0..columns[0].len()).map(|k| columns.iter().map(|c| c[k]).sum::<f64>() / count).collect()
}

pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

pub(crate) fn sd(values: &[f64]) -> f64 {
    let m = mean(values);
    mean(&values.iter().map(|x| (x - m) * (x - m)).collect::<Vec<_>>()).sqrt()
}

pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

pub(crate) fn largest(values: &[f64]) -> f64 {
    values.iter().copied().max_by(f64::total_cmp).unwrap()
}
