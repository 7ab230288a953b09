//! The taps of an archive as a tap set: a folder that can be scanned again and gives the same contents.
//!
//! Samples, scales, velocities, distances, angles, closing taps, stations, attempts, times and truth come back bit for bit, and a
//! refused tap is refused again for the same reason. These come back otherwise or not at all: the kind of the source, which is
//! then a tap set, and so the digest of the plan; when and as which record a tap was sent; missing and corrupt taps, which are
//! refused; the maximum of samples, if no archived tap has as many; and recordings with a sample that is not a number, which
//! tap sets do not permit.

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};

use hound::{SampleFormat as Kind, WavSpec, WavWriter};
use tapline_wire::{Channel, Geometry, Recording, SampleFormat, Serial, TapHeader, csv_cell};

use crate::folder::Draft;
use crate::taps::{COLUMNS, ListedTap, TapCounts, Taps, cells, known, scan_names};
use crate::{Error, Result};
use tapline_store::{OwnedSamples, Reader};

/// Counts of a full-scale 16-bit sample.
const COUNTS_FULL_SCALE: f64 = 32_768.0;

/// Largest full scale, in newtons or volts, that a tap set may have.
const FULL_SCALE_MAX: f64 = 1e12;

/// Columns of values that are in `scan.toml`, and in the list for taps that differ from it.
const OWN_COLUMNS: [&str; 3] = ["force_full_scale_n", "sound_full_scale_v", "microphone_distance_m"];

/// The values of [`OWN_COLUMNS`] of one tap, or of the set.
#[derive(Debug, Clone)]
struct Common {
    full_scales: Vec<(Channel, f64)>,
    microphone_distance_m: f64,
}

/// Writes the taps of the archive into the new folder `folder` as a tap set, with the configuration of the run and the
/// reference that it had.
///
/// # Errors
/// [`Error::FolderNotEmpty`], [`Error::NoSamples`], [`Error::NoTapSet`], or an error of reading or writing; the folder is then not
/// created.
pub fn export_tap_set(reader: &Reader, folder: &Path) -> Result<TapCounts> {
    Taps::new(reader).counts().if_any(reader.path())?;
    let mut set = TapSetFolder::begin(folder)?;
    set.add(reader)?;
    set.finish()
}

/// What must be the same in all archives of a tap set.
#[derive(Debug)]
struct Alike {
    path: PathBuf,
    geometry: Geometry,
    recording: Recording,
    config: String,
    reference: Option<String>,
    plan_digest: u64,
}

impl Alike {
    fn new(reader: &Reader) -> Self {
        let plan = reader.plan();
        Self {
            path: reader.path().to_owned(),
            geometry: plan.geometry,
            recording: plan.recording.clone(),
            config: reader.config().to_owned(),
            reference: reader.reference().map(str::to_owned),
            plan_digest: plan.digest(),
        }
    }

    /// What differs in `reader`.
    fn difference(&self, reader: &Reader) -> Option<&'static str> {
        let (plan, ours) = (reader.plan(), &self.recording);
        let theirs = &plan.recording;
        // The maximum of samples may differ: the set has the largest.
        let is_alike = ours.sample_rate_hz.to_bits() == theirs.sample_rate_hz.to_bits()
            && ours.pre_trigger_samples == theirs.pre_trigger_samples
            && ours.sample_format == theirs.sample_format
            && ours.channels == theirs.channels;
        match () {
            () if !is_alike => {
                Some("its taps are recorded otherwise (rate, format, channels, or samples before the trigger)")
            }
            () if plan.geometry != self.geometry => Some("its geometry is another"),
            () if reader.config() != self.config => Some("its configuration is another"),
            () if reader.reference() != self.reference.as_deref() => Some("its reference is another"),
            () => None,
        }
    }
}

/// A tap set of the taps of one archive or of many, added archive by archive. It appears when it is finished.
#[derive(Debug)]
pub struct TapSetFolder {
    draft: Draft,
    list: csv::Writer<File>,
    truth: Option<csv::Writer<File>>,
    common: Option<Common>,
    alike: Option<Alike>,
    tyres: BTreeSet<Serial>,
    archive_count: usize,
    counts: TapCounts,
}

impl TapSetFolder {
    /// Begins the tap set `folder`.
    ///
    /// # Errors
    /// [`Error::FolderNotEmpty`], or an error of writing.
    pub fn begin(folder: &Path) -> Result<Self> {
        let draft = Draft::new(folder)?;
        let mut list = csv::Writer::from_path(draft.path("taps.csv")?)?;
        list.write_record(COLUMNS.iter().chain(&OWN_COLUMNS))?;
        Ok(Self {
            draft,
            list,
            truth: None,
            common: None,
            alike: None,
            tyres: BTreeSet::new(),
            archive_count: 0,
            counts: TapCounts::default(),
        })
    }

