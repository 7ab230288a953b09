//! The simulated rig: taps of simulated tyres, rendered into the samples a converter would give.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, TAU};

use crate::tyre::casing::{Landing, place};
use crate::tyre::converter::Converter;
use crate::tyre::fault::{distort_force, distort_sound, draw_fault, velocity_ratio};
use crate::tyre::identity::{Generator, Identity};
use crate::tyre::pulse::{Pulse, to_f32};
use crate::tyre::sound::{CASING, MODES, Mode, Resonators, SOUND_M_PER_S};
use crate::{Crack, DampedContact, Error, Impact, Plate, Scene, SimulationConfig};

/// Young's modulus of a shoulder: with it, a sound casing has a contact time of 0.9 ms, as in section 5.4.
const CASING_PA: f64 = 12e6;

/// A tyre on the simulated rig.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedTyre {
    /// Serial number; with the seed it determines the casing.
    pub serial: String,
    /// Its cracks; a sound tyre has none.
    pub cracks: Vec<Crack>,
}

/// Identity of a simulated tap: with the seed it determines every sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedTap<'a> {
    /// Serial number of the tyre; one that was not given to the rig is a sound tyre.
    pub tyre_serial: &'a str,
    /// Side of the casing, 1 or 2.
    pub shoulder: u16,
    /// Offset x from the belt edge.
    pub offset_mm: f64,
    /// Planned velocity.
    pub velocity_m_per_s: f64,
    /// Location on the ring; `location_count` is the closing tap, at location 0 again.
    pub location: u32,
    /// Locations of the ring.
    pub location_count: u32,
    /// Which of the planned repetitions.
    pub repetition: u16,
    /// How many times the tap was taken before.
    pub attempt: u16,
}

/// A rig that taps simulated tyres.
///
/// The same seed, configuration, tyre and [`SimulatedTap`] give the same samples, in any order and on any number of rigs:
/// no state is carried from one tap to the next.
#[derive(Debug)]
pub struct SimulatedRig {
    config: SimulationConfig,
    seed: u64,
    cracks: BTreeMap<String, Vec<Crack>>,
    scene: Scene,
    contact: Impact,
    /// The contact on a rigid target, in its own units.
    rigid: DampedContact,
    converter: Converter,
    /// Force of the impact in N, at the times of its own integration.
    history_n: Vec<f64>,
    /// One channel in physical units.
    signal: Vec<f32>,
}

/// The random quantities of one tap.
#[derive(Debug, Clone, Copy)]
struct DrawnTap {
    velocity_m_per_s: f64,
    velocity_measured_m_per_s: f64,
    stiffness: f64,
    loudness: f64,
    /// Time of the first touch, in samples.
    onset: f64,
    hum_phase: f64,
}

impl SimulatedRig {
    /// A rig as `config` describes it, with `tyres` to tap; `seed` determines every random number.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for the configuration, [`Error::Crack`] for a crack, [`Error::DuplicateTyre`] for two
    /// tyres of one serial number.
    pub fn new(config: &SimulationConfig, seed: u64, tyres: &[SimulatedTyre]) -> Result<Self, Error> {
        config.validate()?;
        let mut cracks = BTreeMap::new();
        for SimulatedTyre { serial, cracks: of_tyre } in tyres {
            for (number, crack) in (1..).zip(of_tyre) {
                crack.validate(serial, number)?;
            }
            if cracks.insert(serial.clone(), of_tyre.clone()).is_some() {
                return Err(Error::DuplicateTyre { serial: serial.clone() });
            }
        }
        let scene = Scene { e_2_pa: CASING_PA * config.modulus_ratio, ..Scene::default() };
        let contact = Impact::integral(&scene)?;
        Ok(Self {
            config: config.clone(),
            seed,
            cracks,
            scene,
            contact,
            rigid: DampedContact::new(contact.chi)?,
            converter: Converter::new(config),
            history_n: Vec::new(),
            signal: vec![0.0; config.sample_count as usize],
        })
    }

    /// Samples of a record: force and sound, one after the other.
    pub fn sample_total(&self) -> usize {
        2 * self.config.sample_count as usize
    }

    /// The configuration of the rig.
    pub fn config(&self) -> &SimulationConfig {
        &self.config
    }

