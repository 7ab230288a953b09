//! An example of recordings to import: what a simulated tyre sounds like, as a recorder would write it.

use std::fs;
use std::path::{Path, PathBuf};

use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_export::write_wav;
use tapline_model::SimulationConfig;
use tapline_store::OwnedSamples;
use tapline_wire::{CacheLine, Samples, TapHeader, cache_lines_for};

use crate::error::{Error, Result};

/// Locations of the example, and samples of each tap: enough for a verdict that finds the cracks, in a megabyte.
const LOCATIONS: u32 = 100;
const SAMPLE_COUNT: u32 = 2048;

/// Writes an example into the new or empty folder `folder`, and returns the files to import and the configuration for them.
///
/// # Errors
/// [`Error::Unwritable`], also for a folder that is not empty; [`Error::Export`] for a recording.
pub fn write_example(folder: &Path) -> Result<(Vec<PathBuf>, PathBuf)> {
    let unwritable =
        |file: &Path, reason: &dyn ToString| Error::Unwritable { file: file.to_owned(), reason: reason.to_string() };
    if fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(unwritable(folder, &"it has files in it; it must be new or empty"));
    }
    let recordings = folder.join("recordings");
    fs::create_dir_all(&recordings).map_err(|error| unwritable(&recordings, &error))?;
    let scan = ScanConfig { locations: LOCATIONS, shoulders: 1, closing_tap: false, ..ScanConfig::default() };
    let simulation = SimulationConfig { sample_count: SAMPLE_COUNT, ..SimulationConfig::default() };
    let mut line = SimulatedLine::new(&scan, &simulation)?;
    let recording = line.plan().recording.clone();
    let mut header = TapHeader::default();
    let mut buffer = vec![CacheLine::default(); cache_lines_for(recording.payload_bytes_max())];
    let taps = line.plan().taps().to_vec();
    let mut files = Vec::new();
    for (row, tap) in (0..).zip(&taps) {
        let file = recordings.join(format!("A-17_{}_{:03}.wav", tap.id.shoulder, tap.id.location));
        line.render(row, 0, &mut header, &mut buffer).map_err(|refusal| unwritable(&file, &refusal))?;
        let Some(Samples::I16(samples)) = Samples::view(&header, &buffer) else {
            return Err(unwritable(&file, &"the simulation gives no counts"));
        };
        write_wav(&file, &recording, &OwnedSamples::I16(samples.to_vec()))?;
        files.push(file);
    }
    let config = folder.join("import.toml");
    let text = format!(
        "# The recordings of a shoulder, one WAV per tap: channel 1 is the force, channel 2 the microphone.
name = \"{{tyre}}_{{shoulder}}_{{location}}.wav\"
channels = {{ force = 1, sound = 2 }}
pre_trigger_samples = {}     # samples in each file before the impact
force_full_scale_n = {:?}   # newtons of a full-scale sample; leave it out if it is not known
sound_full_scale_v = {:?}     # volts of a full-scale sample; the same
tap = {{ offset_mm = 0.0, velocity_m_per_s = 1.85 }}
",
        recording.pre_trigger_samples, simulation.force_full_scale_n, simulation.sound_full_scale_v
    );
    fs::write(&config, text).map_err(|error| unwritable(&config, &error))?;
    Ok((files, config))
}
