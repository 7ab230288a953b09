use super::*;
use crate::tyre::identity::{Generator, Identity};

/// A random scene from the whole range of casings and rigs, with cracks from 1 mm to 0.5 m deep.
fn scene(generator: &mut Generator) -> Scene {
    let mut between = |low: f64, high: f64| low * (high / low).powf(generator.uniform());
    let baseline = Scene::default();
    Scene {
        velocity_m_per_s: between(0.1, 5.0),
        m_1_kg: baseline.m_1_kg * between(0.5, 2.0),
        m_2_kg: between(0.3, 300.0),
        e_2_pa: between(2e6, 100e6),
        h_m: between(1e-3, 0.5),
        l_m: between(4e-3, 60e-3),
        w_m: between(20e-3, 200e-3),
        restitution: between(0.1, 1.0),
        ..baseline
    }
}

/// Catches a rung less accurate than asked for, over random scenes and tolerances, and one that is not the cheapest.
#[test]
fn choices_keep_their_word() {
    let mut generator = Identity::new(11, "choice").generator();
    let mut taken = [0; 4];
    for number in 0..1000 {
        let scene = scene(&mut generator);
        let tolerance = 0.5 * 1e-4_f64.powf(generator.uniform());
        let law =
            [DampingLaw::Exact, DampingLaw::Exact, DampingLaw::Gonthier, DampingLaw::LankaraniNikravesh][number % 4];
        let choice = choose_by_trial(&scene, law, tolerance).unwrap();
        let truth = Rung::Full.contact(&scene, law).unwrap();
        let rung = choice.contact.rung;
        assert!(choice.contact.error_against(&truth) <= tolerance, "{choice} in {scene:?}");
        for &cheaper in Rung::ALL.iter().filter(|&&cheaper| cheaper < rung) {
            assert!(cheaper.contact(&scene, law).unwrap().error_against(&truth) > tolerance, "{choice}");
        }
        taken[rung as usize] += 1;
    }
    assert!(taken.iter().all(|&count| count > 10), "rungs taken: {taken:?}");
}

/// Catches an error that is not passed on, and a tolerance without effect.
#[test]
fn bad_input_is_named() {
    let named = |scene: &Scene, tolerance| match choose_by_trial(scene, DampingLaw::Exact, tolerance) {
        Err(Error::OutOfRange { name, .. }) => name,
        other => panic!("{other:?}"),
    };
    for tolerance in [-1e-9, 1.1, f64::NAN] {
        assert_eq!(named(&Scene::default(), tolerance), "tolerance");
    }
    for e in [0.0, 0.099, 1.001, f64::NAN] {
        assert_eq!(named(&Scene { restitution: e, ..Scene::default() }, 0.1), "restitution");
    }
    assert_eq!(named(&Scene { h_m: -1.0, ..Scene::default() }, 0.1), "h_m");
}

/// Catches a reason that does not name the rung or its error.
#[test]
fn reasons_are_given() {
    let deep = Scene { h_m: 80e-3, l_m: 20e-3, ..Scene::default() };
    let why = |tolerance| choose_by_trial(&deep, DampingLaw::Exact, tolerance).unwrap().to_string();
    let text = why(0.1);
    assert!(text.starts_with("integral is within 0.0") && text.contains("closed is off by"), "{text}");
    let text = why(0.0);
    assert!(text.starts_with("full: nothing cheaper") && text.contains("; integral is off by 0.0"), "{text}");
}
