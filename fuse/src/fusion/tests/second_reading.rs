//! What stands out is tapped again, and the second reading decides with the first.

use std::collections::BTreeSet;

use tapline_wire::Purpose;

use super::*;

fn scanned_once(cracks: Vec<(u16, std::ops::Range<u32>)>) -> Casing {
    let velocities_m_per_s = vec![1.0];
    Casing { velocities_m_per_s, repetition_count: 1, smooth: 0.0, cracks, shift: 2.5, ..Casing::default() }
}

/// The taps that a casing wants besides.
fn wanted(plan: &Plan, records: &[Discriminators]) -> Vec<PlannedTap> {
    whole(&FuseConfig::by(Reference::Own), plan, records).wanted(0, 10_000).unwrap()
}

#[test]
fn a_crack_is_tapped_again_beside_controls() {
    // Catches a suspect that is left out, controls in the crack, a second reading that has the name of a first, one that is asked
    // for twice, and more taps than there is room for.
    let casing = scanned_once(vec![(1, 40..44)]);
    let plan = casing.plan();
    let all = records(&casing, &plan, 3);
    let taps = wanted(&plan, &all);
    let locations = |purpose: Purpose| -> BTreeSet<u32> {
        taps.iter().filter(|tap| tap.purpose == purpose).map(|tap| tap.id.location).collect()
    };
    assert!((40..44).all(|location| locations(Purpose::Suspect).contains(&location)), "{taps:?}");
    assert!(locations(Purpose::Control).len() >= 24);
    assert!((39..45).all(|location| !locations(Purpose::Control).contains(&location)));
    let grown = plan.grown(&taps).unwrap();
    let all = records(&casing, &grown, 3);
    assert_eq!(wanted(&grown, &all), []);
    let (judgement, cells) = whole(&FuseConfig::by(Reference::Own), &grown, &all).judge(0).unwrap();
    assert_eq!(verdict(&judgement), Verdict::Reject);
    let first = whole(&FuseConfig::by(Reference::Own), &plan, &all[..plan.taps().len()]).judge(0).unwrap();
    assert_eq!(judgement.first_strongest_arc.to_bits(), first.0.strongest_arc.to_bits());
    assert!(cells.iter().zip(&first.1).all(|(cell, first)| cell.first_index.to_bits() == first.damage_index.to_bits()));
    let mut fusion = whole(&FuseConfig::by(Reference::Own), &plan, &all[..plan.taps().len()]);
    for room in [0, 5, taps.len() - 1, taps.len()] {
        assert!(fusion.wanted(0, room).unwrap().len() <= room);
    }
}

#[test]
fn what_cannot_pass_or_be_told_by_offset_is_not_tapped_again() {
    // Catches a casing that was taken away and is waited for, and an index without offsets that is asked for one.
    let casing = scanned_once(vec![(1, 40..44)]);
    let plan = casing.plan();
    let mut all = records(&casing, &plan, 3);
    let config = FuseConfig { index: IndexKind::Dissertation, ..FuseConfig::by(Reference::Own) };
    assert_eq!(whole(&config, &plan, &all).wanted(0, 10_000).unwrap(), []);
    all[7] = refusal(&all[7]);
    assert_eq!(wanted(&plan, &all), []);
}

#[test]
fn what_the_second_reading_does_not_show_is_cleared() {
    // Catches a first reading that condemns alone, and a second one that makes a crack of nothing.
    let casing = scanned_once(Vec::new());
    let plan = casing.plan();
    let (mut cleared, mut rejected) = (0, 0);
    for seed in 0..20 {
        let spoilt = |plan: &Plan| {
            let mut all = records(&casing, plan, seed);
            // As cracked as strong cracks are, but in the first reading alone.
            let is_spoilt = |tap: &PlannedTap| (60..64).contains(&tap.id.location) && !tap.is_second_reading();
            for (record, _) in all.iter_mut().zip(plan.taps()).filter(|(_, tap)| is_spoilt(tap)) {
                for which in Discriminator::ALL {
                    let sign = if which == Discriminator::FMax { -1.0 } else { 1.0 };
                    let value = record.values.get(which).map(|value| value * (1.0 + 0.025 * sign));
                    record.values.set(which, value);
                }
            }
            all
        };
        let config = FuseConfig::by(Reference::Own);
        let alone = whole(&config, &plan, &spoilt(&plan)).judge(0).unwrap().0;
        assert_ne!(verdict(&alone), Verdict::Pass);
        let grown = plan.grown(&wanted(&plan, &spoilt(&plan))).unwrap();
        let both = whole(&config, &grown, &spoilt(&grown)).judge(0).unwrap().0;
        cleared += usize::from(verdict(&both) == Verdict::Pass);
        rejected += usize::from(verdict(&both) == Verdict::Reject);
    }
    // The places scatter too: some stand out by themselves.
    assert!(cleared >= 10 && rejected <= 3, "{cleared} cleared and {rejected} rejected of 20");
}

#[test]
fn a_sound_casing_wants_seldom_more() {
    // Catches a limit at which every shoulder is tapped again: one in five is stated.
    let casing = scanned_once(Vec::new());
    let plan = casing.plan();
    let asked = (0..40).filter(|&seed| !wanted(&plan, &records(&casing, &plan, seed)).is_empty()).count();
    assert!((1..=20).contains(&asked), "{asked} of 40");
}
