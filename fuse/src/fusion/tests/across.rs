//! Which offset sees a region best.

use super::*;

/// Offsets in the order in which nothing is sorted: not by millimetres, not by nearness.
const OFFSETS_MM: [f64; 4] = [10.0, -5.0, 15.0, 0.0];

/// Best, least and greatest offset of the region at location 42 of a casing whose crack raises everything by `shift_at` in
/// spreads of a tap, by offset.
fn seen(seed: u64, shift_at: impl Fn(f64) -> f64) -> (f64, f64, f64) {
    let casing = Casing { offsets_mm: OFFSETS_MM.to_vec(), ..Casing::default() };
    let plan = casing.plan();
    let mut all = records(&casing, &plan, seed);
    for record in all.iter_mut().filter(|record| (40..45).contains(&record.id.location)) {
        for which in Discriminator::ALL {
            let sign = if which == Discriminator::FMax { -1.0 } else { 1.0 };
            let factor = 1.0 + 0.01 * sign * shift_at(record.id.offset_mm().unwrap());
            record.values.set(which, record.values.get(which).map(|value| factor * value));
        }
    }
    let (judgement, cells) = whole(&FuseConfig::by(Reference::Own), &plan, &all).judge(0).unwrap();
    assert_eq!(verdict(&judgement), Verdict::Reject, "{}", judgement.reasons);
    (cells[42].offset_best_mm, cells[42].offset_low_mm, cells[42].offset_high_mm)
}

#[test]
fn of_offsets_at_the_clip_the_nearest_to_the_belt_edge_is_best() {
    // Catches a best offset that the scatter of sound places decides, of those at the region's ends or of those that set the
    // scale, where the crack is beyond the clip at several offsets.
    for seed in 0..40 {
        assert_eq!(seen(seed, |_| 40.0), (0.0, -5.0, 15.0), "{seed}");
        assert_eq!(seen(seed, |mm| if mm > 5.0 { 40.0 } else { 0.0 }), (10.0, 10.0, 15.0), "{seed}");
    }
}

#[test]
fn an_offset_that_sees_more_is_best() {
    // Catches a preference for the belt edge that a crack which does not lie there cannot outdo.
    for seed in 0..10 {
        let of = |best: f64| seen(seed, |mm| if (mm - best).abs() < 1e-9 { 5.0 } else { 1.0 });
        for best in OFFSETS_MM {
            assert_eq!(of(best), (best, best, best), "{seed}");
        }
    }
}
