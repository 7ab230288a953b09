//! A casing that is judged again is as if it were judged at once.

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
    let mut at_once = whole(&FuseConfig::by(Reference::Own), &plan, &[all, newer].concat());
    for scan in [0, 1] {
        let again = bits(&fusion.judge(scan).unwrap());
        assert_eq!(again, bits(&at_once.judge(scan).unwrap()), "{scan}");
        assert_ne!(again, before[scan], "{scan}");
    }
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
