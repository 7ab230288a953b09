//! What `docs/dissertation.md` says about the dissertation's equations and curves, in numbers.

use tapline_model::{Rung, Scene, SimulationConfig, defect_contact, integral_contact};

use super::curves::{Figure, figure};

/// The least point of a curve, x and y.
fn least(points: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    points.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
}

fn curve(figure: &Figure, name: &str, rung: Rung) -> Vec<(f64, f64)> {
    let curve = figure.curves.iter().find(|c| c.name == name && c.rung == rung).unwrap();
    curve.points.iter().map(|p| (p.x, p.y)).collect()
}

/// The value of a curve at `x`.
fn at(curve: &[(f64, f64)], x: f64) -> f64 {
    curve.iter().find(|(x_i, _)| (x_i / x - 1.0).abs() < 1e-9).unwrap().1
}

/// Where two curves change sides, between their points.
fn crossings(a: &[(f64, f64)], b: &[(f64, f64)]) -> Vec<f64> {
    let gaps: Vec<(f64, f64)> = a.iter().zip(b).map(|(a, b)| (a.0, a.1 - b.1)).collect();
    let changes = gaps.windows(2).filter(|pair| pair[0].1 * pair[1].1 < 0.0).map(|pair| {
        let part = pair[0].1 / (pair[0].1 - pair[1].1);
        pair[0].0 + part * (pair[1].0 - pair[0].0)
    });
    changes.collect()
}

fn falls(curve: &[(f64, f64)]) -> bool {
    curve.windows(2).all(|pair| pair[1].1 < pair[0].1)
}

/// Catches a page that is wrong on Eq. 9: with its pi the force would be 21.6 N, not Table 4's 34.1 N.
#[test]
fn eq_9_has_a_pi_too_many() {
    let f_max_n = integral_contact(&Scene::default()).unwrap().f_max_n;
    // Eq. 16 goes with K_c^(2/5).
    let as_printed = f_max_n * std::f64::consts::PI.powf(-0.4);
    assert!((f_max_n - 34.149).abs() < 1e-3 && (as_printed - 21.60).abs() < 0.01, "{as_printed}");
}

/// Catches a page that is wrong on Eqs. 30 and 46: cos^2 d in the bending would make Table 10's 2.783 mm 2.360 mm.
#[test]
fn eq_30_has_a_cos2_that_eq_46_has_not() {
    let scene = Scene { h_m: 2.54e-3, ..Scene::default() };
    let contact = defect_contact(&scene).unwrap();
    let of_eq_30 = contact.alpha_max_m + scene.cos2_d() * (contact.d_max_m - contact.alpha_max_m);
    assert!((contact.d_max_m - 2.783_273e-3).abs() < 1e-9 && (of_eq_30 - 2.360e-3).abs() < 1e-6, "{of_eq_30}");
}

/// Catches a page that is wrong on Eq. 32: m_1 V^2/2 on its left gives 33.70 N, not Table 8's 33.65 N.
#[test]
fn eq_32_needs_the_mass_factor() {
    let (mut low, mut high) = (0.0_f64, 100.0_f64);
    let scene = Scene::default();
    for _ in 0..200 {
        let f = 0.5 * (low + high);
        let energy = 0.4 * f.powf(5.0 / 3.0) / scene.k_c_n_per_m1_5().powf(2.0 / 3.0)
            + scene.cos2_d() * f * f / (2.0 * scene.k_f_n_per_m());
        let printed = 0.5 * scene.m_1_kg * scene.velocity_m_per_s.powi(2);
        if energy < printed { low = f } else { high = f }
    }
    assert!((low - 33.705).abs() < 2e-3, "{low}");
    assert!((defect_contact(&scene).unwrap().f_max_n - 33.650).abs() < 1e-3);
}

