//! MATLAB files of versions 5 to 7: variables that are numeric arrays, or fields of structures.
//!
//! Source: MathWorks, *MAT-File Format*. No crate that reads these files keeps 32-bit integers, bounds memory, and passes over
//! variables of other classes.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use flate2::read::ZlibDecoder;

use crate::error::{Fault, broken, some_of};
use crate::format::{
    PRE_TRIGGER_NAME, Pick, RATE_NAMES, Recorded, UNIT, UNIT_BOUND, line_of, picked_twice, place_of, whole,
};
use crate::series::{SAMPLES_MAX, Series, checked_count};

/// Bytes before the first variable.
const HEADER_BYTES: u64 = 128;

/// Most bytes of one variable, unpacked.
const VARIABLE_BYTES_MAX: u64 = 8 * SAMPLES_MAX;

/// Most variables that are kept: the channels and their units, and the scalars of rate and trigger.
const READ_MAX: usize = 6;

/// Deepest structure within structures.
const DEPTH_MAX: usize = 4;

/// Most axes of an array, and fields of a structure.
const AXES_MAX: usize = 32;
const FIELDS_MAX: usize = 4096;

/// A MATLAB file, read into memory but for what other variables hold.
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

/// An array, unpacked.
#[derive(Debug)]
struct Array {
    class: u8,
    is_complex: bool,
    shape: Vec<u64>,
    /// Type and bytes of the numbers.
    numbers: Option<(u32, Vec<u8>)>,
    /// Of an array of characters.
    text: String,
    /// Of a structure of one element, its fields.
    fields: Vec<(String, Array)>,
}

const MI_MATRIX: u32 = 14;
const MI_COMPRESSED: u32 = 15;
const MX_STRUCT: u8 = 2;
const MX_OBJECT: u8 = 3;
const MX_CHAR: u8 = 4;
const COMPLEX: u32 = 0x0800;

/// Name of a class of arrays.
fn class_name(class: u8) -> &'static str {
    const NAMES: [&str; 16] = [
        "unknown", "cell", "struct", "object", "char", "sparse", "double", "single", "int8", "uint8", "int16",
        "uint16", "int32", "uint32", "int64", "uint64",
    ];
    NAMES.get(usize::from(class)).copied().unwrap_or(NAMES[0])
}

impl Mat5 {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let mut file = BufReader::new(File::open(path)?);
        let file_bytes = file.get_ref().metadata()?.len();
        let mut header = [0; HEADER_BYTES as usize];
        if file.read_exact(&mut header).is_err() {
            return broken(format!(
                "is no MATLAB file: it has {file_bytes} bytes; its header alone has {HEADER_BYTES}"
            ));
        }
        let is_big_endian = match (&header[124..126], &header[126..]) {
            ([0, 1], b"IM") => false,
            ([1, 0], b"MI") => true,
            (_, b"IM" | b"MI") => return Err(Fault::Unsupported("its version is not 5 to 7.3".to_owned())),
            _ => {
                let what = "is no MATLAB file of version 5 to 7.3 (version 4 is not read: save it again in MATLAB)";
                return Err(Fault::Unsupported(what.to_owned()));
            }
        };
        let mut mat = Self { file, is_big_endian, variables: Vec::new(), read: VecDeque::new() };
        let mut at = HEADER_BYTES;
        while at + 8 <= file_bytes {
            mat.file.seek(SeekFrom::Start(at))?;
            let mut tag = [0; 8];
            mat.file.read_exact(&mut tag)?;
            let (kind, bytes) = (mat.word(&tag, 0), u64::from(mat.word(&tag, 4)));
            at += 8;
            if bytes > file_bytes - at {
                let what = format!("a variable at byte {} has {bytes} bytes; {} follow", at - 8, file_bytes - at);
                return broken(format!("is cut short: {what}"));
            }
            if kind == MI_MATRIX || kind == MI_COMPRESSED {
                let mut variable = Variable { name: String::new(), at, bytes, is_packed: kind == MI_COMPRESSED };
                variable.name = mat.name_of(&variable)?;
                mat.variables.push(variable);
            }
            // Packed variables are not aligned.
            at += if kind == MI_COMPRESSED { bytes } else { bytes.next_multiple_of(8) };
        }
        Ok(mat)
    }

    fn word(&self, bytes: &[u8], at: usize) -> u32 {
        let word = bytes.get(at..at + 4).and_then(|word| word.try_into().ok()).unwrap_or_default();
        if self.is_big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) }
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
        let is_big_endian = self.is_big_endian;
        let word = |at: usize| {
            let word = [tag[at], tag[at + 1], tag[at + 2], tag[at + 3]];
            if is_big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) }
        };
        if word(0) != MI_MATRIX {
            return broken(format!("a packed variable at byte {at} holds no array"));
        }
        let promised = u64::from(word(4));
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
        let mut elements = Elements { bytes: &bytes, is_big_endian: self.is_big_endian };
        let mut name = || {
            elements.next()?;
            elements.next()?;
            elements.next()
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

/// The elements of an array, one after the other.
struct Elements<'a> {
    bytes: &'a [u8],
    is_big_endian: bool,
}

