//! F_max and tau of pulses: a half-sine of the closed form's size, and the forces of the three rungs that run in time.

use std::f64::consts::PI;

use anyhow::{Result, bail};
use tapline_model::{Impact, Rung, Scene};
use tapline_process::{DurationEstimator, PeakEstimator, Precision, ProcessConfig, ProcessExtractor};
use tapline_wire::{Channel, Discriminator, Values};

use super::{Effort, Estimator, RATES_HZ, Row, SignalCase, add_noise, amount, extract, rows, uniform};

/// Taps of each cell of the page.
pub(super) const EFFORT: Effort = Effort { seed: 0, taps: 300 };
/// Samples before the impact.
const PRE_TRIGGER: u32 = 200;
/// Depth of the crack that the plates lie over: the deepest for thin-plate theory.
const CRACK_M: f64 = 5e-3;

const PULSES: [&str; 4] = ["half-sine", "integral", "plate", "full"];
const SNR_DB: [Option<u32>; 5] = [None, Some(60), Some(40), Some(30), Some(20)];

pub(super) fn cells() -> Vec<SignalCase> {
    let cell = |table, signal, rate_hz, snr_db, fault| SignalCase { table, signal, rate_hz, snr_db, fault };
    let mut cells = Vec::new();
    for signal in PULSES {
        for rate_hz in RATES_HZ {
            cells.extend(SNR_DB.map(|snr_db| cell("force", signal, rate_hz, snr_db, "")));
        }
    }
    for signal in ["half-sine", "integral", "plate"] {
        for fault in ["clipped 90 %", "clipped 80 %", "clipped 60 %"] {
            cells.extend([None, Some(40)].map(|snr_db| cell("clip", signal, RATES_HZ[0], snr_db, fault)));
        }
        for fault in ["time constant 0.1 s", "time constant 0.01 s"] {
            cells.extend([None, Some(40)].map(|snr_db| cell("droop", signal, RATES_HZ[0], snr_db, fault)));
        }
    }
    cells
}

/// A pulse in N, in steps of `step_s` from its first instant, and its duration.
struct Pulse {
    history_n: Vec<f64>,
    step_s: f64,
    contact_time_s: f64,
}

impl Pulse {
    fn named(name: &str) -> Result<Self> {
        let sound = Scene::default();
        let cracked = Scene { h_m: CRACK_M, ..sound };
        let impact = match name {
            "half-sine" => return Self::half_sine(&sound),
            "integral" => Impact::integral(&sound)?,
            "plate" => Impact::plate(&cracked)?,
            "full" => Impact::full(&cracked)?,
            other => bail!("unknown pulse {other}"),
        };
        let mut history_n = Vec::new();
        let step_s = impact.force_history(&mut history_n);
        Ok(Self { history_n, step_s, contact_time_s: impact.outcome()?.contact_time_s })
    }

    fn half_sine(scene: &Scene) -> Result<Self> {
        const STEPS: u32 = 4096;
        let contact = Rung::Closed.contact(scene, tapline_model::DampingLaw::Exact)?;
        let force_n = |i: u32| contact.f_max_n * (PI * f64::from(i) / f64::from(STEPS)).sin();
        Ok(Self {
            history_n: (0..=STEPS).map(force_n).collect(),
            step_s: contact.contact_time_s / f64::from(STEPS),
            contact_time_s: contact.contact_time_s,
        })
    }

    fn f_max_n(&self) -> f64 {
        self.history_n.iter().copied().max_by(f64::total_cmp).unwrap_or(f64::NAN)
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a place in the history, checked by get"
    )]
    fn force_n(&self, t_s: f64) -> f64 {
        let at = t_s / self.step_s;
        let fraction = at - at.floor();
        let pair = if at >= 0.0 { self.history_n.get(at as usize..at as usize + 2) } else { None };
        pair.map_or(0.0, |pair| pair[0] + fraction * (pair[1] - pair[0]))
    }
}

const F_MAX: &[Discriminator] = &[Discriminator::FMax];
const TAU: &[Discriminator] = &[Discriminator::Tau];
const BOTH: &[Discriminator] = &[Discriminator::FMax, Discriminator::Tau];

/// The defaults in double precision.
fn plain() -> ProcessConfig {
    ProcessConfig { precision: Precision::F64, ..super::plain() }
}

