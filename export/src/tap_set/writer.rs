//! A tap set that is written tap by tap: from archives, or from other programs' recordings.

use std::fs::File;
use std::path::Path;

use hound::{SampleFormat as Kind, WavSpec, WavWriter};
use tapline_store::OwnedSamples;
use tapline_wire::{Channel, Geometry, Recording, Unit};

use crate::folder::Draft;
use crate::taps::{COLUMNS, ListedTap, cells, known};
use crate::{Error, Result};

/// Columns of values that are in `scan.toml`, and in the list for taps that differ from it.
const OWN_COLUMNS: [&str; 4] =
    ["force_full_scale_n", "sound_full_scale_v", "sound_full_scale_pa", "microphone_distance_m"];

/// What a full-scale sample of a tap means, and where its microphone was; `None` where it is not known.
///
/// A full-scale sample is 32768 counts of 16 bits, or 1.0 in floating point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Scales {
    /// Newtons of a full-scale sample.
    pub force_full_scale_n: Option<f64>,
    /// Volts of a full-scale sample.
    pub sound_full_scale_v: Option<f64>,
    /// Pascals of a full-scale sample, where the sound is not in volts.
    pub sound_full_scale_pa: Option<f64>,
    /// Distance from impact to microphone.
    pub microphone_distance_m: Option<f64>,
}

impl Scales {
    fn values(&self) -> [Option<f64>; 4] {
        [self.force_full_scale_n, self.sound_full_scale_v, self.sound_full_scale_pa, self.microphone_distance_m]
    }

    /// Says what a full-scale sample of `channel` is worth, in `unit`.
    pub fn set(&mut self, channel: Channel, full_scale: Option<f64>, unit: Unit) {
        match (channel, unit) {
            (_, Unit::FullScale) => {}
            (Channel::Force, _) => self.force_full_scale_n = full_scale,
            (Channel::Sound, Unit::Pascal) => self.sound_full_scale_pa = full_scale,
            (Channel::Sound, _) => self.sound_full_scale_v = full_scale,
        }
    }

    /// What a full-scale sample of `channel` is worth, where it is known.
    pub fn of(&self, channel: Channel) -> Option<f64> {
        match channel {
            Channel::Force => self.force_full_scale_n,
            Channel::Sound => self.sound_full_scale_v.or(self.sound_full_scale_pa),
        }
    }

    /// Unit of the samples of `channel`.
    pub fn unit(&self, channel: Channel) -> Unit {
        match channel {
            Channel::Force if self.force_full_scale_n.is_some() => Unit::Newton,
            Channel::Sound if self.sound_full_scale_v.is_some() => Unit::Volt,
            Channel::Sound if self.sound_full_scale_pa.is_some() => Unit::Pascal,
            _ => Unit::FullScale,
        }
    }

    /// The cells of [`OWN_COLUMNS`]: empty where a tap has the values of the set.
    fn cells(&self, of_set: &Self) -> [String; 4] {
        let own = |value: Option<f64>, of: Option<f64>| {
            let is_same = value.map(f64::to_bits) == of.map(f64::to_bits);
            if is_same { String::new() } else { known(value) }
        };
        let (values, of_set) = (self.values(), of_set.values());
        std::array::from_fn(|k| own(values[k], of_set[k]))
    }
}

/// A tap set, written into a folder that appears when it is finished.
#[derive(Debug)]
pub struct TapSetWriter {
    pub(crate) draft: Draft,
    list: csv::Writer<File>,
    /// Those of the first tap with samples, which `scan.toml` will state.
    scales: Option<Scales>,
}

impl TapSetWriter {
    /// Begins the tap set `folder`.
    ///
    /// # Errors
    /// [`Error::FolderNotEmpty`], or an error of writing.
    pub fn begin(folder: &Path) -> Result<Self> {
        let draft = Draft::new(folder)?;
        let mut list = csv::Writer::from_path(draft.path("taps.csv")?)?;
        list.write_record(COLUMNS.iter().chain(&OWN_COLUMNS))?;
        Ok(Self { draft, list, scales: None })
    }

    /// Adds a tap, whose samples become the WAV `file`. The rate of a WAV is rounded to whole hertz; `scan.toml` has the exact one.
    ///
    /// # Errors
    /// An error of writing.
    pub fn add(&mut self, file: &str, recording: &Recording, tap: &ListedTap<'_>, scales: &Scales) -> Result<()> {
        let mut own = [const { String::new() }; 4];
        if let Ok((_, samples)) = &tap.record {
            write_wav(&self.draft.path(file)?, recording, samples)?;
            own = scales.cells(self.scales.get_or_insert(*scales));
        }
        self.list.write_record(cells(tap, file).iter().chain(&own))?;
        Ok(())
    }

    /// Writes `scan.toml`, after the last tap. `remarks` are its keys of free text.
    ///
    /// # Errors
    /// An error of writing.
    pub fn describe(&mut self, geometry: Geometry, recording: &Recording, remarks: &[(&str, &str)]) -> Result<()> {
        self.list.flush().map_err(|error| Error::Csv(error.into()))?;
        let channels: Vec<&str> = recording.channels.iter().map(|channel| channel.name()).collect();
        let mut text = format!(
            "geometry = {:?}\nchannels = {channels:?}\nsample_rate_hz = {:?}\npre_trigger_samples = {}\n",
            geometry.name(),
            recording.sample_rate_hz,
            recording.pre_trigger_samples,
        );
        for (name, value) in OWN_COLUMNS.iter().zip(self.scales.unwrap_or_default().values()) {
            if let Some(value) = value.filter(|value| value.is_finite() && *value > 0.0) {
                text += &format!("{name} = {value:?}\n");
            }
        }
        for (name, remark) in remarks {
            text += &format!("{name} = {}\n", toml::Value::from(*remark));
        }
        self.draft.write("scan.toml", &text)
    }

    /// Writes where the scales come from, where `recording` has certificates of them.
    ///
    /// # Errors
    /// An error of writing.
    pub fn certify(&mut self, recording: &Recording) -> Result<()> {
        let scales = self.scales.unwrap_or_default();
        let mut text = String::new();
        for &channel in &recording.channels {
            let of = recording.calibration.of(channel);
            let Some((certificate, full_scale)) = of.certificate.as_ref().zip(scales.of(channel)) else { continue };
            let certificate = toml::to_string(certificate).unwrap_or_default(); // texts and numbers cannot fail
            let (name, unit) = (channel.name(), of.unit.name());
            text += &format!(
                "[{name}]\nunit = {unit:?}\nfull_scale = {full_scale:?}\n[{name}.certificate]\n{certificate}\n"
            );
        }
        if text.is_empty() { Ok(()) } else { self.draft.write("calibration.toml", &text) }
    }

    /// The present path of the set, in which it can be looked at before it is finished.
    pub fn folder(&self) -> &Path {
        self.draft.present()
    }

    /// Makes the folder appear.
    ///
    /// # Errors
    /// An error of writing.
    pub fn finish(self) -> Result<()> {
        let Self { draft, mut list, .. } = self;
        list.flush().map_err(|error| Error::Csv(error.into()))?;
        drop(list);
        draft.finish()
    }
}

/// Writes `[channel][sample]` samples as the WAV `path`.
///
/// # Errors
/// [`Error::Wav`].
pub fn write_wav(path: &Path, recording: &Recording, samples: &OwnedSamples) -> Result<()> {
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
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to 5e8, and if not, the limit")]
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
