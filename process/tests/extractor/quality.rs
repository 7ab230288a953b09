//! Quality flags: planted faults are flagged, and nothing else is.

use std::f64::consts::TAU;

use tapline_model::{FaultKind, PlantedFault, Scene, SimulationConfig};
use tapline_process::{Extractor, Policy, ProcessConfig, QualityConfig};
use tapline_wire::{Discriminator, Quality, SampleFormat, Samples, TapHeader};

use crate::other_rig;
use crate::plant::*;
use crate::signal::values;

/// Catches a rule that only fits the simulated tyre: other pulses, rates, formats and scales are clean too.
#[test]
fn clean_taps_of_another_rig_are_clean() {
    let flags: Vec<(usize, Quality)> = (1000..3000).map(|k| (k, other_rig::tap(k).flags())).collect();
    let flagged: Vec<_> = flags.iter().filter(|(_, quality)| !quality.is_empty()).collect();
    eprintln!("other rig, flagged: {} of 2000 clean taps: {flagged:?}", flagged.len());
    assert!(flagged.len() <= 20, "{} of 2000 clean taps: {flagged:?}", flagged.len());
}

/// Catches a rule that changes its input: the values of clean taps have the same bits under any policy.
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
        assert!(found.quality.is_empty() && values(&found).iter().all(Option::is_some), "{found:?}");
        assert_eq!(values(&found), values(&tap.found(&other)));
    }
}

/// Catches a rule that only knows the converter's limit, or only one of the channels.
#[test]
fn clipped() {
    for part in [0.5, 0.7, 0.9, 0.95] {
        assert_flagged(Quality::CLIPPED, &[], &format!("force cut at {part}"), |_, tap| cut(&mut tap.force, part));
    }
    for part in [0.5, 0.7, 0.9] {
        // The rest stands out less from the noise.
        assert_flagged(Quality::CLIPPED, &[Quality::LOW_SNR], &format!("sound cut at {part}"), |_, tap| {
            cut(&mut tap.sound, part)
        });
    }
    for gain in [1.05, 1.5, 4.0] {
        assert_flagged(Quality::CLIPPED, &[], &format!("force beyond the limit by {gain}"), |_, tap| {
            tap.make_i16();
            let gain = gain * 32_768.0 / peak(&tap.force);
            tap.force.iter_mut().for_each(|x| *x *= gain);
            tap.header.channels[0].unit_per_count /= gain;
        });
        assert_flagged(
            Quality::CLIPPED,
            &[Quality::LOW_SNR, Quality::HUM],
            &format!("sound beyond the limit by {gain}"),
            |_, tap| {
                tap.make_i16();
                let gain = gain * 32_768.0 / peak(&tap.sound);
                tap.sound.iter_mut().for_each(|x| *x *= gain);
                tap.header.channels[1].unit_per_count /= gain;
                has_flat_top(&tap.sound, 32_768.0)
            },
        );
    }
}

/// Catches a cut pulse that is measured, and a baseline computed from the pulse.
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
                // So little early that only the mark is late; the rise of a long pulse hides it.
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
    assert_eq!(values(&cut.found(&ProcessConfig::default())), [None; Discriminator::COUNT]);
}

/// Catches a second hit that is missed because it is close, faint, far or stronger than the first.
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
        // The added hit has its own noise.
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

/// Force in N at `RATE_HZ` of an impact on the plate above a crack (Eqs. 21-22), in small steps: the slow twin of the
/// model's, which goes on until the layer has come back.
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

/// Catches a layer above a crack that springs back to the impactor and counts as a second hit. The worst cracks would
/// then never be judged.
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
            // Without the impactor's mass, the two cannot be distinguished.
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

/// Catches a fault of the simulated rig, planted before converter and noise, that is not detected behind them.
///
/// A clipped sound is only detected if noise is at most 0.2 % of its peak; the default rig has more.
#[test]
fn the_rigs_own_faults_are_flagged() {
    let loud = rig();
    let quiet = SimulationConfig { sound_noise_v: 5e-4, hum_v: 0.0, ..rig() };
    for (kind, flag, rig) in [
        (FaultKind::ClippedForce, Quality::CLIPPED, &loud),
        (FaultKind::ClippedSound, Quality::CLIPPED, &quiet),
        (FaultKind::DoubleHit, Quality::DOUBLE_HIT, &loud),
        (FaultKind::Neighbour, Quality::NEIGHBOUR, &loud),
        (FaultKind::Hum, Quality::HUM, &loud),
        (FaultKind::Noise, Quality::LOW_SNR, &loud),
        (FaultKind::LateTrigger, Quality::LATE_TRIGGER, &loud),
        (FaultKind::DeadForce, Quality::NO_PULSE, &loud),
        (FaultKind::DeadSound, Quality::NO_ONSET, &loud),
        (FaultKind::VelocityOff, Quality::VELOCITY_OFF, &loud),
    ] {
        let config = SimulationConfig { fault: vec![PlantedFault { kind, fraction: 1.0 }], ..rig.clone() };
        let flags = Flags(simulated_on(&config, 200).iter().map(Tap::flags).collect());
        flags.assert_raised(flag, &format!("the rig's {kind:?}"));
    }
}

/// Catches hum that is missed because of its frequency or phase, and hum that counts as noise or a neighbour.
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

/// Catches noise that counts as a signal, or as another fault.
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
        tap.make_i16();
        tap.sound.iter_mut().zip(noise(k)).for_each(|(x, e)| *x = 20.0 * e);
    });
}

/// Catches a neighbour that is missed because of its time or strength, and one before the tap.
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
    // Long before the tap, it rings through the whole baseline.
    assert_flagged(Quality::NEIGHBOUR, &[Quality::LOW_SNR, Quality::HUM], "rings before", |k, tap| {
        let amplitude = 0.8 * peak(&tap.sound);
        for (i, x) in tap.sound.iter_mut().enumerate() {
            let t = i as f64 / tap.header.sample_rate_hz;
            *x += amplitude * (-50.0 * t).exp() * (TAU * 700.0 * t + k as f64).sin();
        }
        tap.sound.len() >= N && tap.header.pre_trigger_samples < 2000
    });
}

/// Catches a missing channel, a missing baseline, or a sample that is not a number, without its flag.
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

/// Catches a velocity that is not compared, and a rate that no contact time of a casing fits.
#[test]
fn velocity_off_and_rate_implausible() {
    for factor in [0.9, 0.95, 1.05, 1.2] {
        assert_flagged(Quality::VELOCITY_OFF, &[], &format!("velocity times {factor}"), |_, tap| {
            tap.header.velocity_measured_m_per_s = factor * tap.header.id.velocity_m_per_s().unwrap();
        });
    }
    for (factor, also) in
        [(10.0, &[][..]), (0.1, &[Quality::UNDERSAMPLED, Quality::NEIGHBOUR, Quality::SOUND_LATE][..])]
    {
        assert_flagged(Quality::RATE_IMPLAUSIBLE, also, &format!("rate times {factor}"), |_, tap| {
            tap.header.sample_rate_hz *= factor;
        });
    }
}
