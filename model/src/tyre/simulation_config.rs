//! What the simulated rig records, and how imperfect it and its tyres are.

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::error::within;

/// Recording and imperfections of the simulated rig and its tyres; those without a unit are relative.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulationConfig {
    /// Samples per second and channel.
    pub sample_rate_hz: f64,
    /// Samples of one channel.
    pub sample_count: u32,
    /// Samples before the impact.
    pub pre_trigger_samples: u32,
    /// Force at 32768 counts.
    pub force_full_scale_n: f64,
    /// Microphone voltage at 32768 counts.
    pub sound_full_scale_v: f64,
    /// Distance from impact to microphone.
    pub microphone_distance_m: f64,
    /// Standard deviation of the force sensor's noise.
    pub force_noise_n: f64,
    /// Standard deviation of the microphone's noise.
    pub sound_noise_v: f64,
    /// Amplitude of the mains hum in the sound.
    pub hum_v: f64,
    /// Frequency of the mains.
    pub hum_hz: f64,
    /// Young's modulus of the casings, as a multiple of the usual: rubber loses about 1 % for each degree that it is warmer.
    pub modulus_ratio: f64,
    /// Standard deviation of the impact velocity around the planned one.
    pub velocity_jitter: f64,
    /// Standard deviation of the error of measured velocities.
    pub velocity_error: f64,
    /// Largest change of the microphone's gain over a turn.
    pub gain_drift: f64,
    /// Standard deviation from tap to tap of the contact's stiffness and of the loudness.
    pub repeatability: f64,
    /// Standard deviation of stiffness and loudness from tyre to tyre.
    pub construction_scatter: f64,
    /// Standard deviation of both between the shoulders of a tyre.
    pub shoulder_scatter: f64,
    /// Smooth variation of both around the ring.
    pub ring_variation: f64,
    /// Standard deviation of both from location to location.
    pub location_scatter: f64,
    /// Whether the tyres do not turn: every tap is at location 0.
    pub stands_still: bool,
    /// Faults of the taps, and how often they occur; none by default.
    pub fault: Vec<PlantedFault>,
}

impl Default for SimulationConfig {
    fn default() -> Self {
        Self {
            sample_rate_hz: 40_960.0,
            sample_count: 2048,
            pre_trigger_samples: 512,
            force_full_scale_n: 222.0,
            sound_full_scale_v: 5.0,
            microphone_distance_m: 0.05,
            force_noise_n: 0.05,
            sound_noise_v: 0.004,
            hum_v: 0.003,
            hum_hz: 50.0,
            modulus_ratio: 1.0,
            velocity_jitter: 0.01,
            velocity_error: 0.002,
            gain_drift: 0.02,
            repeatability: 0.01,
            construction_scatter: 0.03,
            shoulder_scatter: 0.01,
            ring_variation: 0.015,
            location_scatter: 0.004,
            stands_still: false,
            fault: Vec::new(),
        }
    }
}

impl SimulationConfig {
    /// Checks every quantity against its bounds.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Fault`], for the first quantity that is out of bounds.
    pub fn validate(&self) -> Result<(), Error> {
        for (name, value, low, high) in [
            ("sample_rate_hz", self.sample_rate_hz, 1e3, 1e7),
            ("sample_count", f64::from(self.sample_count), 64.0, 16_777_216.0),
            ("pre_trigger_samples", f64::from(self.pre_trigger_samples), 0.0, f64::from(self.sample_count) - 1.0),
            ("force_full_scale_n", self.force_full_scale_n, 1e-3, 1e6),
            ("sound_full_scale_v", self.sound_full_scale_v, 1e-3, 1e6),
            ("microphone_distance_m", self.microphone_distance_m, 1e-3, 10.0),
            ("force_noise_n", self.force_noise_n, 0.0, self.force_full_scale_n),
            ("sound_noise_v", self.sound_noise_v, 0.0, self.sound_full_scale_v),
            ("hum_v", self.hum_v, 0.0, self.sound_full_scale_v),
            ("hum_hz", self.hum_hz, 0.0, 0.5 * self.sample_rate_hz),
            ("modulus_ratio", self.modulus_ratio, 0.2, 5.0),
            ("velocity_jitter", self.velocity_jitter, 0.0, 0.2),
            ("velocity_error", self.velocity_error, 0.0, 0.2),
            ("gain_drift", self.gain_drift, 0.0, 0.5),
            ("repeatability", self.repeatability, 0.0, 0.2),
            ("construction_scatter", self.construction_scatter, 0.0, 0.2),
            ("shoulder_scatter", self.shoulder_scatter, 0.0, 0.2),
            ("ring_variation", self.ring_variation, 0.0, 0.5),
            ("location_scatter", self.location_scatter, 0.0, 0.2),
        ] {
            within(name, value, low, high)?;
        }
        for (PlantedFault { fraction, .. }, number) in self.fault.iter().zip(1..) {
            if !(0.0..=1.0).contains(fraction) {
                return Err(Error::Fault { number, fraction: *fraction });
            }
        }
        Ok(())
    }
}

/// What can go wrong with a tap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The force's amplifier saturates at 0.7 of the peak.
    ClippedForce,
    /// The microphone's amplifier saturates at 0.7 of the peak.
    ClippedSound,
    /// The impactor comes back after 4 ms and strikes with 0.4 of the force.
    DoubleHit,
    /// Another station's tap is heard after 60 ms, half as loud. Earlier ones are hidden by the ringing, and a record of the
    /// default length ends before it: state a longer `sample_count` too.
    Neighbour,
    /// Mains hum of a tenth of the sound's peak.
    Hum,
    /// Force and sound have noise of a twentieth of their peaks.
    Noise,
    /// The record begins 0.2 ms after the first touch.
    LateTrigger,
    /// The force sensor gives no signal.
    DeadForce,
    /// The microphone gives no signal.
    DeadSound,
    /// The impactor is a tenth too fast.
    VelocityOff,
}

/// A fault and how often it happens: an entry `[[simulation.fault]]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantedFault {
    /// What goes wrong.
    pub kind: FaultKind,
    /// Fraction of the taps that have it; each tap and each attempt at it is drawn independently.
    pub fraction: f64,
}
