//! A tap set: a folder of recordings, one WAV a tap, with two tables that say what they are.

mod extras;
#[cfg(test)]
mod fuzz_tests;
pub(crate) mod listed;
mod raw16;
pub(crate) mod scan_toml;
mod table;
mod taps_csv;
mod text;
mod truth_csv;
pub(crate) mod watched_folder;
mod wav;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::ffi::OsStr;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tapline_wire::{
    Channel, Geometry, Lane, Plan, PlannedTap, Recording, SampleFormat, Serial, SourceKind, TapHeader, Truth,
    digest_of_parts,
};

use crate::source::{channel_headers, named, no_room, no_such_row};
use crate::tap_set::extras::Extras;
use crate::tap_set::scan_toml::ScanToml;
use crate::tap_set::taps_csv::TapRow;
use crate::tap_set::wav::{WavFault, WavHeader};
use crate::{Error, Refusal, Source};

/// Bytes of a recording's file that tell it from others.
const BEGINNING_BYTES: u64 = 16_384;

/// Counts of a full-scale 16-bit sample.
const COUNTS_FULL_SCALE: f64 = 32_768.0;

/// Refusals that are told when every tap is refused.
const REASONS_TOLD: usize = 3;

/// A folder of recorded taps: `scan.toml`, `taps.csv`, one WAV a tap, and `truth.csv` where the truth is known.
///
/// It is all of the folder, or one casing of it; what they have in common is held once.
#[derive(Debug)]
pub struct TapSet {
    set: Arc<Recordings>,
    plan: Plan,
    /// For every row of the plan that of the set.
    rows: Vec<u32>,
    scratch: Vec<u8>,
}

/// What is known of all recordings of a folder.
#[derive(Debug)]
pub(crate) struct Recordings {
    dir: PathBuf,
    scan: ScanToml,
    scan_text: String,
    pub(crate) taps: Vec<TapRow>,
    headers: Vec<Result<WavHeader, String>>,
    truth: Truth,
}

impl Recordings {
    /// Reads the tables in `dir` and every recording's header.
    ///
    /// # Errors
    /// [`Error`] when a table is missing or wrong, or no recording at all can be used.
    pub(crate) fn open(dir: &Path) -> Result<Self, Error> {
        let need = |file: &Path| text::read(file)?.ok_or_else(|| text::missing(file));
        let scan_file = dir.join("scan.toml");
        let scan_text = need(&scan_file)?;
        let scan = scan_toml::parse(&scan_file, &scan_text)?;
        let taps_file = dir.join("taps.csv");
        let taps = taps_csv::parse(&taps_file, &need(&taps_file)?, scan.geometry)?;
        let truth_file = dir.join("truth.csv");
        let truth = text::read(&truth_file)?.map_or(Ok(Truth::new()), |text| truth_csv::parse(&truth_file, &text))?;
        let header = |row: &TapRow| header_of(dir, row, &scan).map_err(|fault| fault.to_string());
        let headers: Vec<_> = taps.iter().map(header).collect();
        if headers.iter().all(Result::is_err) {
            return Err(no_usable_tap(taps_file, &taps, headers));
        }
        Ok(Self { dir: dir.to_owned(), scan, scan_text, taps, headers, truth })
    }

    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    /// The list of taps.
    pub(crate) fn taps_file(&self) -> PathBuf {
        self.dir.join("taps.csv")
    }

    pub(crate) fn geometry(&self) -> Geometry {
        self.scan.geometry
    }

    /// The plan of the taps in `rows` of the set, at the station that `station_of` gives each row.
    ///
    /// It depends on these rows and their recordings alone, not on what else is in the set.
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
        let recording = recording_of(&self.scan, headers);
        Ok(Plan::of_source(self.scan.geometry, recording, taps, truth, self.digest(rows))?)
    }

    /// What tells the source of `rows` from others with the same taps: scales, files, their lengths and how they begin, which
    /// stand for the recordings themselves.
    fn digest(&self, rows: &[u32]) -> u64 {
        let about = rows.iter().map(|&row| {
            let TapRow { file, velocity_measured_m_per_s, extras, .. } = &self.taps[row as usize];
            let (length, beginning) = length_and_beginning(&self.dir.join(file));
            let mut about = format!("{file} {length} {velocity_measured_m_per_s:?} {extras:?}").into_bytes();
            about.extend_from_slice(&beginning.to_le_bytes());
            about
        });
        let about: Vec<Vec<u8>> = about.collect();
        let parts = std::iter::once(self.scan_text.as_bytes()).chain(about.iter().map(Vec::as_slice));
        digest_of_parts(parts)
    }
}

