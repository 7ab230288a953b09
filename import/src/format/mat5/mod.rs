//! MATLAB files of versions 5 to 7: variables that are numeric arrays, or fields of structures.
//!
//! Source: MathWorks, *MAT-File Format*. No crate that reads these files keeps 32-bit integers, bounds memory, and
//! skips variables of other classes.
//!
//! - here: the variables, and which of them is a channel
//! - `elements`: what an array is written as; `array`: what it holds; `numbers`: its numbers

mod array;
mod elements;
mod numbers;

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use flate2::read::ZlibDecoder;

use crate::error::{Fault, broken, some_of};
use crate::format::bytes::Bytes;
use crate::format::mat5::array::{Array, MI_MATRIX, MX_CHAR, class_name};
use crate::format::mat5::numbers::Numbers;
use crate::format::{
    PRE_TRIGGER_NAME, Pick, RATE_NAMES, Recorded, TIME_AXIS_NAME, UNIT, UNIT_BOUND, line_of, picked_twice, place_of,
    stated_axis, whole,
};
use crate::series::{SAMPLES_MAX, Series, checked_count};

/// Bytes before the first variable.
const HEADER_BYTES: u64 = 128;

/// Most bytes of one variable, unpacked.
const VARIABLE_BYTES_MAX: u64 = 8 * SAMPLES_MAX;

/// Most variables that are kept: the channels and their units, and the scalars of rate and trigger.
const READ_MAX: usize = 6;

/// A MATLAB file, read into memory except what other variables hold.
#[derive(Debug)]
pub(crate) struct Mat5 {
    file: BufReader<File>,
    is_big_endian: bool,
    variables: Vec<Variable>,
    /// The variables that were read last, which usually have the next taps too.
    read: VecDeque<(usize, Array)>,
}

/// Where a variable is.
#[derive(Debug)]
struct Variable {
    name: String,
    at: u64,
    bytes: u64,
    is_packed: bool,
}

const MI_COMPRESSED: u32 = 15;

