//! A reference that is the casing itself, that is stated, or that is labelled.

use tapline_wire::{Discriminator, Geometry, Values};

use super::*;
use crate::ring::Ring;
use crate::shoulder::Reading;

/// One tap a location with a PR that rises by 1 from location to location in a scrambled order, and
/// by `shift` in the first `cracked` of them.
fn slab(count: u32, cracked: u32, shift: f64) -> Shoulder {
    let locations: Vec<_> = (0..count).map(|l| (l, None)).collect();
    let tap = |location: u32| {
        let mut values = Values::default();
        let scatter = f64::from(location * 37 % count);
        values.set(Discriminator::Pr, Some(500.0 + scatter + if location < cracked { shift } else { 0.0 }));
        Reading { place: location as usize, condition: 0, values }
    };
    let ring = Ring::of(Geometry::Line, &locations, None);
    Shoulder { ring, tyre: 0, taps: (0..count).map(tap).collect(), is_cracked: vec![None; count as usize] }
}

fn one_condition() -> Conditions {
    Conditions::of([tapline_wire::TapId::default()].iter())
}

#[test]
fn cracks_leave_a_reference_of_their_own() {
    // Catches a reference that stays spoiled by the cracks in it, and a stated one that is trimmed:
    // the sound locations, here the last 80, then lie below the reference's centre.
    let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::default() };
    let shoulders = [slab(101, 20, 500.0)];
    let sound = |limits: Option<Limits>, map: &IndexMap| {
        let limits = limits.unwrap();
        let mut sound: Vec<f64> = map.index[21..].iter().map(|v| limits.standardised(v.unwrap())).collect();
        crate::stats::median(&mut sound).unwrap()
    };
    let (own, casing) = Standard::own(&config, &one_condition(), &shoulders);
    let stated = Standard::stated(&config, &one_condition(), &shoulders, 0);
    let spoiled = stated.casing(&config, &one_condition(), &shoulders, Some(&stated.levels[0]));
    let (own, stated) = (sound(own.limits, &casing.maps[0]), sound(stated.limits, &spoiled.maps[0]));
    assert!(own.abs() < 0.1 && stated < -0.2, "{own} {stated}");
}

#[test]
fn a_labelled_crack_is_not_the_reference() {
    // Catches labels that are not looked at: the scale would be that of the crack.
    let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::default() };
    let mut labelled = slab(101, 60, 500.0);
    for (place, label) in labelled.is_cracked.iter_mut().enumerate() {
        *label = Some(place < 60);
    }
    let standard = Standard::stated(&config, &one_condition(), &[labelled.clone()], 0);
    let casing = standard.casing(&config, &one_condition(), &[labelled], Some(&standard.levels[0]));
    let limits = standard.limits.unwrap();
    assert!(casing.maps[0].index[2..58].iter().all(|i| i.unwrap() > limits.reject()), "{limits:?}");
    assert!(casing.maps[0].index[62..].iter().all(|i| i.unwrap() < limits.re_inspect));
}

#[test]
fn another_level_is_no_damage() {
    // Catches a casing that is damaged for being louder, and a crack in it that its own level hides.
    let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::default() };
    let standard = Standard::stated(&config, &one_condition(), &[slab(101, 0, 0.0)], 0);
    let mut loud = slab(101, 10, 900.0);
    for tap in &mut loud.taps {
        let pr = tap.values.get(Discriminator::Pr);
        tap.values.set(Discriminator::Pr, pr.map(|pr| 3.0 * pr));
    }
    let limits = standard.limits.unwrap();
    let count = |config: &FuseConfig| {
        let casing = standard.casing(config, &one_condition(), &[loud.clone()], None);
        let is_suspect = |i: &&Option<f64>| i.unwrap() >= limits.re_inspect;
        casing.maps[0].index.iter().filter(is_suspect).count()
    };
    assert!((9..=12).contains(&count(&config)), "{}", count(&config));
    assert_eq!(count(&FuseConfig { centre: Centre::Reference, ..config }), 101);
}

#[test]
fn a_minority_is_no_reference() {
    // Catches trimming until what is left agrees with itself.
    assert!(is_majority(&vec![vec![true, false], vec![true, false]]));
    assert!(!is_majority(&vec![vec![true, true, false], vec![false, false]]));
}

#[test]
fn a_shoulder_has_its_own_level_where_most_of_it_is_kept() {
    // Catches a level that is taken from what is left of a cracked shoulder, or from too few places; and one for all
    // shoulders alike.
    let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::default() };
    let ring = |count: u32, factor: f64| {
        let mut shoulder = slab(count, 0, 0.0);
        let locations: Vec<_> = (0..count).map(|l| (l, None)).collect();
        shoulder.ring = Ring::of(Geometry::Ring, &locations, Some(count));
        for tap in &mut shoulder.taps {
            tap.values.set(Discriminator::Pr, tap.values.get(Discriminator::Pr).map(|pr| factor * pr));
        }
        shoulder
    };
    for (count, kept_count, is_alone) in
        [(101, 101, true), (101, 51, true), (101, 50, false), (20, 16, true), (20, 15, false)]
    {
        let shoulders = [ring(count, 1.0), ring(count, 2.0)];
        let mut kept = everything(&shoulders);
        kept[1][kept_count..].fill(false);
        let level =
            |is_meant: &dyn Fn(&Shoulder) -> bool| level_of(&config, &one_condition(), &shoulders, &kept, is_meant);
        let (alone, together) = (level(&|s| std::ptr::eq(s, &raw const shoulders[1])), level(&|_| true));
        assert_ne!(alone, together);
        let expected = if is_alone { alone } else { together };
        let mut pooled = |kept: &Kept| level_of(&config, &one_condition(), &shoulders, kept, |_| true);
        let whole = whole_levels(&config, &one_condition(), &shoulders);
        let levels = own_levels(&config, &one_condition(), &shoulders, &kept, &whole, &mut pooled);
        assert_eq!(levels[1], expected, "{kept_count} of {count}");
    }
}

#[test]
fn values_alone_are_those_of_the_locations() {
    // Catches a short way to the values that leaves out a step of the long one, and one that takes those of other places
    // for its own.
    let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::default() };
    let shoulders = [slab(101, 20, 500.0), slab(60, 0, 0.0)];
    let fit = |kept: &Kept| {
        let levels = vec![level_of(&config, &one_condition(), &shoulders, kept, |_| true); shoulders.len()];
        let short = Fit::values_of(&config, &one_condition(), &shoulders, kept, &levels);
        (Fit::of(&config, &one_condition(), &shoulders, kept, &levels), levels, short)
    };
    let mut values = once(|kept| fit(kept).2);
    let of = |locations: &[LocationIndex]| locations.iter().map(|l| l.value).collect::<Vec<_>>();
    let all = everything(&shoulders);
    let mut some = all.clone();
    some[0][..20].fill(false);
    for kept in [&all, &all, &some, &all, &some] {
        let ((fit, own), levels, short) = fit(kept);
        let own = values_of(&own);
        assert_eq!((&short, &values(kept)), (&own, &own));
        for ((shoulder, level), own) in shoulders.iter().zip(&levels).zip(&own) {
            let locations = of(&fit.locations(level, shoulder, Taps::All));
            assert_eq!((&locations, &fit.values(level, shoulder, Taps::All)), (own, own));
        }
    }
}
