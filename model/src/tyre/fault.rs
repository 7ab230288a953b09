//! Faults of a rig, planted in simulated taps so that what finds and mends them can be tried.

use std::f64::consts::TAU;

use crate::tyre::identity::Generator;
use crate::tyre::pulse::to_f32;
use crate::tyre::simulation_config::{FaultKind, PlantedFault, SimulationConfig};

/// Part of its peak that a clipped channel keeps.
const CLIP: f32 = 0.7;

/// The first of `faults` that befalls a tap, if one does: each throws its own dice.
pub(crate) fn befalling(faults: &[PlantedFault], dice: &mut Generator) -> Option<FaultKind> {
    faults.iter().fold(None, |befallen, fault| {
        let is_hit = dice.uniform() < fault.share;
        befallen.or_else(|| is_hit.then_some(fault.kind))
    })
}

/// Spoils the force `signal_n`.
pub(crate) fn spoil_force(kind: FaultKind, config: &SimulationConfig, dice: &mut Generator, signal_n: &mut [f32]) {
    match kind {
        FaultKind::ClippedForce => clip(signal_n),
        FaultKind::DoubleHit => echo(signal_n, 0.4, samples(4e-3, config)),
        FaultKind::Noise => hiss(signal_n, 0.05, dice),
        FaultKind::LateTrigger => begin_late(signal_n, config),
        FaultKind::DeadForce => signal_n.fill(0.0),
        _ => {}
    }
}

/// Spoils the sound `signal_v`.
pub(crate) fn spoil_sound(kind: FaultKind, config: &SimulationConfig, dice: &mut Generator, signal_v: &mut [f32]) {
    match kind {
        FaultKind::ClippedSound => clip(signal_v),
        FaultKind::DoubleHit => echo(signal_v, 0.4, samples(4e-3, config)),
        FaultKind::Neighbour => echo(signal_v, 0.5, samples(60e-3, config)),
        FaultKind::Hum => {
            let (amplitude, phase) = (0.1 * f64::from(peak(signal_v)), dice.uniform());
            let turns_per_sample = config.hum_hz / config.sample_rate_hz;
            for (turns, x) in (0..).map(|n| phase + f64::from(n) * turns_per_sample).zip(signal_v) {
                *x += to_f32(amplitude * (TAU * turns.fract()).sin());
            }
        }
        FaultKind::Noise => hiss(signal_v, 0.05, dice),
        FaultKind::LateTrigger => begin_late(signal_v, config),
        FaultKind::DeadSound => signal_v.fill(0.0),
        _ => {}
    }
}

/// Factor on the velocity.
pub(crate) fn speed(kind: Option<FaultKind>) -> f64 {
    if kind == Some(FaultKind::VelocityOff) { 1.1 } else { 1.0 }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a short time at a checked rate")]
fn samples(time_s: f64, config: &SimulationConfig) -> usize {
    (time_s * config.sample_rate_hz).round() as usize
}

fn peak(signal: &[f32]) -> f32 {
    signal.iter().fold(0.0, |peak, x| if x.abs() > peak { x.abs() } else { peak })
}

fn clip(signal: &mut [f32]) {
    let limit = CLIP * peak(signal);
    signal.iter_mut().for_each(|x| *x = x.clamp(-limit, limit));
}

fn hiss(signal: &mut [f32], part: f64, dice: &mut Generator) {
    let sigma = part * f64::from(peak(signal));
    signal.iter_mut().for_each(|x| *x += to_f32(sigma * dice.normal()));
}

/// Adds `part` of `signal` to it, `lag` samples later.
fn echo(signal: &mut [f32], part: f32, lag: usize) {
    // From the end, so that what is added is not itself repeated.
    for n in (lag..signal.len()).rev() {
        signal[n] += part * signal[n - lag];
    }
}

/// Leaves out what lies before the impact and the first 0.2 ms of it.
fn begin_late(signal: &mut [f32], config: &SimulationConfig) {
    let cut = (config.pre_trigger_samples as usize + samples(0.2e-3, config)).min(signal.len());
    signal.copy_within(cut.., 0);
    let kept = signal.len() - cut;
    signal[kept..].fill(0.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tyre::identity::Identity;

    /// Catches a lottery with a wrong share, or in which the first fault's luck decides the second's.
    #[test]
    fn shares_are_kept() {
        let of = |kind, share| PlantedFault { kind, share };
        let faults = [of(FaultKind::Hum, 0.1), of(FaultKind::DoubleHit, 0.3)];
        let mut dice = Identity::new(1, "test").generator();
        let drawn: Vec<_> = (0..20_000).map(|_| befalling(&faults, &mut dice)).collect();
        let share = |kind| drawn.iter().filter(|d| **d == Some(kind)).count() as f64 / 20_000.0;
        assert!((share(FaultKind::Hum) - 0.1).abs() < 0.01);
        assert!((share(FaultKind::DoubleHit) - 0.9 * 0.3).abs() < 0.01);
        assert_eq!(befalling(&[], &mut dice), None);
    }

    /// Catches an echo that echoes itself, a cut at the wrong place, and a clip of one side only.
    #[test]
    fn signals_are_spoilt_as_stated() {
        let config = SimulationConfig { sample_rate_hz: 1000.0, pre_trigger_samples: 2, ..SimulationConfig::default() };
        let mut dice = Identity::new(1, "test").generator();
        let mut spoilt = |kind, mut signal: Vec<f32>| {
            spoil_force(kind, &config, &mut dice, &mut signal);
            signal
        };
        let mut pulse = vec![0.0; 12];
        pulse[1] = 10.0;
        let twice = spoilt(FaultKind::DoubleHit, pulse);
        assert_eq!((twice[1], twice[5], twice[9]), (10.0, 4.0, 0.0));
        assert_eq!(spoilt(FaultKind::LateTrigger, vec![1.0, 2.0, 3.0, 4.0]), [3.0, 4.0, 0.0, 0.0]);
        assert_eq!(spoilt(FaultKind::ClippedForce, vec![-10.0, 3.0, 8.0]), [-7.0, 3.0, 7.0]);
        assert_eq!(spoilt(FaultKind::DeadForce, vec![1.0, 2.0]), [0.0, 0.0]);
        assert_eq!(spoilt(FaultKind::DeadSound, vec![1.0, 2.0]), [1.0, 2.0]);
    }
}
