//! What the values of a shoulder are measured against: its own level, or one for all lines of a slab.

use super::*;

/// Two shoulders, of which the second gives 1.5 % more of everything, on a ring or on lines.
fn uneven(geometry: Geometry) -> (Plan, Vec<Discriminators>) {
    let casing = Casing { shoulder_count: 2, ..Casing::default() };
    let ring = casing.plan();
    let mut all = records(&casing, &ring, 2);
    for record in all.iter_mut().filter(|record| record.id.shoulder == 2) {
        for which in Discriminator::ALL {
            record.values.set(which, record.values.get(which).map(|value| 1.015 * value));
        }
    }
    // A line has no closing tap.
    let is_left = |tap: &PlannedTap| geometry == Geometry::Ring || !tap.is_closing;
    let taps: Vec<PlannedTap> = ring.taps().iter().filter(|tap| is_left(tap)).copied().collect();
    all.retain(|record| is_left(&ring.taps()[record.plan_index as usize]));
    let all = (0..).zip(all).map(|(plan_index, record)| Discriminators { plan_index, ..record }).collect();
    (Plan::new(geometry, recording(), taps, Truth::new()).unwrap(), all)
}

#[test]
fn each_shoulder_of_a_ring_has_its_own_level() {
    // Catches a side that is a little louder and is damaged for it, or that hides the other's cracks.
    let (plan, all) = uneven(Geometry::Ring);
    let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &all);
    let levels = fusion.compared(0).casing.levels.clone();
    let above: Vec<f64> = levels[1].above(&levels[0]).into_iter().flatten().collect();
    assert_eq!(above.len(), 4 * 6, "four conditions of six discriminators");
    assert!(above.iter().all(|share| (share - 0.015).abs() < 0.006), "{above:?}");
    let means = [0, 1].map(|scan| {
        let (judgement, cells) = fusion.judge(scan).unwrap();
        assert_eq!(verdict(&judgement), Verdict::Pass, "{}", judgement.reasons);
        cells.iter().map(|cell| cell.damage_index).sum::<f64>() / 100.0
    });
    assert!((means[0] - means[1]).abs() < 0.3, "{means:?}");
}

#[test]
fn lines_of_a_slab_share_one_level() {
    // Catches a level for each line: one that lies over a crack for half of its length would be measured against the crack.
    let (plan, all) = uneven(Geometry::Line);
    let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &all);
    let levels = fusion.compared(0).casing.levels.clone();
    assert_eq!(levels[0], levels[1]);
    let means = [0, 1].map(|scan| {
        let (_, cells) = fusion.judge(scan).unwrap();
        cells.iter().map(|cell| cell.damage_index).sum::<f64>() / 100.0
    });
    assert!(means[1] > means[0] + 0.5, "{means:?}");
}

#[test]
fn a_shoulder_that_is_mostly_cracked_is_measured_against_both() {
    // Catches the level of a shoulder that is taken from its cracks.
    let casing = Casing { shoulder_count: 2, cracks: vec![(1, 10..70)], shift: 8.0, ..Casing::default() };
    let plan = casing.plan();
    let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &records(&casing, &plan, 2));
    let levels = fusion.compared(0).casing.levels.clone();
    let above: Vec<f64> = levels[0].above(&levels[1]).into_iter().flatten().collect();
    assert!(above.iter().all(|share| share.abs() < 0.02), "{above:?}");
    let (judgement, cells) = fusion.judge(0).unwrap();
    assert_eq!(verdict(&judgement), Verdict::Reject);
    assert!(cells[10..70].iter().filter(|cell| cell.region > 0).count() >= 57);
}