impl TapSet {
    /// Opens the tap set in the folder `dir`, its casings shared out over `station_count` stations in turn where it does
    /// not say whose they are.
    ///
    /// The tables and every recording's header are checked; a recording that cannot be used is a refusal of its tap
    /// when that is asked for, not an error here.
    ///
    /// # Errors
    /// [`Error`] when a table is missing or wrong, when no recording at all can be used, when a casing is at two
    /// stations, or without a station.
    pub fn open(dir: &Path, station_count: u16) -> Result<Self, Error> {
        refuse_no_station(station_count)?;
        let set = Recordings::open(dir)?;
        let units = units_of(&set, station_count)?;
        let mut stations = vec![0; set.taps.len()];
        for unit in &units {
            for &row in &unit.rows {
                stations[row as usize] = unit.station;
            }
        }
        let rows: Vec<u32> = (0..).zip(&set.taps).map(|(row, _)| row).collect();
        let plan = set.plan(&rows, |row| stations[row])?;
        Ok(Self { set: Arc::new(set), plan, rows, scratch: Vec::new() })
    }

    /// The casing `unit` of `set`, at `station`.
    pub(crate) fn of_unit(set: &Arc<Recordings>, unit: &Unit, station: u16) -> Result<Self, Error> {
        let plan = set.plan(&unit.rows, |_| station)?;
        Ok(Self { set: Arc::clone(set), plan, rows: unit.rows.clone(), scratch: Vec::new() })
    }

    /// What `scan.toml` says beside what is computed with: units, description, source and licence of the recordings.
    pub fn remarks(&self) -> &BTreeMap<String, String> {
        &self.set.scan.remarks
    }

    /// The taps that will be refused as far as the headers of their recordings tell, in the order of the plan.
    pub fn refusals(&self) -> impl Iterator<Item = Refusal> + '_ {
        self.rows.iter().filter_map(|&row| Some(self.refusal(row, self.fault(row)?)))
    }

    /// Why the recording in row `row` of the set cannot be used, as far as its header tells.
    fn fault(&self, row: u32) -> Option<String> {
        match &self.set.headers[row as usize] {
            Err(fault) => Some(fault.clone()),
            Ok(wav) => refuse_format(wav, self.plan.recording.sample_format).err().map(|fault| fault.to_string()),
        }
    }

    fn refusal(&self, row: u32, reason: String) -> Refusal {
        let TapRow { file, line, .. } = &self.set.taps[row as usize];
        Refusal { file: file.clone(), line: *line, reason }
    }

    fn read(&mut self, row: u32, lanes: &mut [Lane]) -> Result<u32, WavFault> {
        let recording = &self.plan.recording;
        let (mut file, file_bytes) = wav::open(&self.set.dir.join(&self.set.taps[row as usize].file))?;
        // Read again, because the file may have changed since the set was opened.
        let wav = header(&mut file, &self.set.taps[row as usize].file, file_bytes, &self.set.scan)?;
        refuse_misfit(&wav, &self.set.scan)?;
        refuse_format(&wav, recording.sample_format)?;
        if wav.sample_count > recording.sample_count_max {
            return Err(WavFault::Grown { got: wav.sample_count, most: recording.sample_count_max });
        }
        wav.read_samples(&mut file, &mut self.scratch, lanes)?;
        Ok(wav.sample_count)
    }
}

