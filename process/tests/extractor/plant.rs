//! Taps of two rigs, and faults planted in them.
//!
//! The simulated rig has the default settings of the model: sound and cracked tyres, noise, hum and scatter.

use std::sync::LazyLock;

use tapline_model::{SimulatedRig, SimulatedTap, SimulatedTyre, SimulationConfig, plant_cracks};
use tapline_process::{Extractor, ProcessConfig};
use tapline_wire::{Channel, ChannelHeader, Discriminators, Quality, SampleFormat, Samples, TapHeader, TapId};

use crate::other_rig;

pub(crate) const N: usize = 16_384;
pub(crate) const RATE_HZ: f64 = 40_960.0;

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
        let mut extractor = Extractor::<f32>::new(config).unwrap();
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

pub(crate) fn header_of(config: &SimulationConfig, tap: &SimulatedTap<'_>, measured: f64) -> TapHeader {
    let id = TapId::default().with_velocity_m_per_s(Some(tap.velocity_m_per_s)).unwrap();
    let mut header = TapHeader {
        id,
        velocity_measured_m_per_s: measured,
        velocity_nominal_m_per_s: tap.velocity_m_per_s,
        microphone_distance_m: config.microphone_distance_m,
        ..header(config.sample_rate_hz, config.pre_trigger_samples, config.sample_count, SampleFormat::I16)
    };
    header.channels[0].unit_per_count = config.force_full_scale_n / 32_768.0;
    header.channels[1].unit_per_count = config.sound_full_scale_v / 32_768.0;
    header
}

pub(crate) fn header(
    sample_rate_hz: f64,
    pre_trigger_samples: u32,
    sample_count: u32,
    format: SampleFormat,
) -> TapHeader {
    let mut header = TapHeader {
        sample_rate_hz,
        pre_trigger_samples,
        sample_count,
        sample_format: format.code(),
        channel_count: 2,
        ..TapHeader::default()
    };
    for (slot, kind) in header.channels.iter_mut().zip(Channel::BOTH) {
        *slot = ChannelHeader { code: kind.code(), unit_per_count: 1.0, reserved: 0 };
    }
    header
}

/// The default rig with records of [`N`] samples.
pub(crate) fn rig() -> SimulationConfig {
    SimulationConfig { sample_count: N as u32, ..SimulationConfig::default() }
}

/// `count` taps of four sound and four cracked tyres, at three velocities and four offsets, on the [`rig`].
pub(crate) fn simulated(count: u32) -> Vec<Tap> {
    simulated_on(&rig(), count)
}

/// As [`simulated`], on the rig of `config`.
pub(crate) fn simulated_on(config: &SimulationConfig, count: u32) -> Vec<Tap> {
    let tyre = |k: u32| {
        let serial = format!("T-{k}");
        SimulatedTyre { cracks: if k.is_multiple_of(2) { plant_cracks(3, &serial, 100, 8) } else { vec![] }, serial }
    };
    let tyres: Vec<_> = (0..8).map(tyre).collect();
    let mut rig = SimulatedRig::new(config, 3, &tyres).unwrap();
    let mut samples = vec![0_i16; rig.sample_total()];
    let tap = |k: u32| {
        let tap = SimulatedTap {
            tyre_serial: &tyres[k as usize % 8].serial,
            shoulder: 1,
            offset_mm: 5.0 * f64::from(k / 8 % 4),
            velocity_m_per_s: [1.2, 1.5, 1.85][k as usize % 3],
            location: k * 37 % 100,
            location_count: 100,
            repetition: (k / 100) as u16,
            attempt: 0,
        };
        let rendered = rig.render(&tap, &mut samples);
        let (force, sound) = samples.split_at(samples.len() / 2);
        Tap {
            header: header_of(config, &tap, rendered.velocity_measured_m_per_s),
            force: force.iter().map(|&x| f64::from(x)).collect(),
            sound: sound.iter().map(|&x| f64::from(x)).collect(),
        }
    };
    (0..count).map(tap).collect()
}

/// Taps of the simulated rig, without those whose velocity happens to be off; faults are planted in them.
pub(crate) static TAPS: LazyLock<Vec<Tap>> = LazyLock::new(|| {
    let mut taps = simulated(160);
    taps.retain(|tap| !tap.flags().contains(Quality::VELOCITY_OFF));
    taps
});

