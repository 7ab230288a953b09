//! The course of one impact: a damped Hertz contact on a rigid target or on the plate above a crack.

use crate::contact::compliance::Compliance;
use crate::contact::ode::{State, Step, Stepping, integrate, locate, runge_kutta_4};
use crate::{DampedContact, Error, Scene, chi_for_restitution};

/// The outcome of an impact after 20 ms; a longer contact is cut off there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Peak force.
    pub f_max_n: f64,
    /// Last instant with a force, further contacts included.
    pub contact_time_s: f64,
    /// Deepest position of the impactor.
    pub d_max_m: f64,
    /// Velocity of the impactor after contact over that before, reversed.
    pub restitution: f64,
    /// Largest local deformation alpha at the steps of the integration (within 1e-3).
    pub alpha_max_m: f64,
    /// Largest deflection of the plate in either direction at those steps; 0 without a plate.
    pub deflection_max_m: f64,
}

/// The layer above a crack as one degree of freedom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plate {
    /// Moving mass m_p.
    pub mass_kg: f64,
    /// Viscous damping C.
    pub damping_n_s_per_m: f64,
    /// Stiffness K_f.
    pub stiffness_n_per_m: f64,
    /// Membrane stiffness, which multiplies the cube of the deflection; 0 for a plate that only bends.
    pub membrane_n_per_m3: f64,
}

/// An impact: m_1 x_1'' = -F, m_p x_2'' + C x_2' + K_f x_2 + K_m x_2^3 = F, F = max(0, K_c a^1.5 (1 + chi a'/V)) for a
/// = x_1 - x_2 > 0; K_m is 0 except in the full rung.
///
/// Numbers from a [`Scene`] are checked. Numbers set by hand are not: impossible ones give NaN or [`Error::TooStiff`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impact {
    /// Contact stiffness K_c.
    pub k_c_n_per_m1_5: f64,
    /// Damping ratio chi of the contact.
    pub chi: f64,
    /// Velocity V of the impactor at the first touch.
    pub velocity_m_per_s: f64,
    /// Mass m_1 of the impactor.
    pub mass_kg: f64,
    /// The plate it hits; `None` for a target that does not move.
    pub plate: Option<Plate>,
}

/// The impact in its own units: lengths in L = (m V^2/K)^0.4, times in T = L/V, masses in that of the impactor.
#[derive(Debug, Clone, Copy)]
struct Scaled {
    chi: f64,
    /// Mass, damping, stiffness and membrane stiffness of the plate.
    plate: Option<[f64; 4]>,
}

/// x_1, x_1', x_2, x_2' in the units of [`Scaled`].
type Motion = State<4>;

impl Scaled {
    /// Force in units of m L/T^2.
    fn force(&self, y: &Motion) -> f64 {
        let a = y[0] - y[2];
        let pull = 1.0 + self.chi * (y[1] - y[3]);
        if a > 0.0 && pull > 0.0 { a * a.sqrt() * pull } else { 0.0 }
    }

    fn rate(&self, y: &Motion) -> Motion {
        let force = self.force(y);
        let x_2_acceleration = self.plate.map_or(0.0, |[mass, damping, stiffness, membrane]| {
            (force - damping * y[3] - (stiffness + membrane * y[2] * y[2]) * y[2]) / mass
        });
        [y[1], -force, y[3], x_2_acceleration]
    }

    fn is_touching(&self, y: &Motion) -> bool {
        self.force(y) > 0.0
    }

    /// Whether the bodies, apart at `y`, can never meet again.
    ///
    /// The impactor must move away beyond the range that the plate's energy allows; damping only reduces that energy.
    fn is_over(&self, y: &Motion) -> bool {
        let reach_squared = self.plate.map_or(0.0, |[mass, _, stiffness, membrane]| {
            let x_2_squared = y[2] * y[2];
            (mass * y[3] * y[3] + (stiffness + 0.5 * membrane * x_2_squared) * x_2_squared) / stiffness
        });
        y[1] < 0.0 && y[0] < 0.0 && y[0] * y[0] > reach_squared
    }

    /// Whether there is a force and it rises.
    fn is_rising(&self, y: &Motion) -> bool {
        let (a, velocity) = (y[0] - y[2], y[1] - y[3]);
        let rate = self.rate(y);
        let pull_rate = self.chi * (rate[1] - rate[3]);
        // The derivative of a^1.5 (1 + chi a'), divided by sqrt(a).
        self.is_touching(y) && 1.5 * velocity * (1.0 + self.chi * velocity) + a * pull_rate > 0.0
    }
}

