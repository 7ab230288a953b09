//! Quality flags: faults planted in simulated taps are flagged, and nothing else is.
//!
//! The simulated rig is that of the model's defaults: sound and cracked tyres, noise, hum and scatter as they ship.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use tapline_model::{Scene, SimulatedRig, SimulatedTap, SimulatedTyre, SimulationConfig, plant_cracks};
use tapline_process::{Extractor, Policy, ProcessConfig, QualityConfig};
use tapline_wire::{
    Channel, ChannelHeader, Discriminator, Discriminators, Quality, SampleFormat, Samples, TapHeader, TapId,
};

use crate::other_rig;
use crate::signal::values;

const N: usize = 16_384;
const RATE_HZ: f64 = 40_960.0;

/// A tap with its two channels in counts.
#[derive(Debug, Clone)]
pub(crate) struct Tap {
    pub(crate) header: TapHeader,
    pub(crate) force: Vec<f64>,
    pub(crate) sound: Vec<f64>,
}

impl Tap {
    fn samples(&self) -> Vec<i16> {
        self.force.iter().chain(&self.sound).map(|x| x.round().clamp(-32_768.0, 32_767.0) as i16).collect()
    }

    fn found(&self, config: &ProcessConfig) -> Discriminators {
        let mut extractor = Extractor::<f32>::new(config).unwrap();
        if self.is_i16() {
            return extractor.extract(&self.header, Samples::I16(&self.samples()));
        }
        let samples: Vec<f32> = self.force.iter().chain(&self.sound).map(|&x| x as f32).collect();
        extractor.extract(&self.header, Samples::F32(&samples))
    }

