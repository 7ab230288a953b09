//! What exports of taps share: the list of all planned taps, and the names of files.

pub(crate) mod scan_files;

use std::cell::Cell;
use std::collections::BTreeSet;
use std::path::Path;

use tapline_wire::{Plan, PlannedTap, Scan, TapHeader, TapState, csv_cell};

use crate::csv_file::number_text;
use crate::{Error, Result};
use tapline_store::{OwnedSamples, Reader};

/// Counts of the taps of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TapCounts {
    /// Taps whose samples were written.
    pub written: usize,
    /// Taps that were refused.
    pub refused: usize,
    /// Taps that are missing.
    pub missing: usize,
    /// Taps that are corrupt.
    pub damaged: usize,
}

/// Reason in the list of taps for a missing tap.
const MISSING: &str = "missing in the archive";

/// Reason for a tap that was refused without a reason.
const NO_REASON: &str = "refused without a reason";

/// Reason for a corrupt tap, before what is wrong with it.
const DAMAGED: &str = "damaged in the archive: ";

impl TapCounts {
    /// The sum of two counts.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            written: self.written + other.written,
            refused: self.refused + other.refused,
            missing: self.missing + other.missing,
            damaged: self.damaged + other.damaged,
        }
    }

    /// The counts, if at least one tap was written.
    ///
    /// # Errors
    /// [`Error::NoSamples`] for the archive at `path`.
    pub(crate) fn if_any(self, path: &Path) -> Result<Self> {
        let Self { written, refused, missing, damaged } = self;
        let tap_count = written + refused + missing + damaged;
        if written == 0 { Err(Error::NoSamples { path: path.to_owned(), tap_count }) } else { Ok(self) }
    }
}

/// A planned tap and its record.
#[derive(Debug)]
pub struct ListedTap<'a> {
    /// The tap; at station 0 if that is not known.
    pub planned: &'a PlannedTap,
    /// The record, or why there is none.
    pub record: Result<(TapHeader, OwnedSamples), String>,
    /// The attempt that settled the tap; 0 if none did.
    pub attempt: u16,
}

/// A folder of the taps of one archive or of many, added archive by archive. It appears when it is finished.
pub trait TapFolder: std::fmt::Debug {
    /// Adds the taps of an archive; `on_part` is called before each tap with the part of them that is done, from 0 to 1.
    ///
    /// # Errors
    /// [`Error::NoTapSet`] if it does not fit a tap set, [`Error::TooLarge`] if a matrix would have more bytes than MATLAB reads, or
    /// an error of reading or writing.
    fn add(&mut self, reader: &Reader, on_part: &dyn Fn(f64)) -> Result<()>;

    /// Finishes the folder, and returns the counts of its taps.
    ///
    /// # Errors
    /// [`Error::NoSamples`] if no tap has samples that can be read, or an error of writing.
    fn finish(self: Box<Self>) -> Result<TapCounts>;
}

/// The planned taps of an archive, read one at a time.
pub(crate) struct Taps<'a> {
    reader: &'a Reader,
    damaged_count: Cell<usize>,
    on_part: &'a dyn Fn(f64),
}

impl<'a> Taps<'a> {
    /// The taps of an archive; `on_part` is called before each with the part of them that is done, from 0 to 1.
    pub(crate) fn new(reader: &'a Reader, on_part: &'a dyn Fn(f64)) -> Self {
        Self { reader, damaged_count: Cell::new(0), on_part }
    }

