//! Recordings of other programs become tap sets: WAV, CSV, HDF5, MATLAB, Universal Files, TDMS.
//!
//! [`import`] reads files by a configuration, `import.toml`, that says which tap is where, and writes one tap set.
//!
//! - `config`: that file, `name`: which tap the name of a file means, `rows`: which taps there are
//! - `format`: the formats, one file each; `series`: the samples of one channel
//! - `cut`: continuous records, cut into taps; `example`: recordings to try it on

mod config;
mod cut;
mod error;
mod example;
mod format;
mod name;
mod rows;
mod series;

use std::path::{Path, PathBuf};

use tapline_acquire::{SAMPLE_RATE_HZ_MAX, TapRow, TapSet, none_can};
use tapline_export::{ListedTap, Scales, TapSetWriter};
use tapline_store::OwnedSamples;
use tapline_wire::{Calibration, Channel, Recording, SampleFormat, TapHeader, Unit};

use crate::config::{Config, TAP_SAMPLES_MAX};
use crate::error::{Fault, broken};
use crate::format::Recorded;
use crate::rows::Record;
use crate::series::{Series, count_of, planes, to_floats};

pub use error::{Error, Result};
pub use example::write_example;

/// Largest relative difference of two rates that count as the same: rates from a time step have six digits.
const RATE_ERROR: f64 = 1e-5;

/// What an import did.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Imported {
    /// Taps that were written.
    pub written: usize,
    /// Taps that could not be read, and why: they are listed as refused.
    pub refused: Vec<String>,
    /// Files that could not be read, though their parts name their taps, and why: none of their taps is in the set.
    pub unread: Vec<String>,
    /// Channels whose samples have no known scale, and the unit that their files name.
    pub unscaled: Vec<(&'static str, Option<String>)>,
}

/// Reads the taps of `files` as the configuration at `config` says, and writes them as the tap set `out`, a new or empty folder.
/// `progress` gets the number of recordings that are done, and of all.
///
/// # Errors
/// [`Error`] if the configuration or a table is wrong, if no tap can be read, or if the set cannot be written; nothing is left
/// behind then. A recording that cannot be read is no error: its taps are refused in the set, or, where only the file itself could
/// name them, the file is [`Imported::unread`].
pub fn import(
    files: &[PathBuf],
    config: &Path,
    out: &Path,
    mut progress: impl FnMut(usize, usize),
) -> Result<Imported> {
    let config = Config::read(config)?;
    let (records, unread) = rows::records(files, &config)?;
    let mut set = Set::begin(&config, out)?;
    set.imported.unread = unread;
    let mut last: Option<(&Path, Box<dyn Recorded>)> = None;
    for (done, record) in records.iter().enumerate() {
        progress(done, records.len());
        let taps = read(record, &config, &mut last, &mut set.alike);
        set.add(record, taps)?;
    }
    set.finish()
}

/// The channels of one tap, and what is known of them.
struct Tap {
    channels: Vec<OwnedSamples>,
    scales: Scales,
}

/// What the first tap that could be read decides for all.
#[derive(Debug, Default)]
struct Alike {
    sample_rate_hz: Option<f64>,
    pre_trigger_samples: Option<u32>,
    is_float: Option<bool>,
    /// Units of channels without a scale.
    units: Vec<(Channel, Option<String>)>,
}