/// The length of a recording's file and the digest of its beginning, in which no two recordings are alike: it has the noise
/// before the impact, and the impact. Of a file that cannot be read both are 0.
fn length_and_beginning(path: &Path) -> (u64, u64) {
    let read = || -> std::io::Result<(u64, u64)> {
        let file = std::fs::File::open(path)?;
        let length = file.metadata()?.len();
        let mut beginning = Vec::with_capacity(BEGINNING_BYTES as usize);
        file.take(BEGINNING_BYTES).read_to_end(&mut beginning)?;
        Ok((length, digest_of_parts(std::iter::once(beginning.as_slice()))))
    };
    read().unwrap_or_default()
}

impl Source for TapSet {
    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn kind(&self) -> SourceKind {
        SourceKind::TapSet
    }

    fn can_retake(&self) -> bool {
        false
    }

    fn render(&mut self, row: u32, attempt: u16, header: &mut TapHeader, lanes: &mut [Lane]) -> Result<(), Refusal> {
        let kind = self.kind();
        *header = named(&self.plan, row, attempt, kind, header).ok_or_else(|| no_such_row(&self.plan, row))?;
        let row = self.rows[row as usize];
        let TapRow { velocity_measured_m_per_s, extras, .. } = &self.set.taps[row as usize];
        let scan = &self.set.scan;
        let recording = &self.plan.recording;
        header.id.attempt = attempt.max(extras.attempt);
        header.tap_time_ns = extras.tap_time_ns;
        header.velocity_measured_m_per_s = velocity_measured_m_per_s.unwrap_or(f64::NAN);
        header.microphone_distance_m = extras.microphone_distance_m.unwrap_or(scan.microphone_distance_m);
        header.channels = channel_headers(recording, &scales_of(scan, extras, recording.sample_format));
        if let Some(reason) = self.fault(row).or_else(|| no_room(lanes, recording.payload_bytes_max())) {
            return Err(self.refusal(row, reason));
        }
        header.sample_count = self.read(row, lanes).map_err(|fault| self.refusal(row, fault.to_string()))?;
        Ok(())
    }
}

/// The header of the recording `name`: its format goes by the ending of the name.
fn header(file: impl Read + Seek, name: &str, file_bytes: u64, scan: &ScanToml) -> Result<WavHeader, WavFault> {
    match Path::new(name).extension().and_then(OsStr::to_str) {
        Some(raw16::ENDING) => raw16::header(file_bytes, scan),
        _ => wav::read_header(file, file_bytes),
    }
}

fn header_of(dir: &Path, row: &TapRow, scan: &ScanToml) -> Result<WavHeader, WavFault> {
    if let Some(reason) = &row.extras.refused {
        return Err(WavFault::Refused(reason.clone()));
    }
    let (file, file_bytes) = wav::open(&dir.join(&row.file))?;
    let wav = header(file, &row.file, file_bytes, scan)?;
    refuse_misfit(&wav, scan)?;
    Ok(wav)
}

/// Refuses a recording that is not what `scan.toml` says.
fn refuse_misfit(wav: &WavHeader, scan: &ScanToml) -> Result<(), WavFault> {
    let (got, need) = (wav.channel_count, scan.channels.len());
    if usize::from(got) != need {
        return Err(WavFault::Channels { got, need });
    }
    // A WAV can only hold whole hertz; the rate in scan.toml is the one that is computed with.
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

fn refuse_format(wav: &WavHeader, need: SampleFormat) -> Result<(), WavFault> {
    let got = wav.format;
    if got == need { Ok(()) } else { Err(WavFault::Format { got, need }) }
}

/// The shape of the records with these `headers`; of none that can be used, one sample after the trigger.
fn recording_of<'a, I>(scan: &ScanToml, headers: impl Fn() -> I) -> Recording
where
    I: Iterator<Item = &'a Result<WavHeader, String>>,
{
    let usable = || headers().flatten();
    let first = usable().next().map_or(SampleFormat::I16, |wav| wav.format);
    // The format of most; of the first where there are as many of either.
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
    }
}

/// Newtons or volts of one stored unit of a tap, by channel.
fn scales_of(scan: &ScanToml, extras: &Extras, format: SampleFormat) -> Vec<f64> {
    let full_scale_stored = match format {
        SampleFormat::I16 => COUNTS_FULL_SCALE,
        SampleFormat::F32 => 1.0,
    };
    let full_scale = |&channel: &Channel| {
        let of_tap = match channel {
            Channel::Force => extras.force_full_scale_n,
            Channel::Sound => extras.sound_full_scale_v,
        };
        of_tap.unwrap_or_else(|| scan.full_scale(channel)) / full_scale_stored
    };
    scan.channels.iter().map(full_scale).collect()
}

