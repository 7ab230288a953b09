//! TDMS files of LabVIEW and DIAdem.
//!
//! Source: National Instruments, *TDMS File Format Internal Structure*. No crate that reads these files takes interleaved
//! samples, several chunks of a segment, or big-endian ones.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::path::Path;

use crate::error::{Fault, broken, some_of};
use crate::format::{Pick, Recorded};
use crate::series::{Series, checked_count};

const LEAD_IN_BYTES: u64 = 28;

/// Bits of a segment's table of contents.
const HAS_METADATA: u32 = 1 << 1;
const HAS_NEW_OBJECTS: u32 = 1 << 2;
const HAS_RAW_DATA: u32 = 1 << 3;
const IS_INTERLEAVED: u32 = 1 << 5;
const IS_BIG_ENDIAN: u32 = 1 << 6;

/// Index of an object without raw data, and of one whose data are as in the segment before.
const NO_RAW_DATA: u32 = 0xffff_ffff;
const AS_BEFORE: u32 = 0;
const DAQMX_INDEXES: [u32; 3] = [0x1269, 0x126a, 0x1369];

/// Most groups and channels: those of a hundred thousand taps.
const OBJECTS_MAX: usize = 300_000;

/// Bytes that are read at once.
const BLOCK_BYTES: usize = 1 << 20;

/// A TDMS file: its objects, and where their samples are.
#[derive(Debug)]
pub(crate) struct Tdms {
    file: BufReader<File>,
    objects: Vec<Object>,
    places: HashMap<Vec<String>, usize>,
    segments: Vec<Segment>,
}

/// The file (no steps), a group (one), or a channel (two).
#[derive(Debug, Default)]
struct Object {
    path: Vec<String>,
    properties: BTreeMap<String, Property>,
    kind: Option<u32>,
    sample_count: u64,
}

#[derive(Debug, Clone, PartialEq)]
enum Property {
    Number(f64),
    Text(String),
    Other,
}

/// Raw data of one object in a chunk.
#[derive(Debug, Clone, Copy)]
struct Piece {
    object: usize,
    count: u64,
    bytes: u64,
}

/// Chunks of raw data that are all alike.
#[derive(Debug)]
struct Segment {
    at: u64,
    chunk_count: u64,
    chunk_bytes: u64,
    is_interleaved: bool,
    is_big_endian: bool,
    pieces: Vec<Piece>,
}

/// Bytes of a value; `None` of texts and of what is not a number.
fn value_bytes(kind: u32) -> Option<u64> {
    Some(match kind {
        1 | 5 | 0x21 => 1,
        2 | 6 => 2,
        3 | 7 | 9 | 0x19 => 4,
        4 | 8 | 10 | 0x1a | 0x0008_000c => 8,
        0x44 | 0x0010_000d => 16,
        _ => return None,
    })
}

fn kind_name(kind: u32) -> String {
    match kind {
        5..=8 => format!("unsigned integers of {} bits", 8 << (kind - 5)),
        0x20 => "texts".to_owned(),
        0x21 => "truth values".to_owned(),
        0x44 => "times".to_owned(),
        0x0008_000c | 0x0010_000d => "complex numbers".to_owned(),
        kind => format!("values of type {kind:#x}"),
    }
}

/// Text of a file's metadata, read from its start to its end.
struct Metadata<'a> {
    bytes: &'a [u8],
    is_big_endian: bool,
}

impl<'a> Metadata<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        match self.bytes.split_at_checked(count) {
            Some((taken, rest)) => {
                self.bytes = rest;
                Ok(taken)
            }
            None => broken(format!("its metadata end after {} bytes where {count} belong", self.bytes.len())),
        }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if self.is_big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn u64(&mut self) -> Result<u64, Fault> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn text(&mut self) -> Result<String, Fault> {
        let count = self.u32()? as usize;
        Ok(String::from_utf8_lossy(self.take(count)?).into_owned())
    }

    #[expect(clippy::cast_precision_loss, reason = "rates and factors")]
    fn property(&mut self) -> Result<Property, Fault> {
        let kind = self.u32()?;
        let number = match kind {
            1 => i8::from_le_bytes(self.array()?).into(),
            2 => i16::from_le_bytes(self.array()?).into(),
            3 => i32::from_le_bytes(self.array()?).into(),
            4 => i64::from_le_bytes(self.array()?) as f64,
            5 => u8::from_le_bytes(self.array()?).into(),
            6 => u16::from_le_bytes(self.array()?).into(),
            7 => self.u32()?.into(),
            8 => self.u64()? as f64,
            9 | 0x19 => f32::from_le_bytes(self.array()?).into(),
            10 | 0x1a => f64::from_le_bytes(self.array()?),
            0x20 => return Ok(Property::Text(self.text()?)),
            kind => {
                let Some(bytes) = value_bytes(kind) else {
                    return broken(format!("a property is of type {kind:#x}, which is unknown"));
                };
                self.take(usize::try_from(bytes).unwrap_or(usize::MAX))?;
                return Ok(Property::Other);
            }
        };
        Ok(Property::Number(number))
    }
}

