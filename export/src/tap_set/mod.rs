//! The taps of an archive as a tap set: a folder that can be scanned again and gives the same contents.
//!
//! Samples, scales, velocities, distances, angles, closing taps, stations, attempts, times and truth come back bit for bit, and a
//! refused tap is refused again for the same reason. These change or are lost: the kind of the source, which is
//! then a tap set, and so the digest of the plan; when and as which record a tap was sent; missing and corrupt taps, which are
//! refused; the maximum of samples, if no archived tap has as many; and recordings with a sample that is not a number, which
//! tap sets do not permit.

pub(crate) mod writer;

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};

use tapline_wire::{Geometry, Recording, SampleFormat, Serial, TapHeader, csv_cell};

use crate::tap_set::writer::{Scales, TapSetWriter};
use crate::taps::{ListedTap, TapCounts, TapFolder, Taps, scan_names};
use crate::{Error, Result};
use tapline_store::{Reader, lineage_changes};

/// Counts of a full-scale 16-bit sample.
const COUNTS_FULL_SCALE: f64 = 32_768.0;

/// Largest full scale that a tap set may have.
const FULL_SCALE_MAX: f64 = 1e12;

/// What must be the same in all archives of a tap set.
#[derive(Debug)]
struct Alike {
    path: PathBuf,
    geometry: Geometry,
    recording: Recording,
    /// That of the first archive; those of the others may differ in what affects no result.
    config: String,
    /// Every option that affects results.
    made_by: String,
    reference: Option<String>,
    plan_digest: u64,
}

/// Options of simulated taps: they affect no result of taps that are recorded.
const OF_SIMULATED_TAPS: [&str; 2] = ["scan.", "simulation."];

/// The first options that differ in two texts of [`Reader::made_by`], or that only one has: `fuse.reject_rate = 0.01 here, 0.001 there`.
/// The program that they were given to may differ, and how taps were simulated. Empty if none does.
fn differing(here: &str, there: &str) -> String {
    const MOST: usize = 3;
    /// Bytes up to which two values are shown.
    const SHORT: usize = 80;
    let mut changes = lineage_changes(here, there);
    changes.retain(|(key, ..)| {
        let is_simulated = OF_SIMULATED_TAPS.iter().any(|prefix| key.starts_with(prefix));
        key != "program" && !key.starts_with("sources.") && !is_simulated
    });
    let value = |of: &String| if of.is_empty() { "left out".to_owned() } else { of.clone() };
    let text = |(key, here, there): &(String, String, String)| match [here, there].map(value) {
        [here, there] if here.len() + there.len() <= SHORT => format!("{key} = {here} here, {there} there"),
        _ => key.clone(),
    };
    let mut texts: Vec<String> = changes.iter().take(MOST).map(text).collect();
    if changes.len() > MOST {
        texts.push(format!("and {} more", changes.len() - MOST));
    }
    texts.join("; ")
}

impl Alike {
    fn new(reader: &Reader) -> Self {
        let plan = reader.plan();
        Self {
            path: reader.path().to_owned(),
            geometry: plan.geometry,
            recording: plan.recording.clone(),
            config: reader.config().to_owned(),
            made_by: reader.made_by().to_owned(),
            reference: reader.reference().map(str::to_owned),
            plan_digest: plan.digest(),
        }
    }

    /// What differs in `reader`, with the values there and here where they are short.
    fn difference(&self, reader: &Reader) -> Option<String> {
        let (plan, ours) = (reader.plan(), &self.recording);
        let theirs = &plan.recording;
        // The maximum of samples may differ: the set has the largest.
        let is_alike = ours.sample_rate_hz.to_bits() == theirs.sample_rate_hz.to_bits()
            && ours.pre_trigger_samples == theirs.pre_trigger_samples
            && ours.sample_format == theirs.sample_format
            && ours.channels == theirs.channels;
        let options = differing(reader.made_by(), &self.made_by);
        let what = match () {
            () if !is_alike => {
                "the recording of its taps (rate, format, channels, or samples before the trigger) differs"
            }
            () if plan.geometry != self.geometry => "its geometry differs",
            () if !options.is_empty() => return Some(format!("its options differ ({options})")),
            () if reader.reference() != self.reference.as_deref() => "its reference differs",
            () => return None,
        };
        Some(what.to_owned())
    }
}

/// The archives of a tap set, as far as they must fit each other.
#[derive(Debug, Default)]
pub(crate) struct Members {
    alike: Option<Alike>,
    tyres: BTreeSet<Serial>,
}