    /// The archive.
    pub(crate) fn reader(&self) -> &'a Reader {
        self.reader
    }

    /// Counts of the taps by state; of corrupt taps, those read so far.
    pub(crate) fn counts(&self) -> TapCounts {
        let count = |state| self.reader.ledger().count(state);
        let written = count(TapState::Archived) - self.damaged_count.get();
        let (refused, missing) = (count(TapState::Refused), count(TapState::Missing));
        TapCounts { written, refused, missing, damaged: self.damaged_count.get() }
    }

    /// The tap in plan row `row`.
    pub(crate) fn tap(&self, row: u32) -> Result<ListedTap<'a>> {
        (self.on_part)(f64::from(row) / self.reader.plan().taps().len() as f64);
        let record = match self.reader.tap(row).map_err(what_is_damaged) {
            Ok(Some(tap)) => Ok(tap),
            Ok(None) if self.reader.ledger().taps()[row as usize] == TapState::Missing => Err(MISSING.to_owned()),
            // An empty reason would read as no refusal.
            Ok(None) => Err(Some(self.reader.reason(row)?)
                .filter(|reason| !reason.trim().is_empty())
                .unwrap_or_else(|| NO_REASON.to_owned())),
            // This tap is left out; the others are exported.
            Err(damage) => {
                let damage = damage?;
                self.damaged_count.update(|count| count + 1);
                Err(format!("{DAMAGED}{damage}"))
            }
        };
        Ok(ListedTap {
            planned: &self.reader.plan().taps()[row as usize],
            record,
            attempt: self.reader.attempt(row).unwrap_or(0),
        })
    }
}

/// What is wrong with one tap, if the others may be readable; else the error.
fn what_is_damaged(error: tapline_store::Error) -> Result<String> {
    match error {
        tapline_store::Error::Damaged { what, .. } => Ok(what),
        // Other errors of a disk concern all taps.
        error if error.is_unreadable_part() => Ok(error.to_string()),
        error => Err(error.into()),
    }
}

/// Columns of the list that every export of taps has, in the order of [`cells`].
pub(crate) const COLUMNS: [&str; 14] = [
    "file", "tyre", "shoulder", "offset_mm", "velocity_m_per_s", "location", "angle_deg", "repetition",
    "velocity_measured_m_per_s", "station", "attempt", "purpose", "tap_time_ns", "refused",
];

/// The cells of a tap whose samples are in `file`.
pub(crate) fn cells(tap: &ListedTap<'_>, file: &str) -> [String; 14] {
    let id = &tap.planned.id;
    let header = tap.record.as_ref().ok().map(|(header, _)| header);
    [
        if header.is_some() { csv_cell(file).into_owned() } else { String::new() },
        csv_cell(id.tyre.as_str()).into_owned(),
        id.shoulder.to_string(),
        known(id.offset_mm()),
        known(id.velocity_m_per_s()),
        id.location.to_string(),
        known(tap.planned.angle_deg),
        id.repetition.to_string(),
        known(header.map(|header| header.velocity_measured_m_per_s)),
        if id.station == 0 { String::new() } else { id.station.to_string() },
        tap.attempt.to_string(),
        tap.planned.purpose.name().to_owned(),
        header.map_or_else(String::new, |header| header.tap_time_ns.to_string()),
        tap.record.as_ref().err().map(|reason| csv_cell(reason).into_owned()).unwrap_or_default(),
    ]
}

/// A value as text; empty if it is absent.
pub(crate) fn known(value: Option<f64>) -> String {
    value.filter(|value| value.is_finite()).map_or_else(String::new, number_text)
}

/// The samples of channel `channel` in its unit.
pub(crate) fn physical(samples: &OwnedSamples, channel: usize, sample_count: usize, unit_per_count: f64) -> Vec<f64> {
    let range = channel * sample_count..(channel + 1) * sample_count;
    match samples {
        OwnedSamples::I16(planes) => planes[range].iter().map(|&count| f64::from(count) * unit_per_count).collect(),
        OwnedSamples::F32(planes) => planes[range].iter().map(|&stored| f64::from(stored) * unit_per_count).collect(),
    }
}

/// A name for each scan that every file system permits: letters, digits, '-', '_' and '.', all different, and none that
/// `is_taken`.
pub(crate) fn scan_names(plan: &Plan, is_taken: impl Fn(&str) -> bool) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    let name_of = |(number, scan): (usize, &Scan)| {
        let tyre: String = scan.tyre.as_str().chars().map(plain).collect();
        let name = format!("{tyre}-{}", scan.shoulder);
        // A name without a number has no dot.
        let numbered = (number..).map(|number| format!("{name}.{number}"));
        let free = std::iter::once(name.clone()).chain(numbered).find(|name| !is_taken(name) && !taken.contains(name));
        let name = free.unwrap_or(name);
        taken.insert(name.clone());
        name
    };
    plan.scans().iter().enumerate().map(name_of).collect()
}