    /// In counts of 16 bits, half the full scale, whatever it was in before.
    fn to_i16(&mut self) {
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

    fn is_i16(&self) -> bool {
        self.header.sample_format == SampleFormat::I16.code()
    }

    /// Samples of the pulse above 5 % of its peak.
    fn pulse_samples(&self) -> usize {
        let level = 0.05 * peak(&self.force);
        self.force.iter().filter(|&&x| x > level).count()
    }

    /// Samples of `time_s`.
    fn lag(&self, time_s: f64) -> isize {
        (time_s * self.header.sample_rate_hz) as isize
    }

    fn flags(&self) -> Quality {
        self.found(&ProcessConfig::default()).quality
    }
}

fn header_of(config: &SimulationConfig, tap: &SimulatedTap<'_>, measured: f64) -> TapHeader {
    let id = TapId::default().with_velocity_m_per_s(Some(tap.velocity_m_per_s)).unwrap();
    let mut header = TapHeader {
        id,
        velocity_measured_m_per_s: measured,
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
    for (slot, kind) in header.channels.iter_mut().zip([Channel::Force, Channel::Sound]) {
        *slot = ChannelHeader { code: kind.code(), unit_per_count: 1.0, reserved: 0 };
    }
    header
}

/// `count` taps of four sound and four cracked tyres, at three velocities and four offsets.
fn simulated(count: u32) -> Vec<Tap> {
    let config = SimulationConfig::default();
    let tyre = |k: u32| {
        let serial = format!("T-{k}");
        SimulatedTyre { cracks: if k % 2 == 0 { plant_cracks(3, &serial, 100, 8) } else { vec![] }, serial }
    };
    let tyres: Vec<_> = (0..8).map(tyre).collect();
    let mut rig = SimulatedRig::new(&config, 3, &tyres).unwrap();
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
        let (force, sound) = samples.split_at(N);
        Tap {
            header: header_of(&config, &tap, rendered.velocity_measured_m_per_s),
            force: force.iter().map(|&x| f64::from(x)).collect(),
            sound: sound.iter().map(|&x| f64::from(x)).collect(),
        }
    };
    (0..count).map(tap).collect()
}

/// Taps in which faults are planted; without those whose velocity happens to be off.
static TAPS: LazyLock<Vec<Tap>> = LazyLock::new(|| {
    let mut taps = simulated(160);
    taps.retain(|tap| !tap.flags().contains(Quality::VELOCITY_OFF));
    taps
});

/// Taps of the other rig.
static OTHERS: LazyLock<Vec<Tap>> = LazyLock::new(|| (0..240).map(other_rig::tap).collect());

fn peak(channel: &[f64]) -> f64 {
    channel.iter().fold(0.0, |a, x| if x.abs() > a { x.abs() } else { a })
}

/// Numbers of mean 0 and standard deviation 1, bell-shaped enough.
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

/// `channel` plus `part` of itself, `lag` samples later (earlier, when negative).
fn add_echo(channel: &mut [f64], part: f64, lag: isize) {
    let once = channel.to_vec();
    for (i, x) in channel.iter_mut().enumerate() {
        let from = i as isize - lag;
        *x += part * once.get(from as usize).filter(|_| from >= 0).copied().unwrap_or(0.0);
    }
}

/// Whether three samples in a row are as far from 0 as `level`, or further.
fn has_flat_top(channel: &[f64], level: f64) -> bool {
    channel.windows(3).any(|w| w.iter().all(|&x| x >= level) || w.iter().all(|&x| x <= -level))
}

/// Cuts `channel` at `part` of its peak; a cut of fewer than three samples is none.
fn cut(channel: &mut [f64], part: f64) -> bool {
    let level = part * peak(channel);
    let is_flat = has_flat_top(channel, level);
    channel.iter_mut().for_each(|x| *x = x.clamp(-level, level));
    is_flat
}

/// `channel` from sample `cut` on, made whole with what is last in it.
fn begin_at(channel: &mut Vec<f64>, cut: usize) {
    let last = channel[channel.len() - cut..].to_vec();
    channel.drain(..cut);
    channel.extend(last);
}

/// What comes of planting a fault: `false` when this tap cannot have it.
trait Planted {
    fn is_planted(self) -> bool;
}

impl Planted for () {
    fn is_planted(self) -> bool {
        true
    }
}

impl Planted for bool {
    fn is_planted(self) -> bool {
        self
    }
}

/// Flags of taps with faults.
struct Flags(Vec<Quality>);

impl Flags {
    fn of<P: Planted>(taps: &[Tap], plant: impl Fn(usize, &mut Tap) -> P) -> Self {
        let planted = taps.iter().enumerate().filter_map(|(k, tap)| {
            let mut tap = tap.clone();
            plant(k, &mut tap).is_planted().then(|| tap.flags())
        });
        let flags: Vec<Quality> = planted.collect();
        assert!(!flags.is_empty(), "no tap can have the fault");
        Self(flags)
    }

    fn share(&self, flag: Quality) -> f64 {
        self.0.iter().filter(|flags| flags.contains(flag)).count() as f64 / self.0.len() as f64
    }

