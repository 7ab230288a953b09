//! The impactor on the casing: Hertz's contact with Hunt and Crossley's damping, on a flexural plate.
//!
//! | letter | quantity |
//! |---|---|
//! | K, d | contact stiffness, indentation: F = K d^1.5 (1 + b d'), never below 0 |
//! | b | 1.5 times the slope of restitution over velocity: e = 1 - (b/1.5) V for small b V |
//! | Z | impedance of the plate: its surface moves with F/Z |
//! | k, m, c | stiffness, mass and damping of the loosened layer between contact and plate, over a crack |

/// Distance from the surface, m, at which the contact is over.
const GAP_M: f64 = 5e-5;
/// Longest contact that is simulated, s.
const LONGEST_S: f64 = 8e-3;

/// A layer that a crack has separated from the plate below it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer {
    /// Force for 1 m of deflection.
    pub stiffness_n_per_m: f64,
    /// Mass that moves with it.
    pub mass_kg: f64,
    /// Force for 1 m/s of deflection.
    pub damping_n_s_per_m: f64,
}

impl Layer {
    /// Its natural frequency without damping.
    pub fn frequency_hz(&self) -> f64 {
        (self.stiffness_n_per_m / self.mass_kg).sqrt() / std::f64::consts::TAU
    }
}

/// One impact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Contact {
    /// Mass of the impactor.
    pub mass_kg: f64,
    /// Velocity at first touch.
    pub velocity_m_per_s: f64,
    /// K.
    pub stiffness_n_per_m1_5: f64,
    /// b.
    pub damping_s_per_m: f64,
    /// Z; infinite for a target that does not move.
    pub impedance_n_s_per_m: f64,
    /// The layer between impactor and plate, over a crack.
    pub layer: Option<Layer>,
}

/// The state at one instant: positions and velocities of impactor, plate and layer.
#[derive(Debug, Clone, Copy, Default)]
struct State {
    x: f64,
    v: f64,
    plate: f64,
    layer: f64,
    layer_v: f64,
}

impl State {
    fn plus(self, rate: Self, dt: f64) -> Self {
        Self {
            x: self.x + dt * rate.x,
            v: self.v + dt * rate.v,
            plate: self.plate + dt * rate.plate,
            layer: self.layer + dt * rate.layer,
            layer_v: self.layer_v + dt * rate.layer_v,
        }
    }
}

impl Contact {
    /// Force at the instants `first_s`, `first_s + step_s`, ... after first touch, into `force_n`, until the impactor
    /// has left. Each step consists of `parts` Runge-Kutta steps of fourth order.
    pub(crate) fn force(&self, first_s: f64, step_s: f64, parts: u32, force_n: &mut Vec<f64>) {
        self.follow(first_s, step_s, parts, |_, force| force_n.push(force));
    }

    /// Calls `see` with the state and the force at each of these instants.
    fn follow(&self, first_s: f64, step_s: f64, parts: u32, mut see: impl FnMut(&State, f64)) {
        let mut state = State { v: self.velocity_m_per_s, ..State::default() };
        let mut time = first_s;
        state = self.step(state, first_s);
        let dt = step_s / f64::from(parts.max(1));
        loop {
            let (_, force, indentation) = self.rates(&state);
            see(&state, force);
            let surface_v = if self.layer.is_some() { state.layer_v } else { 0.0 };
            let has_left = indentation < 0.0 && state.v < surface_v && indentation < -GAP_M;
            // A NaN in the state ends it too.
            if has_left || time >= LONGEST_S || !(time + indentation).is_finite() {
                return;
            }
            for _ in 0..parts.max(1) {
                state = self.step(state, dt);
            }
            time += step_s;
        }
    }

    fn step(&self, state: State, dt: f64) -> State {
        let (a, ..) = self.rates(&state);
        let (b, ..) = self.rates(&state.plus(a, 0.5 * dt));
        let (c, ..) = self.rates(&state.plus(b, 0.5 * dt));
        let (d, ..) = self.rates(&state.plus(c, dt));
        state.plus(a, dt / 6.0).plus(b, dt / 3.0).plus(c, dt / 3.0).plus(d, dt / 6.0)
    }