/// The taps of a record, or why there are none.
fn read<'a>(
    record: &'a Record,
    config: &Config,
    last: &mut Option<(&'a Path, Box<dyn Recorded>)>,
    alike: &mut Alike,
) -> Result<Vec<Result<Tap, Fault>>, Fault> {
    let file = match last {
        Some((path, file)) if *path == record.file => file,
        _ => &mut last.insert((&record.file, format::open(&record.file)?)).1,
    };
    let mut all = Vec::new();
    for (channel, pick) in config.channels() {
        all.push((channel, file.series(&record.part, pick, config.time_axis)?));
    }
    let lengths: Vec<usize> = all.iter().map(|(_, series)| count_of(&series.samples)).collect();
    if lengths.iter().any(|length| Some(length) != lengths.first()) {
        let bound = format!("the channels of a tap must be equally long; they have {lengths:?}");
        return Err(Fault::Contradiction { what: "the number of samples", value: "not the same".to_owned(), bound });
    }
    let (scales, sample_rate_hz) = (scales_of(&all, config, alike)?, rate_of(&all, config, alike)?);
    let series: Vec<Series> = all.into_iter().map(|(_, series)| series).collect();
    match &config.cut {
        None => {
            check_pre_trigger(&series, config, alike)?;
            let channels = series.into_iter().map(|series| series.samples).collect();
            Ok(vec![Ok(Tap { channels, scales })])
        }
        Some(cut) => {
            alike.pre_trigger_samples = config.pre_trigger_samples;
            // Without the force, the first channel there is.
            let is_it = |(channel, _): (Channel, _)| Some(channel) == cut.channel;
            let trigger = config.channels().position(is_it).unwrap_or(0);
            let before = config.pre_trigger_samples.unwrap_or(0);
            let pieces = cut::cut(&series, trigger, cut, sample_rate_hz, before, record.taps.len())?;
            Ok(pieces.into_iter().map(|piece| piece.map(|channels| Tap { channels, scales })).collect())
        }
    }
}

/// What full-scale samples are, from the configuration or from the units that the file names.
fn scales_of(all: &[(Channel, Series)], config: &Config, alike: &mut Alike) -> Result<Scales, Fault> {
    let mut scales = Scales { microphone_distance_m: config.microphone_distance_m, ..Scales::default() };
    for (channel, series) in all {
        let unit = series.unit.as_deref();
        let of_unit =
            unit.and_then(|unit| Unit::of_recording(*channel, unit)).map(|(si, unit)| (si * series.full_scale, unit));
        let scale = config.full_scale(*channel).or(of_unit);
        if let Some((full_scale, unit)) = scale {
            scales.set(*channel, Some(full_scale), unit);
        }
        if scale.is_some() {
            continue;
        }
        match alike.units.iter().find(|(of, _)| of == channel) {
            None => alike.units.push((*channel, series.unit.clone())),
            Some((_, before)) if before.as_deref() == unit => {}
            Some((_, before)) => {
                let value = unit.unwrap_or("not named").to_owned();
                let bound = format!("it was {} before", before.as_deref().unwrap_or("not named"));
                return Err(Fault::Contradiction { what: "the unit", value, bound });
            }
        }
    }
    Ok(scales)
}

/// The scales of a tap, of which its row of the table may say more than its file.
fn scales_of_row(TapRow { extras, .. }: &TapRow, of_file: Scales) -> Scales {
    let has_own = extras.sound_full_scale_v.or(extras.sound_full_scale_pa).is_some();
    Scales {
        force_full_scale_n: extras.force_full_scale_n.or(of_file.force_full_scale_n),
        sound_full_scale_v: extras.sound_full_scale_v.or(of_file.sound_full_scale_v.filter(|_| !has_own)),
        sound_full_scale_pa: extras.sound_full_scale_pa.or(of_file.sound_full_scale_pa.filter(|_| !has_own)),
        microphone_distance_m: extras.microphone_distance_m.or(of_file.microphone_distance_m),
    }
}

fn differs(one: f64, other: f64) -> bool {
    ((one - other) / other).abs() > RATE_ERROR
}

/// The rate of the samples, which must be the same everywhere.
fn rate_of(all: &[(Channel, Series)], config: &Config, alike: &mut Alike) -> Result<f64, Fault> {
    for rate_hz in all.iter().filter_map(|(_, series)| series.sample_rate_hz) {
        let known = [(config.sample_rate_hz, "the configuration"), (alike.sample_rate_hz, "what was read before")];
        if let Some((Some(known_hz), of)) =
            known.into_iter().find(|(known, _)| known.is_some_and(|known| differs(rate_hz, known)))
        {
            let bound = format!("in {of} it is {known_hz} Hz");
            return Err(Fault::Contradiction { what: "the sample rate", value: format!("{rate_hz} Hz"), bound });
        }
        if !(1.0..=SAMPLE_RATE_HZ_MAX).contains(&rate_hz) {
            let bound = format!("it must be from 1 to {SAMPLE_RATE_HZ_MAX} Hz");
            return Err(Fault::Contradiction { what: "the sample rate", value: format!("{rate_hz} Hz"), bound });
        }
        alike.sample_rate_hz.get_or_insert(config.sample_rate_hz.unwrap_or(rate_hz));
    }
    match config.sample_rate_hz.or(alike.sample_rate_hz) {
        Some(rate_hz) => Ok(*alike.sample_rate_hz.get_or_insert(rate_hz)),
        None => broken(format!("does not say its sample rate: set sample_rate_hz in {}", config.path.display())),
    }
}

