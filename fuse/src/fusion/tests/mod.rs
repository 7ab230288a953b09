//! The laws of the fusion: order, completeness, false calls, found cracks, and no panic on any input.

use proptest::prelude::*;
use tapline_wire::{DamageCell, Geometry, Judgement, PlannedTap, Reasons, Truth, Verdict};

use super::*;
use crate::IndexKind;
use crate::testing::{Casing, recording, records, tyre, whole_by};

mod absent;
mod again;
mod level;
mod off_velocity;
mod rates;
mod reasons;
mod second_reading;

/// All of `records` pushed, all scans ended.
fn whole(config: &FuseConfig, plan: &Plan, records: &[Discriminators]) -> Fusion {
    whole_by(config, plan, None, records)
}

fn verdict(judgement: &Judgement) -> Verdict {
    Verdict::from_code(judgement.verdict).unwrap()
}

/// Every bit of a judgement and its cells, NaN included.
fn bits(of: &(Judgement, Vec<DamageCell>)) -> String {
    let cells = of.1.iter().map(|c| (c.damage_index.to_bits(), c.p_value.to_bits()));
    format!("{of:?} {:?}", cells.collect::<Vec<_>>())
}

fn refusal(record: &Discriminators) -> Discriminators {
    Discriminators { quality: Quality::REFUSED, values: Values::default(), ..*record }
}

fn small() -> Casing {
    Casing {
        shoulder_count: 2,
        location_count: 12,
        offsets_mm: vec![0.0],
        velocities_m_per_s: vec![1.0],
        ..Casing::default()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn the_order_of_arrival_is_in_no_result(
        order in Just((0..104_usize).collect::<Vec<_>>()).prop_shuffle(), repeated in 0_usize..52, again in 0_usize..52,
        is_dissertation: bool
    ) {
        // Catches sums in order of arrival, an older attempt that replaces a newer, a repeat counted twice.
        let casing = small();
        let plan = casing.plan();
        let index = if is_dissertation { IndexKind::Dissertation } else { IndexKind::Fused };
        let config = FuseConfig { index, ..FuseConfig::by(Reference::Own) };
        let mut all = records(&casing, &plan, 3);
        all.extend(records(&casing, &plan, 4));
        for newer in &mut all[52..] {
            newer.id.attempt = u16::from(newer.plan_index % 3 == 0); // else a different record of the same attempt
        }
        all[repeated] = refusal(&all[repeated]);
        all.push(all[again]);
        let mut straight = whole(&config, &plan, &all);
        let shuffled: Vec<_> = order.iter().chain([&104]).map(|&i| all[i]).collect();
        let mut shuffled = whole(&config, &plan, &shuffled);
        for scan in [1, 0] {
            prop_assert_eq!(bits(&straight.judge(scan).unwrap()), bits(&shuffled.judge(scan).unwrap()));
        }
    }

    #[test]
    fn no_record_makes_it_panic(
        wild in prop::collection::vec((0_u32..60, any::<f64>(), any::<f64>(), any::<u32>(), any::<u16>()), 0..80),
        index in prop_oneof![Just(IndexKind::Fused), Just(IndexKind::Dissertation)], named: bool
    ) {
        // Catches overflow, NaN in a comparison, and an index or a limit out of thin air.
        let plan = small().plan();
        let reference = if named { Reference::Shoulder { tyre: tyre(), shoulder: 2 } } else { Reference::Own };
        let mut fusion = Fusion::new(&FuseConfig { index, ..FuseConfig::by(reference) }, &plan).unwrap();
        for (plan_index, a, b, quality, attempt) in wild {
            let mut values = Values::default();
            values.set(Discriminator::Tau, Some(a));
            values.set(Discriminator::Pr, Some(b));
            let mut id = plan.taps().get(plan_index as usize).map_or(TapId::default(), |t| t.id);
            id.attempt = attempt;
            let record = Discriminators { id, plan_index, quality: Quality::from_bits_retain(quality), values, ..Default::default() };
            prop_assert_eq!(fusion.push(&record).is_ok(), (plan_index as usize) < plan.taps().len());
        }
        for scan in 0..2 {
            let (judgement, cells) = fusion.judge(scan).unwrap();
            prop_assert_ne!(verdict(&judgement), Verdict::Pass);
            prop_assert!(cells.iter().all(|c| !c.damage_index.is_infinite()));
        }
    }
}

#[test]
fn a_scan_can_be_judged_when_it_and_its_reference_are_whole() {
    // Catches a verdict before the end, before the last tap, and before the other shoulder.
    let casing = small();
    let plan = casing.plan();
    let all = records(&casing, &plan, 1);
    let can = |fusion: &Fusion| [0, 1].map(|scan| fusion.can_be_judged(scan));
    let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan).unwrap();
    for record in &all[..51] {
        fusion.push(record).unwrap();
    }
    fusion.end(0).unwrap();
    fusion.end(1).unwrap();
    assert_eq!(can(&fusion), [false; 2], "the tyre lacks a tap");
    let mut set_aside = all[51];
    set_aside.quality.insert(Quality::RETAKE);
    fusion.push(&set_aside).unwrap();
    assert_eq!(can(&fusion), [false; 2], "what is taken again has not come");
    fusion.push(&refusal(&all[51])).unwrap();
    assert_eq!(can(&fusion), [true; 2], "refused is not missing");

    let named = FuseConfig::by(Reference::Shoulder { tyre: tyre(), shoulder: 1 });
    let mut fusion = whole(&named, &plan, &all[..26]);
    assert_eq!(can(&fusion), [false; 2], "scan 0 is compared with scan 1 of its casing as a whole");
    assert!(fusion.judge(0).unwrap().0.reasons.contains(Reasons::SELF_REFERENCE), "compared with itself");
    assert!(!fusion.judge(1).unwrap().0.reasons.contains(Reasons::SELF_REFERENCE));
}

