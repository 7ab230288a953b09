//! Faults of a rig, planted in simulated taps to test the quality flags and retakes.

use std::f64::consts::TAU;

use crate::tyre::identity::Generator;
use crate::tyre::pulse::to_f32;
use crate::tyre::simulation_config::{FaultKind, PlantedFault, SimulationConfig};

/// Level at which a clipped channel saturates, as a fraction of its peak.
const CLIP: f32 = 0.7;

/// Draws the fault of a tap: each of `faults` is drawn independently, and the first that is drawn counts.
pub(crate) fn draw_fault(faults: &[PlantedFault], generator: &mut Generator) -> Option<FaultKind> {
    // Every fault takes a number from the generator, so that one fault's outcome does not shift the next one's.
    faults.iter().fold(None, |drawn, fault| {
        let is_drawn = generator.uniform() < fault.fraction;
        drawn.or_else(|| is_drawn.then_some(fault.kind))
    })
}

/// Applies the fault to the force `signal_n`.
pub(crate) fn distort_force(
    kind: FaultKind,
    config: &SimulationConfig,
    generator: &mut Generator,
    signal_n: &mut [f32],
) {
    match kind {
        FaultKind::ClippedForce => clip(signal_n),
        FaultKind::DoubleHit => echo(signal_n, 0.4, samples(4e-3, config)),
        FaultKind::Noise => add_noise(signal_n, 0.05, generator),
        FaultKind::LateTrigger => trigger_late(signal_n, config),
        FaultKind::DeadForce => signal_n.fill(0.0),
        _ => {}
    }
}

/// Applies the fault to the sound `signal_v`.
pub(crate) fn distort_sound(
    kind: FaultKind,
    config: &SimulationConfig,
    generator: &mut Generator,
    signal_v: &mut [f32],
) {
    match kind {
        FaultKind::ClippedSound => clip(signal_v),
        FaultKind::DoubleHit => echo(signal_v, 0.4, samples(4e-3, config)),
        FaultKind::Neighbour => echo(signal_v, 0.5, samples(60e-3, config)),
        FaultKind::Hum => {
            let (amplitude, phase) = (0.1 * f64::from(peak(signal_v)), generator.uniform());
            let turns_per_sample = config.hum_hz / config.sample_rate_hz;
            for (turns, x) in (0..).map(|n| phase + f64::from(n) * turns_per_sample).zip(signal_v) {
                *x += to_f32(amplitude * (TAU * turns.fract()).sin());
            }
        }
        FaultKind::Noise => add_noise(signal_v, 0.05, generator),
        FaultKind::LateTrigger => trigger_late(signal_v, config),
        FaultKind::DeadSound => signal_v.fill(0.0),
        _ => {}
    }
}

/// Ratio of the actual to the planned velocity.
pub(crate) fn velocity_ratio(kind: Option<FaultKind>) -> f64 {
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

fn add_noise(signal: &mut [f32], relative_sigma: f64, generator: &mut Generator) {
    let sigma = relative_sigma * f64::from(peak(signal));
    signal.iter_mut().for_each(|x| *x += to_f32(sigma * generator.normal()));
}

/// Adds `signal` to itself, scaled by `gain` and `lag` samples later.
fn echo(signal: &mut [f32], gain: f32, lag: usize) {
    // From the end, so that the echo is not itself repeated.
    for n in (lag..signal.len()).rev() {
        signal[n] += gain * signal[n - lag];
    }
}

/// Removes the samples before the impact and the first 0.2 ms of it; the end is filled with zeros.
fn trigger_late(signal: &mut [f32], config: &SimulationConfig) {
    let cut = (config.pre_trigger_samples as usize + samples(0.2e-3, config)).min(signal.len());
    signal.copy_within(cut.., 0);
    let kept = signal.len() - cut;
    signal[kept..].fill(0.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tyre::identity::Identity;

    /// Catches faults drawn with a wrong probability, and one whose draw depends on the one before it.
    #[test]
    fn faults_are_drawn_with_their_fractions() {
        let faults = [(FaultKind::Hum, 0.1), (FaultKind::DoubleHit, 0.3)]
            .map(|(kind, fraction)| PlantedFault { kind, fraction });
        let mut generator = Identity::new(1, "test").generator();
        let drawn: Vec<_> = (0..20_000).map(|_| draw_fault(&faults, &mut generator)).collect();
        let fraction = |kind| drawn.iter().filter(|d| **d == Some(kind)).count() as f64 / 20_000.0;
        assert!((fraction(FaultKind::Hum) - 0.1).abs() < 0.01);
        assert!((fraction(FaultKind::DoubleHit) - 0.9 * 0.3).abs() < 0.01);
        assert_eq!(draw_fault(&[], &mut generator), None);
        let next = |fraction| {
            let faults = [(FaultKind::Hum, fraction), (FaultKind::DoubleHit, 0.3)]
                .map(|(kind, fraction)| PlantedFault { kind, fraction });
            let mut generator = Identity::new(1, "test").generator();
            draw_fault(&faults, &mut generator);
            generator.uniform().to_bits()
        };
        assert_eq!(next(1.0), next(0.0), "a fault that is drawn shifts no random number after it");
    }

    /// Catches an echo that echoes itself, a cut at the wrong place, and a clip of one side only.
    #[test]
    fn signals_are_distorted_as_stated() {
        let config = SimulationConfig { sample_rate_hz: 1000.0, pre_trigger_samples: 2, ..SimulationConfig::default() };
        let mut generator = Identity::new(1, "test").generator();
        let mut distorted = |kind, mut signal: Vec<f32>| {
            distort_force(kind, &config, &mut generator, &mut signal);
            signal
        };
        let mut pulse = vec![0.0; 12];
        pulse[1] = 10.0;
        let twice = distorted(FaultKind::DoubleHit, pulse);
        assert_eq!((twice[1], twice[5], twice[9]), (10.0, 4.0, 0.0));
        assert_eq!(distorted(FaultKind::LateTrigger, vec![1.0, 2.0, 3.0, 4.0]), [3.0, 4.0, 0.0, 0.0]);
        assert_eq!(distorted(FaultKind::ClippedForce, vec![-10.0, 3.0, 8.0]), [-7.0, 3.0, 7.0]);
        assert_eq!(distorted(FaultKind::DeadForce, vec![1.0, 2.0]), [0.0, 0.0]);
        assert_eq!(distorted(FaultKind::DeadSound, vec![1.0, 2.0]), [1.0, 2.0]);
    }
}