impl Impact {
    /// The integral rung with exact damping: one body of mass 1/M against a target at rest.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if a quantity of the scene is outside its bounds.
    pub fn integral(scene: &Scene) -> Result<Self, Error> {
        scene.validate()?;
        Ok(Self {
            k_c_n_per_m1_5: scene.k_c_n_per_m1_5(),
            chi: chi_for_restitution(scene.restitution)?,
            velocity_m_per_s: scene.velocity_m_per_s,
            mass_kg: 1.0 / scene.mass_factor_per_kg(),
            plate: None,
        })
    }

    /// The plate rung (Eqs. 21-22): the impactor against the layer above the crack, without the target's own motion.
    ///
    /// As the method defines it, K_c is computed from the baseline's masses, whatever the masses of the scene.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if a quantity of the scene is outside its bounds.
    pub fn plate(scene: &Scene) -> Result<Self, Error> {
        scene.validate()?;
        let baseline = Scene::default();
        let contact = Scene { m_1_kg: baseline.m_1_kg, m_2_kg: baseline.m_2_kg, ..*scene };
        let stiffness_n_per_m = scene.k_f_n_per_m();
        let mass_kg = scene.rho_2_kg_per_m3 * scene.w_m * scene.l_m * scene.h_m / 4.0;
        Ok(Self {
            k_c_n_per_m1_5: contact.k_c_n_per_m1_5(),
            chi: chi_for_restitution(scene.restitution)?,
            velocity_m_per_s: scene.velocity_m_per_s,
            mass_kg: scene.m_1_kg,
            // C = K_f tan d/omega with omega = sqrt(K_f/m_p) (Eqs. 24-25; Eq. 47 prints omega inverted).
            plate: Some(Plate {
                mass_kg,
                damping_n_s_per_m: scene.loss_tangent() * (stiffness_n_per_m * mass_kg).sqrt(),
                stiffness_n_per_m,
                membrane_n_per_m3: 0.0,
            }),
        })
    }

    /// The full rung: the plate rung with the layer's shear, which softens it, and its membrane, which stiffens it.
    ///
    /// K_f falls to K_f/s, and C with it by its formula; the membrane adds c K_f/h^2 x_2^3. For s and c see
    /// [`Scene::shear_factor`] and [`Scene::membrane_coefficient`].
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if a quantity of the scene is outside its bounds.
    pub fn full(scene: &Scene) -> Result<Self, Error> {
        let thin = Self::plate(scene)?;
        let plate = thin.plate.map(|p| {
            let stiffness_n_per_m = p.stiffness_n_per_m / scene.shear_factor();
            Plate {
                mass_kg: p.mass_kg,
                damping_n_s_per_m: scene.loss_tangent() * (stiffness_n_per_m * p.mass_kg).sqrt(),
                stiffness_n_per_m,
                membrane_n_per_m3: scene.membrane_coefficient() * p.stiffness_n_per_m / (scene.h_m * scene.h_m),
            }
        });
        Ok(Self { plate, ..thin })
    }

    /// The same without its layer where that is known to change no quantity of the contact by more than `tolerance`, relative:
    /// a crack so deep is a sound casing. `rigid` is the contact on a target that does not move, in its own units.
    pub fn without_rigid_layer(self, rigid: &DampedContact, loss_tangent: f64, tolerance: f64) -> Self {
        let is_rigid = Compliance::is_rigid(&self, rigid, loss_tangent, tolerance);
        Self { plate: self.plate.filter(|_| !is_rigid), ..self }
    }

    /// Units of length and time, L and T.
    pub(crate) fn units(&self) -> (f64, f64) {
        let v = self.velocity_m_per_s;
        let length_m = (self.mass_kg * v * v / self.k_c_n_per_m1_5).powf(0.4);
        (length_m, length_m / v)
    }

    fn scaled(&self) -> Scaled {
        let (l, t) = self.units();
        let m = self.mass_kg;
        let plate = self.plate.map(|p| {
            let t_2_per_m = t * t / m;
            [
                p.mass_kg / m,
                p.damping_n_s_per_m * t / m,
                p.stiffness_n_per_m * t_2_per_m,
                p.membrane_n_per_m3 * l * l * t_2_per_m,
            ]
        });
        Scaled { chi: self.chi, plate }
    }

