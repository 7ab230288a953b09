//! The taps of an archive as a tap set: a folder that can be scanned again, and gives the same archive content.
//!
//! Samples, scales, velocities, distances, angles, closing taps, stations, attempts, times and truth come back bit for bit,
//! and a tap that was refused is refused again in the same words. What cannot come back as it was: the kind of the source,
//! which is a tap set from then on; with it the digest of the plan; when and as which record a tap was sent; a missing tap
//! and a damaged one, which are refused; room for samples that no archived tap has; and a recording with a sample that is no number, which no
//! tap set may have.

use std::path::Path;

use hound::{SampleFormat as Kind, WavSpec, WavWriter};
use tapline_wire::{Channel, Recording, SampleFormat, TapHeader};

use super::folder::Draft;
use super::taps::{COLUMNS, ListedTap, TapCounts, Taps, cells, known, scan_names};
use crate::create::geometry_name;
use crate::reader::{OwnedSamples, Reader};
use crate::{Error, Result};

/// Counts of a full-scale 16-bit sample.
const COUNTS_FULL_SCALE: f64 = 32_768.0;

/// Most newtons or volts of a full-scale sample that a tap set can state.
const FULL_SCALE_MAX: f64 = 1e12;

/// Columns of what may differ from tap to tap, but is stated once for the set where it does not.
const OWN_COLUMNS: [&str; 3] = ["force_full_scale_n", "sound_full_scale_v", "microphone_distance_m"];

/// What a tap set states once for all of its taps.
#[derive(Clone)]
struct Common {
    full_scales: Vec<(Channel, f64)>,
    microphone_distance_m: f64,
}

/// Writes the taps of the archive into the new folder `folder` as a tap set, with the configuration of the run and the
/// reference that it had.
///
/// # Errors
/// [`Error::FolderNotEmpty`], [`Error::NoSamples`], [`Error::NoTapSet`], or what reading and writing give; the folder is
/// then not there.
pub fn export_tap_set(reader: &Reader, folder: &Path) -> Result<TapCounts> {
    let taps = Taps::of(reader)?;
    let plan = reader.plan();
    if let Some(scan) = plan.scans().iter().find(|scan| scan.tyre.as_str().trim() != scan.tyre.as_str()) {
        let what =
            format!("the serial {:?} begins or ends with a space, which a table does not keep", scan.tyre.as_str());
        return Err(no_tap_set(reader, what));
    }
    let draft = Draft::new(folder)?;
    let (names, scan_of_tap) = (scan_names(plan), plan.scan_of_tap());
    let mut list = csv::Writer::from_path(draft.path("taps.csv")?)?;
    list.write_record(COLUMNS.iter().chain(&OWN_COLUMNS))?;
    let mut common = None;
    for (row, &scan) in (0..).zip(&scan_of_tap) {
        let tap = taps.tap(row)?;
        let file = format!("{}/{row:06}-{:03}.wav", names[scan as usize], tap.planned.id.location);
        let mut own = [const { String::new() }; 3];
        if let Ok((header, samples)) = &tap.record {
            write_wav(&draft.path(&file)?, &plan.recording, samples)?;
            let of_tap = Common::of(reader, &tap, header)?;
            own = of_tap.cells(common.get_or_insert_with(|| of_tap.clone()));
        }
        list.write_record(cells(&tap, &file).iter().chain(&own))?;
    }
    list.flush().map_err(|error| Error::Csv(error.into()))?;
    drop(list);
    draft.write("scan.toml", &scan_toml(reader, common))?;
    draft.write("config.toml", reader.config())?;
    if let Some(reference) = reader.reference() {
        draft.write("reference.json", reference)?;
    }
    if !reader.truth().is_empty() {
        write_truth(reader, &draft)?;
    }
    let counts = taps.counts()?;
    draft.finish()?;
    Ok(counts)
}

fn no_tap_set(reader: &Reader, what: String) -> Error {
    Error::NoTapSet { path: reader.path().to_owned(), what }
}