#[test]
fn what_does_not_fit_the_plan_is_an_error() {
    // Catches a panic on a foreign record, and a record of one plan taken for another's.
    let casing = small();
    let plan = casing.plan();
    let all = records(&casing, &plan, 1);
    let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan).unwrap();
    let beyond = Discriminators { plan_index: 52, ..all[0] };
    assert_eq!(fusion.push(&beyond), Err(Error::NoSuchRow { got: 52, tap_count: 52 }));
    let other = Discriminators { plan_index: 7, ..all[0] };
    assert!(matches!(fusion.push(&other), Err(Error::OtherTap { row: 7, .. })));
    assert_eq!(fusion.end(2), Err(Error::NoSuchScan { got: 2, scan_count: 2 }));
    assert!(fusion.judge(2).is_err() && !fusion.can_be_judged(2));
    let reference = Reference::Shoulder { tyre: tyre(), shoulder: 3 };
    let error = Fusion::new(&FuseConfig::by(reference), &plan).unwrap_err();
    assert_eq!(error, Error::ReferenceNotPlanned { tyre: tyre(), shoulder: 3, scan_count: 2 });
}

#[test]
fn only_a_whole_sound_scan_passes() {
    // Catches any way to PASS without an end or with a tap or a location missing: all 32 states.
    for state in 0..32 {
        let is = |bit: u32| state >> bit & 1 == 1;
        let (is_open, is_missing, is_refused, is_blind, is_cracked) = (is(0), is(1), is(2), is(3), is(4));
        let cracks = if is_cracked { vec![(1, 40..45)] } else { vec![] };
        let casing = Casing { cracks, shift: 4.0, ..Casing::default() };
        let plan = casing.plan();
        let mut all = records(&casing, &plan, 11);
        for record in &mut all {
            if is_blind && record.id.location == 70 {
                record.values = Values::default();
            }
        }
        if is_refused {
            all[5] = refusal(&all[5]);
        }
        let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan).unwrap();
        for record in &all[usize::from(is_missing)..] {
            fusion.push(record).unwrap();
        }
        if !is_open {
            fusion.end(0).unwrap();
        }
        let (judgement, cells) = fusion.judge(0).unwrap();
        let expected = match state {
            16.. => Verdict::Reject,
            0 => Verdict::Pass,
            _ => Verdict::ReInspect,
        };
        let reasons = judgement.reasons;
        assert_eq!(verdict(&judgement), expected, "{state:05b} {reasons}");
        for (flag, is_set) in [
            (Reasons::NOT_ENDED, is_open),
            (Reasons::TAPS_MISSING, is_missing),
            (Reasons::TAPS_REFUSED, is_refused),
            (Reasons::LOCATION_BLIND, is_blind),
            (Reasons::DAMAGE, is_cracked),
            (Reasons::SELF_REFERENCE, true),
            (Reasons::NO_INDEX, false),
        ] {
            assert_eq!(reasons.contains(flag), is_set, "{state:05b} {reasons}");
        }
        assert_eq!(judgement.planned_count, 808);
        assert_eq!(judgement.received_count + judgement.refused_count + u32::from(is_missing), 808);
        assert_eq!(judgement.refused_count, u32::from(is_refused));
        assert_eq!(judgement.absent_count, if is_blind { 8 * 6 } else { 0 });
        assert_eq!(cells[70].damage_index.is_nan(), is_blind);
    }
}