fn no_usable_tap(file: PathBuf, rows: &[TapRow], headers: Vec<Result<WavHeader, String>>) -> Error {
    let refusals = rows.iter().zip(headers).filter_map(|(row, header)| {
        let reason = header.err()?;
        Some(Refusal { file: row.file.clone(), line: row.line, reason }.to_string())
    });
    let mut reasons = refusals.take(REASONS_TOLD).collect::<Vec<_>>().join("; ");
    if rows.len() > REASONS_TOLD {
        reasons.push_str("; ...");
    }
    Error::NoUsableTap { file, tap_count: rows.len(), reasons }
}

/// A casing of a set, or a whole slab: what is one plan.
#[derive(Debug, Clone)]
pub(crate) struct Unit {
    /// Its serial, or the name of the folder.
    pub(crate) name: String,
    pub(crate) station: u16,
    /// Its rows of the set, ascending.
    pub(crate) rows: Vec<u32>,
}

/// The casings of `set` in order of first appearance: at the stations that the list names, and others at stations
/// 1, 2, ... and round again.
pub(crate) fn units_of(set: &Recordings, station_count: u16) -> Result<Vec<Unit>, Error> {
    refuse_no_station(station_count)?;
    let is_slab = set.geometry() == Geometry::Line;
    let mut units: Vec<Unit> = Vec::new();
    // By unit: the station that is named, and the line that does.
    let mut named: Vec<Option<(u16, usize)>> = Vec::new();
    let mut number_of: HashMap<Serial, usize> = HashMap::new();
    for (number, row) in (0..).zip(&set.taps) {
        let key = if is_slab { Serial::default() } else { row.tap.id.tyre };
        let place = *number_of.entry(key).or_insert_with(|| {
            let name = if is_slab { folder_name(set.dir()) } else { key.to_string() };
            units.push(Unit { name, station: 0, rows: Vec::new() });
            named.push(None);
            units.len() - 1
        });
        units[place].rows.push(number);
        let here = row.extras.station.map(|station| (station, row.line));
        match (named[place], here) {
            (Some(first), Some(second)) if first.0 != second.0 => {
                let what = if is_slab { "this slab".to_owned() } else { format!("tyre {key}") };
                return Err(Error::TwoStations { file: set.taps_file(), what, first, second });
            }
            (None, Some(_)) => named[place] = here,
            _ => {}
        }
    }
    let mut last = station_count;
    for (unit, named) in units.iter_mut().zip(named) {
        unit.station = named.map_or_else(
            || {
                last = if last >= station_count { 1 } else { last + 1 };
                last
            },
            |(station, _)| station,
        );
    }
    Ok(units)
}

pub(crate) fn refuse_no_station(station_count: u16) -> Result<(), Error> {
    let bound = || format!("from 1 to {}", u16::MAX);
    let refusal = || Error::Setting { key: "stations".to_owned(), value: "0".to_owned(), bound: bound() };
    if station_count == 0 { Err(refusal()) } else { Ok(()) }
}

/// Longest name of a slab: it is a part of file names.
const FOLDER_NAME_BYTES_MAX: usize = 64;

/// The name of the folder `dir`, cut where it is long.
fn folder_name(dir: &Path) -> String {
    let whole = std::fs::canonicalize(dir).unwrap_or_else(|_| dir.to_owned());
    let name = whole.file_name().map_or_else(|| "slab".to_owned(), |name| name.to_string_lossy().into_owned());
    let mut cut = name.clone();
    cut.truncate(name.floor_char_boundary(FOLDER_NAME_BYTES_MAX));
    // Two long names that begin alike stay two.
    if cut == name { name } else { format!("{cut}~{:08x}", digest_of_parts([name.as_bytes()]) >> 32) }
}

#[cfg(test)]
pub(crate) mod tests;
