//! Samples read without the HDF5 library: chunks are read from their locations in the file and unpacked here.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::OnceLock;

use tapline_codec::{Codec, head_of, is_chunk_valid, unpack, unpack_gzip};
use tapline_wire::{CacheLine, Plan, SampleFormat, Samples, TapHeader, TapState, bytes_of_mut, cache_lines_for};

use crate::archive::Archive;
use crate::error::{Context, Error, Result};
use crate::format::checksum::ChecksummedRow as _;
use crate::format::layout::HeaderRow;
use crate::h5::extent::Extent;
use crate::h5::samples::{ChunkRows, unpadded};

/// Bytes read first: they hold the whole head of a record of up to 40 blocks; a chunk with a longer head is read whole.
const HEAD_BYTES_MAX: usize = 512;

/// Buffers of one record, which a caller reuses for many.
#[derive(Debug, Default)]
pub struct ReadBuffer {
    /// The packed chunk.
    chunk: Vec<u8>,
    /// Bytes of the previous chunk up to the end of the first samples asked for: about as many are read at once.
    beginning: usize,
    /// The samples.
    buffer: Vec<CacheLine>,
    /// The unpacked planes of bits.
    planes: Vec<u8>,
}

/// The samples of an archive in their file.
#[derive(Debug)]
pub(crate) struct SampleFile {
    path: PathBuf,
    file: File,
    rows: ChunkRows,
    /// The location of every row, once it was looked for.
    locations: OnceLock<Vec<Option<Extent>>>,
}

impl SampleFile {
    /// The file of the samples of `archive`, which may be that of another archive.
    pub(crate) fn open(archive: &Archive) -> Result<Self> {
        let path = PathBuf::from(archive.samples.dataset().filename());
        let file = File::open(&path).context("open the samples", &path)?;
        Ok(Self { path, file, rows: archive.samples.clone(), locations: OnceLock::new() })
    }

    /// The location of every row.
    pub(crate) fn locations(&self) -> Result<Vec<Option<Extent>>> {
        self.rows.locations(&self.file).context("find samples", &self.path)
    }

    /// The location of row `row`. All are looked up at the first call.
    pub(crate) fn location(&self, row: u32) -> Result<Option<Extent>> {
        if self.locations.get().is_none() {
            let locations = self.locations()?;
            self.locations.get_or_init(|| locations);
        }
        Ok(self.locations.get().and_then(|locations| *locations.get(row as usize)?))
    }

    /// The samples of `header`, whose chunk is at `location`, unpacked into `buffer`: the first `sample_count` of each channel. The
    /// checksum of the whole chunk is checked or, if `is_beginning` and the chunk has a head, of the blocks that are unpacked.
    pub(crate) fn read<'r>(
        &self,
        header: &TapHeader,
        stored_checksum: u64,
        location: Option<Extent>,
        is_beginning: bool,
        buffer: &'r mut ReadBuffer,
    ) -> Result<Samples<'r>> {
        let ReadBuffer { chunk, beginning, buffer, planes } = buffer;
        let location = location.ok_or_else(|| self.damaged(header, "have no location in the file"))?;
        let codec = self.rows.codec();
        let is_read = if is_beginning && codec == Codec::Lz4 {
            self.read_blocks(header, location, chunk, beginning)
        } else {
            location.read(&self.file, chunk)
        };
        is_read.context("read samples", &self.path)?;
        let stored = &chunk[..];
        let is_valid = match head_of(codec, stored).filter(|_| is_beginning) {
            Some(head) => {
                let are_valid = |part| head.are_valid(head.blocks(&part), stored);
                head.checksum() == stored_checksum && parts(header, self.rows.row_bytes()).all(are_valid)
            }
            None => is_chunk_valid(codec, stored, stored_checksum),
        };
        if !is_valid {
            return Err(self.damaged(header, "are not what was written: their checksum differs"));
        }
        self.unpacked(header, stored, buffer, planes)
    }

    /// Reads the head of the chunk at `location` and the blocks that hold the samples of `header`, or all of a chunk that has no head.
    /// Other bytes of `chunk` stay what they were.
    fn read_blocks(
        &self,
        header: &TapHeader,
        location: Extent,
        chunk: &mut Vec<u8>,
        beginning: &mut usize,
    ) -> io::Result<()> {
        location.make_room(&self.file, chunk)?;
        let (codec, begin) = (self.rows.codec(), HEAD_BYTES_MAX.max(*beginning + *beginning / 16).min(chunk.len()));
        location.read_part(&self.file, chunk, 0..begin)?;
        for (number, part) in parts(header, self.rows.row_bytes()).enumerate() {
            // The offsets of a damaged head do not lead out of the chunk; its checksum finds the damage.
            let head = head_of(codec, &chunk[..begin]).filter(|head| head.chunk_bytes() == chunk.len());
            let extent = head.map_or(begin..chunk.len(), |head| head.extent(&head.blocks(&part)));
            if number == 0 {
                *beginning = extent.end;
            }
            if extent.end > begin {
                location.read_part(&self.file, chunk, extent)?;
            }
        }
        Ok(())
    }

    /// The samples in the chunk `stored`: as many as the header has.
    fn unpacked<'r>(
        &self,
        header: &TapHeader,
        stored: &[u8],
        buffer: &'r mut Vec<CacheLine>,
        planes: &mut Vec<u8>,
    ) -> Result<Samples<'r>> {
        buffer.resize(cache_lines_for(self.rows.row_bytes()), CacheLine::default());
        let unpacked = &mut bytes_of_mut(buffer)[..self.rows.row_bytes()];
        let is_valid = match (self.rows.codec(), SampleFormat::from_code(header.sample_format)) {
            (Codec::Gzip, Some(format)) => unpack_gzip(format.bytes(), stored, unpacked, planes),
            (codec, _) => unpack(codec, stored, parts(header, unpacked.len()), unpacked, planes),
        };
        if !is_valid {
            return Err(self.damaged(header, "cannot be unpacked"));
        }
        unpadded(unpacked, header.channel_count as usize, header.payload_bytes() / header.channel_count as usize);
        Samples::view(header, buffer).ok_or_else(|| self.damaged(header, "are not as many as their header says"))
    }

    fn damaged(&self, header: &TapHeader, what: &str) -> Error {
        let what = format!("plan row {}: its samples {what}", header.plan_index);
        Error::Damaged { path: self.path.clone(), what }
    }
}

