//! The rig: a tap of a casing becomes a record of force and sound.

use crate::casing::Casing;
use crate::contact::Contact;
use crate::error::{Error, within};
use crate::modes::add_sound;
use crate::population::Population;
use crate::random::Key;

/// Mass of the impactor.
const IMPACTOR_KG: f64 = 4.5e-3;
/// b of the contact: the impactor leaves a casing with about half of its velocity at 1.85 m/s (assumed).
const DAMPING_S_PER_M: f64 = 0.75;
/// Samples between force and sound.
const SOUND_SAMPLES: usize = 6;
/// Speed of sound in air.
const SOUND_M_PER_S: f64 = 343.0;
/// Time between first touch and trigger, s.
const TRIGGER_S: f64 = 2.0 / 40_960.0;
/// Runge-Kutta steps per sample.
const PARTS: u32 = 2;

/// Where, how fast and for which time a casing is tapped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tap {
    /// Side of the casing, 1 or 2.
    pub shoulder: u16,
    /// Offset from the belt's edge.
    pub offset_mm: f64,
    /// Planned velocity.
    pub velocity_m_per_s: f64,
    /// Which of the planned repetitions.
    pub repetition: u16,
    /// Location on the ring.
    pub location: u32,
    /// Locations of the ring.
    pub location_count: u32,
    /// How many times the tap was taken before.
    pub attempt: u16,
}

impl Tap {
    /// Its angle on the ring.
    pub fn angle_deg(&self) -> f64 {
        360.0 * self.turn()
    }

    /// Its fraction of the ring, 0 to 1.
    fn turn(&self) -> f64 {
        f64::from(self.location) / f64::from(self.location_count.max(1))
    }

    fn turn_key(&self, key: Key) -> Key {
        key.millionths(self.offset_mm).millionths(self.velocity_m_per_s).number(self.repetition.into())
    }
}

/// Gains of one tap: of the microphone and of the force sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Gains {
    sound: f64,
    force: f64,
}

/// A rig that taps the casings of a population.
///
/// The same seed, population, casing and [`Tap`] give the same record, in any order of the taps: no state is carried
/// from one tap to the next.
#[derive(Debug)]
pub struct Rig {
    population: Population,
    sample_rate_hz: f64,
    pre_trigger_samples: usize,
    force_n: Vec<f64>,
    second_n: Vec<f64>,
    sound_v: Vec<f64>,
}

impl Rig {
    /// A rig that records at `sample_rate_hz`, with `pre_trigger_samples` before the trigger.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for the rate or the samples.
    pub fn new(population: &Population, sample_rate_hz: f64, pre_trigger_samples: u32) -> Result<Self, Error> {
        within("sample_rate_hz", sample_rate_hz, 1e4, 1e6)?;
        within("pre_trigger_samples", pre_trigger_samples.into(), 8.0, 1e6)?;
        Ok(Self {
            population: *population,
            sample_rate_hz,
            pre_trigger_samples: pre_trigger_samples as usize,
            force_n: Vec::new(),
            second_n: Vec::new(),
            sound_v: Vec::new(),
        })
    }

    /// Distance from impact to microphone: a whole number of samples at the speed of sound.
    pub fn microphone_distance_m(&self) -> f64 {
        SOUND_SAMPLES as f64 * SOUND_M_PER_S / self.sample_rate_hz
    }

    /// Records `tap` of `casing` into `force_n` and `sound_v`, and returns the velocity as measured, in m/s.
    pub fn record(&mut self, casing: &Casing, tap: &Tap, force_n: &mut [f32], sound_v: &mut [f32]) -> f64 {
        let p = self.population;
        let key = tap.turn_key(casing.key(1, tap.shoulder)).number(tap.location.into()).number(tap.attempt.into());
        let mut dice = key.generator();
        let place = casing.place(tap.shoulder, tap.angle_deg(), tap.offset_mm);
        let mut velocity = tap.velocity_m_per_s * dice.factor(p.tap_velocity);
        let measured = velocity * dice.factor(p.velocity_error);
        let mut stiffness = place.stiffness_n_per_m1_5 * dice.factor(p.tap_stiffness);
        let late = dice.uniform();
        let mut modes = place.modes;
        for mode in &mut modes {
            mode.level_v_per_n_s *= dice.factor(p.tap_modes);
        }
        // A separate generator, so that rogue taps leave the others unchanged.
        let mut rogue = key.number(1).generator();
        let is_rogue = rogue.uniform() < p.rogue;
        let bounces = rogue.uniform() < 0.5;
        if is_rogue && !bounces {
            velocity *= rogue.between(0.8, 1.0);
            stiffness *= rogue.factor(0.3);
            modes.iter_mut().for_each(|mode| mode.level_v_per_n_s *= rogue.factor(0.3));
        }
        let gains = self.gains(casing, tap);

        let contact = Contact {
            mass_kg: IMPACTOR_KG,
            velocity_m_per_s: velocity,
            stiffness_n_per_m1_5: stiffness,
            damping_s_per_m: DAMPING_S_PER_M,
            impedance_n_s_per_m: place.impedance_n_s_per_m,
            layer: place.layer,
        };
        let dt = 1.0 / self.sample_rate_hz;
        self.force_n.clear();
        contact.force(late * dt, dt, PARTS, &mut self.force_n);
        if is_rogue && bounces {
            let again = Contact { velocity_m_per_s: velocity * rogue.between(0.25, 0.5), ..contact };
            self.second_n.clear();
            again.force(0.5 * dt, dt, PARTS, &mut self.second_n);
            let gap = (rogue.between(1e-3, 4e-3) * self.sample_rate_hz) as usize;
            self.force_n.extend(std::iter::repeat_n(0.0, gap));
            self.force_n.extend_from_slice(&self.second_n);
        }

        let first = (self.pre_trigger_samples as f64 - TRIGGER_S * self.sample_rate_hz) as usize;
        force_n.fill(0.0);
        for (out, force) in force_n.iter_mut().skip(first).zip(&self.force_n) {
            *out = (gains.force * force) as f32;
        }
        let heard = first + SOUND_SAMPLES;
        self.sound_v.clear();
        self.sound_v.resize(sound_v.len().saturating_sub(heard), 0.0);
        add_sound(&modes, self.sample_rate_hz, &self.force_n, &mut self.sound_v);
        sound_v.fill(0.0);
        for (out, sound) in sound_v.iter_mut().skip(heard).zip(&self.sound_v) {
            *out = (gains.sound * sound) as f32;
        }
        // A separate generator for each channel, so that a shorter record is the beginning of a longer one.
        key.number(2).generator().add_noise(p.force_noise_n as f32, force_n);
        key.number(3).generator().add_noise(p.sound_noise_v as f32, sound_v);
        measured
    }

    /// Gains at this tap: of the casing, of the turn, and their drift within the turn.
    fn gains(&self, casing: &Casing, tap: &Tap) -> Gains {
        let p = &self.population;
        let mut dice = tap.turn_key(casing.key(2, tap.shoulder)).generator();
        let gone = tap.turn() - 0.5;
        let (sound, sound_drift) = (dice.factor(p.turn_gain), p.turn_drift * dice.normal());
        let (force, force_drift) = (dice.factor(p.turn_sensor), p.turn_sensor_drift * dice.normal());
        Gains { sound: casing.gain() * sound * (1.0 + sound_drift * gone), force: force * (1.0 + force_drift * gone) }
    }
}

#[cfg(test)]
#[path = "rig_tests.rs"]
mod tests;
