//! The segments of a TDMS file: which objects it has, and where their samples are.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};

use crate::error::{Fault, broken, some_of};
use crate::format::bytes::Bytes;
use crate::format::tdms::metadata::{Property, kind_name, steps, value_bytes};

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

/// The file (no steps), a group (one), or a channel (two).
#[derive(Debug, Default)]
pub(super) struct Object {
    pub path: Vec<String>,
    pub properties: BTreeMap<String, Property>,
    pub kind: Option<u32>,
    pub sample_count: u64,
}

/// Raw data of one object in a chunk.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub object: usize,
    pub count: u64,
    pub bytes: u64,
}

/// Chunks of raw data that are all alike.
#[derive(Debug)]
pub(super) struct Segment {
    pub at: u64,
    pub chunk_count: u64,
    pub chunk_bytes: u64,
    pub is_interleaved: bool,
    pub is_big_endian: bool,
    pub pieces: Vec<Piece>,
}

/// What the segments of a file say, one after the other.
#[derive(Default)]
pub(super) struct Contents {
    pub objects: Vec<Object>,
    places: HashMap<String, usize>,
    /// What the objects' raw data were like the last time.
    last: HashMap<usize, Piece>,
    /// Objects with raw data in the present chunks.
    order: Vec<Piece>,
    /// The place in `order` of objects that have been there.
    place_in_order: HashMap<usize, usize>,
    pub segments: Vec<Segment>,
}

impl Contents {
    /// Reads all that is said of objects and samples in `file`.
    pub(super) fn read(file: &mut BufReader<File>) -> Result<Self, Fault> {
        let file_bytes = file.get_ref().metadata()?.len();
        let mut contents = Self::default();
        let mut at = 0;
        while at < file_bytes {
            if file_bytes - at < LEAD_IN_BYTES {
                return broken(format!("is cut short: a segment at byte {at} has {} bytes", file_bytes - at));
            }
            file.seek(SeekFrom::Start(at))?;
            let mut lead_in = [0; LEAD_IN_BYTES as usize];
            file.read_exact(&mut lead_in)?;
            if &lead_in[..4] != b"TDSm" {
                return broken(format!("is not TDMS: no segment begins at byte {at}"));
            }
            let flags = u32::from_le_bytes([lead_in[4], lead_in[5], lead_in[6], lead_in[7]]);
            let is_big_endian = flags & IS_BIG_ENDIAN != 0;
            let mut offsets = Bytes { left: &lead_in[12..], is_big_endian };
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
            let metadata = Bytes { left: &metadata, is_big_endian };
            let raw_data = (at + LEAD_IN_BYTES + raw, segment_bytes - raw);
            contents.segment(flags, metadata, raw_data, next != u64::MAX)?;
            at += LEAD_IN_BYTES + segment_bytes;
        }
        Ok(contents)
    }

    fn segment(
        &mut self,
        flags: u32,
        mut metadata: Bytes<'_>,
        (at, raw_bytes): (u64, u64),
        is_ended: bool,
    ) -> Result<(), Fault> {
        if flags & HAS_METADATA != 0 {
            if flags & HAS_NEW_OBJECTS != 0 {
                self.order.clear();
                self.place_in_order.clear();
            }
            for _ in 0..metadata.u32()? {
                self.object(&mut metadata)?;
            }
        }
        if flags & HAS_RAW_DATA == 0 || raw_bytes == 0 {
            return Ok(());
        }
        let mut chunk_bytes = 0_u64;
        for piece in &self.order {
            chunk_bytes = chunk_bytes.saturating_add(piece.bytes);
        }
        if chunk_bytes == 0 {
            return Ok(());
        }
        let is_interleaved = flags & IS_INTERLEAVED != 0;
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
        let is_big_endian = flags & IS_BIG_ENDIAN != 0;
        // Objects without a value would otherwise make a small file a large list.
        let pieces = self.order.iter().filter(|piece| piece.bytes > 0).copied().collect();
        self.segments.push(Segment { at, chunk_count, chunk_bytes, is_interleaved, is_big_endian, pieces });
        Ok(())
    }

    fn object(&mut self, metadata: &mut Bytes<'_>) -> Result<(), Fault> {
        let path = metadata.text()?;
        let place = match self.places.get(&path) {
            Some(&place) => place,
            None if self.objects.len() == OBJECTS_MAX => {
                return broken(format!("has more than {OBJECTS_MAX} groups and channels"));
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
                None => return broken(format!("{:?} refers to earlier data, but has none", self.objects[place].path)),
            },
            index if DAQMX_INDEXES.contains(&index) => {
                return broken(format!(
                    "{} holds raw data of DAQmx with its own scales, which are not read: save it scaled, as floats",
                    some_of(self.objects[place].path.last().map(String::as_str))
                ));
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
