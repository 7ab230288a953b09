//! A tap set: a folder of recordings, one WAV per tap, with two tables that describe them.

pub(crate) mod casings;
pub(crate) mod extras;
#[cfg(test)]
mod fuzz_tests;
pub(crate) mod listed;
mod raw16;
mod recordings;
pub(crate) mod scales;
pub(crate) mod scan_toml;
pub(crate) mod table;
pub(crate) mod taps_csv;
mod truth_csv;
pub(crate) mod watched_folder;
pub(crate) mod wav;

use std::ffi::OsStr;
use std::io::{Read, Seek};
use std::path::Path;
use std::sync::Arc;

use tapline_wire::{CacheLine, Plan, SampleFormat, SourceKind, TapHeader};

use crate::source::channel_headers;
use crate::tap_set::casings::{SetCasing, casings_of};
use crate::tap_set::recordings::{Recordings, check_format, check_shape};
use crate::tap_set::scan_toml::ScanToml;
use crate::tap_set::taps_csv::TapRow;
use crate::tap_set::wav::{WavFault, WavHeader};
use crate::{About, Error, Refusal, Source};

/// Counts of a full-scale 16-bit sample.
const COUNTS_FULL_SCALE: f64 = 32_768.0;

/// A folder of recorded taps: `scan.toml`, `taps.csv`, one WAV per tap, and `truth.csv` if the truth is known.
///
/// It covers all casings of the folder, or one of them.
#[derive(Debug)]
pub struct TapSet {
    set: Arc<Recordings>,
    about: About,
    /// The row of the set for every row of the plan.
    rows: Vec<u32>,
    scratch: Vec<u8>,
}

impl TapSet {
    /// Opens the tap set in the folder `dir`. Casings without a named station are distributed over `station_count`
    /// stations in turn.
    ///
    /// Checks the tables and every recording's header. A recording that cannot be used is not an error here; its tap is
    /// refused when it is rendered.
    ///
    /// # Errors
    /// [`Error`] if a table is missing or wrong, if no recording can be used, if a casing is at two stations, or if
    /// there are no stations.
    pub fn open(dir: &Path, station_count: u16) -> Result<Self, Error> {
        let set = Recordings::open(dir)?;
        let casings = casings_of(&set, station_count)?;
        let mut stations = vec![0; set.taps.len()];
        for casing in &casings {
            for &row in &casing.rows {
                stations[row as usize] = casing.station;
            }
        }
        let rows: Vec<u32> = (0..).zip(&set.taps).map(|(row, _)| row).collect();
        let plan = set.plan(&rows, |row| stations[row])?;
        Ok(Self::of(Arc::new(set), plan, rows))
    }

    /// The taps of `casing` of `set`, at `station`.
    pub(crate) fn from_casing(set: &Arc<Recordings>, casing: &SetCasing, station: u16) -> Result<Self, Error> {
        let plan = set.plan(&casing.rows, |_| station)?;
        Ok(Self::of(Arc::clone(set), plan, casing.rows.clone()))
    }

    fn of(set: Arc<Recordings>, plan: Plan, rows: Vec<u32>) -> Self {
        let about = About { plan, kind: SourceKind::TapSet, can_retake: false, room: 0 };
        Self { set, about, rows, scratch: Vec::new() }
    }

    /// Why the recording in row `row` of the set cannot be used, as far as its header shows.
    fn fault(&self, row: u32) -> Option<String> {
        match self.set.header(row) {
            Err(fault) => Some(fault.to_owned()),
            Ok(wav) => check_format(wav, self.plan().recording.sample_format).err().map(|fault| fault.to_string()),
        }
    }

    fn refusal(&self, row: u32, reason: String) -> Refusal {
        let TapRow { file, line, .. } = &self.set.taps[row as usize];
        Refusal { file: file.clone(), line: *line, reason }
    }

    fn read(&mut self, row: u32, buffer: &mut [CacheLine]) -> Result<u32, WavFault> {
        let recording = &self.about.plan.recording;
        let (mut file, file_bytes) = wav::open(&self.set.dir.join(&self.set.taps[row as usize].file))?;
        // The header is read again because the file may have changed since the set was opened.
        let wav = header(&mut file, &self.set.taps[row as usize].file, file_bytes, &self.set.scan)?;
        check_shape(&wav, &self.set.scan)?;
        check_format(&wav, recording.sample_format)?;
        if wav.sample_count > recording.sample_count_max {
            return Err(WavFault::Grown { got: wav.sample_count, most: recording.sample_count_max });
        }
        wav.read_samples(&mut file, &mut self.scratch, buffer)?;
        Ok(wav.sample_count)
    }
}

impl Source for TapSet {
    fn about(&self) -> &About {
        &self.about
    }

    fn fill(&mut self, header: &mut TapHeader, buffer: &mut [CacheLine]) -> Result<(), Refusal> {
        let row = self.rows[header.plan_index as usize];
        let TapRow { velocity_measured_m_per_s, extras, .. } = &self.set.taps[row as usize];
        let scan = &self.set.scan;
        let recording = &self.plan().recording;
        header.id.attempt = header.id.attempt.max(extras.attempt);
        header.tap_time_ns = extras.tap_time_ns;
        header.velocity_measured_m_per_s = velocity_measured_m_per_s.unwrap_or(f64::NAN);
        header.microphone_distance_m = extras.microphone_distance_m.unwrap_or(scan.microphone_distance_m);
        let full_scales = self.set.scales.of_tap(&scan.channels, extras);
        header.channels = channel_headers(recording, &per_count(&full_scales, recording.sample_format));
        if let Some(reason) = self.fault(row) {
            return Err(self.refusal(row, reason));
        }
        header.sample_count = self.read(row, buffer).map_err(|fault| self.refusal(row, fault.to_string()))?;
        Ok(())
    }
}

/// The header of the recording `name`, whose format follows from the extension.
fn header(file: impl Read + Seek, name: &str, file_bytes: u64, scan: &ScanToml) -> Result<WavHeader, WavFault> {
    match Path::new(name).extension().and_then(OsStr::to_str) {
        Some(raw16::ENDING) => raw16::header(file_bytes, scan),
        _ => wav::read_header(file, file_bytes),
    }
}

/// Physical value of one stored unit, by channel.
fn per_count(full_scales: &[f64], format: SampleFormat) -> Vec<f64> {
    let full_scale_stored = match format {
        SampleFormat::I16 => COUNTS_FULL_SCALE,
        SampleFormat::F32 => 1.0,
    };
    full_scales.iter().map(|full_scale| full_scale / full_scale_stored).collect()
}

#[cfg(test)]
pub(crate) mod tests;
