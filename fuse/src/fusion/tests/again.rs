//! What changes after a verdict makes another; what does not, does not.

use super::*;

/// A fusion of a small sound casing of two shoulders that is whole and judged, and its records.
fn judged() -> (Fusion, Plan, Vec<Discriminators>) {
    let casing = Casing { location_count: 40, ..small() };
    let plan = casing.plan();
    let all = records(&casing, &plan, 3);
    let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &all);
    for scan in [0, 1] {
        fusion.judge(scan).unwrap();
    }
    (fusion, plan, all)
}

#[test]
fn an_end_that_comes_twice_is_one_end() {
    // Catches a verdict that is sent again for every ledger that says the scan has ended.
    let (mut fusion, ..) = judged();
    fusion.end(0).unwrap();
    fusion.end(1).unwrap();
    assert_eq!(fusion.ready(), [0_usize; 0]);
}

#[test]
fn an_end_after_a_verdict_asks_for_another() {
    // Catches a scan that was looked at before its end and stays RE-INSPECT for ever, and so does its other shoulder.
    let (_, plan, all) = judged();
    let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan).unwrap();
    for record in &all {
        fusion.push(record).unwrap();
    }
    fusion.end(0).unwrap();
    for scan in [0, 1] {
        assert!(fusion.judge(scan).unwrap().0.reasons.contains(Reasons::NOT_ENDED));
    }
    assert_eq!(fusion.ready(), [0_usize; 0]);
    fusion.end(1).unwrap();
    assert_eq!(fusion.ready(), [0, 1], "scan 0 rests on scan 1 too");
    assert!(!fusion.judge(0).unwrap().0.reasons.contains(Reasons::NOT_ENDED));
}

#[test]
fn a_newer_record_makes_another_verdict() {
    // Catches results that are kept though what they came from has changed: judged again is as if judged at once.
    let (mut fusion, plan, all) = judged();
    let before = [fusion.judge(0).unwrap(), fusion.judge(1).unwrap()].map(|of| bits(&of));
    let mut newer: Vec<Discriminators> = all.iter().filter(|r| r.id.shoulder == 2).copied().collect();
    newer.retain(|record| (20..25).contains(&record.id.location));
    for record in &mut newer {
        record.id.attempt = 1;
        record.values.set(Discriminator::Pr, record.values.get(Discriminator::Pr).map(|pr| 1.2 * pr));
        fusion.push(record).unwrap();
    }
    assert_eq!(fusion.ready(), [0, 1]);
    let mut at_once = whole(&FuseConfig::by(Reference::Own), &plan, &[all, newer].concat());
    for scan in [0, 1] {
        let again = bits(&fusion.judge(scan).unwrap());
        assert_eq!(again, bits(&at_once.judge(scan).unwrap()), "{scan}");
        assert_ne!(again, before[scan], "{scan}");
    }
    assert_eq!(fusion.ready(), [0_usize; 0]);
}

#[test]
fn a_casing_by_itself_has_the_scores_of_its_index() {
    // Catches scores that are kept of the places that teach alone: what stands out is hidden there. A cracked shoulder, and both indices.
    let casing = Casing { location_count: 40, ..small() };
    let (plan, cracked) = (casing.plan(), 3..8);
    let mut all = records(&casing, &plan, 3);
    for record in all.iter_mut().filter(|record| record.id.shoulder == 1 && cracked.contains(&record.id.location)) {
        record.values.set(Discriminator::Tau, record.values.get(Discriminator::Tau).map(|tau| 1.5 * tau));
    }
    for index in [IndexKind::Fused, IndexKind::Dissertation] {
        let mut fusion = whole(&FuseConfig { index, ..FuseConfig::by(Reference::Own) }, &plan, &all);
        let compared = fusion.compared(0);
        let found = compared.by_reference.as_ref().unwrap();
        let anew = found.fitted.index.scores(&compared.shoulders.iter().collect::<Vec<_>>());
        assert_eq!(format!("{:?}", found.scores), format!("{anew:?}"), "{index:?}");
    }
}
