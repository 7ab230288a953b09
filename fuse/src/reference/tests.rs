//! A reference file: what comes of it is what went in, what was changed is refused, and what it teaches is used.

use proptest::prelude::*;
use tapline_wire::{Discriminator, Reasons, Verdict};

use super::*;
use crate::reference::summary::ScaleLine;
use crate::testing::{Casing, built, file, records, scored, set_of, shoulders_of, shoulders_of_all, tyre, whole_by};
use crate::{Built, Direction, FuseConfig, Fusion, IndexKind, Reference, build_reference};

/// A casing with six cracks of five locations, known, and the reference of it.
fn labelled() -> Casing {
    let cracks = (0..6).map(|k| (1, 15 * k..15 * k + 5)).collect();
    Casing { cracks, shift: 3.0, ..Casing::default() }
}

/// Verdict and damage map of a casing by a reference.
fn judged(set: &ReferenceSet, config: &FuseConfig, casing: &Casing, seed: u64) -> (Verdict, Reasons, Vec<u32>) {
    let plan = casing.plan();
    let mut fusion = whole_by(config, &plan, Some(&Arc::new(set.clone())), &records(casing, &plan, seed));
    let (judgement, cells) = fusion.judge(0).unwrap();
    let regions = cells.iter().filter(|cell| cell.region > 0).map(|cell| cell.location).collect();
    (Verdict::from_code(judgement.verdict).unwrap(), judgement.reasons, regions)
}

/// The first limit, and the strongest arc, of shoulder 1 of `casing` as `plan` scans it, by a reference.
fn limit_and_arc(set: &ReferenceSet, casing: &Casing, plan: &Plan) -> (f64, f64) {
    let mut fusion = whole_by(&file(), plan, Some(&Arc::new(set.clone())), &records(casing, plan, 7));
    let judgement = fusion.judge(0).unwrap().0;
    (judgement.limit_re_inspect, judgement.strongest_arc)
}