impl Members {
    /// Checks that the archive fits those that were checked before.
    ///
    /// # Errors
    /// [`Error::NoTapSet`] if it does not.
    pub(crate) fn check(&mut self, reader: &Reader) -> Result<()> {
        for scan in reader.plan().scans() {
            let serial = scan.tyre.as_str();
            if serial.trim() != serial {
                let what = format!("the serial {serial:?} begins or ends with a space, which a table does not keep");
                return Err(no_tap_set(reader, what));
            }
        }
        let alike = self.alike.get_or_insert_with(|| Alike::new(reader));
        if let Some(what) = alike.difference(reader) {
            let what = format!("{what} from what {} has: export them one by one", alike.path.display());
            return Err(no_tap_set(reader, what));
        }
        alike.recording.sample_count_max =
            alike.recording.sample_count_max.max(reader.plan().recording.sample_count_max);
        let mut of_archive = BTreeSet::new();
        for scan in reader.plan().scans() {
            if of_archive.insert(scan.tyre) && !self.tyres.insert(scan.tyre) {
                let what = format!("{} is also in an earlier archive, and a tap set has each casing once", scan.tyre);
                return Err(no_tap_set(reader, what));
            }
        }
        Ok(())
    }
}

/// A tap set of the taps of one archive or of many, added archive by archive. It appears when it is finished.
#[derive(Debug)]
pub(crate) struct TapSetFolder {
    set: TapSetWriter,
    truth: Option<csv::Writer<File>>,
    members: Members,
    archive_count: usize,
    counts: TapCounts,
}

impl TapSetFolder {
    /// Begins the tap set `folder`.
    pub(crate) fn begin(folder: &Path) -> Result<Self> {
        Ok(Self {
            set: TapSetWriter::begin(folder)?,
            truth: None,
            members: Members::default(),
            archive_count: 0,
            counts: TapCounts::default(),
        })
    }

    fn add_truth(&mut self, reader: &Reader) -> Result<()> {
        if reader.truth().is_empty() {
            return Ok(());
        }
        let mut out = match self.truth.take() {
            Some(out) => out,
            None => {
                let mut out = csv::Writer::from_path(self.set.draft.path("truth.csv")?)?;
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
}

impl TapFolder for TapSetFolder {
    fn add(&mut self, reader: &Reader, on_part: &dyn Fn(f64)) -> Result<()> {
        let plan = reader.plan();
        self.members.check(reader)?;
        let taps = Taps::new(reader, on_part);
        let names = scan_names(plan, |name| self.set.draft.has(name));
        for (row, &scan) in (0..).zip(&plan.scan_of_tap()) {
            let tap = taps.tap(row)?;
            let file = format!("{}/{row:06}-{:03}.wav", names[scan as usize], tap.planned.id.location);
            let scales = match &tap.record {
                Ok((header, _)) => scales_of(reader, &tap, header)?,
                Err(_) => Scales::default(),
            };
            self.set.add(&file, &plan.recording, &tap, &scales)?;
        }
        self.add_truth(reader)?;
        self.counts = self.counts.and(taps.counts());
        self.archive_count += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<TapCounts> {
        let Self { mut set, truth, members: Members { alike, .. }, archive_count, counts } = *self;
        if let Some(mut truth) = truth {
            truth.flush().map_err(|error| Error::Csv(error.into()))?;
        }
        if let Some(alike) = &alike {
            let source = match archive_count {
                1 => format!("tapline archive, scan plan {:016x}", alike.plan_digest),
                count => format!("{count} tapline archives, scan plan {:016x} first", alike.plan_digest),
            };
            set.describe(alike.geometry, &alike.recording, &[("source", &source)])?;
            set.certify(&alike.recording)?;
            set.draft.write("config.toml", &alike.config)?;
            if let Some(reference) = &alike.reference {
                set.draft.write("reference.json", reference)?;
            }
        }
        let path = alike.map(|alike| alike.path).unwrap_or_default();
        let counts = counts.if_any(&path)?;
        set.finish()?;
        Ok(counts)
    }
}

fn no_tap_set(reader: &Reader, what: String) -> Error {
    Error::NoTapSet { path: reader.path().to_owned(), what }
}

/// The scales of a tap of an archive.
fn scales_of(reader: &Reader, tap: &ListedTap<'_>, header: &TapHeader) -> Result<Scales> {
    let full_scale_stored = match reader.plan().recording.sample_format {
        SampleFormat::I16 => COUNTS_FULL_SCALE,
        SampleFormat::F32 => 1.0,
    };
    let mut scales = Scales { microphone_distance_m: Some(header.microphone_distance_m), ..Scales::default() };
    for (channel, unit_per_count) in header.channels() {
        let full_scale = unit_per_count * full_scale_stored;
        if !(full_scale > 0.0 && full_scale <= FULL_SCALE_MAX) {
            let (name, id) = (channel.name(), tap.planned.id);
            let what =
                format!("the {name} of {id} has full scale {full_scale}; it must be above 0 to {FULL_SCALE_MAX}");
            return Err(no_tap_set(reader, what));
        }
        scales.set(channel, Some(full_scale), reader.plan().recording.calibration.unit(channel));
    }
    Ok(scales)
}