/// Taps of the other rig; faults are planted in them.
pub(crate) static OTHERS: LazyLock<Vec<Tap>> = LazyLock::new(|| (0..240).map(other_rig::tap).collect());

pub(crate) fn peak(channel: &[f64]) -> f64 {
    channel.iter().fold(0.0, |a, x| if x.abs() > a { x.abs() } else { a })
}

/// Numbers of mean 0 and standard deviation 1 that are nearly normal.
pub(crate) fn noise(seed: usize) -> impl Iterator<Item = f64> {
    let mut state = seed as u64;
    std::iter::repeat_with(move || {
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..12).map(|_| uniform()).sum()
    })
}

/// Adds `part` of `channel` to itself, `lag` samples later, or earlier if `lag` is negative.
pub(crate) fn add_echo(channel: &mut [f64], part: f64, lag: isize) {
    let once = channel.to_vec();
    for (i, x) in channel.iter_mut().enumerate() {
        let from = i as isize - lag;
        *x += part * once.get(from as usize).filter(|_| from >= 0).copied().unwrap_or(0.0);
    }
}

/// Whether three samples in a row have at least the magnitude `level`.
pub(crate) fn has_flat_top(channel: &[f64], level: f64) -> bool {
    channel.windows(3).any(|w| w.iter().all(|&x| x >= level) || w.iter().all(|&x| x <= -level))
}

/// Clips `channel` at `part` of its peak; returns false if fewer than three samples are clipped.
pub(crate) fn cut(channel: &mut [f64], part: f64) -> bool {
    let level = part * peak(channel);
    let is_flat = has_flat_top(channel, level);
    channel.iter_mut().for_each(|x| *x = x.clamp(-level, level));
    is_flat
}

/// Removes the samples of `channel` before `cut`, and extends its end to the old length.
pub(crate) fn begin_at(channel: &mut Vec<f64>, cut: usize) {
    let last = channel[channel.len() - cut..].to_vec();
    channel.drain(..cut);
    channel.extend(last);
}

/// Outcome of planting a fault: `false` if this tap cannot have it.
pub(crate) trait Planted {
    fn planted(self) -> bool;
}

impl Planted for () {
    fn planted(self) -> bool {
        true
    }
}

impl Planted for bool {
    fn planted(self) -> bool {
        self
    }
}

/// Flags of taps with faults.
pub(crate) struct Flags(pub(crate) Vec<Quality>);

impl Flags {
    pub(crate) fn with_fault<P: Planted>(taps: &[Tap], plant: impl Fn(usize, &mut Tap) -> P) -> Self {
        let planted = taps.iter().enumerate().filter_map(|(k, tap)| {
            let mut tap = tap.clone();
            plant(k, &mut tap).planted().then(|| tap.flags())
        });
        let flags: Vec<Quality> = planted.collect();
        assert!(!flags.is_empty(), "no tap can have the fault");
        Self(flags)
    }

    pub(crate) fn share(&self, flag: Quality) -> f64 {
        self.0.iter().filter(|flags| flags.contains(flag)).count() as f64 / self.0.len() as f64
    }

    #[track_caller]
    pub(crate) fn assert_raised(&self, flag: Quality, what: &str) {
        let raised = self.share(flag);
        eprintln!("{what}: {flag} in {raised:.4} of {} taps", self.0.len());
        assert!(raised >= 0.99, "{what}: {flag} in {raised} of taps");
    }
}

/// Checks that `flag` is raised in 99 of 100 planted taps of either rig, and that in the simulated rig any flag except
/// it and `also` is raised in at most 1 of 100.
#[track_caller]
pub(crate) fn assert_flagged<P: Planted>(
    flag: Quality,
    also: &[Quality],
    what: &str,
    plant: impl Fn(usize, &mut Tap) -> P,
) {
    let flags = Flags::with_fault(&TAPS, &plant);
    flags.assert_raised(flag, what);
    for &(other, name) in Quality::ALL.iter().filter(|(other, _)| *other != flag && !also.contains(other)) {
        let raised = flags.share(other);
        if raised > 0.01 {
            eprintln!("{what}: {name} in {raised} of taps");
        }
        assert!(raised <= 0.01, "{what}: {name} in {raised} of taps");
    }
    Flags::with_fault(&OTHERS, &plant).assert_raised(flag, &format!("other rig, {what}"));
}
