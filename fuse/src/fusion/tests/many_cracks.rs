//! Casings of which so much is cracked that a reference of their own is hard to come by.

use super::*;

#[test]
fn damage_is_found_where_it_is_the_rule() {
    // Catches a reference that its own cracks spoil: 40 of 100 locations, and, against a sound one, 70.
    let cracked = |arc| Casing { shoulder_count: 2, cracks: vec![(1, arc)], shift: 3.0, ..Casing::default() };
    let casing = cracked(10..50);
    let plan = casing.plan();
    let mut own = whole(&FuseConfig::by(Reference::Own), &plan, &records(&casing, &plan, 2));
    let (judgement, cells) = own.judge(0).unwrap();
    assert_eq!(verdict(&judgement), Verdict::Reject);
    assert!(cells[10..50].iter().filter(|c| c.region > 0).count() >= 38);
    let casing = cracked(10..80);
    let reference = Reference::Shoulder { tyre: tyre(), shoulder: 2 };
    let mut named = whole(&FuseConfig::by(reference), &plan, &records(&casing, &plan, 2));
    assert_eq!(verdict(&named.judge(0).unwrap().0), Verdict::Reject);
    assert_eq!(verdict(&named.judge(1).unwrap().0), Verdict::Pass);
}

#[test]
fn many_narrow_cracks_do_not_become_the_rule() {
    // Catches trimming that sees only means of three: of 14 cracks of 3 on each ring they make 70 locations of 100.
    let narrow = |shoulder| (0..14).map(move |k| (shoulder, 7 * k..7 * k + 3));
    let cracks = narrow(1).chain(narrow(2)).collect();
    let casing = Casing { shoulder_count: 2, cracks, shift: 5.0, location_sd: 0.2, ..Casing::default() };
    let plan = casing.plan();
    for seed in 0..8 {
        let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &records(&casing, &plan, seed));
        for scan in [0, 1] {
            let (judgement, cells) = fusion.judge(scan).unwrap();
            assert_eq!(verdict(&judgement), Verdict::Reject, "{seed} {}", judgement.reasons);
            assert!(cells.iter().all(|c| c.region > 0 || c.location >= 98 || c.location % 7 > 2), "{seed}");
        }
    }
}

#[test]
fn a_tyre_that_is_mostly_cracked_does_not_pass() {
    // Catches a reference made of cracks by which the sound rest, lying below it, is all there is to see.
    let cracks = vec![(1, 10..75), (2, 30..95)];
    let casing = Casing { shoulder_count: 2, cracks, shift: 6.0, ..Casing::default() };
    let plan = casing.plan();
    let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &records(&casing, &plan, 5));
    for scan in [0, 1] {
        let judgement = fusion.judge(scan).unwrap().0;
        assert_eq!(verdict(&judgement), Verdict::ReInspect, "{}", judgement.reasons);
        assert!(judgement.reasons.contains(Reasons::NO_INDEX));
    }
}
