use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use super::*;

fn normal_density(z: f64, mean: f64, sd: f64) -> f64 {
    (-0.5 * ((z - mean) / sd).powi(2)).exp() / (sd * (2.0 * std::f64::consts::PI).sqrt())
}

/// Log weight of one path, from the definition.
fn log_weight(path: &[bool], z: &[Option<f64>], is_ring: bool, hidden: Hidden) -> f64 {
    let begins = hidden.share / (hidden.arc_length * (1.0 - hidden.share));
    let step = |from: bool, to: bool| match (from, to) {
        (false, true) => begins,
        (false, false) => 1.0 - begins,
        (true, false) => 1.0 / hidden.arc_length,
        (true, true) => 1.0 - 1.0 / hidden.arc_length,
    };
    let value = |(&z, &is_cracked): (&Option<f64>, &bool)| match (z, is_cracked) {
        (None, _) => 1.0,
        (Some(z), true) => normal_density(z, hidden.shift, hidden.sd),
        (Some(z), false) => normal_density(z, 0.0, 1.0),
    };
    let first = if path[0] { hidden.share } else { 1.0 - hidden.share };
    let ends = if is_ring { step(path[path.len() - 1], path[0]) } else { first };
    let steps: f64 = path.windows(2).map(|pair| step(pair[0], pair[1]).ln()).sum();
    ends.ln() + steps + z.iter().zip(path).map(value).map(f64::ln).sum::<f64>()
}

/// The slow twin: every one of the 2^n paths, with its weight.
fn paths(z: &[Option<f64>], is_ring: bool, hidden: Hidden) -> Vec<(f64, Vec<bool>)> {
    let path = |bits: u32| (0..z.len()).map(|place| bits >> place & 1 == 1).collect::<Vec<bool>>();
    let weighed = |path: Vec<bool>| (log_weight(&path, z, is_ring, hidden).exp(), path);
    (0..1_u32 << z.len()).map(path).map(weighed).collect()
}

/// Settings for whose widths no value below 6 and above -2 is held.
fn settings() -> impl Strategy<Value = Hidden> {
    (1.0..9.0, 0.001..0.49, 2.0..5.0, 0.8..1.3).prop_map(|(arc_length, share, shift, sd)| Hidden {
        arc_length,
        share,
        shift,
        sd,
    })
}