    /// Renders `tap` into `samples`, `[force][sound]`, each of `sample_count` counts; returns the impact velocity as the rig measured it,
    /// m/s.
    ///
    /// A tap whose planned velocity is not a positive number touches nothing: its record is noise, and its velocity NaN.
    ///
    /// # Panics
    /// If `samples` does not hold [`SimulatedRig::sample_total`] samples.
    pub fn render(&mut self, tap: &SimulatedTap<'_>, samples: &mut [i16]) -> f64 {
        assert_eq!(samples.len(), self.sample_total(), "a record has force and sound");
        let mut generator = tap_identity(self.seed, "tap", tap).generator();
        // A separate generator, so that faults do not change the other random numbers of the tap.
        let mut fault_generator = tap_identity(self.seed, "fault", tap).generator();
        let fault = draw_fault(&self.config.fault, &mut fault_generator);
        let drawn = self.draw(tap, velocity_ratio(fault), &mut generator);
        let plate = self.plate_under(tap);
        let dt = self.simulate_impact(&drawn, plate);
        let (force, sound) = samples.split_at_mut(self.config.sample_count as usize);
        self.force_signal(&drawn, dt);
        if let Some(kind) = fault {
            distort_force(kind, &self.config, &mut fault_generator, &mut self.signal);
        }
        self.converter.force(&mut self.signal, &mut generator, force);
        self.sound_signal(&drawn, dt, plate);
        if let Some(kind) = fault {
            distort_sound(kind, &self.config, &mut fault_generator, &mut self.signal);
        }
        self.converter.sound(&mut self.signal, drawn.hum_phase, &mut generator, sound);
        drawn.velocity_measured_m_per_s
    }

    /// Static compliance in m/N of the layer above the crack with the largest effect on `tap`; 0 without a crack.
    ///
    /// The effect of a planted crack at a place, without the random variation of the tap.
    pub fn layer_compliance_m_per_n(&self, tap: &SimulatedTap<'_>) -> f64 {
        self.plate_under(tap).map_or(0.0, |plate| 1.0 / plate.stiffness_n_per_m)
    }

    fn draw(&self, tap: &SimulatedTap<'_>, velocity_ratio: f64, generator: &mut Generator) -> DrawnTap {
        let config = &self.config;
        let location_count = tap.location_count.max(1);
        let place = place(
            config,
            self.seed,
            &Landing {
                serial: tap.tyre_serial,
                shoulder: tap.shoulder,
                location: self.location_under(tap) % location_count,
                location_count,
                offset_mm: tap.offset_mm,
            },
        );
        let planned =
            Some(tap.velocity_m_per_s).filter(|v| v.is_finite() && *v > 0.0).map_or(f64::NAN, |v| v.clamp(1e-3, 50.0));
        let velocity_m_per_s =
            velocity_ratio * planned * (1.0 + config.velocity_jitter * generator.normal()).clamp(0.2, 2.0);
        // The trigger fires at the first sample with a force, so the first touch lies within the sample before.
        let onset = f64::from(config.pre_trigger_samples) - generator.uniform();
        DrawnTap {
            velocity_m_per_s,
            velocity_measured_m_per_s: velocity_m_per_s * (1.0 + config.velocity_error * generator.normal()),
            stiffness: place.stiffness * (1.0 + config.repeatability * generator.normal()).clamp(0.2, 2.0),
            loudness: place.loudness
                * (1.0 + config.repeatability * generator.normal()).clamp(0.2, 2.0)
                * turn_gain(config, self.seed, tap),
            onset,
            hum_phase: TAU * generator.uniform(),
        }
    }

    /// The location that the impactor meets.
    fn location_under(&self, tap: &SimulatedTap<'_>) -> u32 {
        if self.config.stands_still { 0 } else { tap.location }
    }

    /// The layer above the crack with the largest effect on the tap, if there is one.
    fn plate_under(&self, tap: &SimulatedTap<'_>) -> Option<Plate> {
        const FELT_MIN: f64 = 1e-3;
        let cracks = self.cracks.get(tap.tyre_serial)?;
        let plates = cracks.iter().filter_map(|crack| {
            let felt = crack.felt(tap.shoulder, self.location_under(tap), tap.location_count, tap.offset_mm);
            (felt > FELT_MIN).then(|| crack.plate(&self.scene, felt))
        });
        plates.min_by(|a, b| a.stiffness_n_per_m.total_cmp(&b.stiffness_n_per_m))
    }

    /// Computes the force of the impact; returns the time between its values in s.
    ///
    /// A layer whose effect is below the converter's resolution is left out: a tap over a deep or distant crack is a
    /// tap on a sound casing.
    fn simulate_impact(&mut self, drawn: &DrawnTap, plate: Option<Plate>) -> f64 {
        /// Relative to the peak force: 0.02 N of 20 N, less than the noise and far less than the repeatability of a tap.
        const TOLERANCE: f64 = 1e-3;
        if drawn.velocity_m_per_s.is_nan() {
            self.history_n.clear();
            return 1.0;
        }
        let impact = Impact {
            k_c_n_per_m1_5: self.contact.k_c_n_per_m1_5 * drawn.stiffness,
            velocity_m_per_s: drawn.velocity_m_per_s,
            plate,
            ..self.contact
        };
        let needed = impact.without_rigid_layer(&self.rigid, self.scene.loss_tangent(), TOLERANCE);
        needed.force_history(&mut self.history_n)
    }