    /// Derivative of the state, the force, and the indentation.
    fn rates(&self, state: &State) -> (State, f64, f64) {
        let surface = if self.layer.is_some() { state.layer } else { state.plate };
        let indentation = state.x - surface;
        let root = if indentation > 0.0 { indentation.sqrt() } else { 0.0 };
        let hertz = self.stiffness_n_per_m1_5 * indentation * root;
        let admittance = 1.0 / self.impedance_n_s_per_m;
        match self.layer {
            None => {
                // The plate's velocity F/Z is part of d', so the equation is solved for F.
                let force =
                    hertz * (1.0 + self.damping_s_per_m * state.v) / (1.0 + hertz * self.damping_s_per_m * admittance);
                let force = if force > 0.0 { force } else { 0.0 };
                let rate =
                    State { x: state.v, v: -force / self.mass_kg, plate: force * admittance, ..State::default() };
                (rate, force, indentation)
            }
            Some(Layer { stiffness_n_per_m, mass_kg, damping_n_s_per_m }) => {
                let force = hertz * (1.0 + self.damping_s_per_m * (state.v - state.layer_v));
                let force = if force > 0.0 { force } else { 0.0 };
                let held = stiffness_n_per_m * (state.layer - state.plate) + damping_n_s_per_m * state.layer_v;
                let plate_v = held * admittance / (1.0 + damping_n_s_per_m * admittance);
                let on_plate = held - damping_n_s_per_m * plate_v;
                let rate = State {
                    x: state.v,
                    v: -force / self.mass_kg,
                    plate: plate_v,
                    layer: state.layer_v,
                    layer_v: (force - on_plate) / mass_kg,
                };
                (rate, force, indentation)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IMPACT: Contact = Contact {
        mass_kg: 4.5e-3,
        velocity_m_per_s: 1.85,
        stiffness_n_per_m1_5: 2.2e6,
        damping_s_per_m: 0.0,
        impedance_n_s_per_m: f64::INFINITY,
        layer: None,
    };
    const LAYER: Layer = Layer { stiffness_n_per_m: 4e5, mass_kg: 8e-3, damping_n_s_per_m: 8.0 };
    const STEP_S: f64 = 1.0 / 40_960.0;

    fn force(contact: &Contact, parts: u32) -> Vec<f64> {
        let mut force = Vec::new();
        contact.force(0.0, STEP_S / 16.0, parts, &mut force);
        force
    }

    fn peak(force: &[f64]) -> f64 {
        force.iter().copied().max_by(f64::total_cmp).unwrap()
    }

    /// Contact time, in s.
    fn touched(force: &[f64]) -> f64 {
        force.iter().filter(|&&f| f > 0.0).count() as f64 * STEP_S / 16.0
    }

    /// Rebound over approach.
    fn restitution(contact: &Contact) -> f64 {
        let mut last = 0.0;
        contact.follow(0.0, STEP_S / 16.0, 1, |state, _| last = state.v);
        -last / contact.velocity_m_per_s
    }

    /// Hertz 1881: an elastic contact lasts 2.9432 d/V with the deepest indentation d = (5 m V^2/(4 K))^0.4, and its
    /// largest force is K d^1.5. Catches a wrong exponent, step or end.
    #[test]
    fn an_elastic_contact_is_that_of_hertz() {
        let v = IMPACT.velocity_m_per_s;
        let deepest = (1.25 * IMPACT.mass_kg * v * v / IMPACT.stiffness_n_per_m1_5).powf(0.4);
        let force = force(&IMPACT, 1);
        let f_max = IMPACT.stiffness_n_per_m1_5 * deepest.powf(1.5);
        assert!((peak(&force) / f_max - 1.0).abs() < 1e-4, "{} {f_max}", peak(&force));
        let time = 2.943_2 * deepest / v;
        assert!((touched(&force) - time).abs() < 2.0 * STEP_S / 16.0, "{} {time}", touched(&force));
        assert!((restitution(&IMPACT) - 1.0).abs() < 1e-4);
    }

    /// Hunt and Crossley 1975: e = 1 - (b/1.5) V for small b V. Catches a factor in the damping.
    #[test]
    fn damping_takes_the_stated_restitution() {
        for slope in [0.005, 0.01, 0.02] {
            let damped = Contact { damping_s_per_m: 1.5 * slope, velocity_m_per_s: 1.0, ..IMPACT };
            assert!((1.0 - restitution(&damped) - slope).abs() < 0.05 * slope, "{}", restitution(&damped));
        }
    }

    /// Zener 1941: for a small inelasticity parameter the plate alone takes energy, as a layer does. Catches energy
    /// gained in the contact, the plate's impedance or the layer.
    #[test]
    fn energy_never_grows() {
        let full = 0.5 * IMPACT.mass_kg * IMPACT.velocity_m_per_s.powi(2);
        for layer in [None, Some(LAYER)] {
            for (damping, impedance) in [(0.0, f64::INFINITY), (0.0, 600.0), (0.5, 600.0)] {
                let contact = Contact { damping_s_per_m: damping, impedance_n_s_per_m: impedance, layer, ..IMPACT };
                let mut last = full;
                contact.follow(0.0, STEP_S, 4, |s, _| {
                    let surface = if layer.is_some() { s.layer } else { s.plate };
                    let depth = if s.x > surface { s.x - surface } else { 0.0 };
                    let of_layer = layer.map_or(0.0, |l| {
                        0.5 * l.mass_kg * s.layer_v.powi(2) + 0.5 * l.stiffness_n_per_m * (s.layer - s.plate).powi(2)
                    });
                    let energy = 0.5 * contact.mass_kg * s.v.powi(2)
                        + 0.4 * contact.stiffness_n_per_m1_5 * depth.powf(2.5)
                        + of_layer;
                    assert!(energy <= last + 1e-6 * full, "{energy} after {last}: {contact:?}");
                    last = energy;
                });
                assert!(layer.is_some() || damping > 0.0 || impedance < 1e9 || last > 0.999 * full);
            }
        }
    }

    /// A plate that moves with F/Z reduces the force. Catches an inverted impedance.
    #[test]
    fn a_soft_plate_takes_force() {
        let peaks = [f64::INFINITY, 1000.0, 300.0, 50.0]
            .map(|impedance| peak(&force(&Contact { impedance_n_s_per_m: impedance, ..IMPACT }, 1)));
        assert!(peaks.windows(2).all(|p| p[1] < p[0]), "{peaks:?}");
    }

    /// Catches a loosened layer that does not lower the force and lengthen the contact, more so the softer it is, and a
    /// stiff layer that has an effect.
    #[test]
    fn a_softer_layer_is_touched_longer_and_pressed_less() {
        let contact = |stiffness_n_per_m: f64| {
            let force = force(&Contact { layer: Some(Layer { stiffness_n_per_m, ..LAYER }), ..IMPACT }, 1);
            (peak(&force), touched(&force))
        };
        let stiff = contact(4e7);
        let rigid = force(&IMPACT, 1);
        assert!((stiff.0 / peak(&rigid) - 1.0).abs() < 5e-3, "{stiff:?}");
        let soft = [4e7, 1e6, 4e5, 2e5].map(contact);
        assert!(soft.windows(2).all(|p| p[1].0 < p[0].0 && p[1].1 > p[0].1), "{soft:?}");
    }

    /// Catches time steps of a record that are too long for the contact.
    #[test]
    fn two_steps_a_sample_are_enough() {
        for layer in [None, Some(LAYER)] {
            let contact = Contact { damping_s_per_m: 0.5, impedance_n_s_per_m: 600.0, layer, ..IMPACT };
            let (mut coarse, mut fine) = (Vec::new(), Vec::new());
            contact.force(1e-5, STEP_S, 2, &mut coarse);
            contact.force(1e-5, STEP_S, 64, &mut fine);
            for (a, b) in coarse.iter().zip(&fine) {
                assert!((a - b).abs() < 1e-3 * peak(&fine), "{a} {b}");
            }
        }
    }
}
