//! The recordings of a folder: its tables, the header of every recording, and the resulting plan.

use std::collections::HashSet;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use tapline_wire::{Calibration, Plan, PlannedTap, Recording, SampleFormat, Serial, Truth, digest_of_parts};

use crate::config::text;
use crate::tap_set::scales::Scales;
use crate::tap_set::scan_toml::{self, ScanToml};
use crate::tap_set::taps_csv::{self, TapRow};
use crate::tap_set::wav::{self, WavFault, WavHeader};
use crate::tap_set::{header, truth_csv};
use crate::{Error, Refusal, none_can};

/// Bytes at the beginning of a recording's file that identify it.
const BEGINNING_BYTES: u64 = 16_384;

/// The tables of a folder and the headers of its recordings.
#[derive(Debug)]
pub(crate) struct Recordings {
    pub(crate) dir: PathBuf,
    pub(crate) scan: ScanToml,
    scan_text: String,
    /// Scales of the samples.
    pub(crate) scales: Scales,
    /// The rows of the list of taps.
    pub(crate) taps: Vec<TapRow>,
    /// The header of each recording, or why it cannot be used.
    headers: Vec<Result<WavHeader, String>>,
    /// The identity of each recording's file, once it has been read: plans are made several times.
    beginnings: Vec<OnceLock<(u64, u64)>>,
    truth: Truth,
}

impl Recordings {
    /// Reads the tables in `dir` and every recording's header.
    ///
    /// # Errors
    /// [`Error`] if a table is missing or wrong, or if no recording can be used.
    pub(crate) fn open(dir: &Path) -> Result<Self, Error> {
        let (scan, scan_text, taps) = read_tables(dir)?;
        let scales = Scales::read(dir, &scan, &dir.join("taps.csv"), &taps)?;
        let truth_file = dir.join("truth.csv");
        let truth = text::read(&truth_file)?.map_or(Ok(Truth::new()), |text| truth_csv::parse(&truth_file, &text))?;
        let header = |row: &TapRow| header_of(dir, row, &scan).map_err(|fault| fault.to_string());
        let headers: Vec<_> = taps.iter().map(header).collect();
        if headers.iter().all(Result::is_err) {
            let refusals = taps.iter().zip(headers).filter_map(|(row, header)| {
                let reason = header.err()?;
                Some(Refusal { file: row.file.clone(), line: row.line, reason }.to_string())
            });
            return Err(Error::NoUsableTap { folder: dir.to_owned(), what: none_can(taps.len(), "used", refusals) });
        }
        let beginnings = vec![OnceLock::new(); taps.len()];
        Ok(Self { dir: dir.to_owned(), scan, scan_text, scales, taps, headers, beginnings, truth })
    }

    /// The path of the list of taps.
    pub(crate) fn taps_file(&self) -> PathBuf {
        self.dir.join("taps.csv")
    }

    /// The header of the recording in `row`, or why it cannot be used.
    pub(crate) fn header(&self, row: u32) -> Result<&WavHeader, &str> {
        self.headers[row as usize].as_ref().map_err(String::as_str)
    }

    /// The plan of the taps in `rows` of the set, at the station that `station_of` gives each row.
    ///
    /// It depends only on these rows and their recordings, not on the rest of the set.
    pub(crate) fn plan(&self, rows: &[u32], station_of: impl Fn(usize) -> u16) -> Result<Plan, Error> {
        let taps = rows.iter().map(|&row| {
            let mut tap = self.taps[row as usize].tap;
            tap.id.station = station_of(row as usize);
            tap
        });
        let taps: Vec<PlannedTap> = taps.collect();
        let shoulders: HashSet<_> = taps.iter().map(|tap| (tap.id.tyre, tap.id.shoulder)).collect();
        let is_of = |&(tyre, shoulder, _): &(Serial, u16, u32)| shoulders.contains(&(tyre, shoulder));
        let truth = self.truth.iter().filter(|(place, _)| is_of(place)).map(|(&place, &is)| (place, is)).collect();
        let headers = || rows.iter().map(|&row| &self.headers[row as usize]);
        let mut recording = recording_of(&self.scan, headers);
        let of_plan = rows.iter().map(|&row| &self.taps[row as usize]);
        recording.calibration = self.scales.calibration(&self.scan.channels, of_plan);
        Ok(Plan::from_source(self.scan.geometry, recording, taps, truth, self.digest(rows))?)
    }

