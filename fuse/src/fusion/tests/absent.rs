//! Discriminators that are absent or stuck: a dead microphone, a sensor that says the same whatever it is asked.

use tapline_wire::{Channel, Recording};

use super::*;

/// The plan of `casing` with records of these `channels`.
fn plan_of(casing: &Casing, channels: &[Channel]) -> Plan {
    let plan = casing.plan();
    let recording = Recording { channels: channels.to_vec(), ..plan.recording.clone() };
    Plan::new(plan.geometry, recording, plan.taps().to_vec(), Truth::new()).unwrap()
}

/// Verdict, and the reasons of absent discriminators, for a casing that is its own reference; `spoil` has the number of each
/// tap that is no closing one, its name and its values. Of all scans, in their order.
fn judged(
    casing: &Casing,
    channels: &[Channel],
    spoil: impl Fn(usize, &TapId, &mut Values),
) -> Vec<(Verdict, Reasons)> {
    let plan = plan_of(casing, channels);
    let mut all = records(casing, &plan, 1);
    let entering = all.iter_mut().zip(plan.taps()).filter(|(_, tap)| !tap.is_closing());
    for (number, (record, _)) in entering.enumerate() {
        spoil(number, &record.id, &mut record.values);
    }
    let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &all);
    let of = |scan| {
        let judgement = fusion.judge(scan).unwrap().0;
        (verdict(&judgement), judgement.reasons.intersection(ABSENT))
    };
    (0..plan.scans().len()).map(of).collect()
}

const ABSENT: Reasons = Reasons::DISCRIMINATORS_ABSENT.union(Reasons::REFERENCE_INCOMPLETE);
const PASS: (Verdict, Reasons) = (Verdict::Pass, Reasons::empty());
const REPORTED: (Verdict, Reasons) = (Verdict::ReInspect, Reasons::DISCRIMINATORS_ABSENT);

#[test]
fn a_discriminator_that_most_taps_lack_is_reported() {
    // Catches a limit that is not at one half, counted in locations or among the taps that came alone, and closing taps that
    // count: of 800 taps 400 or 401 lack it.
    let lacks = |count: usize| {
        judged(&Casing::default(), &Channel::BOTH, |number, _, values| {
            // Of the four turns of 100 in every two, one and then the other: no location lacks more than another.
            let place = number % 200;
            if place < 100 && number / 200 * 100 + place < count || number == 150 && count == 401 {
                values.set(Discriminator::Ef, None);
            }
        })
    };
    assert_eq!(lacks(0), [PASS]);
    assert_eq!(lacks(400), [PASS]);
    assert_eq!(lacks(401), [REPORTED]);
    // What the index does not ask for may lack.
    assert_eq!(judged(&Casing::default(), &Channel::BOTH, |_, _, values| values.set(Discriminator::A2, None)), [PASS]);
}

#[test]
fn a_channel_that_dies_is_reported_and_one_that_is_not_there_is_not() {
    // Catches a dead microphone, or a dead force sensor, that passes because the other is there; and a rig without a
    // microphone that never passes.
    let of = |channels: &[Channel], dead: Channel| {
        judged(&Casing::default(), channels, |_, _, values| {
            for which in Discriminator::ALL.into_iter().filter(|which| which.channels().contains(&dead)) {
                values.set(which, None);
            }
        })
    };
    assert_eq!(of(&Channel::BOTH, Channel::Sound), [REPORTED]);
    assert_eq!(of(&Channel::BOTH, Channel::Force), [REPORTED]);
    assert_eq!(of(&[Channel::Force], Channel::Sound), [PASS]);
    assert_eq!(of(&[Channel::Sound], Channel::Force), [PASS]);
}

#[test]
fn a_stuck_sensor_is_reported() {
    // Catches one that says the same of every tap, and so of nothing; and values that are alike by chance, or in a few taps.
    let stuck = |is_stuck: fn(usize) -> bool| {
        judged(&Casing::default(), &Channel::BOTH, |number, _, values| {
            if is_stuck(number) {
                values.set(Discriminator::Pr, Some(0.3125));
            }
        })[0]
    };
    assert_eq!(stuck(|_| true), REPORTED);
    assert!(stuck(|number| number < 400).1.is_empty());
    let found = stuck(|number| number <= 400);
    assert!(!found.1.is_empty() && found.0 != Verdict::Pass, "{found:?}");
}

#[test]
fn one_tap_of_a_discriminator_is_not_stuck() {
    // Catches a lone value that is alike with itself, where one tap is all that was asked for.
    let one = Casing {
        location_count: 1,
        offsets_mm: vec![0.0],
        velocities_m_per_s: vec![1.0],
        repetition_count: 1,
        ..Casing::default()
    };
    assert!(judged(&one, &Channel::BOTH, |_, _, _| ())[0].1.is_empty());
}

#[test]
fn a_location_that_lacks_most_of_its_discriminators_is_reported() {
    // Catches a location of which almost nothing is known, and that passes: of 48 values 24 or 25 are absent, the 24 at the belt edge
    // last. Also one whose belt edge alone gave almost nothing: of those 24, 12 or 13 are absent.
    let asked = FuseConfig::default().discriminators;
    let lacks = |count: usize, edge_is_last: bool| {
        judged(&Casing::default(), &Channel::BOTH, |number, id, values| {
            if id.location != 70 {
                return;
            }
            for (place, &which) in asked.iter().enumerate() {
                // Turn by turn, all discriminators of a tap.
                let turn = if edge_is_last { 7 - number / 100 } else { number / 100 };
                if turn * asked.len() + place < count {
                    values.set(which, None);
                }
            }
        })
    };
    assert_eq!((lacks(24, true), lacks(25, true)), (vec![PASS], vec![REPORTED]));
    assert_eq!((lacks(12, false), lacks(13, false)), (vec![PASS], vec![REPORTED]));
}

#[test]
fn a_reference_that_lacks_discriminators_is_reported() {
    // Catches a sound shoulder that passes by a reference half of which is dead, and people who are sent to its own sensors.
    let casing = Casing { shoulder_count: 2, ..Casing::default() };
    let found = judged(&casing, &Channel::BOTH, |_, id, values| {
        if id.shoulder == 2 {
            values.set(Discriminator::Pf, None);
        }
    });
    assert_eq!(found, [(Verdict::ReInspect, Reasons::REFERENCE_INCOMPLETE), REPORTED]);
}