#[test]
fn a_crack_of_three_locations_is_rejected_and_covered() {
    // Catches limits too high, a region that misses the crack's edges, and a region cut at the seam.
    let few = vec![Discriminator::FMax, Discriminator::Tau, Discriminator::Pr, Discriminator::Ef];
    for (arc, shift, shifted) in
        [(40..43, 3.0, Discriminator::ALL.to_vec()), (97..100, 4.0, Discriminator::ALL.to_vec()), (0..3, 4.5, few)]
    {
        for seed in 0..8 {
            let cracks = vec![(2, arc.clone())];
            let casing = Casing {
                shoulder_count: 2,
                repetition_count: 6,
                cracks,
                shift,
                shifted: shifted.clone(),
                location_sd: 0.3,
                smooth: 0.1,
                ..Casing::default()
            };
            let plan = casing.plan();
            let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &records(&casing, &plan, seed));
            let (judgement, cells) = fusion.judge(1).unwrap();
            assert_eq!(verdict(&judgement), Verdict::Reject, "{arc:?} {seed} {}", judgement.reasons);
            let of_crack = cells[arc.start as usize].region;
            assert!(of_crack > 0 && arc.clone().all(|l| cells[l as usize].region == of_crack), "{arc:?} {seed}");
            assert!(cells.iter().filter(|c| c.region > 0).count() <= 7, "{arc:?} {seed}");
            assert!(cells[arc.start as usize + 1].p_value < 1e-2);
            assert_ne!(verdict(&fusion.judge(0).unwrap().0), Verdict::Reject, "the other shoulder, {arc:?} {seed}");
        }
    }
}

#[test]
fn the_closing_tap_enters_nothing() {
    // Catches drift at the ring's end that shows as damage at its start, also under the start's own number.
    let casing = Casing::default();
    let numbered_on = casing.plan();
    let mut taps = numbered_on.taps().to_vec();
    for tap in taps.iter_mut().filter(|t| t.is_closing()) {
        (tap.id.location, tap.id.repetition) = (0, tap.id.repetition + casing.repetition_count);
    }
    let as_start = Plan::new(Geometry::Ring, recording(), taps, Truth::new()).unwrap();
    for plan in [numbered_on, as_start] {
        let mut all = records(&casing, &plan, 6);
        let before = whole(&FuseConfig::by(Reference::Own), &plan, &all).judge(0).unwrap();
        for (record, _) in all.iter_mut().zip(plan.taps()).filter(|(_, tap)| tap.is_closing()) {
            record.values.set(Discriminator::Pr, Some(-1e9));
        }
        let after = whole(&FuseConfig::by(Reference::Own), &plan, &all).judge(0).unwrap();
        assert!(after.0.drift[4] < before.0.drift[4] && before.0.drift[4] > 1.0, "it shows the drift");
        let mut before = before;
        before.0.drift = after.0.drift;
        assert_eq!(bits(&before), bits(&after));
        assert_eq!((after.0.received_count, after.1.len(), after.1[0].tap_count), (808, 100, 8));
    }
}

