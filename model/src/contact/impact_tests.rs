use proptest::prelude::*;

use super::*;

/// V, e, and F_max, contact time, d_max, restitution of the damped integral rung (tests/plate_reference.py).
const INTEGRAL: [(f64, f64, [f64; 4]); 2] = [
    (1.85, 0.5, [3.174780952e+01, 1.001609766e-03, 4.360443430e-04, 0.5]),
    (1.2, 0.8, [1.863360532e+01, 1.001917369e-03, 3.646053470e-04, 0.8]),
];

/// V, e, h, l, and the same quantities of the plate rung (tests/plate_reference.py).
const PLATE: [(f64, f64, f64, f64, [f64; 4]); 8] = [
    (1.85, 0.5, 0.0254, 0.0254, [3.042786166e+01, 1.007389649e-03, 4.469681621e-04, 5.114507482e-01]),
    (1.85, 0.5, 0.0127, 0.0254, [2.402335527e+01, 1.084701526e-03, 4.931825283e-04, 5.917085549e-01]),
    (1.85, 0.5, 0.00254, 0.0254, [1.124552596e+01, 4.597676376e-03, 2.074943790e-03, 6.584124109e-01]),
    (1.2, 0.5, 0.00635, 0.02, [9.922110181e+00, 1.454620772e-03, 4.396315794e-04, 6.809144538e-01]),
    (1.85, 0.7, 0.005, 0.0508, [1.945235026e+01, 2.579415094e-03, 1.035230967e-03, 4.094639980e-01]),
    (0.5, 0.9, 0.003, 0.03, [2.847319616e+00, 4.431118638e-03, 4.900870869e-04, 6.288794229e-01]),
    (2.0, 0.5, 0.001, 0.0254, [7.457341522e+00, 1.710274060e-02, 9.439465510e-03, 7.677456544e-01]),
    (1.85, 0.5, 0.0127, 0.0508, [2.578100946e+01, 1.404262785e-03, 4.883693876e-04, 4.075501768e-01]),
];

fn assert_close(outcome: Outcome, reference: [f64; 4], what: &str) {
    let Outcome { f_max_n, contact_time_s, d_max_m, restitution, .. } = outcome;
    for (got, wanted) in [f_max_n, contact_time_s, d_max_m, restitution].into_iter().zip(reference) {
        assert!((got / wanted - 1.0).abs() < 1e-5, "{what}: {outcome:?} for {reference:?}");
    }
}

/// Catches a wrong mass, unit, event or damping of the integral rung.
#[test]
fn integral_rung_agrees_with_scipy() {
    for (velocity_m_per_s, restitution, reference) in INTEGRAL {
        let scene = Scene { velocity_m_per_s, restitution, ..Scene::default() };
        assert_close(Impact::integral(&scene).unwrap().outcome().unwrap(), reference, "integral");
    }
}

/// Catches the same in the plate rung, and second contacts that are not counted.
#[test]
fn plate_rung_agrees_with_scipy() {
    for (velocity_m_per_s, restitution, h_m, l_m, reference) in PLATE {
        let scene = Scene { velocity_m_per_s, restitution, h_m, l_m, ..Scene::default() };
        assert_close(Impact::plate(&scene).unwrap().outcome().unwrap(), reference, &format!("h = {h_m}, l = {l_m}"));
    }
}

/// Catches a difference between the integration and the closed form: with e = 1 the integral rung is Hertz's contact.
#[test]
fn undamped_integral_rung_is_the_closed_form() {
    let scene = Scene { restitution: 1.0, ..Scene::default() };
    let closed = crate::integral_contact(&scene).unwrap();
    let outcome = Impact::integral(&scene).unwrap().outcome().unwrap();
    assert!((outcome.f_max_n / closed.f_max_n - 1.0).abs() < 1e-9);
    assert!((outcome.d_max_m / closed.alpha_max_m - 1.0).abs() < 1e-9);
    // 2.9432 = 2 int_0^1 dx / sqrt(1 - x^2.5), the time that Eq. 14 takes there and back.
    let hertz_s = 2.943_275_184 * closed.alpha_max_m / scene.velocity_m_per_s;
    assert!((outcome.contact_time_s / hertz_s - 1.0).abs() < 1e-8);
    assert!((outcome.restitution - 1.0).abs() < 1e-9);
}

