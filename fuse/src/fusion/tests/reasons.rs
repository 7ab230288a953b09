//! Reasons that the plan itself gives: a condition that the reference lacks, a part of the ring that is not tapped.

use super::*;
use crate::testing::{file, set_of, shoulders_of, shoulders_of_all};

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

#[test]
fn a_part_of_the_reference_ring_is_no_pass() {
    // Catches a ring without angles that was cut short, or a coarse one, in which a crack has no place; and a whole ring, or every second
    // location with its angle, that is held up.
    let casing = Casing { shoulder_count: 2, ..Casing::default() };
    let set = Arc::new(set_of(shoulders_of_all(&casing, 6)));
    let (plan, all) = (casing.plan(), records(&casing, &casing.plan(), 3));
    let is_blind = |has_angles: bool, is_tapped: &dyn Fn(u32) -> bool| {
        let (plan, left) = without(&plan, &all, |id| is_tapped(id.location));
        let angle = |tap: &PlannedTap| tap.angle_deg.filter(|_| has_angles);
        let taps = plan.taps().iter().map(|tap| PlannedTap { angle_deg: angle(tap), ..*tap }).collect();
        let plan = Plan::new(Geometry::Ring, recording(), taps, Truth::new()).unwrap();
        whole_by(&file(), &plan, Some(&set), &left).judge(0).unwrap().0.reasons.contains(Reasons::LOCATION_BLIND)
    };
    assert!(!is_blind(true, &|_| true) && !is_blind(false, &|_| true));
    assert!(is_blind(false, &|location| location < 60) && is_blind(false, &|location| location.is_multiple_of(2)));
    assert!(!is_blind(true, &|location| location.is_multiple_of(2)));
    assert!(is_blind(true, &|location| location < 100 && location.is_multiple_of(3)));
    // By itself, only the other shoulder shows that this one was cut short.
    let cut = |id: &TapId| id.shoulder == 2 || id.location < 60;
    let (part, left) = without(&plan, &all, cut);
    let taps = part.taps().iter().map(|tap| PlannedTap { angle_deg: None, ..*tap }).collect();
    let part = Plan::new(Geometry::Ring, recording(), taps, Truth::new()).unwrap();
    let mut by_itself = whole(&FuseConfig::by(Reference::Own), &part, &left);
    let blind = [0, 1].map(|scan| by_itself.judge(scan).unwrap().0.reasons.contains(Reasons::LOCATION_BLIND));
    assert_eq!(blind, [true, false]);
    // Rings and lines have nothing in common.
    let line = Plan::new(Geometry::Line, recording(), plan.taps().to_vec(), Truth::new()).unwrap();
    let error = Fusion::by(&file(), &line, Some(set)).unwrap_err();
    assert_eq!(error, Error::OtherGeometry { planned: Geometry::Line });
}

#[test]
fn a_shoulder_that_was_forgotten_is_no_pass() {
    // Catches one shoulder of two that passes for both, where the reference's casings have two; and a rig that always taps one.
    let of = |in_reference: u16, shoulder_count: u16| {
        let casing = |shoulder_count: u16| Casing { shoulder_count, ..Casing::default() };
        let set = Arc::new(set_of(shoulders_of_all(&casing(in_reference), 6)));
        let (casing, one) = (casing(shoulder_count), Reasons::ONE_SHOULDER | Reasons::SHOULDER_MISSING);
        let judgement =
            whole_by(&file(), &casing.plan(), Some(&set), &records(&casing, &casing.plan(), 3)).judge(0).unwrap().0;
        (verdict(&judgement), judgement.reasons.intersection(one))
    };
    assert_eq!(of(2, 1), (Verdict::ReInspect, Reasons::SHOULDER_MISSING));
    assert_eq!(of(1, 1), (Verdict::Pass, Reasons::ONE_SHOULDER));
    assert_eq!(of(2, 2), (Verdict::Pass, Reasons::default()));
}

#[test]
fn a_recording_that_is_there_twice_is_no_pass() {
    // Catches the recording of one place that stands for another, on the same shoulder or the other; a second record of one tap that
    // counts for two; and values that are alike because a sensor is stuck.
    let casing = Casing { shoulder_count: 2, ..Casing::default() };
    let (plan, all) = (casing.plan(), records(&casing, &casing.plan(), 3));
    let of = |from: usize, to: usize, discriminators: &[Discriminator]| {
        let mut all = all.clone();
        for &which in discriminators {
            let value = all[from].values.get(which);
            all[to].values.set(which, value);
        }
        let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &all);
        fusion.push(&all[0]).unwrap();
        [0, 1].map(|scan| fusion.judge(scan).unwrap().0.reasons.contains(Reasons::REPEATED))
    };
    let (first, other) = (plan.scans()[0].taps[5] as usize, plan.scans()[1].taps[7] as usize);
    assert_eq!(of(first, first, &Discriminator::ALL), [false, false]);
    assert_eq!(of(first, first + 1, &Discriminator::ALL), [true, false]);
    assert_eq!(of(first, other, &Discriminator::ALL), [true, true]);
    assert_eq!(of(first, other, &Discriminator::ALL[..3]), [false, false]);
}