impl Common {
    fn of(reader: &Reader, tap: &ListedTap<'_>, header: &TapHeader) -> Result<Self> {
        let full_scale_stored = match reader.plan().recording.sample_format {
            SampleFormat::I16 => COUNTS_FULL_SCALE,
            SampleFormat::F32 => 1.0,
        };
        let full_scales = header.channels().map(|(channel, unit_per_count)| {
            let full_scale = unit_per_count * full_scale_stored;
            if full_scale > 0.0 && full_scale <= FULL_SCALE_MAX {
                return Ok((channel, full_scale));
            }
            let (name, id) = (channel.name(), tap.planned.id);
            let what =
                format!("the {name} of {id} has full scale {full_scale}; above 0 to {FULL_SCALE_MAX} can be stated");
            Err(no_tap_set(reader, what))
        });
        Ok(Self {
            full_scales: full_scales.collect::<Result<_>>()?,
            microphone_distance_m: header.microphone_distance_m,
        })
    }

    fn full_scale(&self, channel: Channel) -> Option<f64> {
        self.full_scales.iter().find(|(of, _)| *of == channel).map(|&(_, full_scale)| full_scale)
    }

    fn values(&self) -> [Option<f64>; 3] {
        [self.full_scale(Channel::Force), self.full_scale(Channel::Sound), Some(self.microphone_distance_m)]
    }

    /// The cells of [`OWN_COLUMNS`]: empty where a tap has what all have.
    fn cells(&self, common: &Self) -> [String; 3] {
        let [force, sound, distance] = self.values();
        let [of_force, of_sound, of_distance] = common.values();
        let own = |value: Option<f64>, of: Option<f64>| {
            let is_same = value.map(f64::to_bits) == of.map(f64::to_bits);
            if is_same { String::new() } else { known(value) }
        };
        [own(force, of_force), own(sound, of_sound), own(distance, of_distance)]
    }
}

/// Writes `[channel][sample]` samples as a WAV of the whole hertz nearest to the rate; the set states the rate itself.
fn write_wav(path: &Path, recording: &Recording, samples: &OwnedSamples) -> Result<()> {
    let outcome = match samples {
        OwnedSamples::I16(planes) => wav(path, recording, Kind::Int, planes),
        OwnedSamples::F32(planes) => wav(path, recording, Kind::Float, planes),
    };
    outcome.map_err(|source| Error::Wav { path: path.to_owned(), source })
}

fn wav<T: hound::Sample + Copy>(
    path: &Path,
    recording: &Recording,
    sample_format: Kind,
    planes: &[T],
) -> Result<(), hound::Error> {
    let channel_count = recording.channels.len();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 1e9, and if not, the limit")]
    let spec = WavSpec {
        channels: u16::try_from(channel_count).unwrap_or(u16::MAX),
        sample_rate: recording.sample_rate_hz.round() as u32,
        bits_per_sample: if sample_format == Kind::Int { 16 } else { 32 },
        sample_format,
    };
    let mut out = WavWriter::create(path, spec)?;
    let sample_count = planes.len() / channel_count;
    for k in 0..sample_count {
        for channel in 0..channel_count {
            out.write_sample(planes[channel * sample_count + k])?;
        }
    }
    out.finalize()
}

fn scan_toml(reader: &Reader, common: Option<Common>) -> String {
    let plan = reader.plan();
    let channels: Vec<&str> = plan.recording.channels.iter().map(|channel| channel.name()).collect();
    let mut text = format!(
        "geometry = {:?}\nchannels = {channels:?}\nsample_rate_hz = {:?}\npre_trigger_samples = {}\n",
        geometry_name(plan.geometry),
        plan.recording.sample_rate_hz,
        plan.recording.pre_trigger_samples,
    );
    if let Some(common) = common {
        for (name, value) in OWN_COLUMNS.iter().zip(common.values()) {
            if let Some(value) = value.filter(|value| value.is_finite()) {
                text += &format!("{name} = {value:?}\n");
            }
        }
    }
    text + &format!("source = \"tapline archive, scan plan {:016x}\"\n", plan.digest())
}

fn write_truth(reader: &Reader, draft: &Draft) -> Result<()> {
    let mut out = csv::Writer::from_path(draft.path("truth.csv")?)?;
    out.write_record(["tyre", "shoulder", "location", "cracked"])?;
    for (&(tyre, shoulder, location), &is_cracked) in reader.truth() {
        let cells = [tyre.to_string(), shoulder.to_string(), location.to_string(), u8::from(is_cracked).to_string()];
        out.write_record(cells)?;
    }
    out.flush().map_err(|error| Error::Csv(error.into()))
}
