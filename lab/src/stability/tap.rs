//! An artificial tap of a half-sine and three decaying modes, and disturbances of its record.

use std::f64::consts::{PI, TAU};

use tapline_process::{Extractor, ProcessConfig};
use tapline_wire::{Channel, Discriminators, Samples, TapHeader, TapId};

/// Samples per second.
pub(crate) const RATE_HZ: f64 = 40_960.0;
/// Samples of the record.
pub(crate) const COUNT: usize = 16_384;
/// Sample of the record at the trigger.
pub(crate) const PRE_TRIGGER: usize = 512;
/// Distance of the microphone, m.
const DISTANCE_M: f64 = 0.0343;
/// Frequency in Hz and amplitude in V of the modes that a sound casing rings with.
const MODES: [(f64, f64); 3] = [(300.0, 0.8), (480.0, 0.3), (900.0, 0.3)];
/// Decay of the modes, 1/s: gone to 1e-20 within the record.
const DECAY_PER_S: f64 = 120.0;

/// The record of one tap.
#[derive(Debug, Clone)]
pub(crate) struct Tap {
    pub force_n: Vec<f64>,
    pub sound_v: Vec<f64>,
    pub rate_hz: f64,
    /// Samples before the trigger, as in the header.
    pub pre_trigger_samples: u32,
    /// Velocity planned and measured, m/s, where both are known.
    pub velocity_m_per_s: Option<(f64, f64)>,
}

impl Tap {
    /// A clean tap of 50 N and contact time `tau_s` whose contact begins `shift_s` after the trigger sample.
    pub(crate) fn clean(tau_s: f64, shift_s: f64) -> Self {
        let time = |k: usize| (k as f64 - PRE_TRIGGER as f64) / RATE_HZ - shift_s;
        let force = |t: f64| if (0.0..tau_s).contains(&t) { 50.0 * (PI * t / tau_s).sin() } else { 0.0 };
        let ring = |t: f64| {
            let modes = MODES.map(|(f_hz, amplitude)| amplitude * (TAU * f_hz * t).sin());
            if t < 0.0 { 0.0 } else { (-DECAY_PER_S * t).exp() * modes.iter().sum::<f64>() }
        };
        Self {
            force_n: (0..COUNT).map(|k| force(time(k))).collect(),
            sound_v: (0..COUNT).map(|k| ring(time(k) - DISTANCE_M / 343.0)).collect(),
            rate_hz: RATE_HZ,
            pre_trigger_samples: 512,
            velocity_m_per_s: None,
        }
    }

    /// The clean tap that all others are compared with.
    pub(crate) fn sound() -> Self {
        Self::clean(1e-3, 0.0)
    }

    /// What the extractor finds, in double precision.
    pub(crate) fn extract(&self, config: &ProcessConfig) -> Discriminators {
        let numbers = self.force_n.iter().chain(&self.sound_v);
        #[expect(clippy::cast_possible_truncation, reason = "samples as a converter gives them")]
        let samples: Vec<f32> = numbers.map(|&x| x as f32).collect();
        let sample_count = u32::try_from(self.force_n.len()).unwrap_or(0);
        let mut header = TapHeader {
            microphone_distance_m: DISTANCE_M,
            ..TapHeader::in_units(self.rate_hz, self.pre_trigger_samples, sample_count, &Channel::BOTH)
        };
        if let Some((planned, measured)) = self.velocity_m_per_s {
            header.id = TapId::default().with_velocity_m_per_s(Some(planned)).unwrap_or_default();
            header.velocity_nominal_m_per_s = planned;
            header.velocity_measured_m_per_s = measured;
        }
        // The default configuration is one that can be worked with, and the only one that is used without a check.
        let extractor = Extractor::<f64>::new(config).or_else(|_| Extractor::new(&ProcessConfig::default()));
        extractor.map(|mut e| e.extract(&header, Samples::F32(&samples))).unwrap_or_default()
    }
}

pub(crate) fn peak(samples: &[f64]) -> f64 {
    samples.iter().fold(0.0, |peak, x| if x.abs() > peak { x.abs() } else { peak })
}

/// Adds `part` of the peak to every sample.
pub(crate) fn add_offset(samples: &mut [f64], part: f64) {
    let offset = part * peak(samples);
    samples.iter_mut().for_each(|x| *x += offset);
}

/// Adds a sine of `part` of the peak.
pub(crate) fn add_hum(samples: &mut [f64], part: f64, f_hz: f64, phase: f64) {
    let amplitude = part * peak(samples);
    for (k, x) in samples.iter_mut().enumerate() {
        *x += amplitude * (TAU * f_hz * k as f64 / RATE_HZ + phase).sin();
    }
}

/// Adds another casing's tap of `amplitude`, 50 ms later, whose mode is at `f_hz`.
pub(crate) fn add_neighbour(samples: &mut [f64], amplitude: f64, f_hz: f64) {
    let first = PRE_TRIGGER + (50e-3 * RATE_HZ) as usize;
    for (k, x) in samples[first..].iter_mut().enumerate() {
        let t = k as f64 / RATE_HZ;
        *x += amplitude * (-120.0 * t).exp() * (TAU * f_hz * t).sin();
    }
}

/// Adds normal noise whose standard deviation is `part` of the peak.
pub(crate) fn add_noise(samples: &mut [f64], part: f64, mut normal: impl FnMut() -> f64) {
    let sd = part * peak(samples);
    samples.iter_mut().for_each(|x| *x += sd * normal());
}

/// Cuts the samples off at `part` of their peak.
pub(crate) fn clip(samples: &mut [f64], part: f64) {
    let most = part * peak(samples);
    samples.iter_mut().for_each(|x| *x = x.clamp(-most, most));
}