/// Catches a page that is wrong on Eq. 47 and on the text after Eq. 49: a shallower or longer crack makes the layer
/// softer, and by sqrt(k/m) its frequency lower.
#[test]
fn eq_47_is_inverted() {
    let layer = |h_m: f64, l_m: f64| {
        let scene = Scene { h_m, l_m, ..Scene::default() };
        let mass_kg = scene.rho_2_kg_per_m3 * scene.w_m * l_m * h_m / 4.0;
        (scene.k_f_n_per_m(), (scene.k_f_n_per_m() / mass_kg).sqrt() / std::f64::consts::TAU)
    };
    let (deep, shallow, long) = (layer(25.4e-3, 25.4e-3), layer(12.7e-3, 25.4e-3), layer(25.4e-3, 50.8e-3));
    assert!(shallow.0 < deep.0 && long.0 < deep.0);
    assert!(shallow.1 < deep.1 && long.1 < deep.1);
    assert!((deep.1 - 2625.0).abs() < 1.0 && (shallow.1 - 1313.0).abs() < 1.0, "{deep:?} {shallow:?}");
    // Such layers are no thin plates: their shear makes them softer still.
    let sheared = |h_m: f64, hz: f64| hz / Scene { h_m, l_m: 25.4e-3, ..Scene::default() }.shear_factor().sqrt();
    let sheared = [sheared(25.4e-3, deep.1), sheared(12.7e-3, shallow.1)];
    assert!((sheared[0] - 1230.0).abs() < 5.0 && (sheared[1] - 950.0).abs() < 5.0, "{sheared:?}");
}

/// Catches a page that is wrong on section 5.2: 16384 samples in 0.4 s are 40.96 kHz with bins of 2.5 Hz.
#[test]
fn a_record_of_0_4_s_has_bins_of_2_5_hz() {
    let seconds = 16_384.0 / SimulationConfig::default().sample_rate_hz;
    assert!((seconds - 0.4).abs() < 1e-12 && (1.0 / seconds - 2.5).abs() < 1e-12);
}

/// Catches a page that is wrong on Fig. 22: 200 N are reached at 8.1 m/s, by the damped contact at 8.6 m/s.
#[test]
fn fig_22_reads_8_m_per_s() {
    let figure = figure(22).unwrap();
    for (rung, v) in [(Rung::Closed, 8.07), (Rung::Integral, 8.58)] {
        let curve = curve(&figure, "no crack", rung);
        let above = curve.windows(2).find(|pair| pair[1].1 >= 200.0).unwrap();
        let share = (200.0 - above[0].1) / (above[1].1 - above[0].1);
        assert!((above[0].0 + share * (above[1].0 - above[0].0) - v).abs() < 0.01, "{rung} {above:?}");
    }
}

/// Catches a page that is wrong on the length of a crack: the closed form's force falls with it, that of the rungs in
/// time falls and then rises, on the full one within its domain (from 25.4 mm on); the duration rises on all.
#[test]
fn a_longer_crack_need_not_take_more_force() {
    let force = figure(31).unwrap();
    // The figure is of the heavier block; the page's numbers are at its baseline.
    assert!(falls(&curve(&force, "h = 12.7 mm", Rung::Closed)));
    for (l_m, f_max_n) in [(25.4e-3, 30.72), (50.8e-3, 26.14)] {
        let found = defect_contact(&Scene { h_m: 12.7e-3, l_m, ..Scene::default() }).unwrap().f_max_n;
        assert!((found - f_max_n).abs() < 0.01, "{found} N at {l_m} m");
    }
    for (rung, l_m, f_max_n) in [(Rung::Plate, 25.4e-3, 24.02), (Rung::Full, 16.5e-3, 21.72)] {
        let points = curve(&force, "h = 12.7 mm", rung);
        let (l, f) = least(points.iter().copied());
        assert!((l - l_m).abs() < 1e-3 && (f - f_max_n).abs() < 0.01, "{rung}: {f} N at {l} m");
        assert!((at(&points, 50.8e-3) - 25.74).abs() < 0.05, "{rung}");
        assert!(at(&points, 25.4e-3) < 0.96 * at(&points, 50.8e-3), "{rung}");
    }
    let duration = figure(32).unwrap();
    for rung in [Rung::Closed, Rung::Plate, Rung::Full] {
        let points = curve(&duration, "h = 12.7 mm", rung);
        assert!(at(&points, 50.8e-3) > 1.2 * at(&points, 25.4e-3) || rung == Rung::Closed, "{rung}");
        assert!(at(&points, 50.8e-3) > 1.1 * at(&points, 25.4e-3), "{rung}");
    }
}