#[test]
fn a_reference_comes_back_as_it_went() {
    // Catches a number that is rounded on its way through the file, and a digest that depends on the way.
    let set = set_of(shoulders_of(&labelled(), 1, true, "A"));
    let again = ReferenceSet::parse(&set.text().unwrap()).unwrap();
    assert_eq!(again, set);
    assert_eq!(set.digest().len(), 64);
    assert_eq!((set.summary.sound_count, set.summary.cracked_count), (70, 30));
    let lines: Vec<_> = set.summary.scales.iter().map(|s| (s.offset_mm, s.velocity_m_per_s)).collect();
    assert_eq!(lines.len(), 4 * 6, "four conditions of six discriminators");
    assert!(lines.contains(&(Some(10.0), Some(1.5))));
    // What the casing was made with: scatter 0.5 of a location and 1 of a tap, in hundredths of its level.
    let spread = set.summary.scales.iter().map(|s| s.spread).sum::<f64>() / 24.0;
    assert!((0.009..0.014).contains(&spread), "{spread}");
    assert_eq!((set.summary.casing_count, set.summary.supported_rate, set.summary.strongest.len()), (1, None, 0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_reference_that_was_changed_is_refused(at in any::<prop::sample::Index>(), to in any::<u8>()) {
        // Catches a digest that leaves a part of the file out, and a panic on a file that is none.
        let small = Casing { location_count: 20, offsets_mm: vec![0.0], velocities_m_per_s: vec![1.0], ..Casing::default() };
        let set = set_of(shoulders_of(&small, 1, false, "A"));
        let mut bytes = set.text().unwrap().into_bytes();
        let place = at.index(bytes.len());
        prop_assume!(bytes[place] != to);
        bytes[place] = to;
        if let Ok(text) = String::from_utf8(bytes) && let Ok(other) = ReferenceSet::parse(&text) {
            // White space, or a digit beyond what a number holds.
            prop_assert_eq!(other, set);
        }
    }
}

#[test]
fn what_is_no_reference_is_refused() {
    // Catches a panic, and an error that does not say what is wrong.
    let good = set_of(shoulders_of(&labelled(), 1, true, "A"));
    let refusal = |set: ReferenceSet| ReferenceSet::parse(&set.signed().text().unwrap()).unwrap_err().to_string();
    let with = |change: &dyn Fn(&mut KnownShoulder)| {
        let mut set = good.clone();
        change(&mut set.shoulders[0]);
        // It is not made either.
        let unmade = build_reference(&built(), set.shoulders.clone()).unwrap_err().to_string();
        let read = refusal(set);
        assert_eq!(unmade, read);
        read
    };
    assert!(with(&|s| s.tyre = String::new()).contains("serial"));
    assert!(with(&|s| s.locations.swap(0, 1)).contains("ascending"));
    assert!(with(&|s| s.angles_deg.truncate(99)).contains("99"));
    assert!(with(&|s| s.is_cracked.as_mut().unwrap().truncate(1)).contains("column of 1"));
    assert!(with(&|s| s.turns[0].velocities_measured_m_per_s.truncate(99)).contains("99"));
    assert!(with(&|s| s.turns[0].offset_mm = Some(1e9)).contains("turn"));
    assert!(with(&|s| drop(s.turns[0].values.insert("loudness".into(), vec![None; 100]))).contains("loudness"));
    assert!(refusal(ReferenceSet { shoulders: vec![], ..good.clone() }).contains("no shoulder"));
    let other = good.text().unwrap().replace("tapline-reference-1", "tapline-reference-9");
    assert!(ReferenceSet::parse(&other).unwrap_err().to_string().contains("tapline-reference-9"));
    assert!(build_reference(&built(), vec![]).is_err());
    let constant = KnownShoulder { turns: vec![], ..good.shoulders[0].clone() };
    assert!(build_reference(&built(), vec![constant]).unwrap_err().to_string().contains("their values do not vary"));
}

#[test]
fn a_shoulder_that_is_there_twice_is_refused() {
    // Catches a shoulder that counts double, as if two casings agreed; the other side of a casing is no repeat.
    let both = Casing { shoulder_count: 2, ..Casing::default() };
    let mut set = set_of(shoulders_of(&both, 1, false, "A"));
    assert!(ReferenceSet::parse(&set.clone().signed().text().unwrap()).is_ok());
    // Apart from each other, so that it is not neighbours only that are compared.
    set.shoulders.push(set.shoulders[0].clone());
    assert!(build_reference(&built(), set.shoulders.clone()).unwrap_err().to_string().contains("A/1 twice"));
    let error = ReferenceSet::parse(&set.signed().text().unwrap()).unwrap_err();
    assert!(error.to_string().contains("A/1 twice"), "{error}");
}

#[test]
fn a_number_that_was_edited_is_refused() {
    // Catches a digest that vouches for the shoulders and not for the limits, the labels or the analysis, or the reverse.
    let set = set_of(shoulders_of(&labelled(), 1, true, "A"));
    let refused = |change: &dyn Fn(&mut ReferenceSet)| {
        let mut edited = set.clone();
        change(&mut edited);
        let parsed = ReferenceSet::parse(&edited.text().unwrap());
        assert!(parsed.unwrap_err().to_string().contains("it was changed"));
    };
    refused(&|set| set.summary.limit_reject += 1e-9);
    refused(&|set| set.summary.scales[0].spread *= 1.0 + 1e-12);
    refused(&|set| set.shoulders[0].turns[0].values.get_mut("pr").unwrap()[3] = Some(0.25));
    refused(&|set| set.shoulders[0].is_cracked.as_mut().unwrap()[0] = false);
    refused(&|set| set.process = set.process.replace("550", "551"));
    refused(&|set| set.directions.set(Discriminator::Pr, Direction::Falls));
}

#[test]
fn rings_of_another_number_of_locations_are_refused() {
    // Catches arcs of so many locations compared with arcs of another length.
    let set = set_of(shoulders_of(&Casing::default(), 1, false, "A"));
    let plan = Casing { location_count: 50, ..Casing::default() }.plan();
    let error = Fusion::by(&file(), &plan, Some(Arc::new(set))).unwrap_err();
    assert_eq!(error, Error::OtherLocations { known: 100, planned: 50 });
    // Nor are such rings one reference.
    let mut mixed = shoulders_of(&Casing::default(), 1, false, "A");
    mixed.extend(shoulders_of(&Casing { location_count: 50, ..Casing::default() }, 2, false, "B"));
    let error = build_reference(&built(), mixed).unwrap_err().to_string();
    assert!(error.contains("A/1 has 100 locations of a ring, B/1 has 50 locations"), "{error}");
}

#[test]
fn a_reference_is_cut_to_the_turns_of_the_scan() {
    // Catches a scan of one repetition judged by the scatter of two, and what the scan does not have that teaches.
    let both = Casing { shoulder_count: 2, ..Casing::default() };
    let once = Casing { repetition_count: 1, offsets_mm: vec![0.0], ..both.clone() };
    let whole = set_of(shoulders_of_all(&both, 6));
    let mut cut = whole.clone();
    for shoulder in &mut cut.shoulders {
        shoulder.turns.retain(|turn| turn.repetition == 0 && turn.offset_mm == Some(0.0));
    }
    let plan = once.plan();
    let by_whole = limit_and_arc(&whole, &once, &plan);
    assert_eq!(by_whole, limit_and_arc(&cut, &once, &plan));
    assert!((by_whole.0 - whole.summary.limit_re_inspect).abs() > 1e-6);
}

#[test]
fn another_casing_is_judged_by_a_reference() {
    // Catches a reference that is not used, a casing damaged for its level, and a mark of self-reference where there is none.
    let sound = Casing { shoulder_count: 2, ..Casing::default() };
    let set = set_of(shoulders_of_all(&sound, 8));
    let (verdict, reasons, regions) = judged(&set, &file(), &sound, 7);
    assert_eq!((verdict, reasons, regions), (Verdict::Pass, Reasons::EXTRAPOLATED, vec![]));
    let cracked = Casing { cracks: vec![(1, 40..46)], shift: 3.0, ..sound.clone() };
    let (verdict, _, regions) = judged(&set, &file(), &cracked, 7);
    assert_eq!(verdict, Verdict::Reject);
    assert!((40..46).all(|location| regions.contains(&location)) && regions.len() <= 9, "{regions:?}");
    // All round, both shoulders: only the levels of the reference's casings show it.
    let all_round = Casing { cracks: vec![(1, 0..100), (2, 0..100)], shift: 8.0, ..sound };
    let (verdict, reasons, _) = judged(&set, &file(), &all_round, 7);
    assert!(verdict != Verdict::Pass && reasons.contains(Reasons::LEVEL_OFF), "{reasons}");
}

#[test]
fn every_index_finds_a_crack_beside_labelled_ones() {
    // Catches cracked places of a reference that teach what is sound.
    let set = set_of(shoulders_of(&labelled(), 1, true, "A"));
    let casing = Casing { cracks: vec![(1, 40..46)], shift: 2.5, ..Casing::default() };
    let plan = casing.plan();
    let found = records(&casing, &plan, 9);
    for index in IndexKind::ALL {
        let config = FuseConfig { index, ..file() };
        let score = scored(Fusion::by(&config, &plan, Some(Arc::new(set.clone()))).unwrap(), &found);
        assert!(score.index.unwrap() > 0.9, "{} {score:?}", index.name());
    }
    assert_eq!(judged(&set, &file(), &casing, 9).0, Verdict::Reject);
}

#[test]
fn directions_are_learned_where_labels_suffice() {
    // Catches a direction learned from noise, and one that labels contradict and that stays.
    let casing = Casing { shifted: vec![Discriminator::Pr, Discriminator::Tau], ..labelled() };
    let mut wrong = built();
    wrong.config.directions.set(Discriminator::Pr, Direction::Falls);
    wrong.config.directions.set(Discriminator::A1, Direction::Falls);
    let of = |learns_directions| {
        let of = Built { learns_directions, ..wrong.clone() };
        build_reference(&of, shoulders_of(&casing, 1, true, "A")).unwrap()
    };
    assert_eq!((of(true).learned, of(false).learned), (vec![Discriminator::Tau, Discriminator::Pr], vec![]));
    let directions = of(true).directions;
    let learned = [Discriminator::Pr, Discriminator::Tau, Discriminator::A1].map(|which| directions.of(which));
    assert_eq!(learned, [Direction::Rises, Direction::Rises, Direction::Falls]);
    assert_eq!(of(false).directions.of(Discriminator::Pr), Direction::Falls);
    assert!(of(false).auc["pr"] > 0.9 && (0.3..0.7).contains(&of(false).auc["a_1"]), "{:?}", of(false).auc);
    // A crack counts once, however many locations it has, and over the seam of the ring too: three are too few.
    let three = Casing { cracks: vec![(1, 90..100), (1, 0..10), (1, 30..40), (1, 60..70)], shift: 6.0, ..casing };
    assert_eq!(
        build_reference(&Built { learns_directions: true, ..wrong }, shoulders_of(&three, 1, true, "A"))
            .unwrap()
            .learned,
        []
    );
}

#[test]
fn a_spread_is_a_fraction_of_the_value_and_of_casings() {
    // Catches the spread of ln(x/(1-x)) in place of that of a power ratio x, and turns of one casing that count like casings.
    let of = |casings| set_of(sound(casings)).summary.scales;
    let pr_and_tau = |scales: &[ScaleLine]| {
        let of =
            |which| scales.iter().filter(move |line| line.discriminator == which).map(|line| line.spread).sum::<f64>();
        of(Discriminator::Pr) / of(Discriminator::Tau)
    };
    // The values of both scatter alike, and PR is 0.3.
    let ratio = pr_and_tau(&of(3));
    assert!((ratio - 1.0).abs() < 0.15, "{ratio}");
    assert!(of(2).iter().all(|line| line.level_spread.is_none()), "two casings of two shoulders are two");
    assert!(of(3).iter().all(|line| line.level_spread.is_some()));
}

#[test]
fn a_plan_without_a_condition_in_common_is_refused() {
    // Catches taps compared with those of other offsets, and a run that ends with no index at all.
    let set = set_of(shoulders_of(&Casing::default(), 1, false, "A"));
    let elsewhere = Casing { offsets_mm: vec![5.0], ..Casing::default() }.plan();
    let error = Fusion::by(&file(), &elsewhere, Some(Arc::new(set.clone()))).unwrap_err();
    assert!(error.to_string().contains("10 mm, 1.5 m/s") && error.to_string().contains("5 mm, 1 m/s"), "{error}");
    // One in common serves: the crack is found by what is left.
    let part = Casing { offsets_mm: vec![0.0, 5.0], cracks: vec![(1, 40..46)], shift: 4.0, ..Casing::default() };
    assert_eq!(judged(&set, &file(), &part, 3).0, Verdict::Reject);
    assert_eq!(tyre().to_string(), "T1");
}

#[test]
fn a_reference_is_cut_to_the_locations_of_the_scan() {
    // Catches a coarse scan judged by arcs of places that it does not have.
    let both = Casing { shoulder_count: 2, ..Casing::default() };
    let whole = set_of(shoulders_of_all(&both, 6));
    let mut cut = whole.clone();
    for shoulder in &mut cut.shoulders {
        shoulder.locations = shoulder.locations.iter().copied().step_by(2).collect();
        shoulder.angles_deg = shoulder.angles_deg.iter().copied().step_by(2).collect();
        for turn in &mut shoulder.turns {
            turn.velocities_measured_m_per_s = turn.velocities_measured_m_per_s.iter().copied().step_by(2).collect();
            turn.values.values_mut().for_each(|column| *column = column.iter().copied().step_by(2).collect());
        }
    }
    let all = both.plan();
    let coarse = |tap: &&tapline_wire::PlannedTap| tap.id.location.is_multiple_of(2);
    let taps: Vec<_> = all.taps().iter().filter(coarse).copied().collect();
    let plan = Plan::new(all.geometry, all.recording.clone(), taps, all.truth().clone()).unwrap();
    assert_eq!(limit_and_arc(&whole, &both, &plan), limit_and_arc(&cut, &both, &plan));
}

/// `count` sound casings of two shoulders, A0, A1, ...
fn sound(count: u64) -> Vec<KnownShoulder> {
    let casing = Casing { shoulder_count: 2, repetition_count: 1, ..Casing::default() };
    shoulders_of_all(&casing, count)
}

/// A casing whose shoulder 1 is cracked, `of` how many locations.
fn cracked(of: u32, with_labels: bool, serial: &str) -> Vec<KnownShoulder> {
    let first = if of > 90 { 0 } else { 10 };
    let cracks = vec![(1, first..first + of)];
    let casing = Casing { shoulder_count: 2, repetition_count: 1, cracks, shift: 6.0, ..Casing::default() };
    shoulders_of(&casing, 7, with_labels, serial)
}

#[test]
fn what_stands_out_of_a_reference_is_named() {
    // Catches a cracked casing that is taken to be sound because its limits were widened by itself, or by another such, one
    // cracked all round, which has no arc, and sound ones that are named.
    let named = |shoulders| set_of(shoulders).summary.standing_out;
    for count in [2, 3, 4, 8, 12] {
        assert!(named(sound(count)).is_empty(), "{count}");
        assert_eq!(named([sound(count), cracked(5, false, "C")].concat()), ["C"], "{count}");
    }
    assert_eq!(named([sound(7), cracked(5, false, "C"), cracked(2, false, "D")].concat()), ["C", "D"]);
    assert_eq!(named([sound(7), cracked(90, false, "C"), cracked(3, false, "D")].concat()), ["C", "D"]);
    assert_eq!(named([sound(7), cracked(5, true, "C")].concat()), [""; 0], "labels say which places are sound");
}

#[test]
fn labelled_damage_does_not_hide_damage_all_round() {
    // Catches the level of a shoulder that is known to be cracked all round among those of sound ones, and a reference that such
    // a shoulder makes impossible.
    let all_round =
        Casing { shoulder_count: 2, cracks: vec![(1, 0..100), (2, 0..100)], shift: 8.0, ..Casing::default() };
    for of in [60, 90, 100] {
        for serial in ["0", "Z"] {
            let labelled: Vec<KnownShoulder> = sound(7)
                .into_iter()
                .map(|shoulder| KnownShoulder { is_cracked: Some(vec![false; 100]), ..shoulder })
                .chain(cracked(of, true, serial))
                .collect();
            let set = set_of(labelled);
            let (verdict, reasons, _) = judged(&set, &file(), &all_round, 7);
            assert!(verdict != Verdict::Pass && reasons.contains(Reasons::LEVEL_OFF), "{of} {serial}: {reasons}");
        }
    }
}

#[test]
fn few_casings_give_no_level() {
    // Catches a PASS that does not say that damage all round was not looked for, and a remark where it was.
    let casing = Casing { shoulder_count: 2, repetition_count: 1, ..Casing::default() };
    for count in [1, 7, 8] {
        let set = set_of(sound(count));
        let (verdict, reasons, _) = judged(&set, &file(), &casing, 7);
        assert_eq!(
            (verdict, reasons.contains(Reasons::LEVEL_UNKNOWN)),
            (Verdict::Pass, count < 8),
            "{count}: {reasons}"
        );
        let said = crate::unsupported(&file(), Some(&set)).iter().any(|text| text.starts_with("level:"));
        assert_eq!(said, count < 8, "{count}");
    }
}

#[test]
fn a_crack_does_not_shift_the_level() {
    // Catches a level that cracked places shift: the sound shoulder beside them would differ from it, and not pass.
    let set = Arc::new(set_of(sound(8)));
    for count in [10, 30, 50] {
        let cracks = vec![(1, 0..count)];
        let casing = Casing { shoulder_count: 2, repetition_count: 1, cracks, shift: 6.0, ..Casing::default() };
        let plan = casing.plan();
        for seed in 0..5 {
            let mut fusion = whole_by(&file(), &plan, Some(&set), &records(&casing, &plan, seed));
            for scan in 0..2 {
                let (judgement, _) = fusion.judge(scan).unwrap();
                let f_max = judgement.level[Discriminator::FMax as usize];
                assert!(
                    !judgement.reasons.contains(Reasons::LEVEL_OFF),
                    "{count} {seed} {scan}: {}",
                    judgement.reasons
                );
                assert!((f_max - 1.0).abs() < 0.02, "{count} {seed} {scan}: {f_max}");
            }
        }
    }
}

#[test]
fn the_level_is_a_multiple_of_the_reference() {
    // Catches a level beside another discriminator or turn, one of the logarithm of PR / (1 - PR), and one beside the casing itself.
    let set = Arc::new(set_of(sound(8)));
    let casing = Casing { shoulder_count: 2, repetition_count: 1, ..Casing::default() };
    let plan = casing.plan();
    let level = |times: f64, config: &FuseConfig, set: Option<&Arc<ReferenceSet>>| {
        let mut all = records(&casing, &plan, 7);
        for record in all.iter_mut().filter(|record| record.id.shoulder == 1) {
            for which in [Discriminator::FMax, Discriminator::A1, Discriminator::Pr] {
                record.values.set(which, record.values.get(which).map(|x| x * times));
            }
        }
        let mut fusion = whole_by(config, &plan, set, &all);
        [0, 1].map(|scan| fusion.judge(scan).unwrap().0.level)
    };
    let ([before, other], [after, same]) = (level(1.0, &file(), Some(&set)), level(1.25, &file(), Some(&set)));
    // Casings made up for tests have no centroid.
    assert!(before[Discriminator::Centroid as usize].is_nan());
    for which in Discriminator::ALL.into_iter().filter(|which| *which != Discriminator::Centroid) {
        let is_changed = [Discriminator::FMax, Discriminator::A1, Discriminator::Pr].contains(&which);
        let (before, after) = (before[which as usize], after[which as usize]);
        assert!((before - 1.0).abs() < 0.03, "{which:?} {before}");
        assert!((after / before - if is_changed { 1.25 } else { 1.0 }).abs() < 1e-3, "{which:?} {before} {after}");
    }
    assert_eq!(other.map(f64::to_bits), same.map(f64::to_bits));
    assert!(level(1.25, &FuseConfig::by(Reference::Own), None)[0].iter().all(|times| times.is_nan()));
}

#[test]
fn a_casing_that_is_noisier_than_the_reference_is_compared_with_itself() {
    // Catches noise that is taken for damage, a crack that is lost in it, and sound casings that are called noisy, or are so when they
    // are quieter.
    let set = set_of(sound(8));
    let noisy = Casing { tap_sd: 3.0, ..Casing::default() };
    let cracked = Casing { cracks: vec![(1, 40..46)], shift: 12.0, ..noisy.clone() };
    for seed in 0..10 {
        let (verdict, reasons, _) = judged(&set, &file(), &noisy, seed);
        let expected = Reasons::SCATTER_OFF | Reasons::SELF_REFERENCE;
        assert!(verdict == Verdict::ReInspect && reasons.contains(expected), "{seed}: {verdict} {reasons}");
        let (verdict, reasons, regions) = judged(&set, &file(), &cracked, seed);
        assert!(verdict == Verdict::Reject && reasons.contains(Reasons::SCATTER_OFF), "{seed}: {verdict} {reasons}");
        assert!((41..45).all(|location| regions.contains(&location)), "{seed}: {regions:?}");
    }
    for (tap_sd, most) in [(1.0, 1), (0.5, 0)] {
        let casing = Casing { tap_sd, ..Casing::default() };
        let called =
            (0..40).filter(|&seed| judged(&set, &file(), &casing, seed).1.contains(Reasons::SCATTER_OFF)).count();
        assert!(called <= most, "{tap_sd}: {called} of 40");
    }
}

#[test]
fn a_casing_of_one_place_does_not_pass() {
    // Catches a casing that has not turned and passes, sound ones of which that is said, and a limit that takes no account of how much sound
    // shoulders differ.
    let judged = |set: &ReferenceSet, casing: &Casing, seed| {
        let (verdict, reasons, _) = judged(set, &file(), casing, seed);
        (verdict, reasons.contains(Reasons::SCATTER_LOW))
    };
    let turning = Casing { shoulder_count: 2, location_sd: 1.5, tap_sd: 0.5, ..Casing::default() };
    let still = Casing { location_sd: 0.0, smooth: 0.0, ..turning.clone() };
    let set = set_of(shoulders_of_all(&turning, 8));
    for seed in 0..10 {
        assert_eq!(judged(&set, &still, seed), (Verdict::ReInspect, true), "{seed}");
    }
    assert!((0..40).all(|seed| !judged(&set, &turning, seed).1));
    let even = (0..4).flat_map(|k| shoulders_of(&still, k, false, &format!("B{k}")));
    let unlike = set_of(shoulders_of_all(&turning, 4).into_iter().chain(even).collect());
    assert!((0..10).all(|seed| !judged(&unlike, &still, seed).1));
    // Two casings do not show it.
    assert!((0..10).all(|seed| !judged(&set_of(shoulders_of_all(&turning, 2)), &still, seed).1));
    // Nor does a line turn.
    let mut lines = shoulders_of_all(&turning, 8);
    lines.iter_mut().for_each(|shoulder| shoulder.geometry = Geometry::Line);
    let ring = still.plan();
    let plan = Plan::new(Geometry::Line, ring.recording.clone(), ring.taps().to_vec(), ring.truth().clone()).unwrap();
    let records = records(&still, &plan, 0);
    let judgement = whole_by(&file(), &plan, Some(&Arc::new(set_of(lines))), &records).judge(0).unwrap().0;
    assert!(judgement.scatter.iter().any(|times| *times < 0.5) && !judgement.reasons.contains(Reasons::SCATTER_LOW));
}

#[test]
fn damage_by_both_comparisons_stays_on_the_scale_of_the_reference() {
    // Catches a crack whose strength is stated now by the reference and now by the casing itself, where the rig scatters somewhat more: by
    // scatter alone all of these would be compared with themselves.
    let set = set_of(sound(8));
    let casing =
        Casing { tap_sd: 1.3, cracks: vec![(1, 40..46)], shift: 12.0, repetition_count: 1, ..Casing::default() };
    for seed in 0..10 {
        let (verdict, reasons, _) = judged(&set, &file(), &casing, seed);
        assert!(verdict == Verdict::Reject && !reasons.contains(Reasons::SCATTER_OFF), "{seed}: {verdict} {reasons}");
    }
}

#[test]
fn damage_of_most_places_is_no_noise() {
    // Catches a scatter that damage raises: by its own casing half of both shoulders is no damage. And a reference whose cracks are known
    // and that does not recognise noise any more.
    let set = set_of(sound(8));
    let casing = Casing { shoulder_count: 2, repetition_count: 1, shift: 6.0, ..Casing::default() };
    for count in [30, 50, 75] {
        let cracked = Casing { cracks: vec![(1, 0..count), (2, 0..count)], ..casing.clone() };
        let called = (0..10).filter(|&seed| {
            let (verdict, reasons, _) = judged(&set, &file(), &cracked, seed);
            assert!(verdict == Verdict::Reject, "{count} {seed}: {reasons}");
            reasons.contains(Reasons::SCATTER_OFF)
        });
        // As on sound ones: a few in a hundred of each discriminator.
        let called = called.count();
        assert!(called <= 2, "{count}: {called} of 10");
    }
    let labelled = (0..4).flat_map(|n| cracked(60, true, &format!("C{n}"))).collect();
    let set = set_of(labelled);
    for seed in 0..5 {
        let (verdict, reasons, _) = judged(&set, &file(), &Casing { tap_sd: 3.0, ..casing.clone() }, seed);
        assert!(verdict == Verdict::ReInspect && reasons.contains(Reasons::SCATTER_OFF), "{seed}: {verdict} {reasons}");
    }
}

#[test]
fn limits_far_above_those_of_noise_show_a_reference_of_cracked_casings() {
    // Catches casings that are all cracked and call one another sound, with limits that no other crack reaches.
    let sound = Casing { shoulder_count: 2, ..Casing::default() };
    let cracked = Casing { cracks: vec![(1, 40..45)], shift: 4.0, ..sound.clone() };
    let ratio = |shoulders| {
        let summary = set_of(shoulders).summary;
        summary.limit_re_inspect / summary.limit_of_noise.unwrap()
    };
    assert!(ratio(shoulders_of_all(&sound, 8)) < 1.3);
    assert!(ratio(shoulders_of_all(&cracked, 8)) > 1.5);
    assert_eq!(set_of(shoulders_of(&sound, 1, false, "A")).summary.limit_of_noise, None);
}
