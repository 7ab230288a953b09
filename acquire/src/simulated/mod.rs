//! The simulated line: stations that tap simulated tyres.

pub(crate) mod listed;

use tapline_model::{Crack, SimulatedRig, SimulatedTap, SimulatedTyre, SimulationConfig, plant_cracks, truth};
use tapline_wire::{
    CHANNELS_MAX, CacheLine, Calibration, Channel, ChannelHeader, Geometry, Plan, Recording, SampleFormat, Serial,
    SourceKind, TapHeader, TapId, Truth, i16_of_mut,
};

use crate::config::scan_taps::taps_of;
use crate::source::{channel_headers, serial_of};
use crate::{About, Error, Refusal, ScanConfig, Source};

/// The key of a tyre's serial.
pub(crate) const SERIAL: &str = "scan.tyre.serial";

/// Cracks of a tyre that is damaged by default.
const CRACKS_PLANTED: u32 = 3;

/// Counts of a full-scale sample.
const COUNTS_FULL_SCALE: f64 = 32_768.0;

/// Stations that tap simulated tyres; the seed decides everything random.
#[derive(Debug)]
pub struct SimulatedLine {
    about: About,
    rig: SimulatedRig,
    locations: u32,
    channels: [ChannelHeader; CHANNELS_MAX],
    /// When each tap of the plan happens, ns since the Unix epoch.
    tap_time_ns: Vec<i64>,
    times: Times,
}

/// A tyre of the line, from the configuration or by default.
#[derive(Debug, Clone)]
pub(crate) struct Tyre {
    pub serial: Serial,
    pub station: u16,
    pub cracks: Vec<Crack>,
}

impl SimulatedLine {
    /// The line that scans what `scan` lists with the rig that `simulation` describes.
    ///
    /// # Errors
    /// [`Error`] for a value out of its bounds.
    pub fn new(scan: &ScanConfig, simulation: &SimulationConfig) -> Result<Self, Error> {
        scan.validate()?;
        let tyres: Vec<Tyre> = (0..scan.tyre_count()).map(|number| tyre_of(scan, number)).collect::<Result<_, _>>()?;
        let start_ns = vec![scan.start_ns; usize::from(scan.stations) + 1];
        Self::for_tyres(scan, simulation, &tyres, start_ns, 0)
    }

    /// One tyre only, whose station has made `taps_before` taps before it: the same taps as in the whole scan. `source_digest`
    /// distinguishes its plan from others of the same taps.
    pub(crate) fn for_tyre(
        scan: &ScanConfig,
        simulation: &SimulationConfig,
        tyre: &Tyre,
        taps_before: u64,
        source_digest: u64,
    ) -> Result<Self, Error> {
        let mut start_ns = vec![0; usize::from(tyre.station) + 1];
        start_ns[usize::from(tyre.station)] = time_after(scan, taps_before);
        Self::for_tyres(scan, simulation, std::slice::from_ref(tyre), start_ns, source_digest)
    }

    /// The line of `tyres`, of which each station starts at its place in `start_ns`.
    fn for_tyres(
        scan: &ScanConfig,
        simulation: &SimulationConfig,
        tyres: &[Tyre],
        start_ns: Vec<i64>,
        source_digest: u64,
    ) -> Result<Self, Error> {
        let rig = rig_of(scan, simulation, tyres)?;
        let plan = plan_of(scan, simulation, tyres, source_digest)?;
        let full_scales = [simulation.force_full_scale_n, simulation.sound_full_scale_v];
        let channels = channel_headers(&plan.recording, &full_scales.map(|full_scale| full_scale / COUNTS_FULL_SCALE));
        let tap_time_ns = times_of(scan, &plan, start_ns);
        let about = About { plan, kind: SourceKind::Simulated, can_retake: true, room: scan.room() };
        Ok(Self { about, rig, locations: scan.locations, channels, tap_time_ns, times: Times::of(scan) })
    }

    fn tap<'a>(&self, id: &'a TapId) -> SimulatedTap<'a> {
        SimulatedTap {
            tyre_serial: id.tyre.as_str(),
            shoulder: id.shoulder,
            offset_mm: id.offset_mm().unwrap_or(0.0),
            velocity_m_per_s: id.velocity_m_per_s().unwrap_or(f64::NAN),
            location: id.location,
            location_count: self.locations,
            repetition: id.repetition,
            attempt: id.attempt,
        }
    }
}

impl Source for SimulatedLine {
    fn about(&self) -> &About {
        &self.about
    }

    fn grow(&mut self, plan: Plan) {
        // Added taps are taken after the others.
        self.tap_time_ns.truncate(plan.taps().len() - plan.added().len());
        let mut now_ns = self.tap_time_ns.iter().copied().max().unwrap_or(0);
        for (before, tap) in plan.taps().iter().zip(&plan.taps()[1..]).skip(self.tap_time_ns.len() - 1) {
            now_ns = now_ns.saturating_add(self.times.between(&before.id, &tap.id));
            self.tap_time_ns.push(now_ns);
        }
        self.about.plan = plan;
    }

    fn fill(&mut self, header: &mut TapHeader, buffer: &mut [CacheLine]) -> Result<(), Refusal> {
        let config = self.rig.config();
        header.tap_time_ns = self.tap_time_ns[header.plan_index as usize];
        header.microphone_distance_m = config.microphone_distance_m;
        header.sample_count = config.sample_count;
        header.channels = self.channels;
        let tap = self.tap(&header.id);
        let sample_total = self.rig.sample_total();
        header.velocity_measured_m_per_s = self.rig.render(&tap, &mut i16_of_mut(buffer)[..sample_total]);
        Ok(())
    }
}