impl<'a> Elements<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        match self.bytes.split_at_checked(count) {
            Some((taken, rest)) => {
                self.bytes = rest;
                Ok(taken)
            }
            None => broken(format!("an array ends after {} bytes; its next element has {count}", self.bytes.len())),
        }
    }

    fn word(&self, bytes: &[u8]) -> u32 {
        let word = bytes.try_into().unwrap_or_default();
        if self.is_big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) }
    }

    /// Type and bytes of the next element.
    fn next(&mut self) -> Result<(u32, &'a [u8]), Fault> {
        let first = self.take(4)?;
        let first = self.word(first);
        // Up to four bytes follow a short tag.
        if first >> 16 != 0 {
            let (kind, count) = (first & 0xffff, (first >> 16) as usize);
            let data = self.take(4)?;
            return match data.get(..count) {
                Some(data) => Ok((kind, data)),
                None => broken(format!("a short element of an array has {count} bytes; at most 4 fit")),
            };
        }
        let count = self.take(4)?;
        let count = self.word(count) as usize;
        let data = self.take(count)?;
        // The last element may end without its padding.
        let padding = (count.next_multiple_of(8) - count).min(self.bytes.len());
        self.take(padding)?;
        Ok((first, data))
    }

    /// Whole numbers of 32 bits.
    fn words(&mut self, most: usize, what: &str) -> Result<Vec<u32>, Fault> {
        let (_, bytes) = self.next()?;
        if bytes.len() / 4 > most {
            return broken(format!("an array has {} {what}; at most {most} are read", bytes.len() / 4));
        }
        Ok(bytes.chunks_exact(4).map(|word| self.word(word)).collect())
    }
}

impl Array {
    /// The name and the contents of an array.
    fn parse(bytes: &[u8], is_big_endian: bool, depth: usize) -> Result<(String, Self), Fault> {
        let mut elements = Elements { bytes, is_big_endian };
        let flags = elements.words(4, "flags")?.first().copied().unwrap_or(0);
        let shape: Vec<u64> = elements.words(AXES_MAX, "axes")?.into_iter().map(u64::from).collect();
        let (_, name) = elements.next()?;
        let name = String::from_utf8_lossy(name).into_owned();
        let class = flags.to_le_bytes()[0];
        let mut array = Self {
            class,
            is_complex: flags & COMPLEX != 0,
            shape,
            numbers: None,
            text: String::new(),
            fields: Vec::new(),
        };
        match class {
            MX_STRUCT | MX_OBJECT if depth < DEPTH_MAX => {
                if class == MX_OBJECT {
                    elements.next()?;
                }
                array.fields = fields(&mut elements, &array.shape, depth)?;
            }
            MX_CHAR => {
                let (kind, bytes) = elements.next()?;
                array.text = match kind {
                    // 16 bits a character, else UTF-8.
                    4 => String::from_utf16_lossy(&Numbers { kind, bytes, is_big_endian }.each(
                        bytes.len() / 2,
                        |k| k,
                        u16::from_le_bytes,
                    )?),
                    _ => String::from_utf8_lossy(bytes).into_owned(),
                };
            }
            6..=15 => {
                let (kind, numbers) = elements.next()?;
                array.numbers = Some((kind, numbers.to_vec()));
            }
            _ => {}
        }
        Ok((name, array))
    }

    /// The first number, if it is one.
    fn double(&self, is_big_endian: bool) -> Option<f64> {
        let (kind, bytes) = self.numbers.as_ref()?;
        Numbers { kind: *kind, bytes, is_big_endian }.doubles(1, |_| 0).ok()?.first().copied()
    }
}

