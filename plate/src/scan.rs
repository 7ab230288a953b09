//! Scans of casings: their plan, and the discriminators of each tap by the shipped extractor.

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
/// As [`Line::new`], and the errors of the extractor.
pub fn discriminators(
    population: &Population,
    seed: u64,
    tyres: &[Tyre],
    plan: &Plan,
    process: &ProcessConfig,
    retakes: u16,
) -> Result<Vec<Discriminators>, Error> {
    let mut line = Line::new(population, seed, tyres, plan)?;
    let mut extractor = ProcessExtractor::new(process)?;
    let of = &plan.recording;
    let mut samples = vec![0.0; 2 * of.sample_count_max as usize];
    let mut tap = |(row, planned): (u32, &PlannedTap)| {
        let mut header = TapHeader {
            id: planned.id,
            plan_index: row,
            velocity_nominal_m_per_s: plan.velocity_nominal_m_per_s(row).unwrap_or(f64::NAN),
            planned_sample_count: of.sample_count_max,
            source: SourceKind::Simulated.code(),
            ..TapHeader::in_units(of.sample_rate_hz, of.pre_trigger_samples, of.sample_count_max, &of.channels)
        };
        loop {
            header.retakes_left = (retakes - header.id.attempt).into();
            line.record(&mut header, &mut samples);
            let found = extractor.extract(&header, Samples::F32(&samples));
            if !found.quality.contains(Quality::RETAKE) || header.id.attempt == retakes {
                return found;
            }
            header.id.attempt += 1;
        }
    };
    Ok((0..).zip(plan.taps()).map(&mut tap).collect())
}

/// A rig with the casings of a plan.
#[derive(Debug)]
pub struct Line {
    rig: Rig,
    shoulders: Vec<Shoulder>,
    sample_count: u32,
}

/// A shoulder that is tapped.
#[derive(Debug)]
struct Shoulder {
    serial: Serial,
    number: u16,
    location_count: u32,
    casing: Casing,
}

impl Line {
    /// The line that makes the taps of `plan` on `tyres`; `seed` decides every random number.
    ///
    /// # Errors
    /// [`Error`] if the plan has other records than force and sound as 32-bit numbers, a tyre that is not among `tyres`, or locations that
    /// are not a full turn numbered from 0; also the errors of [`Rig::new`].
    pub fn new(population: &Population, seed: u64, tyres: &[Tyre], plan: &Plan) -> Result<Self, Error> {
        let recording = &plan.recording;
        if recording.sample_format != SampleFormat::F32 || recording.channels != Channel::BOTH {
            let what = format!("{:?} of the channels {:?}", recording.sample_format, recording.channels);
            return Err(Error::Recording { what });
        }
        let shoulder = |scan: &Scan| {
            let tyre = tyres.iter().find(|tyre| tyre.serial == scan.tyre);
            let tyre = tyre.ok_or_else(|| Error::Recording { what: format!("tyre {}", scan.tyre) })?;
            let count = scan.locations.len() as f64;
            let is_at = |deg: f64, number: u32| (deg - 360.0 * f64::from(number) / count).abs() < 1e-6;
            let mut locations = (0..).zip(&scan.locations);
            let other = locations.find(|&(number, &(location, angle_deg))| {
                location != number || angle_deg.is_some_and(|deg| !is_at(deg, number))
            });
            if let Some((number, (location, angle_deg))) = other {
                let what =
                    format!("location {location} at {angle_deg:?} degrees as number {number} of {count} of {scan}");
                return Err(Error::Recording { what });
            }
            Ok(Shoulder {
                serial: scan.tyre,
                number: scan.shoulder,
                location_count: u32::try_from(scan.locations.len()).unwrap_or(u32::MAX),
                casing: Casing::new(population, seed, scan.tyre, tyre.cracks.clone()),
            })
        };
        Ok(Self {
            rig: Rig::new(population, recording.sample_rate_hz, recording.pre_trigger_samples)?,
            shoulders: plan.scans().iter().map(shoulder).collect::<Result<_, Error>>()?,
            sample_count: recording.sample_count_max,
        })
    }

    /// Records the tap that `header` names: force, then sound, into `samples`, and what is known of both into `header`. A tap of
    /// another plan is left as it is.
    ///
    /// # Panics
    /// If `samples` has no room for a record.
    pub fn record(&mut self, header: &mut TapHeader, samples: &mut [f32]) {
        let id = header.id;
        let is_it = |shoulder: &&Shoulder| shoulder.serial == id.tyre && shoulder.number == id.shoulder;
        let Some(Shoulder { location_count, casing, .. }) = self.shoulders.iter().find(is_it) else { return };
        let tap = Tap {
            shoulder: id.shoulder,
            offset_mm: id.offset_mm().unwrap_or(0.0),
            velocity_m_per_s: id.velocity_m_per_s().unwrap_or(1.85),
            repetition: id.repetition,
            location: id.location,
            location_count: *location_count,
            attempt: id.attempt,
        };
        let count = self.sample_count as usize;
        let (force, sound) = samples[..2 * count].split_at_mut(count);
        header.velocity_measured_m_per_s = self.rig.record(casing, &tap, force, sound);
        header.microphone_distance_m = self.rig.microphone_distance_m();
        header.sample_count = self.sample_count;
        header.channels = TapHeader::in_units(0.0, 0, 0, &Channel::BOTH).channels;
    }
}

#[cfg(test)]
#[path = "scan_tests.rs"]
mod tests;