    /// Integrates the impact for 20 ms, or until the bodies cannot meet again.
    ///
    /// # Errors
    /// [`Error::TooStiff`] if that takes too many steps.
    pub fn outcome(&self) -> Result<Outcome, Error> {
        const STEPS_MAX: usize = 400_000;
        const WINDOW_S: f64 = 20e-3;
        let (length_m, time_s) = self.units();
        let scaled = self.scaled();
        let t_end = WINDOW_S / time_s;
        let dt_max = if t_end > 2000.0 { t_end / 40_000.0 } else { 0.05 };
        let stepping = Stepping { tolerance: 1e-11, dt_max, dt_first: 1e-3, steps_max: STEPS_MAX };
        let mut record = Record::default();
        let mut is_over = false;
        let start = [0.0, 1.0, 0.0, 0.0];
        let reached = integrate(
            |y| scaled.rate(y),
            start,
            t_end,
            &stepping,
            |step| {
                record.take(&scaled, step);
                is_over = record.has_parted && !scaled.is_touching(&step.to) && scaled.is_over(&step.to);
                !is_over
            },
        );
        if reached.t < t_end && !is_over {
            let reached_s = reached.t * time_s;
            return Err(Error::TooStiff { steps: reached.steps, reached_s, wanted_s: WINDOW_S });
        }
        Ok(Outcome {
            f_max_n: record.f_max * self.mass_kg * length_m / (time_s * time_s),
            contact_time_s: record.contact_time * time_s,
            d_max_m: record.d_max * length_m,
            restitution: -record.velocity,
            alpha_max_m: record.alpha_max * length_m,
            deflection_max_m: record.deflection_max * length_m,
        })
    }

    /// Force in N at 0, `dt`, 2 `dt`, ..., until the bodies have parted for good; returns `dt` in s.
    ///
    /// Steps are a fiftieth of the contact's own time L/V: within 1e-4 of the peak force, which is enough for the
    /// simulator. Clears `force_n` first. A further contact long afterwards is left out.
    pub fn force_history(&self, force_n: &mut Vec<f64>) -> f64 {
        const DT: f64 = 0.02;
        const STEPS_MAX: usize = 1500;
        force_n.clear();
        let (length_m, time_s) = self.units();
        let unit_n = self.mass_kg * length_m / (time_s * time_s);
        let scaled = self.scaled();
        let mut y = [0.0, 1.0, 0.0, 0.0];
        for _ in 0..STEPS_MAX {
            force_n.push(scaled.force(&y) * unit_n);
            y = runge_kutta_4(|y| scaled.rate(y), &y, DT);
            let has_parted = y[0] - y[2] < -0.5 && y[1] < y[3];
            if has_parted {
                break;
            }
        }
        force_n.push(0.0);
        DT * time_s
    }
}

/// Extremes of an impact so far, in the units of [`Scaled`].
#[derive(Debug, Default)]
struct Record {
    f_max: f64,
    contact_time: f64,
    d_max: f64,
    velocity: f64,
    alpha_max: f64,
    deflection_max: f64,
    has_parted: bool,
}

impl Record {
    fn take(&mut self, scaled: &Scaled, step: &Step<4>) {
        let rate = |y: &Motion| scaled.rate(y);
        if scaled.is_rising(&step.from) && !scaled.is_rising(&step.to) {
            self.see(scaled, &locate(rate, step, |y| scaled.is_rising(y)).1);
        }
        if step.from[1] > 0.0 && step.to[1] <= 0.0 {
            self.see(scaled, &locate(rate, step, |y| y[1] > 0.0).1);
        }
        self.see(scaled, &step.to);
        if scaled.is_touching(&step.to) {
            (self.contact_time, self.velocity) = (step.t + step.dt, step.to[1]);
        } else if scaled.is_touching(&step.from) {
            let (t, y) = locate(rate, step, |y| scaled.is_touching(y));
            (self.contact_time, self.velocity, self.has_parted) = (t, y[1], true);
        }
    }

    fn see(&mut self, scaled: &Scaled, y: &Motion) {
        let force = scaled.force(y);
        self.f_max = if force > self.f_max { force } else { self.f_max };
        self.d_max = if y[0] > self.d_max { y[0] } else { self.d_max };
        let (alpha, deflection) = (y[0] - y[2], y[2].abs());
        self.alpha_max = if alpha > self.alpha_max { alpha } else { self.alpha_max };
        self.deflection_max = if deflection > self.deflection_max { deflection } else { self.deflection_max };
    }
}

#[cfg(test)]
#[path = "impact_tests.rs"]
mod tests;
