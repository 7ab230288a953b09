//! Reasons that the plan itself gives: a condition that the reference lacks, a part of the ring that is not tapped.

use super::*;
use crate::testing::{file, set_of, shoulders_of};

/// The reference that a casing of seed 1 makes.
fn reference_of(casing: &Casing) -> Arc<ReferenceSet> {
    Arc::new(set_of(shoulders_of(casing, 1, false, "T1")))
}

/// `plan` without the taps that are not `planned`, and the records of the others.
fn without(plan: &Plan, all: &[Discriminators], planned: impl Fn(&TapId) -> bool) -> (Plan, Vec<Discriminators>) {
    let taps: Vec<PlannedTap> = plan.taps().iter().filter(|tap| planned(&tap.id)).copied().collect();
    let left = all.iter().filter(|record| planned(&record.id));
    let left = (0..).zip(left).map(|(plan_index, record)| Discriminators { plan_index, ..*record }).collect();
    (Plan::new(plan.geometry, plan.recording.clone(), taps, Truth::new()).unwrap(), left)
}

#[test]
fn a_condition_that_the_reference_file_lacks_is_no_pass() {
    // Catches taps that nobody looked at and that pass: at an offset, and at a velocity, that the file has nothing of; and a
    // shoulder that is not passed for what only the reference has.
    let known = Casing::default();
    let set = reference_of(&known);
    let of = |offsets_mm: &[f64], velocities_m_per_s: &[f64]| {
        let casing = Casing {
            offsets_mm: offsets_mm.to_vec(),
            velocities_m_per_s: velocities_m_per_s.to_vec(),
            ..known.clone()
        };
        let plan = casing.plan();
        let mut fusion = whole_by(&file(), &plan, Some(&set), &records(&casing, &plan, 7));
        let judgement = fusion.judge(0).unwrap().0;
        (verdict(&judgement), judgement.reasons.difference(Reasons::REMARKS))
    };
    let unknown = (Verdict::ReInspect, Reasons::CONDITION_UNKNOWN);
    let pass = (Verdict::Pass, Reasons::default());
    assert_eq!(of(&[0.0, 10.0], &[1.0, 1.5]), pass);
    assert_eq!(of(&[0.0, 5.0, 10.0], &[1.0, 1.5]), unknown, "another offset");
    assert_eq!(of(&[0.0, 10.0], &[1.0, 1.5, 2.0]), unknown, "another velocity");
    assert_eq!(of(&[0.0], &[1.5]), pass, "less than the reference has");
    // Each of them is known, but not together.
    let plan = Casing { velocities_m_per_s: vec![1.0, 1.5, 2.0], ..known.clone() };
    let (offset_mm, velocity_m_per_s) = (Some(0.0), Some(2.0));
    let mut crossed = (*reference_of(&plan)).clone();
    crossed.shoulders[0].turns.retain(|turn| (turn.offset_mm, turn.velocity_m_per_s) != (offset_mm, velocity_m_per_s));
    let all = records(&plan, &plan.plan(), 7);
    let mut fusion = whole_by(&file(), &plan.plan(), Some(&Arc::new(crossed)), &all);
    assert_eq!(fusion.judge(0).unwrap().0.reasons.difference(Reasons::REMARKS), Reasons::CONDITION_UNKNOWN);
}

#[test]
fn a_condition_that_the_named_shoulder_lacks_is_no_pass() {
    // Catches a reference of the run itself that is not asked which conditions it has.
    let casing = Casing { shoulder_count: 2, ..Casing::default() };
    let whole_plan = casing.plan();
    let is_left = |id: &TapId| id.shoulder == 2 || id.offset_mm() == Some(0.0);
    let (plan, all) = without(&whole_plan, &records(&casing, &whole_plan, 3), is_left);
    let config = FuseConfig::by(Reference::Shoulder { tyre: tyre(), shoulder: 1 });
    let mut fusion = whole(&config, &plan, &all);
    let judgement = fusion.judge(1).unwrap().0;
    assert_eq!(
        (verdict(&judgement), judgement.reasons.difference(Reasons::REMARKS)),
        (Verdict::ReInspect, Reasons::CONDITION_UNKNOWN)
    );
    assert_eq!(
        fusion.judge(0).unwrap().0.reasons.difference(Reasons::EXTRAPOLATED | Reasons::LEVEL_UNKNOWN),
        Reasons::SELF_REFERENCE,
        "it has all that it is scanned at"
    );
    // The other way round the reference has more than is asked.
    let config = FuseConfig::by(Reference::Shoulder { tyre: tyre(), shoulder: 2 });
    let judgement = whole(&config, &plan, &all).judge(0).unwrap().0;
    assert_eq!(
        (verdict(&judgement), judgement.reasons.difference(Reasons::REMARKS)),
        (Verdict::Pass, Reasons::default())
    );
}

