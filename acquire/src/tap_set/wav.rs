//! WAV files: their headers, and their samples channel by channel.
//!
//! `hound` is used only as the oracle in tests, because it fails on an odd chunk that is padded as RIFF requires, and
//! returns samples one by one where a slice is needed.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use tapline_wire::{CacheLine, SampleFormat, bytes_of_mut, f32_of_mut, i16_of_mut};

/// Most samples of one channel: 100 s at 41 kHz. Every record takes as much memory as the longest.
pub(super) const SAMPLE_COUNT_MAX: u64 = 1 << 22;

/// Largest number of chunks before the samples.
const CHUNKS_MAX: usize = 256;

/// Last twelve bytes of the two supported sub-formats of an extensible header, whose samples are not compressed.
const SUB_FORMAT_TAIL: [u8; 12] = [0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71];

/// What the numbers of a WAV file are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WavKind {
    /// Whole numbers; those of 8 bits are counted from -128 on.
    Integer,
    /// Floating point.
    Float,
}

/// Where the samples of a WAV file are, and what they are; the file was checked to be as long as its header says.
#[derive(Debug, Clone, Copy)]
pub struct WavLayout {
    /// What its numbers are.
    pub kind: WavKind,
    /// Bits of a sample, whole bytes.
    pub bits: u16,
    /// Number of channels, whose samples lie side by side.
    pub channel_count: u16,
    /// Samples of a channel per second.
    pub sample_rate_hz: u32,
    /// Samples of one channel.
    pub sample_count: u32,
    /// Offset of the samples in the file.
    pub data_at: u64,
}

/// The header of a recording of a tap set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct WavHeader {
    pub format: SampleFormat,
    pub channel_count: u16,
    pub sample_rate_hz: u32,
    /// Samples of one channel.
    pub sample_count: u32,
    /// Offset of the samples in the file.
    pub data_at: u64,
    pub data_bytes: usize,
}

/// Why a recording cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum WavFault {
    /// The list of taps says why there is no recording.
    #[error("{0}")]
    Refused(String),
    #[error("the file does not exist")]
    Missing,
    #[error("it is not a file")]
    NotAFile,
    #[error("it cannot be read: {0}")]
    Unreadable(io::Error),
    #[error("not a WAV file: {0}")]
    NotWav(&'static str),
    #[error("not a WAV file: it ends at byte {file_bytes}, within its header")]
    HeaderCut { file_bytes: u64 },
    #[error("{bits}-bit {kind} samples are not supported; {known} are")]
    Unsupported { bits: u16, kind: String, known: &'static str },
    #[error(
        "the header gives {block_bytes} bytes to a sample of all {channel_count} channels; {bits} bits need {need}"
    )]
    Block { block_bytes: u16, channel_count: u16, bits: u16, need: u32 },
    #[error("it has no samples")]
    Empty,
    #[error("it is cut short: the header promises {promised_bytes} bytes of samples, the file holds {got_bytes}")]
    Truncated { promised_bytes: u64, got_bytes: u64 },
    #[error("{data_bytes} bytes of samples are not a whole number of {frame_bytes}-byte samples of all channels")]
    Ragged { data_bytes: u64, frame_bytes: u64 },
    #[error("it has {got} samples per channel; at most {SAMPLE_COUNT_MAX} are taken")]
    TooLong { got: u64 },
    #[error("it has {got} channels; scan.toml lists {need}")]
    Channels { got: u16, need: usize },
    #[error("its sample rate is {got_hz} Hz; scan.toml says {need_hz} Hz")]
    Rate { got_hz: u32, need_hz: f64 },
    #[error("it has {got} samples per channel; scan.toml has the trigger at sample {pre_trigger_samples}")]
    TooShort { got: u32, pre_trigger_samples: u32 },
    #[error("its samples are {}; most recordings of the set have {}", format_name(*got), format_name(*need))]
    Format { got: SampleFormat, need: SampleFormat },
    #[error("sample {sample} of channel {channel} (both from 0) is {value}, not a finite number")]
    NonFinite { sample: usize, channel: usize, value: f32 },
    #[error("it became shorter while it was read")]
    Shrunk,
    #[error("it has grown to {got} samples per channel since the set was opened with at most {most}")]
    Grown { got: u32, most: u32 },
}

fn format_name(format: SampleFormat) -> &'static str {
    match format {
        SampleFormat::I16 => "16-bit integer",
        SampleFormat::F32 => "32-bit float",
    }
}

impl From<io::Error> for WavFault {
    fn from(e: io::Error) -> Self {
        if e.kind() == io::ErrorKind::NotFound { Self::Missing } else { Self::Unreadable(e) }
    }
}

