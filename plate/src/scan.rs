//! Scans of casings: their plan, and the discriminators of each tap by the shipped extractor.

use rayon::prelude::*;
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::{
    Channel, Discriminators, Geometry, Plan, PlannedTap, Purpose, Quality, Recording, SampleFormat, Samples, Scan,
    Serial, SourceKind, TapHeader, TapId, Truth,
};

use crate::casing::Casing;
use crate::crack::Crack;
use crate::error::{Error, within};
use crate::population::Population;
use crate::rig::{Rig, Tap};

/// A casing to simulate, and its cracks.
#[derive(Debug, Clone, PartialEq)]
pub struct Tyre {
    /// Serial number; with the seed it determines the casing.
    pub serial: Serial,
    /// Its cracks; a sound casing has none.
    pub cracks: Vec<Crack>,
}

/// Which taps a casing gets: two shoulders, full turns.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanShape {
    /// Offsets from the belt's edge.
    pub offsets_mm: Vec<f64>,
    /// Velocities.
    pub velocities_m_per_s: Vec<f64>,
    /// Turns at each offset and velocity.
    pub repetitions: u16,
    /// Locations of a turn.
    pub location_count: u32,
    /// Length of a record.
    pub record_s: f64,
    /// Samples per second and channel.
    pub sample_rate_hz: f64,
    /// Samples before the trigger.
    pub pre_trigger_samples: u32,
}

impl Default for ScanShape {
    fn default() -> Self {
        Self {
            offsets_mm: vec![0.0, 5.0, 10.0, 15.0],
            velocities_m_per_s: vec![1.85],
            repetitions: 2,
            location_count: 100,
            record_s: 0.05,
            sample_rate_hz: 40_960.0,
            pre_trigger_samples: 256,
        }
    }
}

impl ScanShape {
    /// Taps of one casing.
    pub fn tap_count(&self) -> usize {
        2 * self.offsets_mm.len()
            * self.velocities_m_per_s.len()
            * usize::from(self.repetitions)
            * self.location_count as usize
    }

    /// The plan of `tyres`, ordered by tyre, shoulder, offset, velocity, repetition and location.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a record without samples or with too many, and the errors of names and plans.
    pub fn plan(&self, tyres: &[Tyre]) -> Result<Plan, Error> {
        let sample_count = (self.record_s * self.sample_rate_hz).round();
        within("samples of a record", sample_count, f64::from(self.pre_trigger_samples) + 64.0, 16_777_216.0)?;
        let recording = Recording {
            sample_rate_hz: self.sample_rate_hz,
            pre_trigger_samples: self.pre_trigger_samples,
            sample_count_max: sample_count as u32,
            sample_format: SampleFormat::F32,
            channels: Channel::BOTH.to_vec(),
            calibration: tapline_wire::Calibration::computed(),
        };
        let mut taps = Vec::with_capacity(tyres.len() * self.tap_count());
        let mut truth = Truth::new();
        for tyre in tyres {
            for shoulder in [1, 2] {
                for location in 0..self.location_count {
                    let is_cracked = tyre.cracks.iter().any(|c| c.covers(shoulder, self.angle_deg(location)));
                    truth.insert((tyre.serial, shoulder, location), is_cracked);
                }
                self.ring(tyre.serial, shoulder, &mut taps)?;
            }
        }
        Ok(Plan::new(Geometry::Ring, recording, taps, truth)?)
    }

    fn ring(&self, serial: Serial, shoulder: u16, taps: &mut Vec<PlannedTap>) -> Result<(), Error> {
        for &offset_mm in &self.offsets_mm {
            for &velocity_m_per_s in &self.velocities_m_per_s {
                for repetition in 0..self.repetitions {
                    for location in 0..self.location_count {
                        let mut id = TapId::new(1, serial, shoulder, location)
                            .with_offset_mm(Some(offset_mm))?
                            .with_velocity_m_per_s(Some(velocity_m_per_s))?;
                        id.repetition = repetition;
                        taps.push(PlannedTap { id, angle_deg: Some(self.angle_deg(location)), purpose: Purpose::Scan });
                    }
                }
            }
        }
        Ok(())
    }

    fn angle_deg(&self, location: u32) -> f64 {
        360.0 * f64::from(location) / f64::from(self.location_count.max(1))
    }
}

/// The discriminators of every tap of `plan`, in its order; an unusable tap is taken again up to `retakes` times.
///
/// # Errors
/// As [`taps`], and the errors of the extractor.
pub fn discriminators(
    population: &Population,
    seed: u64,
    tyres: &[Tyre],
    plan: &Plan,
    process: &ProcessConfig,
    retakes: u16,
) -> Result<Vec<Discriminators>, Error> {
    let read = |extractor: &mut ProcessExtractor, header: &TapHeader, samples: &[f32]| {
        let found = extractor.extract(header, Samples::F32(samples));
        (!found.quality.contains(Quality::RETAKE)).then_some(found)
    };
    taps(population, seed, tyres, plan, retakes, || Ok(ProcessExtractor::new(process)?), read)
}