/// The fields of a structure with one element; those of more have no names of their own.
fn fields(elements: &mut Elements<'_>, shape: &[u64], depth: usize) -> Result<Vec<(String, Array)>, Fault> {
    if shape.iter().any(|&n| n != 1) {
        return Ok(Vec::new());
    }
    let name_bytes = elements.words(1, "lengths of names")?.first().copied().unwrap_or(0) as usize;
    let (_, names) = elements.next()?;
    if name_bytes == 0 || names.len() / name_bytes > FIELDS_MAX {
        return broken(format!("a structure has names of {name_bytes} bytes in {} bytes", names.len()));
    }
    let mut fields = Vec::new();
    for name in names.chunks_exact(name_bytes) {
        let name = String::from_utf8_lossy(name.split(|&byte| byte == 0).next().unwrap_or_default()).into_owned();
        let (kind, bytes) = elements.next()?;
        if kind == MI_MATRIX && !bytes.is_empty() {
            fields.push((name, Array::parse(bytes, elements.is_big_endian, depth + 1)?.1));
        }
    }
    Ok(fields)
}

/// Numbers as they are in the file, which may be narrower than the class of their array.
struct Numbers<'a> {
    kind: u32,
    bytes: &'a [u8],
    is_big_endian: bool,
}

impl Numbers<'_> {
    /// `count` numbers at the places that `place` gives.
    fn each<const N: usize, T>(
        &self,
        count: usize,
        place: impl Fn(usize) -> usize,
        number: impl Fn([u8; N]) -> T,
    ) -> Result<Vec<T>, Fault> {
        let (numbers, _) = self.bytes.as_chunks::<N>();
        let got = numbers.len();
        let one = |k: usize| {
            let mut bytes = *numbers
                .get(place(k))
                .ok_or_else(|| Fault::Broken(format!("an array has {got} numbers; its shape asks for more")))?;
            if self.is_big_endian {
                bytes.reverse();
            }
            Ok(number(bytes))
        };
        // Checked before memory is asked for.
        if count > 0 {
            one(count - 1)?;
        }
        (0..count).map(one).collect()
    }

    fn doubles(&self, count: usize, place: impl Fn(usize) -> usize) -> Result<Vec<f64>, Fault> {
        match self.kind {
            9 => self.each(count, place, f64::from_le_bytes),
            7 => self.each(count, place, |bytes| f32::from_le_bytes(bytes).into()),
            #[expect(clippy::cast_precision_loss, reason = "doubles that were stored as integers")]
            _ => Ok(self.integers(count, place)?.into_iter().map(|integer| integer as f64).collect()),
        }
    }

    fn integers(&self, count: usize, place: impl Fn(usize) -> usize) -> Result<Vec<i64>, Fault> {
        match self.kind {
            1 => self.each(count, place, |bytes| i8::from_le_bytes(bytes).into()),
            2 => self.each(count, place, |bytes| u8::from_le_bytes(bytes).into()),
            3 => self.each(count, place, |bytes| i16::from_le_bytes(bytes).into()),
            4 => self.each(count, place, |bytes| u16::from_le_bytes(bytes).into()),
            5 => self.each(count, place, |bytes| i32::from_le_bytes(bytes).into()),
            6 => self.each(count, place, |bytes| u32::from_le_bytes(bytes).into()),
            12 => self.each(count, place, i64::from_le_bytes),
            13 => self.each(count, place, |bytes| i64::try_from(u64::from_le_bytes(bytes)).unwrap_or(i64::MAX)),
            kind => broken(format!("an array of integers holds data of type {kind}")),
        }
    }
}

impl Recorded for Mat5 {
    fn parts(&self, depth: usize) -> Result<Vec<String>, Fault> {
        if depth != 1 {
            return Err(Fault::Unsupported(format!("a MATLAB file has variables, one step below it, not {depth}")));
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
        let Some(array) = self.find(&path)? else {
            return Err(Fault::Missing { what: "channel", name: format!("{path:?}"), known });
        };
        let class = class_name(array.class);
        let (Some((kind, bytes)), false) = (&array.numbers, array.is_complex) else {
            let class = if array.is_complex { "complex" } else { class };
            return Err(Fault::Unsupported(format!("{path:?} is an array of class {class}; real numbers are read")));
        };
        let &[rows, _] = array.shape.as_slice() else {
            return Err(Fault::Unsupported(format!("{path:?} has {} axes; two are read", array.shape.len())));
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
                return Err(Fault::Unsupported(format!(
                    "{path:?} is of class {class}; signed integers, single and double are read"
                )));
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
                let what = format!("{name:?} is an array of class {class}; {UNIT_BOUND}");
                return Err(Fault::Unsupported(what));
            }
            Err(fault) => return broken(format!("{name:?}: {fault}; {UNIT_BOUND}")),
        };
        series.unit = unit.filter(|unit| !unit.is_empty());
        Ok(series)
    }
}