/// The estimators of `which`, F_max or tau.
pub(crate) fn estimators_of(which: Discriminator) -> Vec<Estimator> {
    let plain = plain();
    let peak = |name, f_max| Estimator { name, config: ProcessConfig { f_max, ..plain }, quantities: F_MAX };
    let of_time = |name, tau| Estimator { name, config: ProcessConfig { tau, ..plain }, quantities: TAU };
    match which {
        Discriminator::FMax => vec![
            peak("raw", PeakEstimator::Raw),
            peak("parabola", PeakEstimator::Parabola),
            peak("polynomial", PeakEstimator::Polynomial),
        ],
        _ => vec![
            of_time("half_sine", DurationEstimator::HalfSine),
            of_time("width_02", DurationEstimator::Width02),
            of_time("width_50", DurationEstimator::Width50),
            of_time("impulse", DurationEstimator::Impulse),
        ],
    }
}

fn estimators(cell: &SignalCase) -> Result<Vec<Estimator>> {
    let plain = plain();
    Ok(match cell.table {
        "force" => [Discriminator::FMax, Discriminator::Tau].map(estimators_of).concat(),
        "clip" => vec![Estimator { name: "parabola", config: plain, quantities: BOTH }],
        _ => {
            let Some(droop_time_constant_s) = amount(cell.fault, "time constant ")? else {
                bail!("{} is not a droop", cell.fault)
            };
            let corrected = ProcessConfig { droop_time_constant_s, ..plain };
            vec![
                Estimator { name: "as it is", config: plain, quantities: BOTH },
                Estimator { name: "corrected", config: corrected, quantities: BOTH },
            ]
        }
    })
}

/// The records of `cell`, in N, and the pulse in them.
fn records(cell: &SignalCase, effort: Effort) -> Result<(Pulse, Vec<Vec<f32>>)> {
    let pulse = Pulse::named(cell.signal)?;
    let mut generator = cell.generator(effort.seed);
    let mut made = |_| {
        let mut samples = record(&pulse, cell, uniform(&mut generator)?)?;
        add_noise(&mut samples, pulse.f_max_n(), cell.snr_db, &mut generator);
        clip(&mut samples, &pulse, cell)?;
        Ok(samples)
    };
    let records = (0..effort.taps).map(&mut made).collect::<Result<_>>()?;
    Ok((pulse, records))
}

/// The records of `cell`, in N.
pub(crate) fn pulse_records(cell: &SignalCase, effort: Effort) -> Result<Vec<Vec<f32>>> {
    Ok(records(cell, effort)?.1)
}

/// What `extractor` finds in a record of [`pulse_records`].
pub(crate) fn extract_force(extractor: &mut ProcessExtractor, samples: &[f32], rate_hz: u32) -> Option<Values> {
    extract(extractor, Channel::Force, samples, rate_hz, PRE_TRIGGER).ok()
}

pub(super) fn measure(cell: &SignalCase, effort: Effort) -> Result<Vec<Row>> {
    let (pulse, taps) = records(cell, effort)?;
    rows(cell, Channel::Force, PRE_TRIGGER, &estimators(cell)?, &taps, |_, which| {
        Some(if which == Discriminator::FMax { pulse.f_max_n() } else { pulse.contact_time_s })
    })
}

/// The samples of `pulse`, which begins `phase` samples before the trigger, after the AC coupling if the cell has one.
#[expect(clippy::cast_possible_truncation, reason = "samples are in single precision")]
fn record(pulse: &Pulse, cell: &SignalCase, phase: f64) -> Result<Vec<f32>> {
    /// Steps of the coupling within a sample.
    const STEPS: u32 = 64;
    let rate_hz = f64::from(cell.rate_hz);
    let count = PRE_TRIGGER + cell.rate_hz / 80;
    let force_n = |at: f64| pulse.force_n((at - f64::from(PRE_TRIGGER) + phase) / rate_hz);
    let Some(time_constant_s) = amount(cell.fault, "time constant ")? else {
        return Ok((0..count).map(|i| force_n(f64::from(i)) as f32).collect());
    };
    // y' = x' - y/TC, y held within a step: z = x - y follows z' = y/TC.
    let mut lost_n = 0.0;
    let mut samples = Vec::new();
    for i in 0..count {
        samples.push((force_n(f64::from(i)) - lost_n) as f32);
        for step in 0..STEPS {
            let middle = f64::from(i) + (f64::from(step) + 0.5) / f64::from(STEPS);
            lost_n += (force_n(middle) - lost_n) / (f64::from(STEPS) * rate_hz * time_constant_s);
        }
    }
    Ok(samples)
}

#[expect(clippy::cast_possible_truncation, reason = "samples are in single precision")]
fn clip(samples: &mut [f32], pulse: &Pulse, cell: &SignalCase) -> Result<()> {
    if let Some(percent) = amount(cell.fault, "clipped ")? {
        let limit = (pulse.f_max_n() * percent / 100.0) as f32;
        samples.iter_mut().filter(|x| **x > limit).for_each(|x| *x = limit);
    }
    Ok(())
}