/// Catches a coarse or truncated history: its peak and its impulse m V (1 + e) are those of the fine solution.
#[test]
fn force_history_holds_peak_and_impulse() {
    for (velocity_m_per_s, restitution, h_m, l_m, [f_max, contact_time, _, e_out]) in PLATE {
        if contact_time > 6e-3 {
            continue; // A second contact after a long flight is not in the history.
        }
        let scene = Scene { velocity_m_per_s, restitution, h_m, l_m, ..Scene::default() };
        let mut force_n = Vec::new();
        let dt = Impact::plate(&scene).unwrap().force_history(&mut force_n);
        let peak = force_n.iter().copied().fold(0.0, |a, b| if b > a { b } else { a });
        let impulse: f64 = force_n.iter().sum::<f64>() * dt;
        assert!((peak / f_max - 1.0).abs() < 2e-3, "peak {peak} for {f_max}");
        let momentum = scene.m_1_kg * velocity_m_per_s * (1.0 + e_out);
        assert!((impulse / momentum - 1.0).abs() < 2e-3, "impulse {impulse} for {momentum} at h = {h_m}");
    }
}

/// Catches an impact whose integration neither ends nor reports that it does not.
#[test]
fn extreme_scenes_end_or_say_why() {
    for h_m in [1e-9, 1e-6, 1.0, 1e6] {
        for l_m in [1e-9, 1e-3, 1e3] {
            for velocity_m_per_s in [1e-9, 1.0, 1e6] {
                let scene = Scene { h_m, l_m, velocity_m_per_s, ..Scene::default() };
                match Impact::plate(&scene).unwrap().outcome() {
                    Ok(outcome) => assert!(outcome.f_max_n.is_finite() && outcome.d_max_m.is_finite(), "{outcome:?}"),
                    Err(error) => assert!(matches!(error, Error::TooStiff { .. }), "{error}"),
                }
            }
        }
    }
}

/// Catches a panic or an endless integration on numbers that no scene would give.
#[test]
fn senseless_impacts_end() {
    let sound = Impact::plate(&Scene::default()).unwrap();
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let plate = sound.plate.map(|p| Plate { mass_kg: bad, ..p });
        for impact in
            [Impact { k_c_n_per_m1_5: bad, ..sound }, Impact { mass_kg: bad, ..sound }, Impact { plate, ..sound }]
        {
            drop(impact.outcome());
            let mut force_n = Vec::new();
            impact.force_history(&mut force_n);
            assert!(force_n.len() < 2000);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Catches a chi that does not give the wanted restitution, at any velocity.
    #[test]
    fn integral_rung_returns_the_restitution(restitution in 0.1..1.0_f64, velocity_m_per_s in 0.1..10.0_f64) {
        let scene = Scene { restitution, velocity_m_per_s, ..Scene::default() };
        let outcome = Impact::integral(&scene).unwrap().outcome().unwrap();
        prop_assert!((outcome.restitution - restitution).abs() < 1e-7, "{outcome:?}");
    }

    /// Catches a gain of energy: no plate throws the impactor back faster than it came.
    #[test]
    fn plate_rung_gains_no_energy(h in 1e-3..50e-3_f64, l in 5e-3..50e-3_f64, v in 0.2..4.0_f64) {
        let scene = Scene { h_m: h, l_m: l, velocity_m_per_s: v, ..Scene::default() };
        let outcome = Impact::plate(&scene).unwrap().outcome().unwrap();
        prop_assert!(outcome.restitution.abs() <= 1.0, "{outcome:?}");
        prop_assert!(outcome.f_max_n > 0.0 && outcome.contact_time_s > 0.0 && outcome.d_max_m > 0.0);
    }
}