    /// Digest that distinguishes the source of `rows` from others with the same taps. It covers the scales, and the
    /// name, length and beginning of each file.
    fn digest(&self, rows: &[u32]) -> u64 {
        let about = rows.iter().map(|&row| {
            let TapRow { file, velocity_measured_m_per_s, extras, .. } = &self.taps[row as usize];
            let read = || length_and_beginning(&self.dir.join(file));
            let (length, beginning) = self.beginnings[row as usize].get_or_init(read);
            let mut about = format!("{file} {length} {velocity_measured_m_per_s:?} {extras:?}").into_bytes();
            about.extend_from_slice(&beginning.to_le_bytes());
            about
        });
        let about: Vec<Vec<u8>> = about.collect();
        let scales = format!("{:?}", self.scales);
        let parts = [self.scan_text.as_bytes(), scales.as_bytes()].into_iter().chain(about.iter().map(Vec::as_slice));
        digest_of_parts(parts)
    }
}

/// The two tables in `dir`, and the text of the first.
fn read_tables(dir: &Path) -> Result<(ScanToml, String, Vec<TapRow>), Error> {
    let scan_file = dir.join("scan.toml");
    let scan_text = text::read_text(&scan_file)?;
    let scan = scan_toml::parse(&scan_file, &scan_text)?;
    let taps_file = dir.join("taps.csv");
    let taps = taps_csv::parse(&taps_file, &text::read_text(&taps_file)?, scan.geometry)?;
    Ok((scan, scan_text, taps))
}

/// The recordings that the tables in `dir` list, but for those of refused taps; some may not be there.
///
/// # Errors
/// [`Error`] if a table is missing or wrong.
pub(crate) fn listed_recordings(dir: &Path) -> Result<Vec<String>, Error> {
    let (.., taps) = read_tables(dir)?;
    Ok(taps.into_iter().filter(|row| row.extras.refused.is_none()).map(|row| row.file).collect())
}

/// The length of a recording's file and the digest of its beginning, which holds the noise before the impact and the
/// impact itself: no two recordings have the same. Both are 0 if the file cannot be read.
fn length_and_beginning(path: &Path) -> (u64, u64) {
    let read = || -> Result<(u64, u64), WavFault> {
        let (file, length) = wav::open(path)?;
        let mut beginning = Vec::with_capacity(BEGINNING_BYTES as usize);
        file.take(BEGINNING_BYTES).read_to_end(&mut beginning)?;
        Ok((length, digest_of_parts(std::iter::once(beginning.as_slice()))))
    };
    read().unwrap_or_default()
}

fn header_of(dir: &Path, row: &TapRow, scan: &ScanToml) -> Result<WavHeader, WavFault> {
    if let Some(reason) = &row.extras.refused {
        return Err(WavFault::Refused(reason.clone()));
    }
    let (file, file_bytes) = wav::open(&dir.join(&row.file))?;
    let wav = header(file, &row.file, file_bytes, scan)?;
    check_shape(&wav, scan)?;
    Ok(wav)
}

/// Checks channels, rate and length of a recording against `scan.toml`.
pub(crate) fn check_shape(wav: &WavHeader, scan: &ScanToml) -> Result<(), WavFault> {
    let (got, need) = (wav.channel_count, scan.channels.len());
    if usize::from(got) != need {
        return Err(WavFault::Channels { got, need });
    }
    // A WAV can only hold whole hertz; computations use the rate in scan.toml.
    let (got_hz, need_hz) = (wav.sample_rate_hz, scan.sample_rate_hz);
    if (f64::from(got_hz) - need_hz).abs() >= 1.0 {
        return Err(WavFault::Rate { got_hz, need_hz });
    }
    let (got, pre_trigger_samples) = (wav.sample_count, scan.pre_trigger_samples);
    if pre_trigger_samples >= got {
        return Err(WavFault::TooShort { got, pre_trigger_samples });
    }
    Ok(())
}

pub(crate) fn check_format(wav: &WavHeader, need: SampleFormat) -> Result<(), WavFault> {
    let got = wav.format;
    if got == need { Ok(()) } else { Err(WavFault::Format { got, need }) }
}

/// The shape of the records with these `headers`; if none can be used, records end one sample after the trigger.
fn recording_of<'a, I>(scan: &ScanToml, headers: impl Fn() -> I) -> Recording
where
    I: Iterator<Item = &'a Result<WavHeader, String>>,
{
    let usable = || headers().flatten();
    let first = usable().next().map_or(SampleFormat::I16, |wav| wav.format);
    // The format of the majority; the first one in a tie.
    let first_count = usable().filter(|h| h.format == first).count();
    let sample_format = match usable().find(|h| h.format != first) {
        Some(other) if first_count * 2 < usable().count() => other.format,
        _ => first,
    };
    let longest = usable().filter(|h| h.format == sample_format).map(|h| h.sample_count).max();
    Recording {
        sample_rate_hz: scan.sample_rate_hz,
        pre_trigger_samples: scan.pre_trigger_samples,
        sample_count_max: longest.unwrap_or_else(|| scan.pre_trigger_samples.saturating_add(1)),
        sample_format,
        channels: scan.channels.clone(),
        calibration: Calibration::default(),
    }
}