/// Catches a page that is wrong on Figs. 37 and 38: the curves of two lengths never meet in the closed form, and do in
/// the rungs in time; there a longer crack at 12.7 mm does not deform more.
#[test]
fn curves_of_fig_37_meet_on_the_rungs_in_time_only() {
    let depth = figure(37).unwrap();
    let of = |rung| crossings(&curve(&depth, "l = 25.4 mm", rung), &curve(&depth, "l = 50.8 mm", rung));
    assert!(of(Rung::Closed).is_empty());
    let (plate, full) = (of(Rung::Plate), of(Rung::Full));
    assert!(plate.len() == 2 && (plate[0] - 7.01e-3).abs() < 3e-5 && (plate[1] - 14.99e-3).abs() < 3e-5, "{plate:?}");
    assert!(full.len() == 1 && (full[0] - 6.83e-3).abs() < 3e-5, "{full:?}");
    let length = figure(38).unwrap();
    let [closed, full] = [Rung::Closed, Rung::Full].map(|rung| curve(&length, "h = 12.7 mm", rung));
    assert!((at(&closed, 50.8e-3) / at(&closed, 25.4e-3) - 1.165).abs() < 1e-3);
    assert!((at(&full, 50.8e-3) / at(&full, 25.4e-3) - 0.952).abs() < 1e-3);
}

/// Catches a page that is wrong on the depth: on every rung a deeper crack takes less force away; how much is left at
/// 25.4 mm, and how far the duration is from that without a crack.
#[test]
fn deeper_cracks_are_felt_less() {
    let [force, duration, sound] = [26, 27, 22].map(|number| figure(number).unwrap());
    for (rung, base, at_25) in
        [(Rung::Closed, Rung::Closed, 0.985), (Rung::Plate, Rung::Integral, 0.958), (Rung::Full, Rung::Integral, 0.855)]
    {
        let curve_26 = curve(&force, "l = 25.4 mm", rung);
        assert!(curve_26.windows(2).all(|pair| pair[1].1 > pair[0].1), "{rung}");
        let without = curve(&sound, "no crack", base);
        // Force goes with V^1.2 exactly, on both.
        let without = at(&without, 2.0) * (1.85_f64 / 2.0).powf(1.2);
        assert!(
            (at(&curve_26, 25.4e-3) / without - at_25).abs() < 1e-3,
            "{rung}: {}",
            at(&curve_26, 25.4e-3) / without
        );
        assert!(falls(&curve(&duration, "l = 25.4 mm", rung)), "{rung}");
    }
    let closed = curve(&duration, "l = 25.4 mm", Rung::Closed);
    assert!((at(&closed, 15.24e-3) / 0.765_869e-3 - 1.066).abs() < 1e-3);
}

/// Catches a page that is wrong on lambda_f: by Eq. 34 it nears 1 under a thin layer, by Eq. 3 half comes back.
#[test]
fn a_thin_layer_gives_half_the_energy_back() {
    let figure = figure(20).unwrap();
    for (rung, lambda) in [(Rung::Closed, 0.933), (Rung::Plate, 0.540), (Rung::Full, 0.541)] {
        assert!((at(&curve(&figure, "h", rung), 0.1) - lambda).abs() < 1e-3, "{rung}");
    }
    let closed = curve(&figure, "l", Rung::Closed);
    assert!((at(&closed, 2.0) - at(&closed, 1.0) - 0.0459).abs() < 1e-4);
}