#[test]
fn a_ring_with_a_gap_is_no_pass() {
    // Catches a crack that hides where the plan has no location: amid the ring, and over the seam.
    let casing = Casing { smooth: 0.1, location_sd: 0.2, ..Casing::default() };
    let whole_plan = casing.plan();
    let all = records(&casing, &whole_plan, 3);
    let own = FuseConfig::by(Reference::Own);
    let is_blind = |plan: &Plan, all: &[Discriminators]| {
        let judgement = whole(&own, plan, all).judge(0).unwrap().0;
        let is_blind = judgement.reasons.contains(Reasons::LOCATION_BLIND);
        assert!(!is_blind || verdict(&judgement) != Verdict::Pass);
        is_blind
    };
    assert!(!is_blind(&whole_plan, &all));
    for gap in [40..46, 57..58, 95..100, 0..4] {
        let (plan, left) = without(&whole_plan, &all, |id| !gap.contains(&id.location));
        assert!(is_blind(&plan, &left), "{gap:?}");
    }
    // Every second location is a coarser ring, and no gap.
    let (plan, left) = without(&whole_plan, &all, |id| id.location % 2 == 0);
    assert!(!is_blind(&plan, &left));
    // A gap at one offset is one, unless little more than that was tapped there.
    let gap_at = |mm: f64, gap: std::ops::Range<u32>| {
        let (plan, left) = without(&whole_plan, &all, |id| id.offset_mm() != Some(mm) || !gap.contains(&id.location));
        is_blind(&plan, &left)
    };
    assert!(gap_at(0.0, 10..40) && gap_at(0.0, 10..90) && gap_at(10.0, 10..40) && !gap_at(10.0, 5..95));
    // A line has ends, and may be tapped in parts.
    let (plan, left) = without(&whole_plan, &all, |id| id.location < 100 && !(40..46).contains(&id.location));
    let line = Plan::new(Geometry::Line, recording(), plan.taps().to_vec(), Truth::new()).unwrap();
    assert!(!is_blind(&line, &left));
}

#[test]
fn a_flag_on_most_taps_is_a_remark() {
    // Catches a rate that no casing has, or hum on every tap, that passes without a word; a flag on half of the taps that is
    // remarked; and a remark that takes PASS away, or stays when the taps are made again.
    let casing = Casing::default();
    let plan = casing.plan();
    let found = records(&casing, &plan, 1);
    let of = |flag: Quality, flagged: usize| {
        let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan).unwrap();
        for (k, record) in found.iter().enumerate() {
            let quality = if k < flagged { flag } else { Quality::default() };
            fusion.push(&Discriminators { quality, ..*record }).unwrap();
        }
        fusion.end(0).unwrap();
        fusion
    };
    let reasons = |fusion: &mut Fusion| {
        let judgement = fusion.judge(0).unwrap().0;
        assert_eq!(verdict(&judgement), Verdict::Pass);
        judgement.reasons.difference(Reasons::SELF_REFERENCE | Reasons::EXTRAPOLATED | Reasons::ONE_SHOULDER)
    };
    let half = found.len() / 2;
    for flag in [Quality::RATE_IMPLAUSIBLE, Quality::HUM] {
        assert_eq!(reasons(&mut of(flag, found.len())), Reasons::FLAGGED, "{flag}");
        assert_eq!(reasons(&mut of(flag, half)), Reasons::default(), "{flag}");
        let mut most = of(flag, half + 1);
        assert_eq!(reasons(&mut most), Reasons::FLAGGED, "{flag}");
        let mut again = found[0];
        again.id.attempt += 1;
        most.push(&again).unwrap();
        assert_eq!(reasons(&mut most), Reasons::default(), "{flag}");
    }
}

#[test]
fn a_casing_of_one_shoulder_is_remarked_on() {
    // Catches a PASS that seems to be of both shoulders, and a remark on a slab, which has none.
    let is_remarked = |shoulder_count: u16, geometry: Geometry| {
        let casing = Casing { shoulder_count, ..Casing::default() };
        let ring = casing.plan();
        let plan = Plan::new(geometry, recording(), ring.taps().to_vec(), Truth::new()).unwrap();
        let judgement = whole(&FuseConfig::by(Reference::Own), &plan, &records(&casing, &ring, 1)).judge(0).unwrap().0;
        assert_eq!(verdict(&judgement), Verdict::Pass);
        judgement.reasons.contains(Reasons::ONE_SHOULDER)
    };
    assert!(is_remarked(1, Geometry::Ring));
    assert!(!is_remarked(2, Geometry::Ring) && !is_remarked(1, Geometry::Line));
}