#[test]
fn a_condition_that_lacks_taps_shows_no_damage() {
    // Catches taps standardised together whose offset or velocity alone makes them differ: the locations
    // that lack one velocity would stand out.
    let casing = Casing::default();
    let plan = casing.plan();
    let mut all = records(&casing, &plan, 8);
    for record in all.iter_mut().filter(|r| (30..34).contains(&r.id.location)) {
        if record.id.velocity_m_per_s() == Some(1.0) {
            record.values = Values::default();
        }
    }
    let (judgement, cells) = whole(&FuseConfig::by(Reference::Own), &plan, &all).judge(0).unwrap();
    assert_eq!(verdict(&judgement), Verdict::Pass, "{}", judgement.reasons);
    assert_eq!((cells[30].tap_count, cells[30].absent_count), (4, 24));
}

#[test]
fn without_an_index_there_is_no_pass() {
    // Catches 0/0 for constants and empty sets, and a PASS on nothing or on a handful of places.
    let constant = || {
        let mut values = Values::default();
        Discriminator::ALL.into_iter().for_each(|d| values.set(d, Some(3.0)));
        values
    };
    let spoilt = [(Values::default(), 6), (constant(), 0)];
    for index in [IndexKind::Fused, IndexKind::Dissertation] {
        let config = FuseConfig { index, ..FuseConfig::by(Reference::Own) };
        for location_count in [1, 2, 15, 100] {
            let casing = Casing { location_count, ..Casing::default() };
            let plan = casing.plan();
            let sound = records(&casing, &plan, 1);
            for (values, absent_count) in &spoilt {
                let mut all = sound.clone();
                all.iter_mut().for_each(|r| r.values = *values);
                let (judgement, cells) = whole(&config, &plan, &all).judge(0).unwrap();
                assert_eq!(verdict(&judgement), Verdict::ReInspect);
                assert!(judgement.reasons.contains(Reasons::NO_INDEX) && judgement.limit_reject.is_nan());
                assert!(cells.iter().all(|c| c.damage_index.is_nan() && c.p_value.is_nan() && c.region == 0));
                assert_eq!(judgement.absent_count, location_count * 8 * absent_count);
            }
            let few = whole(&config, &plan, &sound).judge(0).unwrap().0;
            assert_eq!(few.reasons.contains(Reasons::NO_INDEX), location_count < 20, "{location_count}");
            // A ring of 1 or 2 has gaps; places of the others have values, with an index or without.
            assert_eq!(few.reasons.contains(Reasons::LOCATION_BLIND), location_count < 3, "{location_count}");
            assert!(location_count > 20 || verdict(&few) != Verdict::Pass, "{}", few.reasons);
        }
    }
}

#[test]
fn each_offset_has_its_own_map() {
    // Catches mixed-up offsets, rows of an offset mistaken for rows of the plan, and an index without a tap.
    let casing = Casing { location_count: 60, offsets_mm: vec![10.0, 5.0, 0.0], shift: 8.0, ..Casing::default() };
    let plan = casing.plan();
    let cracked = records(&Casing { cracks: vec![(1, 20..26)], ..casing.clone() }, &plan, 3);
    let mut all = records(&casing, &plan, 3);
    for (record, of_crack) in all.iter_mut().zip(cracked) {
        match record.id.offset_mm() {
            Some(5.0) if record.id.location == 30 => record.values = Values::default(),
            Some(5.0) => *record = of_crack,
            _ => {}
        }
    }
    let maps = whole(&FuseConfig::by(Reference::Own), &plan, &all).by_offset(0).unwrap();
    assert_eq!(maps.iter().map(|map| map.offset_mm).collect::<Vec<_>>(), [0.0, 5.0, 10.0]);
    for map in maps {
        let is_cracked = map.offset_mm.to_bits() == 5.0_f64.to_bits();
        assert_eq!((map.index[22].unwrap() > 3.0, map.index[30].is_none()), (is_cracked, is_cracked), "{map:?}");
        assert_eq!(map.index.len(), 60);
    }
}