    fn force_signal(&mut self, drawn: &DrawnTap, dt: f64) {
        self.signal.fill(0.0);
        let pulse = Pulse { history_n: &self.history_n, per_sample: 1.0 / (self.config.sample_rate_hz * dt) };
        let (first, last) = pulse.span(drawn.onset, self.signal.len());
        for n in first..last {
            self.signal[n] = pulse.force_n(n, drawn.onset);
        }
    }

    fn sound_signal(&mut self, drawn: &DrawnTap, dt: f64, plate: Option<Plate>) {
        const SILENCE_V: f64 = 1e-5;
        self.signal.fill(0.0);
        let config = &self.config;
        let delay = config.microphone_distance_m / SOUND_M_PER_S * config.sample_rate_hz;
        let onset = drawn.onset + delay;
        let pulse = Pulse { history_n: &self.history_n, per_sample: 1.0 / (config.sample_rate_hz * dt) };
        let (first, last) = pulse.span(onset, self.signal.len());
        let mut resonators = Resonators::new(&modes(plate, config.modulus_ratio), config.sample_rate_hz);
        // Sound from a point falls with distance (section 4.3); the modes are given at 50 mm.
        let gain = drawn.loudness * 0.05 / config.microphone_distance_m;
        let mut before = 0.0;
        for n in first..self.signal.len() {
            let force = if n < last { f64::from(pulse.force_n(n, onset)) } else { 0.0 };
            self.signal[n] = to_f32(gain * resonators.step(before, force));
            before = force;
            if n > last && n % 64 == 0 && resonators.loudness_v() * gain < SILENCE_V {
                break;
            }
        }
    }
}

/// The casing's modes, at this multiple of its modulus, and that of the layer above a crack.
///
/// The layer sounds with its deflection. Beside the casing's velocity, that adds energy at every frequency; two
/// velocities would cancel below the layer's resonance.
fn modes(plate: Option<Plate>, modulus_ratio: f64) -> [Mode; MODES] {
    /// An impulse gives the layer the velocity 1/m; this is its voltage per m/s.
    const LAYER_V_PER_M_PER_S: f64 = 0.35;
    /// Assumed. In the contact the layer has half the rubber's loss tangent, 0.22.
    const LAYER_DAMPING: f64 = 0.10;
    let layer = plate.map_or(Mode::SILENT, |p| Mode {
        frequency_hz: (p.stiffness_n_per_m / p.mass_kg).sqrt() / TAU,
        damping_ratio: LAYER_DAMPING,
        voltage_v_per_n_s: LAYER_V_PER_M_PER_S / p.mass_kg,
        phase_rad: -FRAC_PI_2,
    });
    let [a, b, c, d, e] = CASING.map(|mode| Mode { frequency_hz: mode.frequency_hz * modulus_ratio.sqrt(), ..mode });
    [a, b, c, d, e, layer]
}

/// Gain of the microphone at this tap; it drifts linearly over each turn.
fn turn_gain(config: &SimulationConfig, seed: u64, tap: &SimulatedTap<'_>) -> f64 {
    let mut generator = Identity::new(seed, "turn")
        .text(tap.tyre_serial)
        .number(u64::from(tap.shoulder))
        .millionths(tap.offset_mm * 1e-3)
        .millionths(tap.velocity_m_per_s)
        .number(u64::from(tap.repetition))
        .generator();
    let (from, to) = (generator.uniform() - 0.5, generator.uniform() - 0.5);
    let turn = (f64::from(tap.location) / f64::from(tap.location_count.max(1))).clamp(0.0, 1.0);
    1.0 + config.gain_drift * (from + (to - from) * turn)
}

fn tap_identity(seed: u64, what: &str, tap: &SimulatedTap<'_>) -> Identity {
    Identity::new(seed, what)
        .text(tap.tyre_serial)
        .number(u64::from(tap.shoulder))
        .millionths(tap.offset_mm * 1e-3)
        .millionths(tap.velocity_m_per_s)
        .number(u64::from(tap.location))
        .number(u64::from(tap.repetition))
        .number(u64::from(tap.attempt))
}

#[cfg(test)]
#[path = "simulated_tests.rs"]
mod tests;
