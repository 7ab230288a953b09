//! Closed-form taps, as `scipy_reference.py` makes them.

use std::f64::consts::PI;

use tapline_process::{Extractor, ProcessConfig, Real};
use tapline_testing::noise::Noise;
use tapline_wire::{Channel, Discriminator, Discriminators, SampleFormat, Samples, TapHeader};

/// A tap with the settings of its extraction; the fields are those of the script.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Case {
    pub name: &'static str,
    pub seed: u32,
    pub rate: f64,
    pub count: u32,
    pub p: u32,
    pub is_i16: bool,
    pub has_force: bool,
    pub sound_first: bool,
    pub distance: f64,
    pub onset: f64,
    pub tau: f64,
    pub f_max: f64,
    pub sound_unit: f64,
    pub force_unit: f64,
    pub offset: f64,
    pub noise: f64,
    pub f_lo: f64,
    pub follow: bool,
}

/// Owned samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Recorded {
    I16(Vec<i16>),
    F32(Vec<f32>),
}

impl Recorded {
    pub(crate) fn samples(&self) -> Samples<'_> {
        match self {
            Self::I16(samples) => Samples::I16(samples),
            Self::F32(samples) => Samples::F32(samples),
        }
    }

    pub(crate) fn counts(&self) -> Vec<f64> {
        match self {
            Self::I16(samples) => samples.iter().map(|&x| f64::from(x)).collect(),
            Self::F32(samples) => samples.iter().map(|&x| f64::from(x)).collect(),
        }
    }
}

fn hiss(seed: u32, count: usize) -> Vec<f64> {
    let mut noise = Noise(seed);
    std::iter::repeat_with(|| noise.uniform() - 0.5).take(count).collect()
}

fn half_sine(t: f64, tau: f64) -> f64 {
    if 0.0 < t && t < tau { (PI * t / tau).sin() } else { 0.0 }
}

impl Case {
    /// Force in N and sound in V, before the converter.
    fn channels(&self) -> (Vec<f64>, Vec<f64>) {
        const MODES: [(f64, f64, f64); 4] =
            [(310.0, 60.0, 0.2), (880.0, 150.0, 0.5), (1730.0, 260.0, 0.3), (4200.0, 500.0, 0.25)];
        let n = self.count as usize;
        let hiss = hiss(self.seed, 2 * n);
        let at = |i: usize| {
            let t = (i as f64 - self.onset) / self.rate;
            let s = half_sine(t, self.tau);
            let force = self.f_max * (s * s.sqrt() + self.noise * hiss[i]) + self.offset;
            let t = t - self.distance / 343.0;
            let mut x = 0.6 * half_sine(t, self.tau);
            if t > 0.0 {
                for (f, d, a) in MODES {
                    x += a * (-d * t).exp() * (2.0 * PI * f * t).sin();
                }
            }
            (force, x + self.noise * hiss[n + i] + self.offset)
        };
        (0..n).map(at).unzip()
    }

    pub(crate) fn recorded(&self) -> Recorded {
        let (force, sound) = self.channels();
        let force = force.into_iter().map(|x| x / self.force_unit);
        let sound = sound.into_iter().map(|x| x / self.sound_unit);
        let counts: Vec<f64> = match (self.has_force, self.sound_first) {
            (false, _) => sound.collect(),
            (true, false) => force.chain(sound).collect(),
            (true, true) => sound.chain(force).collect(),
        };
        if self.is_i16 {
            Recorded::I16(counts.into_iter().map(|x| (x + 0.5).floor() as i16).collect())
        } else {
            Recorded::F32(counts.into_iter().map(|x| x as f32).collect())
        }
    }

    pub(crate) fn header(&self) -> TapHeader {
        let kinds: &[Channel] = match (self.has_force, self.sound_first) {
            (false, _) => &[Channel::Sound],
            (true, false) => &[Channel::Force, Channel::Sound],
            (true, true) => &[Channel::Sound, Channel::Force],
        };
        let mut header = TapHeader {
            microphone_distance_m: self.distance,
            sample_format: if self.is_i16 { SampleFormat::I16 } else { SampleFormat::F32 }.code(),
            ..TapHeader::in_units(self.rate, self.p, self.count, kinds)
        };
        for (channel, kind) in header.channels.iter_mut().zip(kinds) {
            channel.unit_per_count = if *kind == Channel::Force { self.force_unit } else { self.sound_unit };
        }
        header
    }

    pub(crate) fn config(&self) -> ProcessConfig {
        ProcessConfig { f_lo_hz: self.f_lo, f_c_follows_tau: self.follow, ..ProcessConfig::default() }
    }

    pub(crate) fn extract<T: Real>(&self) -> Discriminators {
        let mut extractor = Extractor::<T>::new(&self.config()).unwrap();
        extractor.extract(&self.header(), self.recorded().samples())
    }
}

/// The values in their order.
pub(crate) fn values(found: &Discriminators) -> [Option<f64>; Discriminator::COUNT] {
    Discriminator::ALL.map(|which| found.values.get(which))
}

/// Checks that `found` has the `expected` values, each within the relative `tolerance`.
#[track_caller]
pub(crate) fn assert_close(
    found: &Discriminators,
    expected: [Option<f64>; Discriminator::COUNT],
    tolerance: f64,
    what: &str,
) {
    for (which, expected) in Discriminator::ALL.into_iter().zip(expected) {
        match (found.values.get(which), expected) {
            (None, None) => {}
            (Some(x), Some(y)) if ((x - y) / y).abs() <= tolerance => {}
            (x, y) => panic!("{what}: {} is {x:?}, expected {y:?} within {tolerance:e} ({found:?})", which.column()),
        }
    }
}
