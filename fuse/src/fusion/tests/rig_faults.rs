//! What a rig does wrong: a velocity that drifts.

use super::*;

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