/// The rig with `tyres` to tap.
pub(crate) fn rig_of(
    scan: &ScanConfig,
    simulation: &SimulationConfig,
    tyres: &[Tyre],
) -> Result<SimulatedRig, tapline_model::Error> {
    let on_rig: Vec<_> = tyres
        .iter()
        .map(|tyre| SimulatedTyre { serial: tyre.serial.to_string(), cracks: tyre.cracks.clone() })
        .collect();
    SimulatedRig::new(simulation, scan.seed, &on_rig)
}

/// The plan of the scan of `tyres`.
pub(crate) fn plan_of(
    scan: &ScanConfig,
    simulation: &SimulationConfig,
    tyres: &[Tyre],
    source_digest: u64,
) -> Result<Plan, Error> {
    let recording = Recording {
        sample_rate_hz: simulation.sample_rate_hz,
        pre_trigger_samples: simulation.pre_trigger_samples,
        sample_count_max: simulation.sample_count,
        sample_format: SampleFormat::I16,
        channels: Channel::BOTH.to_vec(),
        calibration: Calibration::computed(),
    };
    let taps = taps_of(scan, tyres.iter().map(|tyre| (tyre.serial, tyre.station)))?;
    Ok(Plan::from_source(Geometry::Ring, recording, taps, truth_of(scan, tyres), source_digest)?)
}

/// Station of tyre `number`, from 0.
pub(crate) fn station_of(scan: &ScanConfig, number: usize) -> u16 {
    scan.tyre.get(number).map_or_else(|| u16::try_from(number + 1).unwrap_or(u16::MAX), |tyre| tyre.station)
}

/// Tyre `number`, from 0, as configured; if none is, the default one of station `number` + 1.
pub(crate) fn tyre_of(scan: &ScanConfig, number: usize) -> Result<Tyre, Error> {
    let station = station_of(scan, number);
    match scan.tyre.get(number) {
        Some(written) => {
            Ok(Tyre { serial: serial_of(SERIAL, &written.serial)?, station, cracks: written.crack.clone() })
        }
        None => default_tyre(scan, &format!("SIM-{station:04}"), station, station % 2 == 1),
    }
}

/// A tyre that no configuration lists: with cracks that its serial and the seed decide, or sound.
pub(crate) fn default_tyre(scan: &ScanConfig, serial: &str, station: u16, is_damaged: bool) -> Result<Tyre, Error> {
    let crack_count = if is_damaged { CRACKS_PLANTED } else { 0 };
    let cracks = plant_cracks(scan.seed, serial, scan.locations, crack_count);
    Ok(Tyre { serial: serial_of(SERIAL, serial)?, station, cracks })
}

/// For every location of every shoulder that is scanned, whether it is cracked.
fn truth_of(scan: &ScanConfig, tyres: &[Tyre]) -> Truth {
    let mut known = Truth::new();
    for tyre in tyres {
        for shoulder in 1..=scan.shoulders {
            let cracked = truth(&tyre.cracks, shoulder, scan.locations);
            known.extend((0..).zip(cracked).map(|(location, is)| ((tyre.serial, shoulder, location), is)));
        }
    }
    known
}

/// Time of a station's tap after `taps_before` others, ns since the Unix epoch.
fn time_after(scan: &ScanConfig, taps_before: u64) -> i64 {
    let taps_before = i64::try_from(taps_before).unwrap_or(i64::MAX);
    scan.start_ns.saturating_add(period_ns(scan).saturating_mul(taps_before))
}

fn period_ns(scan: &ScanConfig) -> i64 {
    ns(scan.tap_period_s)
}

#[expect(clippy::cast_possible_truncation, reason = "at most an hour, which is 3.6e12 ns")]
fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

/// What a rig needs from tap to tap.
#[derive(Debug, Clone, Copy)]
struct Times {
    tap_ns: i64,
    offset_ns: i64,
}

impl Times {
    fn of(scan: &ScanConfig) -> Self {
        Self { tap_ns: ns(scan.tap_period_s), offset_ns: ns(scan.offset_change_s) }
    }

    /// From one tap of a shoulder to the next.
    fn between(self, before: &TapId, tap: &TapId) -> i64 {
        let moves = (before.tyre, before.shoulder) == (tap.tyre, tap.shoulder) && before.offset_mm() != tap.offset_mm();
        self.tap_ns.saturating_add(if moves { self.offset_ns } else { 0 })
    }
}

/// Times of the taps; stations work in parallel, each from its entry in `next_ns` on.
fn times_of(scan: &ScanConfig, plan: &Plan, mut next_ns: Vec<i64>) -> Vec<i64> {
    let times = Times::of(scan);
    let mut before: Vec<Option<TapId>> = vec![None; next_ns.len()];
    plan.taps()
        .iter()
        .map(|tap| {
            let station = usize::from(tap.id.station);
            let step_ns = before[station].replace(tap.id).map_or(0, |before| times.between(&before, &tap.id));
            next_ns[station] = next_ns[station].saturating_add(step_ns);
            next_ns[station]
        })
        .collect()
}

#[cfg(test)]
mod tests;
