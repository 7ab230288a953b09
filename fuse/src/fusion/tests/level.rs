//! What multiplies a whole turn is no damage: a gain that is off, or that drifts while the turn is made.

use super::*;

/// The casing of `seed` with one turn of its sound multiplied by `gain` of how far the turn has come.
fn heard(casing: &Casing, seed: u64, gain: impl Fn(f64) -> f64) -> (Verdict, Vec<DamageCell>) {
    let plan = casing.plan();
    let mut all = records(casing, &plan, seed);
    for record in all.iter_mut().filter(|r| r.id.repetition == 0 && r.id.velocity_m_per_s() == Some(1.0)) {
        if record.id.offset_mm() == Some(0.0) {
            let gain = gain(f64::from(record.id.location) / f64::from(casing.location_count));
            for (which, power) in [(Discriminator::A1, 1), (Discriminator::Pf, 2), (Discriminator::Ef, 2)] {
                record.values.set(which, record.values.get(which).map(|x| x * gain.powi(power)));
            }
        }
    }
    let (judgement, cells) = whole(&FuseConfig::by(Reference::Own), &plan, &all).judge(0).unwrap();
    (verdict(&judgement), cells)
}

#[test]
fn a_gain_that_is_off_changes_no_verdict() {
    // Catches a level that two turns or two shoulders share: what is heard louder would be damaged.
    for seed in 0..10 {
        let (expected, cells) = heard(&Casing::default(), seed, |_| 1.0);
        for gain in [0.5, 0.8, 1.2, 3.0] {
            let (verdict, others) = heard(&Casing::default(), seed, |_| gain);
            assert_eq!(verdict, expected, "{seed} {gain}");
            for (cell, other) in cells.iter().zip(&others) {
                assert!((cell.damage_index - other.damage_index).abs() < 1e-6, "{seed} {gain} {cell:?} {other:?}");
            }
        }
    }
}

#[test]
fn a_gain_that_drifts_is_no_damage() {
    // Catches a level that stands still while the turn does not.
    let passed =
        |gain: fn(f64) -> f64| (0..20).filter(|&seed| heard(&Casing::default(), seed, gain).0 == Verdict::Pass).count();
    // 5 % are ten standard deviations of a tap's E_f: without a drift of the level none would pass.
    let (still, drifting) = (passed(|_| 1.0), passed(|turn| 1.0 + 0.05 * (turn - 0.5)));
    assert!(drifting + 2 >= still, "{drifting} of {still}");
}

#[test]
fn a_wide_crack_keeps_its_level() {
    // Catches a level that cracked places bend.
    for count in [10, 30, 50] {
        let casing = Casing { cracks: vec![(1, 20..20 + count)], shift: 8.0, smooth: 0.1, ..Casing::default() };
        let (verdict, cells) = heard(&casing, 5, |_| 1.0);
        assert_eq!(verdict, Verdict::Reject, "{count}");
        let called = |is_cracked: bool| {
            let of_class = cells.iter().filter(|c| (20..20 + count).contains(&c.location) == is_cracked);
            of_class.filter(|c| c.region > 0).count()
        };
        assert!(called(true) * 10 >= count as usize * 9, "{count}: {}", called(true));
        assert!(called(false) <= 15, "{count}: {}", called(false));
    }
}
