//! A tap set: a folder of recordings, one WAV a tap, with two tables that say what they are.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use tapline_wire::{
    CHANNELS_MAX, Channel, ChannelHeader, Lane, Plan, PlannedTap, Recording, SampleFormat, Serial, SourceKind,
    TapHeader, Truth, digest_of_parts,
};

use crate::extras::Extras;
use crate::scan_toml::ScanToml;
use crate::source::{channel_headers, named, no_room, no_such_row};
use crate::taps_csv::TapRow;
use crate::wav::{self, WavFault, WavHeader};
use crate::{Error, Refusal, Source, scan_toml, taps_csv, text, truth_csv};

/// Counts of a full-scale 16-bit sample.
const COUNTS_FULL_SCALE: f64 = 32_768.0;

/// Refusals that are told when every tap is refused.
const REASONS_TOLD: usize = 3;

/// A folder of recorded taps: `scan.toml`, `taps.csv`, one WAV a tap, and `truth.csv` where the truth is known.
#[derive(Debug)]
pub struct TapSet {
    dir: PathBuf,
    scan: ScanToml,
    plan: Plan,
    rows: Vec<RecordedTap>,
    scratch: Vec<u8>,
}

#[derive(Debug)]
struct RecordedTap {
    file: String,
    line: usize,
    velocity_measured_m_per_s: f64,
    microphone_distance_m: f64,
    tap_time_ns: i64,
    /// How many takes of it were of no use before the one that was recorded.
    attempt: u16,
    channels: [ChannelHeader; CHANNELS_MAX],
    /// Why the recording cannot be used, as far as its header tells.
    fault: Option<String>,
}

impl TapSet {
    /// Opens the tap set in the folder `dir`, its shoulders shared out over `station_count` stations in turn where it does
    /// not say whose they are.
    ///
    /// The tables and every recording's header are checked; a recording that cannot be used is a refusal of its tap
    /// when that is asked for, not an error here.
    ///
    /// # Errors
    /// [`Error`] when a table is missing or wrong, when no recording at all can be used, or without a station.
    pub fn open(dir: &Path, station_count: u16) -> Result<Self, Error> {
        if station_count == 0 {
            let bound = format!("from 1 to {}", u16::MAX);
            return Err(Error::Setting { key: "stations".to_owned(), value: "0".to_owned(), bound });
        }
        let need = |file: &Path| text::read(file)?.ok_or_else(|| text::missing(file));
        let scan_file = dir.join("scan.toml");
        let scan_text = need(&scan_file)?;
        let scan = scan_toml::parse(&scan_file, &scan_text)?;
        let taps_file = dir.join("taps.csv");
        let taps_text = need(&taps_file)?;
        let rows = taps_csv::parse(&taps_file, &taps_text, scan.geometry)?;
        let truth_file = dir.join("truth.csv");
        let truth = text::read(&truth_file)?.map_or(Ok(Truth::new()), |text| truth_csv::parse(&truth_file, &text))?;

        let headers: Vec<_> = rows.iter().map(|row| header_of(dir, row, &scan)).collect();
        let Some(recording) = recording_of(&scan, &headers) else {
            return Err(no_usable_tap(taps_file, &rows, headers));
        };
        let taps = at_stations(&rows, station_count);
        // Same taps, other scales or files: not the same source. Lengths stand for the recordings themselves.
        let lengths: Vec<String> = rows.iter().map(|row| file_length(&dir.join(&row.file))).collect();
        let lengths = lengths.join(" ");
        let source = digest_of_parts([scan_text.as_bytes(), taps_text.as_bytes(), lengths.as_bytes()]);
        let plan = Plan::new(scan.geometry, recording, taps, truth)?.with_source(source);
        let rows = rows.into_iter().zip(headers).map(|(row, header)| recorded_tap(row, header, &scan, &plan.recording));
        let rows = rows.collect();
        Ok(Self { dir: dir.to_owned(), scan, plan, rows, scratch: Vec::new() })
    }

    /// What `scan.toml` says beside what is computed with: units, description, source and licence of the recordings.
    pub fn remarks(&self) -> &BTreeMap<String, String> {
        &self.scan.remarks
    }

    /// The taps that will be refused as far as the headers of their recordings tell, in the order of the plan.
    pub fn refusals(&self) -> impl Iterator<Item = Refusal> + '_ {
        self.rows.iter().filter_map(|tap| tap.fault.as_ref().map(|fault| tap.refusal(fault.clone())))
    }

    fn read(&mut self, row: usize, lanes: &mut [Lane]) -> Result<u32, WavFault> {
        let recording = &self.plan.recording;
        let (mut file, file_bytes) = wav::open(&self.dir.join(&self.rows[row].file))?;
        // Read again, because the file may have changed since the set was opened.
        let wav = wav::read_header(&mut file, file_bytes)?;
        refuse_misfit(&wav, &self.scan)?;
        refuse_format(&wav, recording.sample_format)?;
        if wav.sample_count > recording.sample_count_max {
            return Err(WavFault::Grown { got: wav.sample_count, most: recording.sample_count_max });
        }
        wav.read_samples(&mut file, &mut self.scratch, lanes)?;
        Ok(wav.sample_count)
    }
}