    /// Adds the taps of an archive.
    ///
    /// # Errors
    /// [`Error::NoTapSet`], also if the archive does not fit those before, or an error of reading or writing.
    pub fn add(&mut self, reader: &Reader) -> Result<()> {
        let plan = reader.plan();
        self.check(reader)?;
        let (taps, draft) = (Taps::new(reader), &self.draft);
        let names = scan_names(plan, |name| draft.has(name));
        for (row, &scan) in (0..).zip(&plan.scan_of_tap()) {
            let tap = taps.tap(row)?;
            let file = format!("{}/{row:06}-{:03}.wav", names[scan as usize], tap.planned.id.location);
            let mut own = [const { String::new() }; 3];
            if let Ok((header, samples)) = &tap.record {
                write_wav(&draft.path(&file)?, &plan.recording, samples)?;
                let of_tap = Common::new(reader, &tap, header)?;
                own = of_tap.cells(self.common.get_or_insert_with(|| of_tap.clone()));
            }
            self.list.write_record(cells(&tap, &file).iter().chain(&own))?;
        }
        self.add_truth(reader)?;
        self.counts = self.counts.and(taps.counts());
        self.archive_count += 1;
        Ok(())
    }

    /// Checks that the archive fits the set.
    fn check(&mut self, reader: &Reader) -> Result<()> {
        for scan in reader.plan().scans() {
            let serial = scan.tyre.as_str();
            if serial.trim() != serial {
                let what = format!("the serial {serial:?} begins or ends with a space, which a table does not keep");
                return Err(no_tap_set(reader, what));
            }
        }
        let alike = self.alike.get_or_insert_with(|| Alike::new(reader));
        if let Some(what) = alike.difference(reader) {
            let what = format!("{what} than that of {}: export them one by one", alike.path.display());
            return Err(no_tap_set(reader, what));
        }
        alike.recording.sample_count_max =
            alike.recording.sample_count_max.max(reader.plan().recording.sample_count_max);
        let mut of_archive = BTreeSet::new();
        for scan in reader.plan().scans() {
            if of_archive.insert(scan.tyre) && !self.tyres.insert(scan.tyre) {
                let what = format!("{} is in an archive before it, and a tap set has each casing once", scan.tyre);
                return Err(no_tap_set(reader, what));
            }
        }
        Ok(())
    }

    fn add_truth(&mut self, reader: &Reader) -> Result<()> {
        if reader.truth().is_empty() {
            return Ok(());
        }
        let mut out = match self.truth.take() {
            Some(out) => out,
            None => {
                let mut out = csv::Writer::from_path(self.draft.path("truth.csv")?)?;
                out.write_record(["tyre", "shoulder", "location", "cracked"])?;
                out
            }
        };
        for (&(tyre, shoulder, location), &is_cracked) in reader.truth() {
            let tyre = csv_cell(tyre.as_str()).into_owned();
            let cells = [tyre, shoulder.to_string(), location.to_string(), u8::from(is_cracked).to_string()];
            out.write_record(cells)?;
        }
        self.truth = Some(out);
        Ok(())
    }

    /// Finishes the folder, and returns the counts of its taps.
    ///
    /// # Errors
    /// [`Error::NoSamples`] if it has no tap, or an error of writing.
    pub fn finish(self) -> Result<TapCounts> {
        let Self { draft, list, truth, common, alike, archive_count, counts, .. } = self;
        for mut file in [Some(list), truth].into_iter().flatten() {
            file.flush().map_err(|error| Error::Csv(error.into()))?;
        }
        if let Some(alike) = &alike {
            draft.write("scan.toml", &scan_toml(alike, common, archive_count))?;
            draft.write("config.toml", &alike.config)?;
            if let Some(reference) = &alike.reference {
                draft.write("reference.json", reference)?;
            }
        }
        let path = alike.map(|alike| alike.path).unwrap_or_default();
        let counts = counts.if_any(&path)?;
        draft.finish()?;
        Ok(counts)
    }
}

fn no_tap_set(reader: &Reader, what: String) -> Error {
    Error::NoTapSet { path: reader.path().to_owned(), what }
}

impl Common {
    fn new(reader: &Reader, tap: &ListedTap<'_>, header: &TapHeader) -> Result<Self> {
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

    /// The cells of [`OWN_COLUMNS`]: empty where a tap has the values of the set.
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

/// Writes `[channel][sample]` samples as a WAV, whose rate is rounded to whole hertz; `scan.toml` has the exact rate.
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

fn scan_toml(alike: &Alike, common: Option<Common>, archive_count: usize) -> String {
    let recording = &alike.recording;
    let channels: Vec<&str> = recording.channels.iter().map(|channel| channel.name()).collect();
    let mut text = format!(
        "geometry = {:?}\nchannels = {channels:?}\nsample_rate_hz = {:?}\npre_trigger_samples = {}\n",
        alike.geometry.name(),
        recording.sample_rate_hz,
        recording.pre_trigger_samples,
    );
    if let Some(common) = common {
        for (name, value) in OWN_COLUMNS.iter().zip(common.values()) {
            if let Some(value) = value.filter(|value| value.is_finite()) {
                text += &format!("{name} = {value:?}\n");
            }
        }
    }
    let source = match archive_count {
        1 => format!("tapline archive, scan plan {:016x}", alike.plan_digest),
        count => format!("{count} tapline archives, scan plan {:016x} first", alike.plan_digest),
    };
    text + &format!("source = \"{source}\"\n")
}