/// Opens `path`, and returns its length in bytes.
pub(crate) fn open(path: &Path) -> Result<(File, u64), WavFault> {
    // Checked first, because opening a pipe waits for its writer.
    if !std::fs::metadata(path)?.is_file() {
        return Err(WavFault::NotAFile);
    }
    let file = File::open(path)?;
    let file_bytes = file.metadata()?.len();
    Ok((file, file_bytes))
}

/// Reads the header of a recording of a tap set, a WAV file of `file_bytes` bytes.
pub(crate) fn read_header<R: Read + Seek>(file: R, file_bytes: u64) -> Result<WavHeader, WavFault> {
    let readable = (&[(WavKind::Integer, 16), (WavKind::Float, 32)][..], "16-bit integer and 32-bit float");
    let WavLayout { kind, channel_count, sample_rate_hz, sample_count, data_at, .. } =
        read_wav_layout(file, file_bytes, readable)?;
    if u64::from(sample_count) > SAMPLE_COUNT_MAX {
        return Err(WavFault::TooLong { got: sample_count.into() });
    }
    let format = if kind == WavKind::Integer { SampleFormat::I16 } else { SampleFormat::F32 };
    let data_bytes = sample_count as usize * usize::from(channel_count) * format.bytes();
    Ok(WavHeader { format, channel_count, sample_rate_hz, sample_count, data_at, data_bytes })
}

/// Reads the header of a WAV file of `file_bytes` bytes, whose samples must be of one of the kinds and bits that are `readable`;
/// their list in words is for the error.
///
/// # Errors
/// Why it cannot be read.
pub fn read_wav_layout<R: Read + Seek>(
    mut file: R,
    file_bytes: u64,
    readable: (&[(WavKind, u16)], &'static str),
) -> Result<WavLayout, WavFault> {
    if file_bytes == 0 {
        return Err(WavFault::NotWav("it is empty"));
    }
    let mut at = 0;
    let tag: [u8; 12] = take(&mut file, &mut at, file_bytes)?;
    match (&tag[..4], &tag[8..]) {
        (b"RIFF", b"WAVE") => {}
        (b"RF64" | b"RIFX", _) => return Err(WavFault::NotWav("RF64 and RIFX are not read, only RIFF")),
        _ => return Err(WavFault::NotWav("it does not start with RIFF and WAVE")),
    }
    let mut format = None;
    for _ in 0..CHUNKS_MAX {
        let [k0, k1, k2, k3, length @ ..]: [u8; 8] = take(&mut file, &mut at, file_bytes)?;
        let chunk_bytes = u64::from(u32::from_le_bytes(length));
        match &[k0, k1, k2, k3] {
            b"fmt " => {
                let start = at;
                format = Some(read_format(&mut file, &mut at, file_bytes, chunk_bytes, readable)?);
                at = start;
            }
            b"data" => {
                let format = format.ok_or(WavFault::NotWav("its samples come before their format"))?;
                return with_samples(format, at, chunk_bytes, file_bytes);
            }
            _ => {}
        }
        // RIFF pads a chunk to an even length.
        at += chunk_bytes + chunk_bytes % 2;
        if at >= file_bytes {
            return Err(WavFault::NotWav("it has no samples chunk"));
        }
        file.seek(SeekFrom::Start(at))?;
    }
    Err(WavFault::NotWav("no samples come within its first 256 chunks"))
}

fn take<R: Read, const N: usize>(file: &mut R, at: &mut u64, file_bytes: u64) -> Result<[u8; N], WavFault> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes).map_err(|e| match e.kind() {
        io::ErrorKind::UnexpectedEof => WavFault::HeaderCut { file_bytes },
        _ => WavFault::Unreadable(e),
    })?;
    *at += N as u64;
    Ok(bytes)
}

