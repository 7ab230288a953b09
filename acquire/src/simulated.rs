//! The simulated line: stations that tap simulated tyres.

use tapline_model::{Crack, SimulatedRig, SimulatedTap, SimulatedTyre, SimulationConfig, plant_cracks, truth};
use tapline_wire::{
    CHANNELS_MAX, Channel, ChannelHeader, Geometry, Lane, Plan, PlannedTap, Recording, SampleFormat, Serial,
    SourceKind, TapHeader, TapId, Truth, i16_of_mut,
};

use crate::source::{channel_headers, named, no_room, no_such_row};
use crate::{Error, Refusal, ScanConfig, Source};

/// Cracks of a tyre that is damaged by default.
const CRACKS_PLANTED: u32 = 3;

/// Counts of a full-scale sample.
const COUNTS_FULL_SCALE: f64 = 32_768.0;

/// Stations that tap simulated tyres, with nothing left to chance but what the seed decides.
#[derive(Debug)]
pub struct SimulatedLine {
    plan: Plan,
    rig: SimulatedRig,
    locations: u32,
    channels: [ChannelHeader; CHANNELS_MAX],
    /// When each tap of the plan happens, ns since the Unix epoch.
    tap_time_ns: Vec<i64>,
}

/// A tyre of the line, as it was written or as it is by default.
struct Tyre {
    serial: Serial,
    station: u16,
    cracks: Vec<Crack>,
}

impl SimulatedLine {
    /// The line that scans what `scan` lists with the rig that `simulation` describes.
    ///
    /// # Errors
    /// [`Error`] for a value out of its bounds.
    pub fn new(scan: &ScanConfig, simulation: &SimulationConfig) -> Result<Self, Error> {
        scan.validate()?;
        let tyres = tyres_of(scan)?;
        let on_rig: Vec<_> = tyres
            .iter()
            .map(|tyre| SimulatedTyre { serial: tyre.serial.to_string(), cracks: tyre.cracks.clone() })
            .collect();
        let rig = SimulatedRig::new(simulation, scan.seed, &on_rig)?;
        let recording = Recording {
            sample_rate_hz: simulation.sample_rate_hz,
            pre_trigger_samples: simulation.pre_trigger_samples,
            sample_count_max: simulation.sample_count,
            sample_format: SampleFormat::I16,
            channels: vec![Channel::Force, Channel::Sound],
        };
        let full_scales = [simulation.force_full_scale_n, simulation.sound_full_scale_v];
        let channels = channel_headers(&recording, &full_scales.map(|full_scale| full_scale / COUNTS_FULL_SCALE));
        let plan = Plan::new(Geometry::Ring, recording, taps_of(scan, &tyres)?, truth_of(scan, &tyres))?;
        let tap_time_ns = times_of(scan, &plan);
        Ok(Self { plan, rig, locations: scan.locations, channels, tap_time_ns })
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
    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn kind(&self) -> SourceKind {
        SourceKind::Simulated
    }

    fn can_retake(&self) -> bool {
        true
    }

    fn render(&mut self, row: u32, attempt: u16, header: &mut TapHeader, lanes: &mut [Lane]) -> Result<(), Refusal> {
        let kind = self.kind();
        *header = named(&self.plan, row, attempt, kind, header).ok_or_else(|| no_such_row(&self.plan, row))?;
        if let Some(reason) = no_room(lanes, self.plan.recording.payload_bytes_max()) {
            return Err(Refusal { file: "simulation".to_owned(), line: 0, reason });
        }
        let config = self.rig.config();
        header.tap_time_ns = self.tap_time_ns[row as usize];
        header.microphone_distance_m = config.microphone_distance_m;
        header.sample_count = config.sample_count;
        header.channels = self.channels;
        let tap = self.tap(&header.id);
        let sample_total = self.rig.sample_total();
        let rendered = self.rig.render(&tap, &mut i16_of_mut(lanes)[..sample_total]);
        header.velocity_measured_m_per_s = rendered.velocity_measured_m_per_s;
        Ok(())
    }
}

fn tyres_of(scan: &ScanConfig) -> Result<Vec<Tyre>, Error> {
    let serial_of = |text: &str| {
        Serial::new(text).map_err(|e| Error::Setting {
            key: "scan.tyre.serial".to_owned(),
            value: format!("{text:?}"),
            bound: format!("such that {e}"),
        })
    };
    if scan.tyre.is_empty() {
        let default_tyre = |station: u16| {
            let serial = format!("SIM-{station:04}");
            let is_damaged = station % 2 == 1;
            let crack_count = if is_damaged { CRACKS_PLANTED } else { 0 };
            let cracks = plant_cracks(scan.seed, &serial, scan.locations, crack_count);
            Ok(Tyre { serial: serial_of(&serial)?, station, cracks })
        };
        return (1..=scan.stations).map(default_tyre).collect();
    }
    let written = scan.tyre.iter();
    written.map(|t| Ok(Tyre { serial: serial_of(&t.serial)?, station: t.station, cracks: t.crack.clone() })).collect()
}

/// Every tap in the order in which it is taken: tyre, shoulder, offset, velocity, repetition, full turn.
fn taps_of(scan: &ScanConfig, tyres: &[Tyre]) -> Result<Vec<PlannedTap>, Error> {
    let mut taps = Vec::new();
    for tyre in tyres {
        for shoulder in 1..=scan.shoulders {
            for &offset_mm in &scan.offsets_mm {
                for &velocity_m_per_s in &scan.velocities_m_per_s {
                    for repetition in 0..scan.repetitions {
                        let mut id = id_of(offset_mm, velocity_m_per_s)?;
                        id.tyre = tyre.serial;
                        id.station = tyre.station;
                        id.shoulder = shoulder;
                        id.repetition = repetition;
                        taps.extend(turn(scan, id));
                    }
                }
            }
        }
    }
    Ok(taps)
}

fn id_of(offset_mm: f64, velocity_m_per_s: f64) -> Result<TapId, Error> {
    let named = TapId::default().with_offset_mm(Some(offset_mm));
    named.and_then(|id| id.with_velocity_m_per_s(Some(velocity_m_per_s))).map_err(|e| Error::Setting {
        key: "scan.offsets_mm or scan.velocities_m_per_s".to_owned(),
        value: format!("{offset_mm} or {velocity_m_per_s}"),
        bound: format!("such that {e}"),
    })
}

/// One full turn of `id`, with the first location again at its end.
fn turn(scan: &ScanConfig, id: TapId) -> impl Iterator<Item = PlannedTap> {
    let locations = scan.locations;
    let end = locations + u32::from(scan.closing_tap);
    (0..end).map(move |location| {
        let mut id = id;
        id.location = location;
        let angle_deg = 360.0 * f64::from(location) / f64::from(locations);
        PlannedTap { id, angle_deg: Some(angle_deg), is_closing: location == locations }
    })
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

/// Times of the taps; stations work side by side, each tapping once a period.
fn times_of(scan: &ScanConfig, plan: &Plan) -> Vec<i64> {
    #[expect(clippy::cast_possible_truncation, reason = "at most an hour, which is 3.6e12 ns")]
    let period_ns = (scan.tap_period_s * 1e9).round() as i64;
    let mut next_ns = vec![scan.start_ns; usize::from(scan.stations) + 1];
    plan.taps()
        .iter()
        .map(|tap| {
            let next_ns = &mut next_ns[usize::from(tap.id.station)];
            let now_ns = *next_ns;
            *next_ns = next_ns.saturating_add(period_ns);
            now_ns
        })
        .collect()
}

#[cfg(test)]
#[path = "simulated_tests.rs"]
mod tests;
