//! The taps of the experiment, turn by turn.

use anyhow::{Context as _, Result};
use realfft::RealFftPlanner;
use tapline_acquire::{ScanConfig, SimulatedLine};
use tapline_draw::record::channel;
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::{Channel, Discriminator, Discriminators, Plan, PlannedTap, Quality, Samples, TapHeader, TapId};

use super::spectrum::{peak_v, steps};
use super::tyres;
use super::tyres::{OFFSETS_MM, REPRESENTATIVE, Severity, VELOCITIES_M_PER_S, VELOCITY_M_PER_S};
use crate::in_memory::scanned;

/// Samples of a record: 0.4 s, as in section 5.2.
const SAMPLES: u32 = 16_384;

/// One tap: its discriminators, and the truth about it.
#[derive(Debug, Clone)]
pub(super) struct Tap {
    pub(super) found: Discriminators,
    /// Peak of the sound, not one of the seven.
    pub(super) peak_v: f64,
    /// Its power density in steps of frequency; none where it was not asked for.
    pub(super) density_v2_per_hz: Vec<f64>,
    /// Of the planted crack: 0 to 3.
    pub(super) severity: u8,
    pub(super) angle_deg: f64,
}

impl Tap {
    pub(super) fn value(&self, which: Discriminator) -> Option<f64> {
        self.found.values.get(which)
    }

    pub(super) fn is_cracked(&self) -> bool {
        self.severity > 0
    }
}

/// A scan and its taps, by plan row.
#[derive(Debug)]
pub(super) struct Dataset {
    pub plan: Plan,
    pub taps: Vec<Tap>,
}

/// Names a turn around one shoulder.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    pub tyre: &'static str,
    pub shoulder: u16,
    pub offset_mm: f64,
    pub velocity_m_per_s: f64,
    pub repetition: u16,
}

impl Default for Turn {
    fn default() -> Self {
        Self { tyre: REPRESENTATIVE, shoulder: 1, offset_mm: 0.0, velocity_m_per_s: VELOCITY_M_PER_S, repetition: 0 }
    }
}

impl Dataset {
    /// Takes the taps of `scan`; spectra of those that `has_spectrum` selects.
    fn scan(scan: &ScanConfig, has_spectrum: impl Fn(&TapId) -> bool + Sync) -> Result<Self> {
        let simulation = SimulationConfig { sample_count: SAMPLES, ..SimulationConfig::default() };
        let severity = Severity::new(scan)?;
        let look = |header: &TapHeader, samples: Samples<'_>| -> Result<(f64, Vec<f64>)> {
            let sound_v = channel(header, samples, Channel::Sound).context("a simulated record has no sound")?;
            let peak_v = peak_v(&sound_v);
            let spectrum = || steps(&mut RealFftPlanner::new(), sound_v, header.sample_rate_hz);
            Ok((peak_v, if has_spectrum(&header.id) { spectrum()? } else { Vec::new() }))
        };
        let read = |extractor: &mut ProcessExtractor, header: &TapHeader, samples: Samples<'_>| {
            let found = extractor.extract(header, samples);
            (!found.quality.contains(Quality::RETAKE)).then(|| (found, look(header, samples)))
        };
        let process = ProcessConfig::default();
        let source = || Ok(SimulatedLine::new(scan, &simulation)?);
        let (plan, seen) = scanned(source, || Ok(ProcessExtractor::new(&process)?), read)?;
        let tap = |(planned, (found, looked)): (&PlannedTap, (Discriminators, Result<_>))| {
            let (peak_v, density_v2_per_hz) = looked?;
            let angle_deg = planned.angle_deg.context("a tap of a ring has an angle")?;
            Ok(Tap { found, peak_v, density_v2_per_hz, severity: severity.at(&found.id)?, angle_deg })
        };
        let taps = plan.taps().iter().zip(seen).map(tap).collect::<Result<_>>()?;
        Ok(Self { plan, taps })
    }

    /// The taps of `turn`, in the order of their angles, the closing tap last.
    pub(super) fn turn(&self, turn: Turn) -> Vec<&Tap> {
        let is_it = |tap: &&Tap| {
            let id = &tap.found.id;
            let is = |value: Option<f64>, wanted: f64| value.is_some_and(|value| (value - wanted).abs() < 1e-9);
            id.tyre.as_str() == turn.tyre
                && id.shoulder == turn.shoulder
                && id.repetition == turn.repetition
                && is(id.offset_mm(), turn.offset_mm)
                && is(id.velocity_m_per_s(), turn.velocity_m_per_s)
        };
        self.taps.iter().filter(is_it).collect()
    }
}

#[derive(Debug)]
pub(super) struct Experiment {
    /// Three tyres, twice around.
    pub inspection: Dataset,
    pub over_offsets: Dataset,
    pub over_velocities: Dataset,
    pub at_one_place: Dataset,
}

impl Experiment {
    /// Takes them all, with the random numbers of `seed`.
    pub(super) fn take(seed: u64) -> Result<Self> {
        let is_in_b_scan = |id: &TapId| id.tyre.as_str() == REPRESENTATIVE && id.repetition == 0;
        let none = |_: &TapId| false;
        Ok(Self {
            inspection: Dataset::scan(&tyres::inspection(seed), is_in_b_scan)?,
            over_offsets: Dataset::scan(&tyres::over_offsets(seed), none)?,
            over_velocities: Dataset::scan(&tyres::over_velocities(seed), none)?,
            at_one_place: Dataset::scan(&tyres::at_one_place(seed), none)?,
        })
    }

    /// The turns at each offset, with their offset in mm.
    pub(super) fn offset_turns(&self) -> Vec<(f64, Vec<&Tap>)> {
        let turn = |offset_mm| (offset_mm, self.over_offsets.turn(Turn { offset_mm, ..Turn::default() }));
        OFFSETS_MM.into_iter().map(turn).collect()
    }

    /// The turns at each velocity, with their velocity in m/s.
    pub(super) fn velocity_turns(&self) -> Vec<(f64, Vec<&Tap>)> {
        let turn = |velocity_m_per_s| {
            (velocity_m_per_s, self.over_velocities.turn(Turn { velocity_m_per_s, ..Turn::default() }))
        };
        VELOCITIES_M_PER_S.into_iter().map(turn).collect()
    }

    /// Shoulder `shoulder` of the representative tyre, first and second time around.
    pub(super) fn repetitions(&self, shoulder: u16) -> [Vec<&Tap>; 2] {
        [0, 1].map(|repetition| self.inspection.turn(Turn { shoulder, repetition, ..Turn::default() }))
    }
}

/// The mean of `which` over two turns, location by location; if one is absent, the other.
pub(super) fn averaged(turns: &[Vec<&Tap>; 2], which: Discriminator) -> Vec<Option<f64>> {
    let [first, second] = turns;
    let mean = |(a, b): (&&Tap, &&Tap)| match (a.value(which), b.value(which)) {
        (Some(a), Some(b)) => Some(0.5 * (a + b)),
        (a, b) => a.or(b),
    };
    first.iter().zip(second).map(mean).collect()
}