/// The format chunk: a layout without samples.
fn read_format<R: Read>(
    file: &mut R,
    at: &mut u64,
    file_bytes: u64,
    chunk_bytes: u64,
    (readable, known): (&[(WavKind, u16)], &'static str),
) -> Result<WavLayout, WavFault> {
    if chunk_bytes < 16 {
        return Err(WavFault::NotWav("its format chunk has less than 16 bytes"));
    }
    let b: [u8; 16] = take(file, at, file_bytes)?;
    let word = |i: usize| u16::from_le_bytes([b[i], b[i + 1]]);
    let (mut tag, channel_count, block_bytes, bits) = (word(0), word(2), word(12), word(14));
    let mut is_known = true;
    if tag == 0xfffe && chunk_bytes >= 40 {
        let extension: [u8; 24] = take(file, at, file_bytes)?;
        tag = u16::from_le_bytes([extension[8], extension[9]]);
        is_known = extension[10..12] == [0, 0] && extension[12..] == SUB_FORMAT_TAIL;
    }
    let kind = if tag == 1 { WavKind::Integer } else { WavKind::Float };
    if !is_known || ![1, 3].contains(&tag) || !readable.contains(&(kind, bits)) {
        return Err(WavFault::Unsupported { bits, kind: kind_name(tag, is_known), known });
    }
    if channel_count == 0 {
        return Err(WavFault::NotWav("it has no channels"));
    }
    let need = u32::from(channel_count) * u32::from(bits / 8);
    if u32::from(block_bytes) != need {
        return Err(WavFault::Block { block_bytes, channel_count, bits, need });
    }
    let sample_rate_hz = u32::from_le_bytes([b[4], b[5], b[6], b[7]]);
    Ok(WavLayout { kind, bits, channel_count, sample_rate_hz, sample_count: 0, data_at: 0 })
}

/// The layout of a file whose samples begin at `data_at`.
fn with_samples(format: WavLayout, data_at: u64, data_bytes: u64, file_bytes: u64) -> Result<WavLayout, WavFault> {
    let frame_bytes = u64::from(format.channel_count) * u64::from(format.bits / 8);
    let (got_bytes, got) = (file_bytes.saturating_sub(data_at), data_bytes / frame_bytes);
    match () {
        () if data_bytes == 0 => Err(WavFault::Empty),
        () if got_bytes < data_bytes => Err(WavFault::Truncated { promised_bytes: data_bytes, got_bytes }),
        () if !data_bytes.is_multiple_of(frame_bytes) => Err(WavFault::Ragged { data_bytes, frame_bytes }),
        () => {
            let sample_count = u32::try_from(got).map_err(|_overflow| WavFault::TooLong { got })?;
            Ok(WavLayout { sample_count, data_at, ..format })
        }
    }
}

fn kind_name(tag: u16, is_known: bool) -> String {
    match tag {
        1 if is_known => "integer".to_owned(),
        3 if is_known => "float".to_owned(),
        6 if is_known => "A-law".to_owned(),
        7 if is_known => "mu-law".to_owned(),
        2 | 0x11 if is_known => "ADPCM".to_owned(),
        _ => format!("(format {tag:#06x})"),
    }
}

impl WavHeader {
    /// Reads the samples of `file` into `buffer`, planar; `scratch` is a buffer for reuse.
    ///
    /// # Panics
    /// If `buffer` has less room than the samples need.
    pub(crate) fn read_samples<R: Read + Seek>(
        &self,
        mut file: R,
        scratch: &mut Vec<u8>,
        buffer: &mut [CacheLine],
    ) -> Result<(), WavFault> {
        file.seek(SeekFrom::Start(self.data_at))?;
        if self.channel_count == 1 && cfg!(target_endian = "little") {
            Self::fill(&mut file, &mut bytes_of_mut(buffer)[..self.data_bytes])?;
        } else {
            scratch.resize(self.data_bytes, 0);
            Self::fill(&mut file, scratch)?;
            match self.format {
                SampleFormat::I16 => self.write_planes(scratch, i16_of_mut(buffer), i16::from_le_bytes),
                SampleFormat::F32 => self.write_planes(scratch, f32_of_mut(buffer), f32::from_le_bytes),
            }
        }
        if self.format == SampleFormat::F32 { self.refuse_non_finite(f32_of_mut(buffer)) } else { Ok(()) }
    }

    fn fill<R: Read>(file: &mut R, bytes: &mut [u8]) -> Result<(), WavFault> {
        file.read_exact(bytes).map_err(|e| match e.kind() {
            // The length was checked when the header was read.
            io::ErrorKind::UnexpectedEof => WavFault::Shrunk,
            _ => WavFault::Unreadable(e),
        })
    }

    /// Converts `[sample][channel]` bytes to `[channel][sample]` numbers.
    fn write_planes<const N: usize, T>(&self, bytes: &[u8], planes: &mut [T], number: impl Fn([u8; N]) -> T) {
        let (numbers, _none) = bytes.as_chunks::<N>();
        let channel_count = usize::from(self.channel_count);
        for (channel, plane) in planes.chunks_exact_mut(self.sample_count as usize).take(channel_count).enumerate() {
            for (sample, &bytes) in plane.iter_mut().zip(numbers.iter().skip(channel).step_by(channel_count)) {
                *sample = number(bytes);
            }
        }
    }

    fn refuse_non_finite(&self, planes: &[f32]) -> Result<(), WavFault> {
        let sample_count = self.sample_count as usize;
        let planes = &planes[..sample_count * usize::from(self.channel_count)];
        match planes.iter().position(|s| !s.is_finite()) {
            None => Ok(()),
            Some(at) => {
                Err(WavFault::NonFinite { sample: at % sample_count, channel: at / sample_count, value: planes[at] })
            }
        }
    }
}

#[cfg(test)]
#[path = "wav_tests.rs"]
mod tests;