/// The steps of an object's path: `/'group'/'channel'`, with quotes in names doubled.
fn steps(path: &str) -> Result<Vec<String>, Fault> {
    let mut steps = Vec::new();
    let mut rest = path;
    while let Some(inner) = rest.strip_prefix("/'") {
        let (mut name, mut letters) = (String::new(), inner.char_indices().peekable());
        rest = loop {
            match letters.next() {
                Some((_, '\'')) if letters.next_if(|(_, next)| *next == '\'').is_some() => name.push('\''),
                Some((at, '\'')) => break &inner[at + 1..],
                Some((_, letter)) => name.push(letter),
                None => return broken(format!("an object is called {path:?}, which is no path")),
            }
        };
        steps.push(name);
    }
    if rest.is_empty() || path == "/" {
        Ok(steps)
    } else {
        broken(format!("an object is called {path:?}, which is no path"))
    }
}

impl Tdms {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let mut file = BufReader::new(File::open(path)?);
        let file_bytes = file.get_ref().metadata()?.len();
        let mut tdms = Builder::default();
        let mut at = 0;
        while at < file_bytes {
            if file_bytes - at < LEAD_IN_BYTES {
                return broken(format!("is cut short: a segment at byte {at} has {} bytes", file_bytes - at));
            }
            file.seek(SeekFrom::Start(at))?;
            let mut lead_in = [0; LEAD_IN_BYTES as usize];
            file.read_exact(&mut lead_in)?;
            if &lead_in[..4] != b"TDSm" {
                return broken(format!("is no TDMS: no segment begins at byte {at}"));
            }
            let contents = u32::from_le_bytes([lead_in[4], lead_in[5], lead_in[6], lead_in[7]]);
            let is_big_endian = contents & IS_BIG_ENDIAN != 0;
            let mut offsets = Metadata { bytes: &lead_in[12..], is_big_endian };
            let (next, raw) = (offsets.u64()?, offsets.u64()?);
            let left = file_bytes - at - LEAD_IN_BYTES;
            // All ones: the program that wrote it did not end it.
            let segment_bytes = if next == u64::MAX { left } else { next };
            if segment_bytes > left {
                return broken(format!(
                    "is cut short: the segment at byte {at} has {segment_bytes} bytes; {left} follow"
                ));
            }
            if raw > segment_bytes {
                return broken(format!("the segment at byte {at} has {raw} bytes of metadata in {segment_bytes}"));
            }
            let mut metadata = Vec::new();
            file.by_ref().take(raw).read_to_end(&mut metadata)?;
            let metadata = Metadata { bytes: &metadata, is_big_endian };
            let raw_data = (at + LEAD_IN_BYTES + raw, segment_bytes - raw);
            tdms.segment(contents, metadata, raw_data, next != u64::MAX)?;
            at += LEAD_IN_BYTES + segment_bytes;
        }
        let places = tdms.objects.iter().enumerate().map(|(place, object)| (object.path.clone(), place)).collect();
        Ok(Self { file, objects: tdms.objects, places, segments: tdms.segments })
    }

    /// Places of the channels of the group `part`, or of all.
    fn channels(&self, part: &str) -> Vec<usize> {
        let is_of = |object: &Object| object.path.len() == 2 && (part.is_empty() || object.path[0] == part);
        (0..self.objects.len()).filter(|&place| is_of(&self.objects[place])).collect()
    }

    fn place(&self, part: &str, channel: &Pick) -> Result<usize, Fault> {
        let all = self.channels(part);
        if all.is_empty() {
            let known = some_of(self.objects.iter().filter(|o| o.path.len() == 1).map(|o| o.path[0].as_str()));
            return Err(Fault::Missing { what: "part", name: format!("{part:?}"), known });
        }
        let name = |&place: &usize| self.objects[place].path[1].as_str();
        match channel {
            Pick::Number(_) => Ok(all[channel.find(all.iter().map(name))?]),
            Pick::Name(wanted) => {
                let is_it = |place: &&usize| {
                    let path = &self.objects[**place].path;
                    path[1] == *wanted || wanted.split_once('/') == Some((&path[0], &path[1]))
                };
                let mut found = all.iter().filter(is_it);
                match (found.next(), found.count()) {
                    (None, _) => channel.find(all.iter().map(name)),
                    (Some(&place), 0) => Ok(place),
                    (Some(_), more) => Err(Fault::Unsupported(format!(
                        "has {} channels called {wanted:?}; say which as \"GROUP/{wanted}\", or by the part, a group",
                        more + 1
                    ))),
                }
            }
        }
    }

    /// The bytes of all samples of the object at `place`, each of `N` bytes.
    fn samples<const N: usize, T>(&mut self, place: usize, number: impl Fn([u8; N]) -> T) -> Result<Vec<T>, Fault> {
        let count = checked_count(self.objects[place].sample_count)?;
        let mut samples = Vec::with_capacity(count);
        let mut block = Vec::new();
        for segment in &self.segments {
            let mut before = 0;
            let Some(&piece) = segment.pieces.iter().find(|piece| {
                let is_it = piece.object == place;
                if !is_it {
                    before += if segment.is_interleaved { piece.bytes / piece.count.max(1) } else { piece.bytes };
                }
                is_it
            }) else {
                continue;
            };
            // Samples of all channels lie side by side, or those of each channel one after the other.
            let stride = match segment.is_interleaved {
                true => segment.pieces.iter().map(|piece| piece.bytes / piece.count.max(1)).sum(),
                false => N as u64,
            };
            let stride = usize::try_from(stride).unwrap_or(usize::MAX).max(N);
            for chunk in 0..segment.chunk_count {
                self.file.seek(SeekFrom::Start(segment.at + chunk * segment.chunk_bytes + before))?;
                let mut left = usize::try_from(piece.count).unwrap_or(usize::MAX);
                while left > 0 {
                    let now = left.min((BLOCK_BYTES / stride).max(1));
                    // Behind the last sample there may be nothing.
                    block.resize((now - 1) * stride + N, 0);
                    self.file.read_exact(&mut block)?;
                    if now < left {
                        self.file.seek_relative((stride - N) as i64)?;
                    }
                    for sample in block.chunks(stride) {
                        let Some(&bytes) = sample.first_chunk::<N>() else { continue };
                        let mut bytes: [u8; N] = bytes;
                        if segment.is_big_endian {
                            bytes.reverse();
                        }
                        samples.push(number(bytes));
                    }
                    left -= now;
                }
            }
        }
        Ok(samples)
    }

    /// A property of a channel, or else of its group, or of the file.
    fn property(&self, place: usize, name: &str) -> Option<&Property> {
        let path = &self.objects[place].path;
        (0..=path.len()).rev().find_map(|depth| {
            let place = self.places.get(&path[..depth])?;
            self.objects[*place].properties.get(name)
        })
    }

    fn number(&self, place: usize, name: &str) -> Option<f64> {
        match self.property(place, name) {
            Some(Property::Number(number)) => Some(*number),
            _ => None,
        }
    }

    fn text(&self, place: usize, name: &str) -> Option<&str> {
        match self.property(place, name) {
            Some(Property::Text(text)) => Some(text),
            _ => None,
        }
    }

    /// The polynomial that makes physical values of the stored ones; `None` if these are physical.
    fn polynomial(&self, place: usize) -> Result<Option<Vec<f64>>, Fault> {
        let scale_count = self.number(place, "NI_Number_Of_Scales").unwrap_or(0.0);
        if scale_count < 1.0 || self.text(place, "NI_Scaling_Status") == Some("scaled") {
            return Ok(None);
        }
        let kind = self.text(place, "NI_Scale[0]_Scale_Type").unwrap_or("of DAQmx");
        let value = |name: &str| {
            let name = format!("NI_Scale[0]_{name}");
            self.number(place, &name).ok_or_else(|| Fault::Broken(format!("a scale lacks the property {name}")))
        };
        match kind {
            "Linear" if scale_count < 2.0 => Ok(Some(vec![value("Linear_Y_Intercept")?, value("Linear_Slope")?])),
            "Polynomial" if scale_count < 2.0 => {
                let term_count = value("Polynomial_Coefficients_Size")?;
                let terms = (0_u32..16).take_while(|&k| f64::from(k) < term_count);
                Ok(Some(terms.map(|k| value(&format!("Polynomial_Coefficients[{k}]"))).collect::<Result<_, _>>()?))
            }
            kind => Err(Fault::Unsupported(format!(
                "channel {:?} has {scale_count} scales, the first {kind}; one, Linear or Polynomial, is read: save it scaled",
                self.objects[place].path[1]
            ))),
        }
    }
}

