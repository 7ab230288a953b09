//! Rates of false calls are those that are stated, and cracks are found at them.

use super::*;
use crate::testing::{file, set_of, shoulders_of};

fn casing() -> Casing {
    Casing { shoulder_count: 2, location_count: 60, smooth: 0.1, ..Casing::default() }
}

/// A reference of `count` casings.
fn reference_of(count: u64) -> Arc<ReferenceSet> {
    let shoulders =
        (0..count).flat_map(|number| shoulders_of(&casing(), 10_000 + number, false, &format!("R{number}"))).collect();
    Arc::new(set_of(shoulders))
}

/// How many of the shoulders of `count` sound casings are not passed, and how many are rejected.
fn called(set: Option<&Arc<ReferenceSet>>, config: &FuseConfig, count: u64) -> (usize, usize) {
    let plan = casing().plan();
    let reference = if set.is_some() { config.reference.clone() } else { Some(Reference::Own) };
    let config = FuseConfig { reference, ..config.clone() };
    let mut verdicts = Vec::new();
    for seed in 0..count {
        let mut fusion = whole_by(&config, &plan, set, &records(&casing(), &plan, seed));
        for scan in [0, 1] {
            let judgement = fusion.judge(scan).unwrap().0;
            verdicts.push(verdict(&judgement));
        }
    }
    let count = |of: Verdict| verdicts.iter().filter(|&&verdict| verdict == of).count();
    (count(Verdict::ReInspect) + count(Verdict::Reject), count(Verdict::Reject))
}

#[test]
fn sound_shoulders_are_called_as_often_as_is_stated() {
    // Catches limits of another rate than they say, and ones so wide that nothing is ever called.
    let config = FuseConfig { re_inspect_rate: 0.1, ..file() };
    let set = reference_of(12);
    let (by_file, rejected) = called(Some(&set), &config, 100);
    // 20 of 200 are stated. They are not independent: the reference is one.
    assert!((5..=40).contains(&by_file), "{by_file}");
    assert!(rejected <= 2, "{rejected}");
    let (by_itself, rejected) = called(None, &config, 60);
    assert!(by_itself <= 24, "{by_itself} of 120, 12 stated");
    assert!(rejected <= 2, "{rejected}");
}

#[test]
fn what_a_reference_cannot_support_is_remarked() {
    // Catches a rate that nobody vouches for, a PASS that the remark takes away, and a rate that is supported remarked.
    let plan = casing().plan();
    let set = reference_of(12);
    let judged = |rate: f64| {
        let config = FuseConfig { re_inspect_rate: rate, reject_rate: rate, ..file() };
        let mut fusion = whole_by(&config, &plan, Some(&set), &records(&casing(), &plan, 4));
        let judgement = fusion.judge(0).unwrap().0;
        let texts = crate::unsupported(&config, Some(&set));
        (texts.len(), judgement.reasons.contains(Reasons::EXTRAPOLATED), verdict(&judgement))
    };
    assert_eq!(judged(0.08), (0, false, Verdict::Pass));
    assert_eq!(judged(0.02), (2, true, Verdict::Pass));
}