/// The result of `read` for the record (force, then sound) of every tap of `plan`, in its order. If it is `None`, the tap
/// is taken again; after `retakes` times, which the header counts down, it must return a result. Each thread
/// has its own `reader`.
///
/// # Errors
/// [`Error`] if the plan has other records than force and sound as 32-bit numbers, a tyre that is not among `tyres`, or a tap of
/// which `read` makes nothing; also the errors of [`Rig::new`] and `reader`.
pub fn taps<R, T: Send>(
    population: &Population,
    seed: u64,
    tyres: &[Tyre],
    plan: &Plan,
    retakes: u16,
    reader: impl Fn() -> Result<R, Error> + Sync,
    read: impl Fn(&mut R, &TapHeader, &[f32]) -> Option<T> + Sync,
) -> Result<Vec<T>, Error> {
    check(&plan.recording)?;
    let scans: Vec<Vec<(u32, T)>> = plan
        .scans()
        .par_iter()
        .map(|scan| {
            let tyre = tyres.iter().find(|tyre| tyre.serial == scan.tyre);
            let tyre = tyre.ok_or_else(|| Error::Recording { what: format!("tyre {}", scan.tyre) })?;
            let casing = Casing::new(population, seed, scan.tyre, tyre.cracks.clone());
            let mut station = Station::new(population, plan)?;
            let mut reader = reader()?;
            let take = |&row: &u32| {
                let made = station
                    .take(&casing, plan, scan, row, retakes, |header, samples| read(&mut reader, header, samples));
                Ok((
                    row,
                    made.ok_or_else(|| Error::Recording { what: format!("tap {row}, for which nothing is returned") })?,
                ))
            };
            scan.taps.iter().map(take).collect()
        })
        .collect::<Result<_, Error>>()?;
    let mut all: Vec<(u32, T)> = scans.into_iter().flatten().collect();
    all.sort_by_key(|&(row, _)| row);
    Ok(all.into_iter().map(|(_, made)| made).collect())
}

/// Refuses a recording that the simulator cannot make.
fn check(recording: &Recording) -> Result<(), Error> {
    let refuse = |what: &str| Err(Error::Recording { what: what.to_owned() });
    match () {
        () if recording.sample_format != SampleFormat::F32 => refuse("integer samples"),
        () if recording.channels != Channel::BOTH => refuse("other channels"),
        () => Ok(()),
    }
}

/// The tap in `row` of `plan`, which belongs to `scan`.
fn tap_of(plan: &Plan, scan: &Scan, row: u32, attempt: u16) -> Tap {
    let id = plan.taps()[row as usize].id;
    Tap {
        shoulder: id.shoulder,
        offset_mm: id.offset_mm().unwrap_or(0.0),
        velocity_m_per_s: id.velocity_m_per_s().unwrap_or(1.85),
        repetition: id.repetition,
        location: id.location,
        location_count: u32::try_from(scan.locations.len()).unwrap_or(u32::MAX),
        attempt,
    }
}

/// A rig with room for a record.
struct Station {
    rig: Rig,
    samples: Vec<f32>,
}

impl Station {
    fn new(population: &Population, plan: &Plan) -> Result<Self, Error> {
        let recording = &plan.recording;
        Ok(Self {
            rig: Rig::new(population, recording.sample_rate_hz, recording.pre_trigger_samples)?,
            samples: vec![0.0; 2 * recording.sample_count_max as usize],
        })
    }

    fn take<T>(
        &mut self,
        casing: &Casing,
        plan: &Plan,
        scan: &Scan,
        row: u32,
        retakes: u16,
        mut read: impl FnMut(&TapHeader, &[f32]) -> Option<T>,
    ) -> Option<T> {
        let of = &plan.recording;
        let mut header = TapHeader {
            id: plan.taps()[row as usize].id,
            plan_index: row,
            velocity_nominal_m_per_s: plan.velocity_nominal_m_per_s(row).unwrap_or(f64::NAN),
            microphone_distance_m: self.rig.microphone_distance_m(),
            planned_sample_count: of.sample_count_max,
            source: SourceKind::Simulated.code(),
            ..TapHeader::in_units(of.sample_rate_hz, of.pre_trigger_samples, of.sample_count_max, &of.channels)
        };
        (0..=retakes).find_map(|attempt| {
            let (force, sound) = self.samples.split_at_mut(of.sample_count_max as usize);
            header.id.attempt = attempt;
            header.retakes_left = (retakes - attempt).into();
            header.velocity_measured_m_per_s = self.rig.record(casing, &tap_of(plan, scan, row, attempt), force, sound);
            read(&header, &self.samples)
        })
    }
}

#[cfg(test)]
#[path = "scan_tests.rs"]
mod tests;
