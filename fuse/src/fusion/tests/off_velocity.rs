//! A tap that struck at another velocity than was meant is compared with those beside it, and may be normalised.

use super::*;
use crate::KnownShoulder;

#[test]
fn a_tap_that_struck_out_stays_in_its_class() {
    // Catches classes by what each tap was struck at: those that struck out would be alone, without a scale, and their
    // locations blind in a condition; in the map, in the drift, and in a reference that is made of them.
    let casing = Casing { velocities_m_per_s: vec![1.0, 2.0], ..Casing::default() };
    let meant = casing.plan();
    let all = records(&casing, &meant, 4);
    let struck = |tap: &PlannedTap| {
        let is_out = tap.is_closing() || (30..33).contains(&tap.id.location);
        let velocity = tap.id.velocity_m_per_s().map(|v| if is_out { 0.8 * v } else { v });
        PlannedTap { id: tap.id.with_velocity_m_per_s(velocity).unwrap(), ..*tap }
    };
    let taps: Vec<PlannedTap> = meant.taps().iter().map(struck).collect();
    let plan = Plan::new(meant.geometry, recording(), taps, meant.truth().clone()).unwrap();
    let named = |(record, tap): (&Discriminators, &PlannedTap)| Discriminators { id: tap.id, ..*record };
    let renamed: Vec<Discriminators> = all.iter().zip(plan.taps()).map(named).collect();
    let own = FuseConfig::by(Reference::Own);
    let expected = whole(&own, &meant, &all).judge(0).unwrap();
    let mut got = whole(&own, &plan, &renamed).judge(0).unwrap();
    got.0.stamp = expected.0.stamp; // another plan has another digest
    assert!(bits(&got) == bits(&expected));
    assert!(got.0.drift[4].is_finite());
    let known = |plan: &Plan, all: &[Discriminators]| KnownShoulder::of(plan, all, 0, None).unwrap();
    assert_eq!(known(&plan, &renamed), known(&meant, &all));
}

#[test]
fn a_measured_velocity_makes_no_class() {
    // Catches a class by the velocity that was measured: it is for the normalisation, which is off here.
    let casing = Casing::default();
    let plan = casing.plan();
    let mut all = records(&casing, &plan, 4);
    let config = FuseConfig::by(Reference::Own);
    let expected = bits(&whole(&config, &plan, &all).judge(0).unwrap());
    for record in all.iter_mut().filter(|record| (30..33).contains(&record.id.location)) {
        record.velocity_measured_m_per_s = record.id.velocity_m_per_s().unwrap() * 1.3;
    }
    assert_eq!(bits(&whole(&config, &plan, &all).judge(0).unwrap()), expected);
}

#[test]
fn of_two_records_that_differ_in_velocity_the_same_holds() {
    // Catches a choice that is left to the order of arrival where two records of one attempt differ in nothing but the
    // velocity that was measured; it enters the index by the normalisation.
    let casing = Casing::default();
    let plan = casing.plan();
    let mut all = records(&casing, &plan, 9);
    for (row, record) in (0_u32..).zip(&mut all) {
        let v = record.id.velocity_m_per_s().unwrap() * (1.0 + 0.004 * f64::from(row * 37 % 11) - 0.02);
        record.velocity_measured_m_per_s = v;
        let own = 1.0 + 0.002 * (f64::from(row * 71 % 13) - 6.0);
        record.values.set(Discriminator::FMax, Some(30.0 * v.powf(1.31) * own));
    }
    let config = FuseConfig { normalise_velocity: true, ..FuseConfig::by(Reference::Own) };
    let faster = Discriminators { velocity_measured_m_per_s: 1.1, ..all[40] };
    assert_ne!(faster.velocity_measured_m_per_s.to_bits(), all[40].velocity_measured_m_per_s.to_bits());
    let after = [&all[..], &[faster]].concat();
    let before = [&[faster], &all[..]].concat();
    let judged = |all: &[Discriminators]| bits(&whole(&config, &plan, all).judge(0).unwrap());
    assert_eq!(judged(&after), judged(&before));
    // It matters which one holds.
    assert_ne!(judged(&after), judged(&all));
}

#[test]
fn a_velocity_that_drifts_is_normalised() {
    // Catches a normalisation that is not applied, by the wrong exponent, or to a reference that is not: a velocity that
    // rises by 8 % over part of the ring lowers nothing else, and looks like damage where forces fall with it.
    let casing = Casing { velocities_m_per_s: vec![1.0, 1.5, 2.0], ..Casing::default() };
    let plan = casing.plan();
    let mut all = records(&casing, &plan, 9);
    for (row, record) in (0_u32..).zip(&mut all) {
        let is_slow = (30..50).contains(&record.id.location);
        let scatter = 1.0 + 0.004 * f64::from(row * 37 % 11) - 0.02;
        let v = record.id.velocity_m_per_s().unwrap() * if is_slow { 0.85 } else { 1.0 } * scatter;
        record.velocity_measured_m_per_s = v;
        let own = 1.0 + 0.002 * (f64::from(row * 71 % 13) - 6.0);
        record.values.set(Discriminator::FMax, Some(30.0 * v.powf(1.31) * own));
    }
    let of = |normalise_velocity| {
        let config = FuseConfig {
            normalise_velocity,
            discriminators: vec![Discriminator::FMax],
            ..FuseConfig::by(Reference::Own)
        };
        let (judgement, _) = whole(&config, &plan, &all).judge(0).unwrap();
        verdict(&judgement)
    };
    assert_ne!(of(false), Verdict::Pass);
    assert_eq!(of(true), Verdict::Pass);
}
