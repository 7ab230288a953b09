//! PR, P_f and E_f of sounds from the simulated rig without imperfections: noise and faults are only this study's.

use std::f64::consts::TAU;

use anyhow::{Result, bail};
use tapline_model::{Crack, SimulatedRig, SimulatedTap, SimulatedTyre, SimulationConfig};
use tapline_process::{BandEdges, Precision, ProcessConfig, ProcessExtractor, Subtraction};
use tapline_wire::{Channel, Discriminator};

use super::{Estimator, RATES_HZ, Row, SignalCase, add_noise, amount, extract, rows, uniform};

/// Taps of each cell.
const TAPS: u32 = 100;
/// Seconds of a record, and before the impact.
const RECORD_S: f64 = 0.4;
const PRE_TRIGGER_S: f64 = 0.0125;
/// Seconds at the beginning that some ways read: a record's default length.
const USED_S: f64 = 0.05;

const POWERS: &[Discriminator] = &[Discriminator::Pr, Discriminator::Pf, Discriminator::Ef];

pub(super) fn cells() -> Vec<SignalCase> {
    let mut cells = Vec::new();
    for signal in ["sound", "cracked"] {
        for rate_hz in RATES_HZ {
            let conditions = [
                (None, ""),
                (Some(60), ""),
                (Some(40), ""),
                (Some(30), ""),
                (Some(20), ""),
                (Some(60), "hum 3 %"),
                (Some(60), "hum 10 %"),
                (Some(60), "neighbour 50 %"),
            ];
            cells.extend(conditions.map(|(snr_db, fault)| SignalCase {
                table: "sound",
                signal,
                rate_hz,
                snr_db,
                fault,
            }));
        }
    }
    cells
}

fn estimators() -> Vec<Estimator> {
    let all = super::plain();
    let part = ProcessConfig { record_s: USED_S, ..all };
    let less = |subtract, config| ProcessConfig { subtract, ..config };
    let fractional = |config| ProcessConfig { band_edges: BandEdges::Fractional, ..config };
    use Subtraction::{Both, Hum, Noise};
    let ways = [
        ("0.4 s, f64", ProcessConfig { precision: Precision::F64, ..all }),
        ("0.4 s", all),
        ("0.4 s, fractional", fractional(all)),
        ("0.4 s, less noise", less(Noise, all)),
        ("0.4 s, less hum", less(Hum, all)),
        ("0.05 s", part),
        ("0.05 s, fractional", fractional(part)),
        ("0.05 s, less noise", less(Noise, part)),
        ("0.05 s, less hum", less(Hum, part)),
        ("0.05 s, less both", less(Both, part)),
    ];
    ways.map(|(name, config)| Estimator { name, config, quantities: POWERS }).into()
}

pub(super) fn measure(cell: &SignalCase) -> Result<Vec<Row>> {
    let clean = clean(cell)?;
    let pre_trigger = pre_trigger(cell.rate_hz);
    let mut reference = ProcessExtractor::new(&ProcessConfig { precision: Precision::F64, ..super::plain() })?;
    let truth = extract(&mut reference, Channel::Sound, &clean, cell.rate_hz, pre_trigger)?;
    let peak = clean.iter().map(|x| f64::from(x.abs())).max_by(f64::total_cmp).unwrap_or(f64::NAN);
    let mut generator = cell.generator(0);
    let mut taps = Vec::new();
    // Without random numbers all taps are the same.
    for _ in 0..if cell.snr_db.is_none() && cell.fault.is_empty() { 1 } else { TAPS } {
        let mut samples = clean.clone();
        spoil(&mut samples, &clean, peak, pre_trigger, cell, uniform(&mut generator)?)?;
        add_noise(&mut samples, peak, cell.snr_db, &mut generator);
        taps.push(samples);
    }
    rows(cell, Channel::Sound, pre_trigger, &estimators(), &taps, |estimator, which| {
        let used_s = estimator.config.record_s;
        // Density and energy are averages over the part that is read: they are compared with averages over it.
        let part = if used_s > 0.0 && which != Discriminator::Pr { used_s / RECORD_S } else { 1.0 };
        truth.get(which).map(|truth| truth / part)
    })
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred samples")]
fn pre_trigger(rate_hz: u32) -> u32 {
    (PRE_TRIGGER_S * f64::from(rate_hz)) as u32
}

/// The sound of one tap, V: of sound rubber, or in the middle of a crack 6 mm deep.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a few thousand samples, in single precision"
)]
fn clean(cell: &SignalCase) -> Result<Vec<f32>> {
    let sample_count = (RECORD_S * f64::from(cell.rate_hz)) as u32;
    let config = SimulationConfig {
        sample_rate_hz: f64::from(cell.rate_hz),
        sample_count,
        pre_trigger_samples: pre_trigger(cell.rate_hz),
        force_noise_n: 0.0,
        sound_noise_v: 0.0,
        hum_v: 0.0,
        velocity_jitter: 0.0,
        gain_drift: 0.0,
        repeatability: 0.0,
        construction_scatter: 0.0,
        shoulder_scatter: 0.0,
        ring_variation: 0.0,
        location_scatter: 0.0,
        ..SimulationConfig::default()
    };
    let cracks = match cell.signal {
        "sound" => Vec::new(),
        "cracked" => vec![Crack::default()],
        other => bail!("unknown sound {other}"),
    };
    let volts_per_count = config.sound_full_scale_v / 32_768.0;
    let mut rig = SimulatedRig::new(&config, 1, &[SimulatedTyre { serial: "E".to_owned(), cracks }])?;
    let tap = SimulatedTap {
        tyre_serial: "E",
        shoulder: 1,
        offset_mm: 5.0,
        velocity_m_per_s: 1.85,
        location: 2,
        location_count: 100,
        repetition: 0,
        attempt: 0,
    };
    let mut samples = vec![0_i16; rig.sample_total()];
    rig.render(&tap, &mut samples);
    Ok(samples[sample_count as usize..].iter().map(|&x| (f64::from(x) * volts_per_count) as f32).collect())
}

/// Adds the fault of the cell: hum of any phase, or a neighbour's tap after 60 to 120 ms.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "places in a record, and samples in single precision"
)]
fn spoil(samples: &mut [f32], clean: &[f32], peak: f64, pre_trigger: u32, cell: &SignalCase, phase: f64) -> Result<()> {
    const MAINS_HZ: f64 = 50.0;
    const NEIGHBOUR_S: f64 = 0.06;
    if let Some(percent) = amount(cell.fault, "hum ")? {
        let omega = TAU * MAINS_HZ / f64::from(cell.rate_hz);
        for (i, x) in samples.iter_mut().enumerate() {
            *x += (peak * percent / 100.0 * (omega * i as f64 + TAU * phase).sin()) as f32;
        }
    }
    if let Some(percent) = amount(cell.fault, "neighbour ")? {
        let later = pre_trigger as usize + (NEIGHBOUR_S * f64::from(cell.rate_hz) * (1.0 + phase)) as usize;
        let loudness = (percent / 100.0) as f32;
        for (x, y) in samples[later..].iter_mut().zip(&clean[pre_trigger as usize..]) {
            *x += loudness * y;
        }
    }
    Ok(())
}
