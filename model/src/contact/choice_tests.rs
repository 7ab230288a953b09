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

/// Catches a rung less accurate than promised, over random scenes and tolerances, and one that is not the first whose
/// bound allows it.
#[test]
fn choices_keep_their_word() {
    let mut generator = Identity::new(11, "choice").generator();
    const SCENES: usize = 4000;
    let (mut taken, mut missed) = ([0; 4], 0);
    for number in 0..SCENES {
        let scene = scene(&mut generator);
        let tolerance = 0.5 * 1e-4_f64.powf(generator.uniform());
        let law =
            [DampingLaw::Exact, DampingLaw::Exact, DampingLaw::Gonthier, DampingLaw::LankaraniNikravesh][number % 4];
        let choice = choose(&scene, law, tolerance).unwrap();
        let truth = Rung::Full.contact(&scene, law).unwrap();
        let rung = choice.contact.rung;
        let error = choice.contact.error_against(&truth);
        assert!(error <= choice.bounds.of(rung), "{rung} is off by {error}: {choice} in {scene:?}");
        assert!(choice.bounds.of(rung) <= tolerance, "{choice}");
        assert!(Rung::ALL.iter().all(|&cheaper| cheaper >= rung || choice.bounds.of(cheaper) > tolerance), "{choice}");
        taken[rung as usize] += 1;
        let tried = choose_by_trial(&scene, law, tolerance).unwrap();
        assert!(tried.contact.rung <= rung && tried.contact.error_against(&truth) <= tolerance, "{tried}");
        let is_cheapest = Rung::ALL.iter().filter(|&&cheaper| cheaper < tried.contact.rung);
        for cheaper in is_cheapest {
            assert!(cheaper.contact(&scene, law).unwrap().error_against(&truth) > tolerance, "{tried}");
        }
        missed += u32::from(tried.contact.rung < rung);
    }
    // The cost of not running the full rung.
    println!("{missed} of {SCENES} choices were dearer than need be");
    assert!(taken.iter().all(|&count| count > 10), "rungs taken: {taken:?}");
}

/// Catches bounds so wide that they never select a cheap rung: a deep crack is a sound casing, and a thin layer far
/// from the membrane's range is a plate.
#[test]
fn choices_are_not_timid() {
    let rung = |scene: &Scene, tolerance| choose(scene, DampingLaw::Exact, tolerance).unwrap().contact.rung;
    let deep = Scene { h_m: 80e-3, l_m: 20e-3, ..Scene::default() };
    assert_eq!(rung(&deep, 0.0), Rung::Full);
    assert_eq!(rung(&deep, 0.1), Rung::Integral);
    assert_eq!(rung(&Scene { restitution: 1.0, ..deep }, 0.3), Rung::Closed);
    let thin = Scene { h_m: 5e-3, l_m: 25e-3, velocity_m_per_s: 0.5, ..Scene::default() };
    assert_eq!(rung(&thin, 0.2), Rung::Plate);
    assert_eq!(rung(&thin, 0.01), Rung::Full);
}

/// Catches an error that is not passed on, and a tolerance without effect.
#[test]
fn bad_input_is_named() {
    let named = |scene: &Scene, tolerance| match choose(scene, DampingLaw::Exact, tolerance) {
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

/// Catches a reason that does not name the rung, its bound, or where the map ends.
#[test]
fn reasons_are_given() {
    let why = |scene: &Scene, tolerance| choose(scene, DampingLaw::Exact, tolerance).unwrap().why();
    let deep = Scene { h_m: 80e-3, l_m: 20e-3, ..Scene::default() };
    let text = why(&deep, 0.1);
    assert!(text.starts_with("integral is within 0.0") && text.contains("closed may be off by"), "{text}");
    let text = why(&deep, 1e-5);
    assert!(text.starts_with("full: nothing cheaper") && text.contains("; integral may be off by 0.0"), "{text}");
    let text = why(&Scene { restitution: 0.2, ..deep }, 0.1);
    assert!(
        text.ends_with("; nothing is known of plate (rebound is 0.2000; the map of errors has 0.3000 to 1.0000)"),
        "{text}"
    );
}