    #[track_caller]
    fn assert_raised(&self, flag: Quality, what: &str) {
        let raised = self.share(flag);
        eprintln!("{what}: {flag} in {raised:.4} of {} taps", self.0.len());
        assert!(raised >= 0.99, "{what}: {flag} in {raised} of taps");
    }
}

/// Fails unless `flag` is raised in 99 of 100 planted taps of either rig, and, of the simulated one, any but it and
/// `also` in one at most.
#[track_caller]
fn assert_flagged<P: Planted>(flag: Quality, also: &[Quality], what: &str, plant: impl Fn(usize, &mut Tap) -> P) {
    let flags = Flags::of(&TAPS, &plant);
    flags.assert_raised(flag, what);
    for &(other, name) in Quality::ALL.iter().filter(|(other, _)| *other != flag && !also.contains(other)) {
        let raised = flags.share(other);
        if raised > 0.01 {
            eprintln!("{what}: {name} in {raised} of taps");
        }
        assert!(raised <= 0.01, "{what}: {name} in {raised} of taps");
    }
    Flags::of(&OTHERS, &plant).assert_raised(flag, &format!("other rig, {what}"));
}

/// Catches a rule that takes physics, noise or the scatter of tyres for a fault: over cracks, too, where the layer
/// springs back, no flag is raised in more than one of a hundred taps.
#[test]
fn clean_taps_are_clean() {
    let flags: Vec<Quality> = simulated(2000).iter().map(Tap::flags).collect();
    for &(flag, name) in Quality::ALL {
        let raised = flags.iter().filter(|quality| quality.contains(flag)).count();
        assert!(raised <= 20, "{name} in {raised} of 2000 clean taps");
        if raised > 0 {
            eprintln!("{name} in {raised} of 2000 clean taps");
        }
    }
    let flagged = flags.iter().filter(|quality| !quality.is_clean()).count();
    eprintln!("flagged: {flagged} of 2000 clean taps");
    assert!(flagged <= 20, "{flagged} of 2000 clean taps");
}

/// Catches a rule that fits nothing but the simulated tyre: other pulses, rates, formats and scales are clean too.
#[test]
fn clean_taps_of_another_rig_are_clean() {
    let flags: Vec<(usize, Quality)> = (1000..3000).map(|k| (k, other_rig::tap(k).flags())).collect();
    let flagged: Vec<_> = flags.iter().filter(|(_, quality)| !quality.is_clean()).collect();
    eprintln!("other rig, flagged: {} of 2000 clean taps: {flagged:?}", flagged.len());
    assert!(flagged.len() <= 20, "{} of 2000 clean taps: {flagged:?}", flagged.len());
}

/// Catches a rule that changes what it looks at: the values of clean taps are the same bits under any policy.
#[test]
fn policies_do_not_touch_clean_taps() {
    let quality = QualityConfig {
        hum: Policy::Drop,
        low_snr: Policy::Drop,
        double_hit: Policy::Keep,
        ..QualityConfig::default()
    };
    let other = ProcessConfig { quality, ..ProcessConfig::default() };
    for tap in TAPS.iter().take(40) {
        let found = tap.found(&ProcessConfig::default());
        assert!(found.quality.is_clean() && values(&found).iter().all(Option::is_some), "{found:?}");
        assert_eq!(values(&found), values(&tap.found(&other)));
    }
}

/// Catches a rule that knows only the converter's limit, or only one of the channels.
#[test]
fn clipped() {
    for part in [0.5, 0.7, 0.9, 0.95] {
        assert_flagged(Quality::CLIPPED, &[], &format!("force cut at {part}"), |_, tap| cut(&mut tap.force, part));
    }
    for part in [0.5, 0.7, 0.9] {
        // What is left stands less far out of the noise.
        assert_flagged(Quality::CLIPPED, &[Quality::LOW_SNR], &format!("sound cut at {part}"), |_, tap| {
            cut(&mut tap.sound, part)
        });
    }
    for gain in [1.05, 1.5, 4.0] {
        assert_flagged(Quality::CLIPPED, &[], &format!("force beyond the limit by {gain}"), |_, tap| {
            tap.to_i16();
            let gain = gain * 32_768.0 / peak(&tap.force);
            tap.force.iter_mut().for_each(|x| *x *= gain);
            tap.header.channels[0].unit_per_count /= gain;
        });
        assert_flagged(
            Quality::CLIPPED,
            &[Quality::LOW_SNR, Quality::HUM],
            &format!("sound beyond the limit by {gain}"),
            |_, tap| {
                tap.to_i16();
                let gain = gain * 32_768.0 / peak(&tap.sound);
                tap.sound.iter_mut().for_each(|x| *x *= gain);
                tap.header.channels[1].unit_per_count /= gain;
                has_flat_top(&tap.sound, 32_768.0)
            },
        );
    }
}

/// Catches a cut pulse that is measured, and a baseline taken from the pulse.
#[test]
fn late_trigger() {
    for late_s in [0.1e-3, 0.2e-3, 0.4e-3] {
        assert_flagged(Quality::LATE_TRIGGER, &[], &format!("cut {late_s} s into the pulse"), |_, tap| {
            let cut = tap.header.pre_trigger_samples as usize + tap.lag(late_s) as usize;
            begin_at(&mut tap.force, cut);
            begin_at(&mut tap.sound, cut);
        });
    }
    for part in [0.3, 0.6, 0.9] {
        assert_flagged(Quality::LATE_TRIGGER, &[], &format!("pulse at {part} of the time before it"), |_, tap| {
            let early = ((1.0 - part) * f64::from(tap.header.pre_trigger_samples)) as usize;
            if part > 0.8 && early < tap.lag(2.1e-3) as usize {
                // So little early that the mark alone is late, and the rise of a long pulse hides it.
                tap.header.pre_trigger_samples += tap.lag(2.1e-3) as u32;
                return;
            }
            begin_at(&mut tap.force, early);
            begin_at(&mut tap.sound, early);
        });
    }
    let mut cut = TAPS[0].clone();
    begin_at(&mut cut.force, 520);
    begin_at(&mut cut.sound, 520);
    assert_eq!(values(&cut.found(&ProcessConfig::default())), [None; 7]);
}

/// Catches a second hit that is missed because it is close, faint, far or greater than the first.
#[test]
fn double_hit() {
    for (part, lag_s) in [
        (0.4, 1e-3),
        (0.4, 3e-3),
        (0.4, 8e-3),
        (0.15, 3e-3),
        (0.1, 8e-3),
        (1.3, 5e-3),
        (0.4, 60e-3),
        (0.6, 1.5e-3),
        (0.1, 4e-3),
    ] {
        // What is added has noise of its own.
        let also = if part > 1.0 { &[Quality::LOW_SNR][..] } else { &[Quality::CLIPPED] };
        assert_flagged(Quality::DOUBLE_HIT, also, &format!("{part} after {lag_s} s"), |_, tap| {
            let lag = tap.lag(lag_s);
            let is_apart = tap.pulse_samples() < lag as usize;
            add_echo(&mut tap.force, part, lag);
            add_echo(&mut tap.sound, part, lag);
            is_apart
        });
    }
}

/// Force in N at `RATE_HZ` of an impact upon the plate above a crack (Eqs. 21-22), by small steps: the slow twin of
/// the model's, and one that goes on until the layer has come back.
fn plate_force(scene: &Scene) -> Vec<f64> {
    const STEPS: usize = 64;
    let dt = 1.0 / (RATE_HZ * STEPS as f64);
    let chi = tapline_model::chi_for_restitution(scene.restitution).unwrap();
    let (k_c, k_f, m_1) = (scene.k_c_n_per_m1_5(), scene.k_f_n_per_m(), scene.m_1_kg);
    let m_p = scene.rho_2_kg_per_m3 * scene.w_m * scene.l_m * scene.h_m / 4.0;
    let c = scene.loss_tangent() * (k_f * m_p).sqrt();
    let (mut x_1, mut v_1, mut x_2, mut v_2) = (0.0, scene.velocity_m_per_s, 0.0, 0.0);
    let mut force = vec![0.0; N];
    for n in 0..600 * STEPS {
        let a: f64 = x_1 - x_2;
        let pull = 1.0 + chi * (v_1 - v_2) / scene.velocity_m_per_s;
        let f = if a > 0.0 && pull > 0.0 { k_c * a.powf(1.5) * pull } else { 0.0 };
        force[512 + n / STEPS] = f;
        v_1 -= f / m_1 * dt;
        v_2 += (f - c * v_2 - k_f * x_2) / m_p * dt;
        x_1 += v_1 * dt;
        x_2 += v_2 * dt;
    }
    force
}

/// Catches the layer above a crack, which comes back and touches the impactor again, taken for a second hit: the worst
/// cracks would then be the ones that are never judged.
#[test]
fn a_layer_that_comes_back_is_no_second_hit() {
    for (h_m, l_m) in [(1e-3, 25.4e-3), (2.54e-3, 25.4e-3), (2.54e-3, 50.8e-3), (6.35e-3, 50.8e-3)] {
        for velocity_m_per_s in [1.2, 1.85] {
            let scene = Scene { h_m, l_m, velocity_m_per_s, ..Scene::default() };
            let mut tap = TAPS[0].clone();
            let unit = tap.header.channels[0].unit_per_count;
            tap.force = plate_force(&scene).iter().zip(noise(1)).map(|(f, e)| (f + 0.05 * e) / unit).collect();
            tap.header.id = tap.header.id.with_velocity_m_per_s(Some(velocity_m_per_s)).unwrap();
            tap.header.velocity_measured_m_per_s = f64::NAN;
            let found = tap.found(&ProcessConfig::default());
            assert!(!found.quality.contains(Quality::DOUBLE_HIT), "{h_m} {l_m}: {}", found.quality);
            assert!(found.values.get(Discriminator::FMax).is_some() && found.values.get(Discriminator::Pr).is_some());
            // Nobody can tell without the impactor's mass.
            let quality = QualityConfig { impactor_mass_kg: 0.0, ..QualityConfig::default() };
            let found = tap.found(&ProcessConfig { quality, ..ProcessConfig::default() });
            assert!(found.quality.contains(Quality::DOUBLE_HIT), "{h_m} {l_m}: {}", found.quality);
        }
    }
}

/// Catches a pulse of a few samples that is measured.
#[test]
fn undersampled() {
    for factor in [8, 16] {
        assert_flagged(Quality::UNDERSAMPLED, &[], &format!("every {factor}th sample"), |_, tap| {
            tap.force = tap.force.iter().step_by(factor).copied().collect();
            tap.sound = tap.sound.iter().step_by(factor).copied().collect();
            tap.header.sample_rate_hz /= factor as f64;
            tap.header.sample_count /= factor as u32;
            tap.header.pre_trigger_samples /= factor as u32;
            tap.pulse_samples() < 8
        });
    }
}

/// Catches hum that is missed for its frequency or phase, and hum that is taken for noise or a neighbour.
#[test]
fn hum() {
    for f_hz in [50.0, 60.0, 49.8] {
        for part in [0.03, 0.1, 0.3] {
            assert_flagged(Quality::HUM, &[], &format!("{part} at {f_hz} Hz"), |k, tap| {
                let amplitude = part * peak(&tap.sound);
                let rate_hz = tap.header.sample_rate_hz;
                let sine = |i: usize| (TAU * f_hz * i as f64 / rate_hz + 0.7 * k as f64).sin();
                tap.sound.iter_mut().enumerate().for_each(|(i, x)| *x += amplitude * sine(i));
            });
        }
    }
}

/// Catches noise that is taken for a signal, or for anything else.
#[test]
fn low_snr() {
    for part in [0.03, 0.1, 0.3] {
        assert_flagged(
            Quality::LOW_SNR,
            &[Quality::NO_ONSET, Quality::NEIGHBOUR],
            &format!("noise {part} of the sound"),
            |k, tap| {
                let sigma = part * peak(&tap.sound);
                tap.sound.iter_mut().zip(noise(k)).for_each(|(x, e)| *x += sigma * e);
            },
        );
    }
    for part in [0.03, 0.08] {
        assert_flagged(Quality::LOW_SNR, &[], &format!("noise {part} of the force"), |k, tap| {
            let sigma = part * peak(&tap.force);
            tap.force.iter_mut().zip(noise(k)).for_each(|(x, e)| *x += sigma * e);
        });
    }
    assert_flagged(Quality::LOW_SNR, &[Quality::NO_ONSET], "unplugged microphone", |k, tap| {
        tap.to_i16();
        tap.sound.iter_mut().zip(noise(k)).for_each(|(x, e)| *x = 20.0 * e);
    });
}

/// Catches a neighbour that is missed for its time or strength, and one heard before the tap.
#[test]
fn neighbour() {
    for (part, lag_s) in [(0.25, 50e-3), (0.5, 50e-3), (1.0, 50e-3), (0.5, 100e-3), (0.25, 200e-3), (1.0, 250e-3)] {
        assert_flagged(Quality::NEIGHBOUR, &[Quality::LOW_SNR], &format!("{part} after {lag_s} s"), |_, tap| {
            let (lag, begin) = (tap.lag(lag_s), tap.header.pre_trigger_samples as usize);
            add_echo(&mut tap.sound, part, lag);
            begin + lag as usize + 1000 < tap.sound.len()
        });
    }
    for part in [0.3, 1.0] {
        assert_flagged(Quality::NEIGHBOUR, &[Quality::LOW_SNR], &format!("{part} before"), |_, tap| {
            add_echo(&mut tap.sound, part, -200);
            tap.header.pre_trigger_samples >= 512
        });
    }
}

/// Catches a missing channel, a missing baseline or a sample that is not a number, that passes without its flag.
#[test]
fn missing_channel_no_baseline_and_not_a_number() {
    assert_flagged(Quality::NO_SOUND, &[], "no sound", |_, tap| {
        tap.header.channel_count = 1;
        tap.sound.clear();
    });
    assert_flagged(Quality::NO_FORCE, &[], "no force", |_, tap| {
        tap.header.channel_count = 1;
        tap.header.channels[0] = tap.header.channels[1];
        tap.force.clear();
    });
    assert_flagged(Quality::NO_SOUND, &[Quality::NO_ONSET], "a sound of zeros", |_, tap| tap.sound.fill(0.0));
    assert_flagged(Quality::NO_FORCE, &[Quality::NO_PULSE], "a force of zeros", |_, tap| tap.force.fill(0.0));
    for pre_trigger_samples in [0, 1] {
        assert_flagged(Quality::NO_BASELINE, &[], "no baseline", |_, tap| {
            tap.header.pre_trigger_samples = pre_trigger_samples;
        });
    }
    for (place, bad) in [(0, f32::NAN), (530, f32::INFINITY), (N + 9000, f32::NAN)] {
        let mut samples: Vec<f32> = TAPS[0].samples().into_iter().map(f32::from).collect();
        samples[place] = bad;
        let header = TapHeader { sample_format: SampleFormat::F32.code(), ..TAPS[0].header };
        let found = Extractor::<f32>::new(&ProcessConfig::default()).unwrap().extract(&header, Samples::F32(&samples));
        assert_eq!(found.quality, Quality::NON_FINITE);
    }
}

/// Catches a velocity that is not compared, and a rate that no casing's contact time agrees with.
#[test]
fn velocity_off_and_rate_implausible() {
    for factor in [0.9, 0.95, 1.05, 1.2] {
        assert_flagged(Quality::VELOCITY_OFF, &[], &format!("velocity times {factor}"), |_, tap| {
            tap.header.velocity_measured_m_per_s = factor * tap.header.id.velocity_m_per_s().unwrap();
        });
    }
    for (factor, also) in [(10.0, &[][..]), (0.1, &[Quality::UNDERSAMPLED, Quality::NEIGHBOUR][..])] {
        assert_flagged(Quality::RATE_IMPLAUSIBLE, also, &format!("rate times {factor}"), |_, tap| {
            tap.header.sample_rate_hz *= factor;
        });
    }
}

/// Path of a recording that comes beside the repository, and is not part of it.
fn shared(file: &str) -> Option<Vec<u8>> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");
    let folder = std::env::var("TAPLINE_SHARED").unwrap_or_else(|_| beside.to_owned());
    let found = std::fs::read(format!("{folder}/data/{file}")).ok();
    if found.is_none() {
        eprintln!("skipped: no {file} in {folder}/data");
    }
    found
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// Tag at `at` of a MATLAB 5 file: type, and the range of its data, which may lie in the tag itself.
fn element(bytes: &[u8], at: usize) -> (usize, std::ops::Range<usize>, usize) {
    let (kind, size) = (u32_at(bytes, at), u32_at(bytes, at + 4));
    if kind >> 16 != 0 {
        return (kind & 0xffff, at + 4..at + 4 + (kind >> 16), at + 8);
    }
    (kind, at + 8..at + 8 + size, at + 8 + size.next_multiple_of(8))
}

/// The array `name` of a MATLAB 5 file, of whatever numbers it is made.
fn matlab_array(bytes: &[u8], name: &str) -> Vec<f32> {
    let mut at = 128;
    loop {
        let (_, matrix, next) = element(bytes, at);
        let (_, _, dims) = element(bytes, matrix.start);
        let (_, _, named) = element(bytes, dims);
        let (_, text, values) = element(bytes, named);
        if &bytes[text] == name.as_bytes() {
            let (kind, data, _) = element(bytes, values);
            return match kind {
                7 => bytes[data].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect(),
                9 => bytes[data].chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap()) as f32).collect(),
                _ => panic!("numbers of type {kind}"),
            };
        }
        at = next;
    }
}