impl Recorded for Tdms {
    fn parts(&self, depth: usize) -> Result<Vec<String>, Fault> {
        if depth != 1 {
            return Err(Fault::Unsupported(format!("a TDMS file has groups, one step below it, not {depth}")));
        }
        Ok(self.objects.iter().filter(|object| object.path.len() == 1).map(|object| object.path[0].clone()).collect())
    }

    fn series(&mut self, part: &str, channel: &Pick, _time_axis: Option<u8>) -> Result<Series, Fault> {
        let place = self.place(part, channel)?;
        let object = &self.objects[place];
        let name = &object.path[1];
        let integers = |integers: Vec<i64>, bits| Series::of_integers(integers, bits);
        let mut series = match object.kind.unwrap_or(0) {
            0 => return Err(Fault::Empty),
            1 => integers(self.samples(place, |b| i8::from_le_bytes(b).into())?, 8),
            2 => integers(self.samples(place, |b| i16::from_le_bytes(b).into())?, 16),
            3 => integers(self.samples(place, |b| i32::from_le_bytes(b).into())?, 32),
            4 => integers(self.samples(place, i64::from_le_bytes)?, 64),
            9 | 0x19 => Series::of_floats(self.samples(place, f32::from_le_bytes)?)?,
            10 | 0x1a => Series::of_doubles(&self.samples(place, f64::from_le_bytes)?)?,
            kind => {
                return Err(Fault::Unsupported(format!(
                    "channel {name:?} holds {}; signed integers and floats are read",
                    kind_name(kind)
                )));
            }
        };
        if let Some(terms) = self.polynomial(place)? {
            let full_scale = series.full_scale;
            let scaled = |stored: f32| {
                let stored = f64::from(stored) * full_scale;
                terms.iter().rev().fold(0.0, |sum, term| sum * stored + term)
            };
            let unscaled = match &series.samples {
                crate::series::Stored::F32(floats) if full_scale.to_bits() == 1_f64.to_bits() => floats.clone(),
                samples => samples.to_floats(),
            };
            series = Series::of_doubles(&unscaled.into_iter().map(scaled).collect::<Vec<_>>())?;
        }
        let increment_s = self.number(place, "wf_increment").filter(|&s| s > 0.0);
        series.sample_rate_hz = increment_s.map(rate_of);
        series.unit = self.text(place, "unit_string").filter(|unit| !unit.is_empty()).map(str::to_owned);
        Ok(series)
    }
}