fn check_pre_trigger(series: &[Series], config: &Config, alike: &mut Alike) -> Result<(), Fault> {
    let stated = series.iter().find_map(|series| series.pre_trigger_samples);
    let Some(before) = config.pre_trigger_samples.or(stated) else {
        return broken(format!(
            "does not say which sample is the trigger: set pre_trigger_samples in {}, or [cut] to find it",
            config.path.display()
        ));
    };
    let known = *alike.pre_trigger_samples.get_or_insert(before);
    if known != before {
        let bound = format!("in what was read before they are {known}");
        return Err(Fault::Contradiction { what: "the samples before the trigger", value: before.to_string(), bound });
    }
    Ok(())
}

/// A tap set that is being written.
struct Set<'a> {
    config: &'a Config,
    writer: TapSetWriter,
    alike: Alike,
    imported: Imported,
    /// Units of the channels, once a tap could be read.
    units: Option<Vec<(Channel, Unit)>>,
    tap_count: usize,
}

impl<'a> Set<'a> {
    fn begin(config: &'a Config, out: &Path) -> Result<Self> {
        let writer = TapSetWriter::begin(out)?;
        let (alike, imported) = (Alike::default(), Imported::default());
        Ok(Self { config, writer, alike, imported, units: None, tap_count: 0 })
    }

    fn recording(&self) -> Recording {
        Recording {
            sample_rate_hz: self.alike.sample_rate_hz.unwrap_or(1.0),
            pre_trigger_samples: self.alike.pre_trigger_samples.unwrap_or(0),
            sample_count_max: 0,
            sample_format: if self.alike.is_float == Some(false) { SampleFormat::I16 } else { SampleFormat::F32 },
            channels: self.config.channels().map(|(channel, _)| channel).collect(),
            calibration: Calibration::default(),
        }
    }

    /// Adds the taps of a record; each that could not be read is listed with the reason.
    fn add(&mut self, record: &Record, taps: Result<Vec<Result<Tap, Fault>>, Fault>) -> Result<()> {
        let mut taps = taps.map(Vec::into_iter);
        for row in &record.taps {
            // A refused row has a piece of a cut record too: without taking it, those below would get their neighbours'.
            let piece = match &mut taps {
                Ok(taps) => match taps.next() {
                    Some(tap) => tap.map_err(|fault| fault.to_string()),
                    None => Err("has fewer taps than are planned".to_owned()),
                },
                Err(fault) => Err(fault.to_string()),
            };
            let tap = match &row.extras.refused {
                Some(reason) => Err(reason.clone()),
                None => piece,
            };
            let read = tap.and_then(|tap| {
                let (planes, scales) =
                    (self.planes(&tap).map_err(|fault| fault.to_string())?, scales_of_row(row, tap.scales));
                self.check_units(&scales)?;
                Ok((planes, scales))
            });
            let read = read.map_err(|reason| {
                let part = if record.part.is_empty() { String::new() } else { format!(" part {:?}", record.part) };
                if row.extras.refused.is_some() { reason } else { format!("{}{part}: {reason}", record.file.display()) }
            });
            self.write(row, read)?;
        }
        Ok(())
    }

    /// Refuses a tap whose channels have other units than those of the first one: an empty cell of the table means the scale of the set.
    fn check_units(&mut self, scales: &Scales) -> Result<(), String> {
        let units = || self.config.channels().map(|(channel, _)| (channel, scales.unit(channel)));
        let before = self.units.get_or_insert_with(|| units().collect());
        let shown = |unit: Unit| if unit.is_known() { unit.name() } else { "not known" };
        match before.iter().zip(units()).find(|(before, now)| **before != *now) {
            Some(((channel, before), (_, now))) => Err(format!(
                "the unit of the {} is {}, and that of the taps before is {}: import them apart",
                channel.name(),
                shown(now),
                shown(*before)
            )),
            None => Ok(()),
        }
    }

