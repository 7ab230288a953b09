//! The slow twin: the equations of an impact, solved in small steps of equal length. It shares no code with `model`.

use tapline_model::Impact;

/// Window of an outcome, as in `model`.
const WINDOW_S: f64 = 20e-3;
/// Steps of the contact's own time (m^2/(K^2 V))^(1/5).
const STEPS: f64 = 2000.0;

/// An impact that was followed to its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Solved {
    f_max_n: f64,
    contact_time_s: f64,
    d_max_m: f64,
    restitution: f64,
}

/// Positions and velocities of impactor and layer.
#[derive(Debug, Clone, Copy)]
struct Motion {
    x: [f64; 2],
    v: [f64; 2],
}

impl Solved {
    pub(super) fn new(impact: &Impact) -> Self {
        Self::by(impact, -1.0)
    }

    /// With a' = x_1' + `sign` x_2', in which Eq. 7 prints a plus.
    pub(super) fn by(impact: &Impact, sign: f64) -> Self {
        let v0 = impact.velocity_m_per_s;
        let unit_s = (impact.mass_kg.powi(2) / (impact.k_c_n_per_m1_5.powi(2) * v0)).powf(0.2);
        let dt = unit_s / STEPS;
        let mut motion = Motion { x: [0.0; 2], v: [v0, 0.0] };
        let mut solved = Self { f_max_n: 0.0, contact_time_s: 0.0, d_max_m: 0.0, restitution: f64::NAN };
        let mut forces = [0.0; 3];
        let mut time_s = 0.0;
        while time_s < WINDOW_S {
            let before = motion;
            motion = step(impact, sign, motion, dt);
            time_s += dt;
            forces = [forces[1], forces[2], force(impact, sign, &motion)];
            let peak = vertex(forces);
            solved.f_max_n = if peak > solved.f_max_n { peak } else { solved.f_max_n };
            solved.d_max_m = if motion.x[0] > solved.d_max_m { motion.x[0] } else { solved.d_max_m };
            let (gap, gap_before) = (motion.x[0] - motion.x[1], before.x[0] - before.x[1]);
            if gap > 0.0 {
                (solved.contact_time_s, solved.restitution) = (time_s, -motion.v[0] / v0);
            } else if gap_before > 0.0 {
                // The instant at which they part, interpolated between the steps.
                let part = gap_before / (gap_before - gap);
                solved.contact_time_s = time_s - dt + part * dt;
                solved.restitution = -(before.v[0] + part * (motion.v[0] - before.v[0])) / v0;
            }
            // From a target that does not move, the impactor leaves for good.
            let is_gone = gap <= 0.0 && motion.v[0] < 0.0 && impact.plate.is_none();
            if is_gone {
                break;
            }
        }
        solved
    }

    /// Peak force, contact time, deepest position and restitution.
    pub(super) fn quantities(&self) -> [f64; 4] {
        [self.f_max_n, self.contact_time_s, self.d_max_m, self.restitution]
    }
}

/// The top of the parabola through three values of equal distance, where the middle one is the largest.
fn vertex([a, b, c]: [f64; 3]) -> f64 {
    let bend = a - 2.0 * b + c;
    if b > a && b >= c && bend < 0.0 { b - (a - c).powi(2) / (8.0 * bend) } else { b }
}

fn force(impact: &Impact, sign: f64, motion: &Motion) -> f64 {
    let gap = motion.x[0] - motion.x[1];
    let pull = 1.0 + impact.chi * (motion.v[0] + sign * motion.v[1]) / impact.velocity_m_per_s;
    if gap > 0.0 && pull > 0.0 { impact.k_c_n_per_m1_5 * gap.powf(1.5) * pull } else { 0.0 }
}

/// Accelerations of impactor and layer.
fn accelerations(impact: &Impact, sign: f64, motion: &Motion) -> [f64; 2] {
    let force_n = force(impact, sign, motion);
    let layer = impact.plate.map_or(0.0, |plate| {
        let held = plate.damping_n_s_per_m * motion.v[1]
            + plate.stiffness_n_per_m * motion.x[1]
            + plate.membrane_n_per_m3 * motion.x[1].powi(3);
        (force_n - held) / plate.mass_kg
    });
    [-force_n / impact.mass_kg, layer]
}

/// One step of Runge and Kutta's classical method.
fn step(impact: &Impact, sign: f64, from: Motion, dt: f64) -> Motion {
    let moved = |by: f64, v: [f64; 2], a: [f64; 2]| Motion {
        x: [from.x[0] + by * v[0], from.x[1] + by * v[1]],
        v: [from.v[0] + by * a[0], from.v[1] + by * a[1]],
    };
    let a1 = accelerations(impact, sign, &from);
    let second = moved(0.5 * dt, from.v, a1);
    let a2 = accelerations(impact, sign, &second);
    let third = moved(0.5 * dt, second.v, a2);
    let a3 = accelerations(impact, sign, &third);
    let fourth = moved(dt, third.v, a3);
    let a4 = accelerations(impact, sign, &fourth);
    let mean = |k: [f64; 4]| (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3]) / 6.0;
    let v = [0, 1].map(|i| mean([from.v[i], second.v[i], third.v[i], fourth.v[i]]));
    let a = [0, 1].map(|i| mean([a1[i], a2[i], a3[i], a4[i]]));
    moved(dt, v, a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tapline_model::{DampingLaw, Rung, Scene};

    /// Catches a wrong twin: two programs that share no code agree on all four quantities, also over a crack that
    /// strikes the impactor again.
    #[test]
    fn two_programs_agree() {
        for h_m in [2e-3, 6e-3, 25.4e-3, 100e-3] {
            let scene = Scene { h_m, ..Scene::default() };
            let solved = Solved::new(&Impact::full(&scene).unwrap()).quantities();
            let c = Rung::Full.contact(&scene, DampingLaw::Exact).unwrap();
            for (twin, ours) in solved.into_iter().zip([c.f_max_n, c.contact_time_s, c.d_max_m, c.restitution]) {
                assert!((twin / ours - 1.0).abs() < 1e-5, "{h_m}: {twin} {ours}");
            }
        }
    }
}