/// The rate of a time step: whole hertz where the step is as near to them as a double is.
fn rate_of(step_s: f64) -> f64 {
    let rate_hz = 1.0 / step_s;
    let whole = rate_hz.round();
    if ((whole - rate_hz) / rate_hz).abs() < 1e-12 { whole } else { rate_hz }
}

/// The file as its segments describe it, one after the other.
#[derive(Default)]
struct Builder {
    objects: Vec<Object>,
    places: HashMap<String, usize>,
    /// What the objects' raw data were like the last time.
    last: HashMap<usize, Piece>,
    /// Objects with raw data in the present chunks.
    order: Vec<Piece>,
    /// The place in `order` of objects that have been there.
    place_in_order: HashMap<usize, usize>,
    segments: Vec<Segment>,
}

impl Builder {
    fn segment(
        &mut self,
        contents: u32,
        mut metadata: Metadata<'_>,
        (at, raw_bytes): (u64, u64),
        is_ended: bool,
    ) -> Result<(), Fault> {
        if contents & HAS_METADATA != 0 {
            if contents & HAS_NEW_OBJECTS != 0 {
                self.order.clear();
                self.place_in_order.clear();
            }
            for _ in 0..metadata.u32()? {
                self.object(&mut metadata)?;
            }
        }
        if contents & HAS_RAW_DATA == 0 || raw_bytes == 0 {
            return Ok(());
        }
        let mut chunk_bytes = 0_u64;
        for piece in &self.order {
            chunk_bytes = chunk_bytes.saturating_add(piece.bytes);
        }
        if chunk_bytes == 0 {
            return Ok(());
        }
        let is_interleaved = contents & IS_INTERLEAVED != 0;
        if is_interleaved && {
            let mut counts = self.order.iter().filter(|piece| piece.bytes > 0).map(|piece| piece.count);
            let first = counts.next();
            counts.any(|count| Some(count) != first)
        } {
            return broken("a segment interleaves channels of different lengths");
        }
        let chunk_count = raw_bytes / chunk_bytes;
        // A program that did not end a segment may have left a part of a chunk.
        if chunk_count == 0 || is_ended && raw_bytes % chunk_bytes != 0 {
            return broken(format!(
                "is cut short: samples at byte {at} have {raw_bytes} bytes; chunks of {chunk_bytes} are promised"
            ));
        }
        for piece in &self.order {
            let count = &mut self.objects[piece.object].sample_count;
            *count = count.saturating_add(piece.count.saturating_mul(chunk_count));
        }
        let is_big_endian = contents & IS_BIG_ENDIAN != 0;
        // Objects without a value would otherwise make a small file a large list.
        let pieces = self.order.iter().filter(|piece| piece.bytes > 0).copied().collect();
        self.segments.push(Segment { at, chunk_count, chunk_bytes, is_interleaved, is_big_endian, pieces });
        Ok(())
    }