impl Mat5 {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let mut file = BufReader::new(File::open(path)?);
        let file_bytes = file.get_ref().metadata()?.len();
        let mut header = [0; HEADER_BYTES as usize];
        if file.read_exact(&mut header).is_err() {
            return broken(format!(
                "is not a MATLAB file: it has {file_bytes} bytes; the header alone has {HEADER_BYTES}"
            ));
        }
        let is_big_endian = match (&header[124..126], &header[126..]) {
            ([0, 1], b"IM") => false,
            ([1, 0], b"MI") => true,
            (_, b"IM" | b"MI") => return broken("its version is not 5 to 7.3"),
            _ => {
                return broken(
                    "is not a MATLAB file of version 5 to 7.3 (version 4 is not read: save it again in MATLAB)",
                );
            }
        };
        let mut mat = Self { file, is_big_endian, variables: Vec::new(), read: VecDeque::new() };
        let mut at = HEADER_BYTES;
        while at + 8 <= file_bytes {
            mat.file.seek(SeekFrom::Start(at))?;
            let mut tag = [0; 8];
            mat.file.read_exact(&mut tag)?;
            let mut tag = Bytes { left: &tag, is_big_endian };
            let (kind, bytes) = (tag.u32()?, u64::from(tag.u32()?));
            at += 8;
            if bytes > file_bytes - at {
                let what = format!("a variable at byte {} has {bytes} bytes; {} follow", at - 8, file_bytes - at);
                return broken(format!("is cut short: {what}"));
            }
            let is_padding = kind == 0 && bytes == 0;
            if kind != MI_MATRIX && kind != MI_COMPRESSED && !is_padding {
                return broken(format!("a variable at byte {} has the unknown kind {kind}", at - 8));
            }
            if !is_padding {
                let mut variable = Variable { name: String::new(), at, bytes, is_packed: kind == MI_COMPRESSED };
                variable.name = mat.name_of(&variable)?;
                mat.variables.push(variable);
            }
            // Packed variables are not aligned.
            at += if kind == MI_COMPRESSED { bytes } else { bytes.next_multiple_of(8) };
        }
        Ok(mat)
    }

    /// The first `most` bytes of a variable, unpacked; less if it has less.
    fn unpacked(&mut self, at: u64, bytes: u64, is_packed: bool, most: u64) -> Result<Vec<u8>, Fault> {
        self.file.seek(SeekFrom::Start(at))?;
        let mut unpacked = Vec::new();
        if !is_packed {
            self.file.by_ref().take(bytes.min(most)).read_to_end(&mut unpacked)?;
            return Ok(unpacked);
        }
        let mut tag = [0; 8];
        let mut inner = ZlibDecoder::new(self.file.by_ref().take(bytes));
        let is_damaged =
            |error: std::io::Error| Fault::Broken(format!("a packed variable at byte {at} is damaged: {error}"));
        inner.read_exact(&mut tag).map_err(is_damaged)?;
        let mut tag = Bytes { left: &tag, is_big_endian: self.is_big_endian };
        if tag.u32()? != MI_MATRIX {
            return broken(format!("a packed variable at byte {at} holds no array"));
        }
        let promised = u64::from(tag.u32()?);
        inner.take(promised.min(most)).read_to_end(&mut unpacked).map_err(is_damaged)?;
        if (unpacked.len() as u64) < promised.min(most) {
            let got = unpacked.len();
            return broken(format!("a packed variable at byte {at} promises {promised} bytes; it holds {got}"));
        }
        Ok(unpacked)
    }

    fn name_of(&mut self, variable: &Variable) -> Result<String, Fault> {
        // Flags, up to 32 axes and the name come first.
        let bytes = self.unpacked(variable.at, variable.bytes, variable.is_packed, 512)?;
        let mut elements = Bytes { left: &bytes, is_big_endian: self.is_big_endian };
        let mut name = || {
            elements.element()?;
            elements.element()?;
            elements.element()
        };
        // Variables of classes that the format does not document have other elements, and so no name here.
        Ok(name().map_or_else(
            |_| String::new(),
            |(_, name)| String::from_utf8_lossy(name).trim_end_matches('\0').to_owned(),
        ))
    }

    /// The variable at `place` of the list.
    fn array(&mut self, place: usize) -> Result<&Array, Fault> {
        if let Some(at) = self.read.iter().position(|(known, _)| *known == place) {
            return Ok(&self.read[at].1);
        }
        let Variable { at, bytes, is_packed, .. } = self.variables[place];
        let unpacked = self.unpacked(at, bytes, is_packed, VARIABLE_BYTES_MAX)?;
        let array = Array::parse(&unpacked, self.is_big_endian, 0)?.1;
        while self.read.len() >= READ_MAX {
            self.read.pop_front();
        }
        self.read.push_back((place, array));
        match self.read.back() {
            Some((_, array)) => Ok(array),
            None => broken("has no such variable"),
        }
    }

    /// The array at the path `path` of names, parted by '.' or '/'.
    fn find(&mut self, path: &str) -> Result<Option<&Array>, Fault> {
        let mut steps = path.split(['.', '/']);
        let first = steps.next().unwrap_or_default();
        let Some(place) = self.variables.iter().position(|variable| variable.name == first) else { return Ok(None) };
        let mut array = self.array(place)?;
        for step in steps {
            let Some((_, field)) = array.fields.iter().find(|(name, _)| name == step) else { return Ok(None) };
            array = field;
        }
        Ok(Some(array))
    }

    /// The name of the variable, or of the field of `group`, that is called `name`, in its own case.
    fn spelled(&mut self, group: &str, name: &str) -> Result<String, Fault> {
        let variables = self.variables.iter().map(|variable| variable.name.clone());
        let names: Vec<String> = match group {
            "" => variables.collect(),
            _ => self.find(group)?.map_or(Vec::new(), |of| of.fields.iter().map(|(field, _)| field.clone()).collect()),
        };
        let place = place_of(name, names.iter().map(String::as_str));
        Ok(place.map_or(name, |place| &names[place]).to_owned())
    }

    fn number(&mut self, part: &str, names: &[&str]) -> Option<f64> {
        names.iter().find_map(|name| {
            let inner = format!("{part}.{name}");
            [inner.as_str(), name].into_iter().find_map(|path| {
                let big = self.is_big_endian;
                let array = self.find(path).ok()??;
                if array.shape.iter().all(|&n| n == 1) { array.double(big) } else { None }
            })
        })
    }

    fn names(&self) -> String {
        some_of(self.variables.iter().map(|variable| variable.name.as_str()))
    }
}