/// The bytes of a row of `row_bytes` that the samples of `header` take, as few ranges as possible.
fn parts(header: &TapHeader, row_bytes: usize) -> impl Iterator<Item = Range<usize>> {
    let channel_count = (header.channel_count as usize).max(1);
    let stride = row_bytes / channel_count;
    let used = (header.payload_bytes() / channel_count).clamp(0, stride);
    let (count, length) = if used == stride { (1, row_bytes) } else { (channel_count, used) };
    (0..count).map(move |channel| channel * stride..channel * stride + length)
}

/// The taps of an archive, for several threads: their locations are looked up once, and reading takes no lock.
#[derive(Debug)]
pub struct Taps {
    file: SampleFile,
    plan: Plan,
    /// By plan row; `None` for taps that are not archived.
    found: Vec<Option<Found>>,
}

/// Header and location of a tap.
#[derive(Debug, Clone, Copy)]
struct Found {
    header: HeaderRow,
    location: Option<Extent>,
}

impl Taps {
    pub(crate) fn new(archive: &Archive, states: &[TapState]) -> Result<Self> {
        let file = SampleFile::open(archive)?;
        let locations = file.locations()?;
        let headers = archive.headers.read_all().context("read the headers", &archive.path)?;
        let taps = states.iter().zip(headers).zip(locations);
        let found = taps.map(|((state, header), location)| {
            Some(Found { header, location }).filter(|_| *state == TapState::Archived)
        });
        Ok(Self { file, plan: archive.plan.clone(), found: found.collect() })
    }

    /// The tap in plan row `row`, bit for bit, its samples in `buffer`; `None` if it is not archived or there is no such row.
    ///
    /// # Errors
    /// [`Error::Damaged`] if a checksum differs, or what the system returns.
    pub fn read<'r>(&self, row: u32, buffer: &'r mut ReadBuffer) -> Result<Option<(TapHeader, Samples<'r>)>> {
        self.read_beginning(row, |header| header.sample_count, buffer)
    }

    /// As [`Taps::read`], but for only the first samples of each channel: as many as `used` returns, which are then the
    /// `sample_count` of the header. Only the blocks that hold them are unpacked.
    ///
    /// # Errors
    /// As [`Taps::read`]; if the chunk has a head, only damage in the blocks that are unpacked is an error.
    pub fn read_beginning<'r>(
        &self,
        row: u32,
        used: impl FnOnce(&TapHeader) -> u32,
        buffer: &'r mut ReadBuffer,
    ) -> Result<Option<(TapHeader, Samples<'r>)>> {
        let Some(found) = self.found.get(row as usize).copied().flatten() else { return Ok(None) };
        let header = checked_header(&self.file.path, &self.plan, row, found.header)?;
        let used = used(&header).clamp(0, header.sample_count);
        let is_beginning = used < header.sample_count;
        let header = TapHeader { sample_count: used, ..header };
        let samples = self.file.read(&header, found.header.stored_checksum, found.location, is_beginning, buffer)?;
        Ok(Some((header, samples)))
    }
}

/// The header in row `row`, if its checksum is valid and it names that row.
pub(crate) fn checked_header(path: &std::path::Path, plan: &Plan, row: u32, header: HeaderRow) -> Result<TapHeader> {
    let damaged = |what: String| Error::Damaged { path: path.to_owned(), what };
    if !header.is_valid(row as usize) {
        return Err(damaged(format!("plan row {row}: its header is not what was written: the checksum differs")));
    }
    let of_row = header.to_header(row, plan);
    let most = plan.recording.sample_count_max;
    if of_row.plan_index != row || of_row.sample_count > most {
        let (named, count) = (of_row.plan_index, of_row.sample_count);
        return Err(damaged(format!("plan row {row}: its header names row {named} and {count} samples")));
    }
    Ok(of_row)
}
