//! The formats of recordings, each in one file: what channels a file has, and their samples.

mod bytes;
mod csv_table;
mod hdf5_file;
mod mat5;
mod tdms;
mod uff;
mod wav;

use std::fmt;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use serde::Deserialize;

use crate::error::{Fault, broken, some_of};
use crate::series::Series;

/// Which channel of a file, or of a part of it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a channel is its number, from 1, or its name")]
pub(crate) enum Pick {
    /// The one at this place, from 1.
    Number(usize),
    /// The one of this name.
    Name(String),
}

impl fmt::Display for Pick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "number {number} (from 1)"),
            Self::Name(name) => write!(f, "{name:?}"),
        }
    }
}

impl Pick {
    /// The place, from 0, of the channel among those called `names`.
    fn find<'a>(&self, names: impl Iterator<Item = &'a str> + Clone) -> Result<usize, Fault> {
        let place = match self {
            Self::Number(number) => number.checked_sub(1).filter(|&place| place < names.clone().count()),
            Self::Name(name) => place_of(name, names.clone()),
        };
        place.ok_or_else(|| Fault::Missing { what: "channel", name: self.to_string(), known: some_of(names) })
    }
}

/// The place, from 0, of the channel `name` among `names`: as it is written, or else the only one that differs in case.
fn place_of<'a>(name: &str, names: impl Iterator<Item = &'a str> + Clone) -> Option<usize> {
    names.clone().position(|known| known == name).or_else(|| {
        let lower = name.to_lowercase();
        let mut alike = names.enumerate().filter(|(_, known)| known.to_lowercase() == lower);
        alike.next().filter(|_| alike.next().is_none()).map(|(place, _)| place)
    })
}

/// A file of recordings, opened.
pub(crate) trait Recorded {
    /// Names of the parts at `depth` below the file, joined by '/': groups, datasets, variables. Some files have none.
    fn parts(&self, _depth: usize) -> Result<Vec<String>, Fault> {
        Ok(Vec::new())
    }

    /// The samples of a channel of the file, or of its part `part`.
    fn series(&mut self, part: &str, channel: &Pick, time_axis: Option<u8>) -> Result<Series, Fault>;
}

/// Endings of files, and their formats.
const ENDINGS: [(&str, Kind); 16] = [
    ("wav", Kind::Wav),
    ("csv", Kind::Csv),
    ("txt", Kind::Csv),
    ("tsv", Kind::Csv),
    ("h5", Kind::Hdf5),
    ("hdf5", Kind::Hdf5),
    ("hdf", Kind::Hdf5),
    ("he5", Kind::Hdf5),
    ("nxs", Kind::Hdf5),
    ("mat", Kind::Mat),
    ("uff", Kind::Uff),
    ("unv", Kind::Uff),
    ("uf", Kind::Uff),
    ("buf", Kind::Uff),
    ("58b", Kind::Uff),
    ("tdms", Kind::Tdms),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Wav,
    Csv,
    Hdf5,
    Mat,
    Uff,
    Tdms,
}

fn kind_of(name: &str) -> Option<Kind> {
    let (_, ending) = name.rsplit_once('.')?;
    ENDINGS.iter().find(|(known, _)| ending.eq_ignore_ascii_case(known)).map(|&(_, kind)| kind)
}

/// Whether `name` has the ending of a format that is read.
pub(crate) fn is_recording(name: &str) -> bool {
    kind_of(name).is_some()
}

/// Opens a file by its ending.
pub(crate) fn open(file: &Path) -> Result<Box<dyn Recorded>, Fault> {
    let about = std::fs::metadata(file)?;
    // A pipe would block for ever.
    if !about.is_file() {
        return broken("is not a file");
    }
    if about.len() == 0 {
        return Err(Fault::Empty);
    }
    Ok(match kind_of(&file.to_string_lossy()) {
        Some(Kind::Wav) => Box::new(wav::Wav::open(file)?),
        Some(Kind::Csv) => Box::new(csv_table::CsvTable::open(file)?),
        Some(Kind::Hdf5) => Box::new(hdf5_file::Hdf5File::open(file)?),
        Some(Kind::Mat) if is_hdf5(file)? => Box::new(hdf5_file::Hdf5File::open(file)?),
        Some(Kind::Mat) => Box::new(mat5::Mat5::open(file)?),
        Some(Kind::Uff) => Box::new(uff::Uff::open(file)?),
        Some(Kind::Tdms) => Box::new(tdms::Tdms::open(file)?),
        None => {
            let known = ENDINGS.map(|(ending, _)| ending).join(", ");
            return broken(format!("its ending is not one that is read: {known}"));
        }
    })
}