impl Recorded for Mat5 {
    fn parts(&self, depth: usize) -> Result<Vec<String>, Fault> {
        if depth != 1 {
            return broken(format!("a MATLAB file has variables, one step below it, not {depth}"));
        }
        Ok(self.variables.iter().map(|variable| variable.name.clone()).collect())
    }

    fn series(&mut self, part: &str, channel: &Pick, time_axis: Option<u8>) -> Result<Series, Fault> {
        let is_big_endian = self.is_big_endian;
        let is_part = !part.is_empty() && self.find(part)?.is_some();
        let line_of_part = part.parse::<usize>().ok().filter(|_| !is_part);
        if !part.is_empty() && !is_part && line_of_part.is_none() {
            return Err(Fault::Missing { what: "part", name: format!("{part:?}"), known: self.names() });
        }
        let group = if is_part { part } else { "" };
        let (path, number) = match channel {
            Pick::Name(name) if group.is_empty() => (self.spelled(group, name)?, line_of_part),
            Pick::Name(name) => (format!("{group}.{}", self.spelled(group, name)?), None),
            Pick::Number(number) if is_part => (group.to_owned(), Some(*number)),
            Pick::Number(_) if line_of_part.is_some() => return Err(picked_twice(part)),
            Pick::Number(number) => {
                let arrays: Vec<&Variable> = self.variables.iter().collect();
                match arrays.as_slice() {
                    [only] => (only.name.clone(), Some(*number)),
                    _ => {
                        return Err(Fault::Missing {
                            what: "channel",
                            name: format!("{channel}: it has several variables, so give their names"),
                            known: self.names(),
                        });
                    }
                }
            }
        };
        let known = self.names();
        let time_axis = time_axis.or_else(|| self.number(group, &[TIME_AXIS_NAME]).and_then(stated_axis));
        let Some(array) = self.find(&path)? else {
            return Err(Fault::Missing { what: "channel", name: format!("{path:?}"), known });
        };
        let class = class_name(array.class);
        let (Some((kind, bytes)), false) = (&array.numbers, array.is_complex) else {
            let class = if array.is_complex { "complex" } else { class };
            return broken(format!("{path:?} is an array of class {class}; real numbers are read"));
        };
        let &[rows, _] = array.shape.as_slice() else {
            return broken(format!("{path:?} has {} axes; two are read", array.shape.len()));
        };
        let line = line_of(&array.shape, number, time_axis)?;
        let count = checked_count(line.sample_count)?;
        let rows = usize::try_from(rows).unwrap_or(usize::MAX);
        // Columns lie one after the other.
        let place = |k: usize| match line.time_axis {
            0 => line.place.saturating_mul(rows).saturating_add(k),
            _ => k.saturating_mul(rows).saturating_add(line.place),
        };
        let numbers = Numbers { kind: *kind, bytes, is_big_endian };
        let mut series = match class {
            "int8" => Series::of_integers(numbers.integers(count, place)?, 8),
            "int16" => Series::of_integers(numbers.integers(count, place)?, 16),
            "int32" => Series::of_integers(numbers.integers(count, place)?, 32),
            "int64" => Series::of_integers(numbers.integers(count, place)?, 64),
            "double" | "single" => Series::of_doubles(&numbers.doubles(count, place)?)?,
            _ => {
                return broken(format!("{path:?} is of class {class}; signed integers, single and double are read"));
            }
        };
        series.sample_rate_hz = self.number(group, &RATE_NAMES);
        series.pre_trigger_samples = self.number(group, &[PRE_TRIGGER_NAME]).and_then(whole);
        let name = format!("{path}{UNIT}");
        let unit = match self.find(&name) {
            Ok(None) => None,
            Ok(Some(array)) if array.class == MX_CHAR => Some(array.text.trim().to_owned()),
            Ok(Some(array)) => {
                let class = class_name(array.class);
                return broken(format!("{name:?} is an array of class {class}; {UNIT_BOUND}"));
            }
            Err(fault) => return broken(format!("{name:?}: {fault}; {UNIT_BOUND}")),
        };
        series.unit = unit.filter(|unit| !unit.is_empty());
        Ok(series)
    }
}