fn values(n: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Option<f64>>> {
    prop::collection::vec(prop::option::weighted(0.8, -2.0..5.5), n)
}

proptest! {
    #[test]
    fn forward_and_backward_are_the_sum_over_all_paths(z in values(1..11), is_ring: bool, hidden in settings()) {
        // Catches a ring that is not closed, a start counted twice, a value in both passes, a path whose ends do not
        // meet, and a wrong normal density.
        let paths = paths(&z, is_ring, hidden);
        let whole: f64 = paths.iter().map(|(weight, _)| weight).sum();
        let got = hidden_states(&z, is_ring, hidden).unwrap();
        for place in 0..z.len() {
            let cracked: f64 = paths.iter().filter(|(_, path)| path[place]).map(|(weight, _)| weight).sum();
            prop_assert!((got.cracked[place] - cracked / whole).abs() < 1e-10, "{place}: {got:?} {}", cracked / whole);
        }
        prop_assert!((got.all_sound - paths[0].0 / whole).abs() < 1e-10, "{} {}", got.all_sound, paths[0].0 / whole);
        let best = paths.iter().map(|(weight, _)| *weight).max_by(f64::total_cmp).unwrap();
        let (found, _) = paths.iter().find(|(_, path)| *path == got.is_cracked).unwrap();
        prop_assert!(*found >= best * (1.0 - 1e-10), "{found} {best} {got:?}");
    }

    #[test]
    fn a_ring_has_no_first_place(z in values(1..120), by in 0_usize..120, hidden in settings()) {
        // Catches a seam: a crack over it that counts as two, or a prior of the first place.
        let by = by % z.len();
        let mut turned = z.clone();
        turned.rotate_left(by);
        let mut expected = hidden_states(&z, true, hidden).unwrap();
        let got = hidden_states(&turned, true, hidden).unwrap();
        expected.cracked.rotate_left(by);
        expected.is_cracked.rotate_left(by);
        for (got, expected) in got.cracked.iter().zip(&expected.cracked) {
            prop_assert!((got - expected).abs() < 1e-9);
        }
        prop_assert!((got.all_sound - expected.all_sound).abs() < 1e-9);
        // Paths may be as likely as each other; then either will do.
        let of = |path: &[bool]| log_weight(path, &turned, true, hidden);
        prop_assert!((of(&got.is_cracked) - of(&expected.is_cracked)).abs() < 1e-9);
    }

    #[test]
    fn any_doubles_give_chances(
        z in prop::collection::vec(prop::option::of(any::<f64>()), 0..40),
        is_ring: bool,
        (arc_length, share, shift, sd) in (any::<f64>(), any::<f64>(), any::<f64>(), any::<f64>()),
        known in settings(),
    ) {
        // Catches NaN out of values or settings: infinity less infinity, 0 x infinity, the logarithm of 0.
        let odd = [
            Hidden { sd: 0.1, ..known },
            Hidden { sd: 100.0, ..known },
            Hidden { arc_length: 1.0, ..known },
            Hidden { shift, ..known },
            Hidden { arc_length, share, shift, sd },
        ];
        for hidden in odd.into_iter().chain([known]) {
            let Ok(got) = hidden_states(&z, is_ring, hidden) else { continue };
            prop_assert!(got.cracked.iter().all(|p| (0.0..=1.0).contains(p)), "{got:?}");
            prop_assert!((0.0..=1.0).contains(&got.all_sound), "{got:?}");
            prop_assert_eq!((got.cracked.len(), got.is_cracked.len()), (z.len(), z.len()));
            let shift = fitted_shift(&z, is_ring, hidden).unwrap();
            prop_assert!((1.0..=20.0).contains(&shift));
        }
    }

    #[test]
    fn nothing_falls_as_a_value_rises(
        z in values(2..30),
        place in 0_usize..30,
        to in -9.0..60.0,
        sd in 0.2..4.0,
        hidden in settings(),
    ) {
        // Catches the second crossing of two normal curves: with a wide cracked state very low values would be cracked,
        // with a narrow one very high values sound.
        let hidden = Hidden { sd, ..hidden };
        let place = place % z.len();
        let chance = |value: f64| {
            let mut z = z.clone();
            z[place] = Some(value);
            hidden_states(&z, true, hidden).unwrap().cracked[place]
        };
        prop_assert!(chance(to) >= chance(-9.0) - 1e-9 && chance(60.0) >= chance(to) - 1e-9);
    }
}

#[test]
fn a_line_is_not_a_ring() {
    // Catches a flag that is not read: a high value at each end are neighbours on a ring alone, and speak for each
    // other.
    let mut z = vec![Some(0.0); 40];
    (z[0], z[39]) = (Some(3.0), Some(3.0));
    let chance = |is_ring| hidden_states(&z, is_ring, Hidden::default()).unwrap().cracked[0];
    assert!(chance(true) > 2.0 * chance(false), "{} {}", chance(true), chance(false));
    // A gap within a crack is cracked, one beside sound places is not.
    let mut z = vec![Some(0.0); 40];
    for place in [38, 39, 1, 2] {
        z[place] = Some(4.0);
    }
    (z[0], z[20]) = (None, Some(f64::NAN));
    let states = hidden_states(&z, true, Hidden::default()).unwrap();
    assert!(states.cracked[0] > 0.99 && states.is_cracked[0], "{:?}", states.cracked[0]);
    assert!(states.cracked[20] < 0.01 && !states.is_cracked[20], "{:?}", states.cracked[20]);
    assert_eq!(states.is_cracked.iter().filter(|&&is_cracked| is_cracked).count(), 5);
}

#[test]
fn settings_outside_their_bounds_are_named() {
    // Catches a setting that would make the chain impossible, or NaN that passes.
    let name = |hidden: Hidden| match hidden_states(&[Some(1.0)], true, hidden) {
        Err(Error::OutOfRange { name, .. }) => name,
        other => panic!("{other:?}"),
    };
    let right = Hidden::default();
    assert_eq!(name(Hidden { arc_length: 0.9, ..right }), "arc_length");
    assert_eq!(name(Hidden { arc_length: f64::NAN, ..right }), "arc_length");
    assert_eq!(name(Hidden { share: 0.0, ..right }), "share");
    assert_eq!(name(Hidden { share: 5.0 / 6.0, ..right }), "share");
    assert_eq!(name(Hidden { shift: -1.0, ..right }), "shift");
    assert_eq!(name(Hidden { sd: 0.0, ..right }), "sd");
    let none = hidden_states(&[], true, right).unwrap();
    assert_eq!((none.cracked.len(), none.is_cracked.len(), none.all_sound.to_bits()), (0, 0, 1.0_f64.to_bits()));
}

/// A ring of 100 with one crack of 3 to 8 places that stands out by `shift`, or none.
fn ring(rng: &mut ChaCha8Rng, shift: Option<f64>) -> (Vec<Option<f64>>, Vec<bool>) {
    let (first, length) = (rng.random_range(0..100), rng.random_range(3..9));
    let is_cracked: Vec<bool> = (0..100).map(|i| shift.is_some() && (i + 100 - first) % 100 < length).collect();
    let draw = |&is_cracked: &bool| {
        let noise: f64 = StandardNormal.sample(rng);
        Some(noise + shift.filter(|_| is_cracked).unwrap_or(0.0))
    };
    let z = is_cracked.iter().map(draw).collect();
    (z, is_cracked)
}

/// Log loss of the chances of 200 rings whose cracks stand out by `shift`, a ring, with the default's shift and with
/// one learned.
fn losses(shift: f64) -> [f64; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut losses = [0.0; 2];
    for i in 0..200 {
        let (z, truth) = ring(&mut rng, (i % 4 != 0).then_some(shift));
        let given = Hidden::default();
        let learned = Hidden { shift: fitted_shift(&z, true, given).unwrap(), ..given };
        for (loss, hidden) in losses.iter_mut().zip([given, learned]) {
            for (p, &is_cracked) in hidden_states(&z, true, hidden).unwrap().cracked.iter().zip(&truth) {
                *loss -= if is_cracked { p.ln() } else { (1.0 - p).ln() } / 200.0;
            }
        }
    }
    losses
}

#[test]
fn learning_the_shift_helps_where_cracks_are_plain_and_costs_little_where_they_are_not() {
    // Catches a shift learned from the sound places, one that runs away on rings without a crack, and rounds that do
    // nothing.
    let [given, learned] = losses(6.0);
    assert!(learned < 0.3 * given, "{given} {learned}");
    let [given, learned] = losses(2.0);
    assert!(learned < 1.05 * given, "{given} {learned}");
}

#[test]
fn the_rounds_are_enough() {
    // Catches a cap that cuts learning off.
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for i in 0..100 {
        let (z, _) = ring(&mut rng, (i % 4 != 0).then_some([1.5, 2.0, 3.0, 6.0][i % 7 % 4]));
        let by = [ROUNDS, 50].map(|rounds| learned(&z, true, Hidden::default(), rounds).unwrap().shift);
        assert!((by[0] - by[1]).abs() < 0.02, "ring {i}: {by:?}");
    }
}