/// Catches a number made of a real record that has none in it: a pulse of two or three samples, cut at its beginning,
/// without anything before it.
#[test]
fn the_recorded_bad_impact_is_refused_for_the_right_reasons() {
    let Some(file) = shared("vibrationtesting-impact/case1.mat") else { return };
    let samples: Vec<f32> = ["Time_chan_1", "Time_chan_2"].iter().flat_map(|name| matlab_array(&file, name)).collect();
    assert_eq!(samples.len(), 2 * 4096);
    for pre_trigger_samples in [0, 100] {
        let header = header(1280.0, pre_trigger_samples, 4096, SampleFormat::F32);
        let found = Extractor::<f64>::new(&ProcessConfig::default()).unwrap().extract(&header, Samples::F32(&samples));
        assert!(found.quality.contains(Quality::UNDERSAMPLED), "{}", found.quality);
        assert!(found.quality.contains(Quality::LATE_TRIGGER), "{}", found.quality);
        assert_eq!(found.quality.contains(Quality::NO_BASELINE), pre_trigger_samples == 0);
        assert_eq!(values(&found), [None; 7], "{}", found.quality);
    }
}

/// Catches noise estimated where a real room is quiet by chance: background recorded by a microphone, most of it
/// rumble below the bands, is flagged when it is loud and let pass when it is not.
#[test]
fn recorded_background() {
    let Some(file) = shared("pyuff-microphone/Sample_UFF58b_bin.uff") else { return };
    const COUNT: usize = 79_292;
    const BACKGROUND_HZ: f64 = 65_536.0;
    let data = &file[572..572 + 4 * COUNT];
    let pa: Vec<f64> = data.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
    let background = |k: usize| {
        let from = k * 331 % (COUNT - 27_000);
        let at = |i: usize| from as f64 + i as f64 * BACKGROUND_HZ / RATE_HZ;
        let part: Vec<f64> = (0..N)
            .map(|i| pa[at(i) as usize] * (1.0 - at(i).fract()) + pa[at(i) as usize + 1] * at(i).fract())
            .collect();
        let mean = part.iter().sum::<f64>() / N as f64;
        let sigma = (part.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / N as f64).sqrt();
        part.into_iter().map(move |x| (x - mean) / sigma)
    };
    let loud = |part: f64| {
        let background = &background;
        move |k: usize, tap: &mut Tap| {
            let sigma = part * peak(&tap.sound);
            tap.sound.iter_mut().zip(background(k)).for_each(|(x, e)| *x += sigma * e);
        }
    };
    for part in [0.05, 0.1, 0.3] {
        Flags::of(&TAPS, loud(part)).assert_raised(Quality::LOW_SNR, &format!("background {part}"));
    }
    for (k, tap) in TAPS.iter().enumerate() {
        let mut tap = tap.clone();
        loud(0.003)(k, &mut tap);
        assert!(tap.flags().is_clean(), "{}", tap.flags());
    }
}