/// Length of a file as text; nothing where there is none.
fn file_length(path: &Path) -> String {
    std::fs::metadata(path).map_or_else(|_| String::new(), |data| data.len().to_string())
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
        let row = row as usize;
        let tap = &self.rows[row];
        header.id.attempt = attempt.max(tap.attempt);
        header.tap_time_ns = tap.tap_time_ns;
        header.velocity_measured_m_per_s = tap.velocity_measured_m_per_s;
        header.microphone_distance_m = tap.microphone_distance_m;
        header.channels = tap.channels;
        let known = tap.fault.clone().or_else(|| no_room(lanes, self.plan.recording.payload_bytes_max()));
        if let Some(reason) = known {
            return Err(self.rows[row].refusal(reason));
        }
        header.sample_count = self.read(row, lanes).map_err(|fault| self.rows[row].refusal(fault.to_string()))?;
        Ok(())
    }
}

impl RecordedTap {
    fn refusal(&self, reason: String) -> Refusal {
        Refusal { file: self.file.clone(), line: self.line, reason }
    }
}

fn header_of(dir: &Path, row: &TapRow, scan: &ScanToml) -> Result<WavHeader, WavFault> {
    if let Some(reason) = &row.extras.refused {
        return Err(WavFault::Refused(reason.clone()));
    }
    let (file, file_bytes) = wav::open(&dir.join(&row.file))?;
    let wav = wav::read_header(file, file_bytes)?;
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

/// The shape of the set's records, `None` when no recording can be used.
fn recording_of(scan: &ScanToml, headers: &[Result<WavHeader, WavFault>]) -> Option<Recording> {
    let usable = || headers.iter().flatten();
    let first = usable().next()?.format;
    // The format of most; of the first where there are as many of either.
    let first_count = usable().filter(|h| h.format == first).count();
    let sample_format = match usable().find(|h| h.format != first) {
        Some(other) if first_count * 2 < usable().count() => other.format,
        _ => first,
    };
    Some(Recording {
        sample_rate_hz: scan.sample_rate_hz,
        pre_trigger_samples: scan.pre_trigger_samples,
        sample_count_max: usable().filter(|h| h.format == sample_format).map(|h| h.sample_count).max()?,
        sample_format,
        channels: scan.channels.clone(),
    })
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

fn recorded_tap(
    row: TapRow,
    header: Result<WavHeader, WavFault>,
    scan: &ScanToml,
    recording: &Recording,
) -> RecordedTap {
    let fault = header.and_then(|wav| refuse_format(&wav, recording.sample_format)).err();
    RecordedTap {
        file: row.file,
        line: row.line,
        velocity_measured_m_per_s: row.velocity_measured_m_per_s.unwrap_or(f64::NAN),
        microphone_distance_m: row.extras.microphone_distance_m.unwrap_or(scan.microphone_distance_m),
        tap_time_ns: row.extras.tap_time_ns,
        attempt: row.extras.attempt,
        channels: channel_headers(recording, &scales_of(scan, &row.extras, recording.sample_format)),
        fault: fault.map(|fault| fault.to_string()),
    }
}

fn no_usable_tap(file: PathBuf, rows: &[TapRow], headers: Vec<Result<WavHeader, WavFault>>) -> Error {
    let refusals = rows.iter().zip(headers).filter_map(|(row, header)| {
        let reason = header.err()?.to_string();
        Some(Refusal { file: row.file.clone(), line: row.line, reason }.to_string())
    });
    let mut reasons = refusals.take(REASONS_TOLD).collect::<Vec<_>>().join("; ");
    if rows.len() > REASONS_TOLD {
        reasons.push_str("; ...");
    }
    Error::NoUsableTap { file, tap_count: rows.len(), reasons }
}

/// The taps at their stations: those that the list names, and other shoulders in order of first appearance, to stations
/// 1, 2, ... and round again.
fn at_stations(rows: &[TapRow], station_count: u16) -> Vec<PlannedTap> {
    let mut station_of: HashMap<(Serial, u16), u16> = HashMap::new();
    let mut last = station_count;
    rows.iter()
        .map(|row| {
            let mut tap = row.tap;
            if row.extras.station.is_some() {
                return tap;
            }
            tap.id.station = *station_of.entry((tap.id.tyre, tap.id.shoulder)).or_insert_with(|| {
                last = if last >= station_count { 1 } else { last + 1 };
                last
            });
            tap
        })
        .collect()
}

#[cfg(test)]
#[path = "tapset_tests.rs"]
mod tests;
