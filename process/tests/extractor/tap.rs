//! A tap in counts, in which tests plant faults, and those that the model makes; the tests of `tapline-plate` have them too.

use tapline_model::{SimulatedRig, SimulatedTap, SimulatedTyre, SimulationConfig, plant_cracks};
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::{Channel, Discriminators, Quality, SampleFormat, Samples, TapHeader, TapId};

/// A tap with its two channels in counts.
#[derive(Debug, Clone)]
pub(crate) struct Tap {
    pub header: TapHeader,
    pub force: Vec<f64>,
    pub sound: Vec<f64>,
}

impl Tap {
    pub(crate) fn samples(&self) -> Vec<i16> {
        self.force.iter().chain(&self.sound).map(|x| x.round().clamp(-32_768.0, 32_767.0) as i16).collect()
    }

    pub(crate) fn found(&self, config: &ProcessConfig) -> Discriminators {
        let mut extractor = ProcessExtractor::new(config).unwrap();
        if self.is_i16() {
            return extractor.extract(&self.header, Samples::I16(&self.samples()));
        }
        let samples: Vec<f32> = self.force.iter().chain(&self.sound).map(|&x| x as f32).collect();
        extractor.extract(&self.header, Samples::F32(&samples))
    }

    /// Converts to 16-bit counts at half the full scale.
    pub(crate) fn make_i16(&mut self) {
        if self.is_i16() {
            return;
        }
        self.header.sample_format = SampleFormat::I16.code();
        for (channel, slot) in [&mut self.force, &mut self.sound].into_iter().zip(&mut self.header.channels) {
            let gain = 16_384.0 / peak(channel);
            channel.iter_mut().for_each(|x| *x *= gain);
            slot.unit_per_count /= gain;
        }
    }

    pub(crate) fn is_i16(&self) -> bool {
        self.header.sample_format == SampleFormat::I16.code()
    }

    /// Number of samples of the pulse above 5 % of its peak.
    pub(crate) fn pulse_samples(&self) -> usize {
        let level = 0.05 * peak(&self.force);
        self.force.iter().filter(|&&x| x > level).count()
    }

    /// Number of samples in `time_s`.
    pub(crate) fn lag(&self, time_s: f64) -> isize {
        (time_s * self.header.sample_rate_hz) as isize
    }

    pub(crate) fn flags(&self) -> Quality {
        self.found(&ProcessConfig::default()).quality
    }
}

pub(crate) fn peak(channel: &[f64]) -> f64 {
    channel.iter().fold(0.0, |a, x| if x.abs() > a { x.abs() } else { a })
}

/// The rig of `config` with four sound and four cracked tyres.
pub(crate) fn rig_with_tyres(config: &SimulationConfig, seed: u64) -> SimulatedRig {
    let tyre = |k: u32| {
        let serial = format!("T-{k}");
        SimulatedTyre { cracks: if k.is_multiple_of(2) { plant_cracks(3, &serial, 100, 8) } else { vec![] }, serial }
    };
    SimulatedRig::new(config, seed, &(0..8).map(tyre).collect::<Vec<_>>()).unwrap()
}

/// Tap number `k` on such a rig: of one of its tyres, at one of three velocities and four offsets.
pub(crate) fn tap_on(rig: &mut SimulatedRig, k: u32) -> Tap {
    let config = rig.config().clone();
    let mut samples = vec![0_i16; rig.sample_total()];
    let velocity_m_per_s = [1.2, 1.5, 1.85][k as usize % 3];
    let tap = SimulatedTap {
        tyre_serial: &format!("T-{}", k % 8),
        shoulder: 1,
        offset_mm: 5.0 * f64::from(k / 8 % 4),
        velocity_m_per_s,
        location: k * 37 % 100,
        location_count: 100,
        repetition: (k / 100) as u16,
        attempt: 0,
    };
    let mut header = TapHeader {
        id: TapId::default().with_velocity_m_per_s(Some(velocity_m_per_s)).unwrap(),
        velocity_measured_m_per_s: rig.render(&tap, &mut samples),
        velocity_nominal_m_per_s: velocity_m_per_s,
        microphone_distance_m: config.microphone_distance_m,
        sample_format: SampleFormat::I16.code(),
        ..TapHeader::in_units(config.sample_rate_hz, config.pre_trigger_samples, config.sample_count, &Channel::BOTH)
    };
    header.channels[0].unit_per_count = config.force_full_scale_n / 32_768.0;
    header.channels[1].unit_per_count = config.sound_full_scale_v / 32_768.0;
    let (force, sound) = samples.split_at(samples.len() / 2);
    let [force, sound] = [force, sound].map(|channel| channel.iter().map(|&x| f64::from(x)).collect());
    Tap { header, force, sound }
}