/// Whether a MATLAB file is one of version 7.3: HDF5 behind 512 bytes.
fn is_hdf5(file: &Path) -> Result<bool, Fault> {
    let mut file = File::open(file)?;
    file.seek(SeekFrom::Start(512))?;
    let mut beginning = Vec::new();
    file.take(8).read_to_end(&mut beginning)?;
    Ok(beginning == b"\x89HDF\r\n\x1a\n")
}

/// Refuses a part of a file that has none.
fn no_parts(part: &str, what: &str) -> Result<(), Fault> {
    if part.is_empty() { Ok(()) } else { broken(format!("a {what} has no parts, and so no {part:?}")) }
}

/// The fault that both part and channel pick a line of one matrix.
fn picked_twice(part: &str) -> Fault {
    Fault::Broken(format!("part {part:?} is a line of each channel's matrix, so give channels by their names"))
}

/// The line of a matrix that is one channel, or one tap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Line {
    /// Axis along which time runs, 0 or 1.
    pub time_axis: usize,
    /// Place on the other axis.
    pub place: usize,
    pub sample_count: u64,
}

/// The line number `number`, from 1, of an array of `shape`; without a number the array must be one line.
///
/// Time runs along `time_axis`, from 1, or else along the longer axis.
fn line_of(shape: &[u64], number: Option<usize>, time_axis: Option<u8>) -> Result<Line, Fault> {
    let shape_text = || shape.iter().map(u64::to_string).collect::<Vec<_>>().join(" x ");
    let [rows, columns] = match *shape {
        [count] => [count, 1],
        [rows, columns] => [rows, columns],
        _ => {
            return broken(format!("is an array of {}; one or two axes are read", shape_text()));
        }
    };
    let axis = match time_axis {
        Some(axis) if shape.len() == 2 => usize::from(axis) - 1,
        _ => usize::from(columns > rows),
    };
    let (sample_count, line_count) = if axis == 0 { (rows, columns) } else { (columns, rows) };
    let place = match number {
        None if line_count == 1 => 0,
        None => {
            return broken(format!(
                "is an array of {}, with {line_count} lines of samples; say which by the number of the channel or of the part",
                shape_text()
            ));
        }
        Some(number) => {
            number.checked_sub(1).filter(|&place| (place as u64) < line_count).ok_or_else(|| Fault::Missing {
                what: "line of samples",
                name: format!("{number} (from 1)"),
                known: format!("{line_count}, in an array of {}", shape_text()),
            })?
        }
    };
    Ok(Line { time_axis: axis, place, sample_count })
}

/// Names of scalars with the sample rate, and with the samples before the trigger, in formats that can hold them.
const RATE_NAMES: [&str; 4] = ["sample_rate_hz", "sample_rate", "fs", "Fs"];
const PRE_TRIGGER_NAME: &str = "pre_trigger_samples";

/// Name of a scalar that says along which axis of the file's matrices time runs, from 1.
const TIME_AXIS_NAME: &str = "time_axis";

/// The axis that such a scalar names; `None` if it means something else.
fn stated_axis(value: f64) -> Option<u8> {
    whole(value).and_then(|axis| u8::try_from(axis).ok()).filter(|axis| (1..=2).contains(axis))
}

/// Suffix of a MATLAB channel's name that gives the name of the text with its unit, and what that text must be.
const UNIT: &str = "_unit";
const UNIT_BOUND: &str = "it must be a text with the unit of the channel, such as \"N\" or \"V\"";

/// A number of samples that a file states as a float.
fn whole(value: f64) -> Option<u32> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in bounds")]
    let whole = (0.0..=f64::from(u32::MAX)).contains(&value).then_some(value.round() as u32);
    whole.filter(|&whole| (f64::from(whole) - value).abs() < 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches the wrong line of a matrix: a channel along time, or time along channels.
    #[test]
    fn a_line_is_found_along_time() {
        let line = |shape: &[u64], number, axis| {
            line_of(shape, number, axis).map(|l| (l.time_axis, l.place, l.sample_count)).map_err(|e| e.to_string())
        };
        assert_eq!(line(&[9], None, None), Ok((0, 0, 9)));
        assert_eq!(line(&[1, 9], None, None), Ok((1, 0, 9)));
        assert_eq!(line(&[9, 2], Some(2), None), Ok((0, 1, 9)));
        assert_eq!(line(&[2, 9], Some(2), None), Ok((1, 1, 9)));
        assert_eq!(line(&[2, 9], Some(9), Some(1)), Ok((0, 8, 2)));
        assert!(line(&[9, 2], None, None).unwrap_err().contains("array of 9 x 2, with 2 lines"));
        assert!(line(&[9, 2], Some(3), None).unwrap_err().contains("line of samples 3 (from 1); it has 2"));
        assert!(line(&[9, 2], Some(0), None).is_err());
        assert!(line(&[1, 2, 3], None, None).unwrap_err().contains("1 x 2 x 3"));
    }
}
