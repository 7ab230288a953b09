//! Writes a scan as a tap set, the folder of recordings that the program reads.

use std::fs;
use std::path::Path;

use hound::{SampleFormat, WavSpec, WavWriter};
use tapline_wire::Plan;

use crate::casing::Casing;
use crate::error::Error;
use crate::population::Population;
use crate::rig::Rig;
use crate::scan::{Tyre, check, tap_of};

/// Full scales in `scan.toml`: samples are in newtons and volts.
const FULL_SCALE: f64 = 1.0;

/// Writes the taps of `plan` into `folder` as a tap set, with its truth; no tap is taken again.
///
/// # Errors
/// As [`discriminators`](crate::discriminators), and errors of the operating system.
pub fn write_tap_set(
    folder: &Path,
    population: &Population,
    seed: u64,
    tyres: &[Tyre],
    plan: &Plan,
) -> Result<(), Error> {
    let recording = &plan.recording;
    check(recording)?;
    fs::create_dir_all(folder)?;
    let mut rig = Rig::new(population, recording.sample_rate_hz, recording.pre_trigger_samples)?;
    let mut list = csv::Writer::from_path(folder.join("taps.csv"))?;
    list.write_record([
        "file",
        "tyre",
        "shoulder",
        "offset_mm",
        "velocity_m_per_s",
        "location",
        "angle_deg",
        "repetition",
        "velocity_measured_m_per_s",
    ])?;
    let spec = WavSpec {
        channels: 2,
        sample_rate: recording.sample_rate_hz.round() as u32,
        bits_per_sample: 32,
        sample_format: SampleFormat::Float,
    };
    let count = recording.sample_count_max as usize;
    let (mut force, mut sound) = (vec![0.0_f32; count], vec![0.0_f32; count]);
    for (number, scan) in plan.scans().iter().enumerate() {
        let cracks = tyres.iter().find(|tyre| tyre.serial == scan.tyre).map(|tyre| tyre.cracks.clone());
        let cracks = cracks.ok_or_else(|| Error::Recording { what: format!("tyre {}", scan.tyre) })?;
        let casing = Casing::new(population, seed, scan.tyre, cracks)?;
        fs::create_dir_all(folder.join(format!("scan-{number:04}")))?;
        for &row in &scan.taps {
            let tap = tap_of(plan, scan, row, 0);
            let measured = rig.record(&casing, &tap, &mut force, &mut sound);
            let file = format!("scan-{number:04}/{row:06}.wav");
            let mut wav = WavWriter::create(folder.join(&file), spec)?;
            for (force, sound) in force.iter().zip(&sound) {
                wav.write_sample(*force)?;
                wav.write_sample(*sound)?;
            }
            wav.finalize()?;
            let planned = &plan.taps()[row as usize];
            list.write_record([
                file,
                scan.tyre.to_string(),
                scan.shoulder.to_string(),
                tap.offset_mm.to_string(),
                tap.velocity_m_per_s.to_string(),
                tap.location.to_string(),
                planned.angle_deg.map(|angle| angle.to_string()).unwrap_or_default(),
                tap.repetition.to_string(),
                measured.to_string(),
            ])?;
        }
    }
    list.flush()?;
    let mut truth = csv::Writer::from_path(folder.join("truth.csv"))?;
    truth.write_record(["tyre", "shoulder", "location", "cracked"])?;
    for ((tyre, shoulder, location), &is_cracked) in plan.truth() {
        let cells = [tyre.to_string(), shoulder.to_string(), location.to_string(), u8::from(is_cracked).to_string()];
        truth.write_record(cells)?;
    }
    truth.flush()?;
    let scan = format!(
        "geometry = {:?}\nchannels = [\"force\", \"sound\"]\nsample_rate_hz = {:?}\npre_trigger_samples = {}\n\
         force_full_scale_n = {FULL_SCALE:?}\nsound_full_scale_v = {FULL_SCALE:?}\nmicrophone_distance_m = {:?}\n",
        plan.geometry.name(),
        recording.sample_rate_hz,
        recording.pre_trigger_samples,
        rig.microphone_distance_m(),
    );
    Ok(fs::write(folder.join("scan.toml"), scan)?)
}

#[cfg(test)]
#[path = "tap_set_tests.rs"]
mod tests;
