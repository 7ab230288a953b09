//! A slow twin of the two bodies in time: plain steps of Runge and Kutta, and a sign that may be wrong.

use tapline_model::{Impact, Scene, chi_for_restitution};

/// Peak force and restitution of the impact of `scene` on the plate above its crack.
///
/// `sign` is that of x_2' in a' = x_1' + sign x_2' (Eq. 7 prints plus), `damping` the plate's C.
pub(crate) fn collide(scene: &Scene, sign: f64, damping: f64) -> (f64, f64) {
    let impact = Impact::plate(scene).unwrap();
    let plate = impact.plate.unwrap();
    run(&impact, (plate.mass_kg, damping, plate.stiffness_n_per_m), sign)
}

/// The restitution that a rigid target returns for the damping ratio `chi`.
pub(crate) fn restitution_of(chi: f64) -> f64 {
    let scene = Scene::default();
    let impact = Impact { chi, plate: None, ..Impact::plate(&scene).unwrap() };
    run(&impact, (1e9, 0.0, 0.0), -1.0).1
}

/// The chi of a law for `restitution`, found by halving on the slow twin; good to 1e-6.
pub(crate) fn chi_by_trial(restitution: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if restitution_of(middle) > restitution { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

fn run(impact: &Impact, (mass, damping, stiffness): (f64, f64, f64), sign: f64) -> (f64, f64) {
    let (v, k, m) = (impact.velocity_m_per_s, impact.k_c_n_per_m1_5, impact.mass_kg);
    let force = |y: &[f64; 4]| {
        let (a, rate) = (y[0] - y[2], y[1] + sign * y[3]);
        if a > 0.0 { (k * a.powf(1.5) * (1.0 + impact.chi * rate / v)).clamp(0.0, f64::MAX) } else { 0.0 }
    };
    let rate = |y: &[f64; 4]| {
        let f = force(y);
        [y[1], -f / m, y[3], (f - damping * y[3] - stiffness * y[2]) / mass]
    };
    // A two-hundredth of the time in which a rigid target is left, and less where the dashpot is faster than that.
    let natural = (m * v * v / k).powf(0.4) / v;
    let relaxing = if damping > 0.0 { mass / damping } else { f64::INFINITY };
    let dt = if relaxing < natural { relaxing.clamp(1e-3 * natural, natural) / 50.0 } else { natural / 100.0 };
    let steps = (20e-3 / dt).ceil().clamp(1.0, 3e6);
    let (mut y, mut f_max, mut t) = ([0.0, v, 0.0, 0.0], 0.0, 0.0);
    while t < steps {
        let step = |k: &[f64; 4], share: f64| std::array::from_fn(|i| y[i] + share * dt * k[i]);
        let k_1 = rate(&y);
        let k_2 = rate(&step(&k_1, 0.5));
        let k_3 = rate(&step(&k_2, 0.5));
        let k_4 = rate(&step(&k_3, 1.0));
        y = std::array::from_fn(|i| y[i] + dt / 6.0 * (k_1[i] + 2.0 * (k_2[i] + k_3[i]) + k_4[i]));
        let f = force(&y);
        f_max = if f > f_max { f } else { f_max };
        t += 1.0;
        if stiffness == 0.0 && y[1] < 0.0 && f == 0.0 {
            break;
        }
    }
    (f_max, -y[1] / v)
}

/// Catches a twin that is no oracle: it must agree with the adaptive integration, and with the exact chi, both by another
/// way than theirs.
#[test]
fn the_slow_twin_is_one() {
    for h_m in [6.35e-3, 12.7e-3, 25.4e-3] {
        let scene = Scene { h_m, ..Scene::default() };
        let impact = Impact::plate(&scene).unwrap();
        let (f_max, restitution) = collide(&scene, -1.0, impact.plate.unwrap().damping_n_s_per_m);
        let outcome = impact.outcome().unwrap();
        assert!((f_max / outcome.f_max_n - 1.0).abs() < 1e-3, "{f_max} {outcome:?}");
        assert!((restitution - outcome.restitution).abs() < 1e-3, "{restitution} {outcome:?}");
    }
    for e in [0.2, 0.5, 0.9] {
        let (slow, exact) = (chi_by_trial(e), chi_for_restitution(e).unwrap());
        assert!((slow / exact - 1.0).abs() < 1e-3, "{e}: {slow} {exact}");
    }
}
