use proptest::prelude::*;

use super::*;
use crate::{Crack, Plate, Scene, chi_for_restitution};

/// An impact in its own units, except that the unit of time is 10 us, on a layer of stiffness `kappa` and `rho`.
pub(crate) fn impact(e: f64, layer: Option<(f64, f64)>) -> Impact {
    const T: f64 = 1e-5;
    let plate = layer.map(|(kappa, rho)| Plate {
        mass_kg: kappa / rho,
        damping_n_s_per_m: LOSS_TANGENT * kappa / rho.sqrt() / T,
        stiffness_n_per_m: kappa / (T * T),
        membrane_n_per_m3: 0.0,
    });
    let chi = chi_for_restitution(e).unwrap();
    Impact { k_c_n_per_m1_5: T.powf(-2.5), chi, velocity_m_per_s: 1.0, mass_kg: 1.0, plate }
}

/// The four quantities of an impact.
pub(crate) fn quantities(impact: &Impact) -> [f64; 4] {
    let o = impact.outcome().unwrap();
    [o.f_max_n, o.contact_time_s, o.d_max_m, o.restitution]
}

/// Largest relative change of the four from one impact to the other.
pub(crate) fn change(from: &Impact, to: &Impact) -> f64 {
    let (from, to) = (quantities(from), quantities(to));
    from.iter().zip(to).map(|(a, b)| (b / a - 1.0).abs()).fold(0.0, |a, b| if b > a { b } else { a })
}

/// A(e, rho) by integration, with a layer so stiff that only the first order matters.
fn effect_slow(e: f64, rho: f64) -> f64 {
    let kappa = 1e5 * if rho > 1.0 { rho } else { 1.0 };
    change(&impact(e, None), &impact(e, Some((kappa, rho)))) * kappa
}

#[expect(clippy::cast_precision_loss, reason = "a small index")]
fn rho_at(column: f64) -> f64 {
    RHO_MIN * (RHO_MAX / RHO_MIN).powf(column / (RHOS - 1) as f64)
}

/// Prints the rows of `compliance_map.rs`; run with `--ignored --nocapture`.
#[test]
#[ignore = "prints the map"]
fn print_the_map() {
    for e in RESTITUTIONS {
        let row: Vec<String> = (0..RHOS).map(|j| format!("{:.4}", effect_slow(e, rho_at(j as f64)))).collect();
        println!("    [{}],", row.join(", "));
    }
}

/// Catches a map that its generator does not give, and mixed-up rows or columns.
#[test]
fn the_map_is_that_of_the_equation() {
    for (i, &e) in RESTITUTIONS.iter().enumerate() {
        for j in (i % 3..RHOS).step_by(3) {
            let (rho, kept) = (rho_at(j as f64), EFFECT[i][j]);
            let made = effect_slow(e, rho);
            assert!((made - kept).abs() < 2e-3 * kept + 1e-3, "e = {e}, rho = {rho}: {kept} for {made}");
            assert!((effect(e, rho) - kept).abs() < 1e-9, "e = {e}, rho = {rho}");
        }
    }
}

/// Catches nodes too far apart: between them the map must be within its safety factor of the equation.
#[test]
fn the_map_holds_between_its_nodes() {
    for pair in RESTITUTIONS.windows(2) {
        let e = 0.5 * (pair[0] + pair[1]);
        for j in 0..RHOS - 1 {
            let rho = rho_at(j as f64 + 0.5);
            let (read, made) = (effect(e, rho), effect_slow(e, rho));
            assert!(made < 1.12 * read && read < 1.5 * made, "e = {e}, rho = {rho}: {read} for {made}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Catches a bound that the layer exceeds anywhere within the map.
    #[test]
    fn bounds_hold(e in 0.3..1.0_f64, column in 1e-9..22.999_f64, decades in 0.0..2.0_f64) {
        let rho = rho_at(column);
        let epsilon = epsilon_max(e) * 0.1_f64.powf(decades);
        let kappa = effect(e, rho) / epsilon;
        let (rigid, soft) = (impact(e, None), impact(e, Some((kappa, rho))));
        let found = Compliance::new(&soft, &DampedContact::new(soft.chi).unwrap(), LOSS_TANGENT).unwrap();
        prop_assert!((found.epsilon / epsilon - 1.0).abs() < 1e-5, "{found:?} for {epsilon}");
        let seen = change(&rigid, &soft);
        prop_assert!(seen < found.bound(), "{found:?} changes it by {seen}");
    }
}

/// Catches a ratio outside the map that is accepted.
#[test]
fn the_map_has_its_ends() {
    let is_within = |e: f64, kappa: f64, rho: f64, loss_tangent: f64| {
        let impact = impact(e, Some((kappa, rho)));
        Compliance::new(&impact, &DampedContact::new(impact.chi).unwrap(), loss_tangent).is_some()
    };
    assert!(is_within(0.5, 100.0, 10.0, LOSS_TANGENT));
    assert!(!is_within(0.29, 100.0, 10.0, LOSS_TANGENT), "restitution");
    assert!(!is_within(0.5, 100.0, 10.0, 0.3) && !is_within(0.5, 100.0, 10.0, f64::NAN), "loss tangent");
    assert!(!is_within(0.5, 100.0, 2e4, LOSS_TANGENT), "rho");
    assert!(!is_within(0.5, 1.0, 10.0, LOSS_TANGENT), "epsilon");
}

/// Catches a deep crack of the simulated tyre that is not treated as a sound casing, a shallow one that is, and a force
/// that is off by more than the tolerance.
#[test]
fn deep_cracks_are_rigid_within_the_tolerance() {
    const TOLERANCE: f64 = 1e-3;
    let scene = Scene { e_2_pa: 12e6, ..Scene::default() };
    let sound = Impact::integral(&scene).unwrap();
    let rigid = DampedContact::new(sound.chi).unwrap();
    let mut left_out = 0;
    for depth_mm in [3.0, 6.0, 12.7, 25.0, 50.0, 80.0, 100.0] {
        for felt in [1.0, 0.1, 0.01, 0.001] {
            let plate = Crack { depth_mm, ..Crack::default() }.plate(&scene, felt);
            let cracked = Impact { plate: Some(plate), ..sound };
            let is_rigid = Compliance::is_rigid(&cracked, &rigid, scene.loss_tangent(), TOLERANCE);
            assert!(is_rigid || felt > 0.001 || depth_mm < 6.0, "{depth_mm} mm, felt {felt}");
            assert!(!is_rigid || felt < 1.0 || depth_mm > 50.0, "{depth_mm} mm, felt {felt}");
            if is_rigid {
                left_out += 1;
                let seen = change(&sound, &cracked);
                assert!(seen < TOLERANCE, "{depth_mm} mm, felt {felt}: changed by {seen}");
            }
        }
    }
    assert!(left_out > 7, "{left_out}");
}