    /// The samples of a tap in the format of the set.
    fn planes(&mut self, tap: &Tap) -> Result<OwnedSamples, Fault> {
        let sample_count = tap.channels.first().map_or(0, count_of);
        let before = self.alike.pre_trigger_samples.unwrap_or(0);
        if sample_count as u64 > TAP_SAMPLES_MAX {
            return Err(Fault::TooMany { samples: sample_count as u64, most: TAP_SAMPLES_MAX });
        }
        if sample_count <= before as usize {
            let bound = format!("the trigger is at sample {before} (pre_trigger_samples)");
            return Err(Fault::Contradiction { what: "the number of samples", value: sample_count.to_string(), bound });
        }
        let planes = planes(&tap.channels);
        let is_float = matches!(planes, OwnedSamples::F32(_));
        match (*self.alike.is_float.get_or_insert(is_float), planes) {
            (false, OwnedSamples::F32(_)) => Err(Fault::Contradiction {
                what: "the kind of its samples",
                value: "floats or wide integers".to_owned(),
                bound: "those before are integers of 16 bits, and a tap set has one kind: import them apart".to_owned(),
            }),
            (true, OwnedSamples::I16(_)) => Ok(OwnedSamples::F32(tap.channels.iter().flat_map(to_floats).collect())),
            (_, planes) => Ok(planes),
        }
    }

    fn write(&mut self, row: &TapRow, read: Result<(OwnedSamples, Scales), String>) -> Result<()> {
        let TapRow { tap, extras, velocity_measured_m_per_s, .. } = row;
        let id = tap.id;
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
        let tyre: String = id.tyre.as_str().chars().map(plain).collect();
        let file = format!("{tyre}-{}/{:06}-{:03}.wav", id.shoulder, self.tap_count, id.location);
        self.tap_count += 1;
        let header = TapHeader {
            tap_time_ns: extras.tap_time_ns,
            velocity_measured_m_per_s: velocity_measured_m_per_s.unwrap_or(f64::NAN),
            ..TapHeader::default()
        };
        let mut scales = Scales::default();
        let record = read.map(|(samples, of_tap)| {
            scales = of_tap;
            (header, samples)
        });
        match &record {
            Ok(_) => {
                self.imported.written += 1;
                for (channel, _) in self.config.channels() {
                    if scales.of(channel).is_none()
                        && !self.imported.unscaled.iter().any(|(of, _)| *of == channel.name())
                    {
                        let unit =
                            self.alike.units.iter().find(|(of, _)| *of == channel).and_then(|(_, unit)| unit.clone());
                        self.imported.unscaled.push((channel.name(), unit));
                    }
                }
            }
            Err(reason) => self.imported.refused.push(reason.clone()),
        }
        let listed = ListedTap { planned: tap, record, attempt: extras.attempt };
        self.writer.add(&file, &self.recording(), &listed, &scales)?;
        Ok(())
    }

    fn finish(mut self) -> Result<Imported> {
        if self.imported.written == 0 {
            let tap_count = self.imported.refused.len();
            // All taps of a record are refused for one reason.
            self.imported.refused.dedup();
            return Err(Error::NoTap { what: none_can(tap_count, "imported", self.imported.refused) });
        }
        let unscaled = self.imported.unscaled.clone();
        let mut remarks = vec![("source", "imported by tapline")];
        for (channel, unit) in &unscaled {
            let key = if *channel == Channel::Force.name() { "force_unit" } else { "sound_unit" };
            remarks.extend(unit.as_deref().map(|unit| (key, unit)));
        }
        self.writer.describe(self.config.geometry, &self.recording(), &remarks)?;
        // A set of which its reader can use no tap is none.
        drop(TapSet::open(self.writer.folder(), 1)?);
        self.writer.finish()?;
        Ok(self.imported)
    }
}