    fn object(&mut self, metadata: &mut Metadata<'_>) -> Result<(), Fault> {
        let path = metadata.text()?;
        let place = match self.places.get(&path) {
            Some(&place) => place,
            None if self.objects.len() == OBJECTS_MAX => {
                return Err(Fault::Unsupported(format!("has more than {OBJECTS_MAX} groups and channels")));
            }
            None => {
                self.objects.push(Object { path: steps(&path)?, ..Object::default() });
                self.places.insert(path, self.objects.len() - 1);
                self.objects.len() - 1
            }
        };
        match metadata.u32()? {
            NO_RAW_DATA => {
                let known = self.place_in_order.get(&place).and_then(|&at| self.order.get_mut(at));
                if let Some(piece) = known.filter(|piece| piece.object == place) {
                    (piece.count, piece.bytes) = (0, 0);
                }
            }
            AS_BEFORE => match self.last.get(&place) {
                Some(&piece) => self.set(piece),
                None => return broken(format!("{:?} has data as before, but none before", self.objects[place].path)),
            },
            index if DAQMX_INDEXES.contains(&index) => {
                return Err(Fault::Unsupported(format!(
                    "{} holds raw data of DAQmx with its own scales, which are not read: save it scaled, as floats",
                    some_of(self.objects[place].path.last().map(String::as_str))
                )));
            }
            _ => {
                let (kind, axes, count) = (metadata.u32()?, metadata.u32()?, metadata.u64()?);
                if axes != 1 {
                    return broken(format!("{:?} has {axes} axes; there must be 1", self.objects[place].path));
                }
                let bytes = match value_bytes(kind) {
                    Some(bytes) => bytes.saturating_mul(count),
                    None if kind == 0x20 => metadata.u64()?,
                    None => return broken(format!("{:?} holds unknown {}", self.objects[place].path, kind_name(kind))),
                };
                let object = &mut self.objects[place];
                if object.kind.is_some_and(|before| before != kind) {
                    return broken(format!("{:?} changes the type of its values", object.path));
                }
                object.kind = Some(kind);
                let piece = Piece { object: place, count, bytes };
                self.last.insert(place, piece);
                self.set(piece);
            }
        }
        for _ in 0..metadata.u32()? {
            let (name, value) = (metadata.text()?, metadata.property()?);
            self.objects[place].properties.insert(name, value);
        }
        Ok(())
    }

    fn set(&mut self, piece: Piece) {
        let place = *self.place_in_order.entry(piece.object).or_insert(self.order.len());
        match self.order.get_mut(place) {
            Some(known) if known.object == piece.object => *known = piece,
            _ => {
                self.place_in_order.insert(piece.object, self.order.len());
                self.order.push(piece);
            }
        }
    }
}
