//! Tests of the trigger on simulated streams of the force.

use std::f64::consts::PI;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use super::*;

const RATE_HZ: f64 = 40_960.0;

fn noise(rng: &mut ChaCha8Rng, sd: f64) -> f64 {
    let normal: f64 = StandardNormal.sample(rng);
    sd * normal
}

/// A force pulse at `t` samples after its start: as a sphere's that springs back, 1 ms long.
fn pulse(t: f64) -> f64 {
    let width = 1e-3 * RATE_HZ;
    if (0.0..width).contains(&t) { (PI * t / width).sin().powf(1.5) } else { 0.0 }
}

/// Where [`pulse`] is half of its peak.
fn half() -> f64 {
    0.5_f64.powf(1.0 / 1.5).asin() / PI * 1e-3 * RATE_HZ
}

fn crossings(config: &TriggerConfig, stream: &[f32], piece: usize) -> (Vec<Crossing>, NotTaps) {
    let mut trigger = Trigger::new(config, RATE_HZ);
    let mut found = Vec::new();
    for chunk in stream.chunks(piece) {
        trigger.push(chunk, |crossing| found.push(crossing));
    }
    (found, trigger.not_taps())
}

/// Taps of changing heights at changing parts of a sample, and when each is half of its peak.
fn taps(count: usize, period: usize, sd: f64, seed: u64) -> (Vec<f32>, Vec<f64>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut stream: Vec<f64> = (0..(count + 1) * period).map(|_| noise(&mut rng, sd)).collect();
    let mut times = Vec::new();
    for tap in 0..count {
        let start = (tap * period + period / 2) as f64 + (tap % 97) as f64 / 97.0;
        let height = 0.3 + 0.6 * (tap % 13) as f64 / 12.0;
        for (place, value) in stream.iter_mut().enumerate().skip(start as usize).take(50) {
            *value += height * pulse(place as f64 - start);
        }
        times.push(start + half());
    }
    (stream.into_iter().map(|x| x as f32).collect(), times)
}

#[test]
fn every_tap_is_found_once_at_its_time() {
    // Catches a tap that is missed, found twice, or found elsewhere, and a result that depends on how the samples come.
    // The lowest taps are 0.3 high. The last noise is 1 % of them: there the bound of Cramer and Rao for a pulse of 1 ms whose
    // height and length are not known is 0.04 samples, so that of thousands the worst is 0.16 off or more, however it is found.
    let config = TriggerConfig { hold_off_s: 0.02, ..TriggerConfig::default() };
    for (number, sd) in [0.0, 1e-4, 2e-4, 5e-4, 1e-3, 3e-3].into_iter().enumerate() {
        let (stream, times) = taps(2000, 2048, sd, number as u64);
        let (found, not_taps) = crossings(&config, &stream, 411);
        assert_eq!((found.len(), not_taps), (times.len(), NotTaps::default()), "noise {sd}");
        let errors = || found.iter().zip(&times).map(|(found, time)| found.time_samples - time);
        let rms = (errors().map(|e| e * e).sum::<f64>() / times.len() as f64).sqrt();
        let worst = errors().map(f64::abs).max_by(f64::total_cmp).unwrap();
        assert!(rms < 0.06 && worst < if sd > 1e-3 { 0.4 } else { 0.1 }, "noise {sd}: {rms}, {worst} samples");
        assert_eq!(found, crossings(&config, &stream, 7).0);
    }
}

#[test]
fn clicks_and_steps_are_no_taps() {
    // Catches a cable's click and a step of the offset taken for taps, and a tap behind them that is missed.
    let (mut stream, times) = taps(40, 4096, 1e-3, 9);
    for (number, place) in (0..40).map(|tap| (tap, tap * 4096 + 500)) {
        match number % 4 {
            0 => stream[place] += 0.8,
            1 => stream[place..].iter_mut().for_each(|x| *x += 0.1),
            2 => stream[place..].iter_mut().for_each(|x| *x -= 0.1),
            _ => stream[place..place + 2].iter_mut().for_each(|x| *x -= 0.5),
        }
    }
    let config = TriggerConfig { hold_off_s: 0.02, ..TriggerConfig::default() };
    let (found, not_taps) = crossings(&config, &stream, 1000);
    assert_eq!(not_taps, NotTaps { clicks: 10, steps: 10 });
    assert_eq!(found.len(), 40);
    for (found, time) in found.iter().zip(&times) {
        assert!((found.time_samples - time).abs() < 0.1, "{found:?} {time}");
    }
}

#[test]
fn a_rebound_belongs_to_its_tap() {
    // Catches a second hit of the impactor that is taken for the next tap or not told, and a clipped pulse that is no tap.
    let (mut stream, times) = taps(20, 8192, 1e-3, 5);
    for (number, time) in times.iter().enumerate() {
        let rebound = *time as usize + 1500;
        for (place, value) in stream[rebound..rebound + 41].iter_mut().enumerate() {
            *value += 0.3 * pulse(place as f64) as f32;
        }
        if number % 2 == 0 {
            stream[*time as usize - 20..rebound].iter_mut().for_each(|x| *x = x.clamp(-0.2, 0.2));
        }
    }
    let (found, not_taps) = crossings(&TriggerConfig::default(), &stream, 256);
    assert_eq!((found.len(), not_taps), (20, NotTaps::default()));
    assert!(found.iter().zip(&times).all(|(found, time)| (found.time_samples - time).abs() < 8.0));
}

#[test]
fn a_gap_in_the_stream_is_counted() {
    // Catches taps behind an overrun that are placed as if nothing had been lost.
    let (stream, times) = taps(20, 4096, 1e-3, 5);
    let config = TriggerConfig::default();
    let mut trigger = Trigger::new(&config, RATE_HZ);
    let mut found = Vec::new();
    trigger.push(&stream[..5 * 4096], |crossing| found.push(crossing));
    trigger.skip(4 * 4096);
    trigger.push(&stream[9 * 4096..], |crossing| found.push(crossing));
    let kept: Vec<f64> = times.iter().copied().filter(|time| !(20_480.0..36_864.0).contains(time)).collect();
    assert_eq!(found.len(), kept.len());
    assert!(found.iter().zip(&kept).all(|(found, time)| (found.time_samples - time).abs() < 0.1));
}

#[test]
fn what_is_no_trigger_is_refused() {
    // Catches a value out of bounds that is let through, or refused without its key.
    for (change, want) in [
        (TriggerConfig { level: 0.0, ..TriggerConfig::default() }, "capture.level is 0; it must be from 0.0001 to 0.9"),
        (TriggerConfig { release: f64::NAN, ..TriggerConfig::default() }, "capture.release is NaN"),
        (TriggerConfig { hold_off_s: 11.0, ..TriggerConfig::default() }, "capture.hold_off_s is 11"),
    ] {
        let error = change.validate("capture").unwrap_err().to_string();
        assert!(error.contains(want), "{error}");
    }
    TriggerConfig::default().validate("capture").unwrap();
}
