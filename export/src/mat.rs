//! The taps of an archive as MATLAB files of version 7, which MATLAB, Octave and scipy open.
//!
//! There is one file for each shoulder. `force` and `sound` are matrices of floats with a column for each tap, in `force_unit` and
//! `sound_unit` (FS is a fraction of full scale, if the scale is not known); the location, angle, time (`tap_time_s`, since the Unix epoch) and
//! other numbers of the taps are row vectors with an element for each. `tyre` and `shoulder` say whose they are. A tap with fewer samples than the longest
//! ends with NaN. Beside the files, `taps.csv` lists every planned tap, with its column or why it has none.
//!
//! Source: MathWorks, *MAT-File Format*.

use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use tapline_store::Reader;
use tapline_wire::{Channel, Scan};

use crate::error::Context as _;
use crate::fortran::plain;
use crate::taps::scan_files::{List, ScanFormat};
use crate::taps::{ListedTap, Taps, known, physical};
use crate::{Error, Result};

/// Most bytes of a variable: MATLAB reads no more from a file of this version.
const VARIABLE_BYTES_MAX: usize = (1 << 31) - 1;

const MI_INT8: u32 = 1;
const MI_INT32: u32 = 5;
const MI_UINT16: u32 = 4;
const MI_UINT32: u32 = 6;
const MI_SINGLE: u32 = 7;
const MI_DOUBLE: u32 = 9;
const MI_MATRIX: u32 = 14;
const MI_COMPRESSED: u32 = 15;
const MX_CHAR: u32 = 4;
const MX_DOUBLE: u32 = 6;
const MX_SINGLE: u32 = 7;

/// MATLAB files; the part of a tap is its column in the matrices.
#[derive(Debug)]
pub(crate) struct Mat;

impl ScanFormat for Mat {
    const ENDING: &'static str = "mat";

    fn write(&self, taps: &Taps<'_>, scan: &Scan, _name: &str, path: &Path, list: &mut List<'_>) -> Result<()> {
        let mut columns = Columns::default();
        for &row in &scan.taps {
            let tap = taps.tap(row)?;
            let part = columns.take(&tap, path)?;
            list(&tap, &part)?;
        }
        columns.write(taps.reader(), scan, path).context("write", path)
    }
}

/// What the variables of a file hold: a column, or an element, for each tap.
#[derive(Default)]
struct Columns {
    force: Vec<Vec<f32>>,
    sound: Vec<Vec<f32>>,
    sample_count_max: usize,
    numbers: Vec<[f64; 9]>,
}

/// Names of the row vectors, in the order of their numbers.
const NUMBERS: [&str; 9] = [
    "location", "angle_deg", "offset_mm", "velocity_m_per_s", "velocity_measured_m_per_s", "repetition",
    "sample_count", "microphone_distance_m", "tap_time_s",
];

impl Columns {
    /// Takes a tap, and returns its column; none if it has no samples.
    fn take(&mut self, tap: &ListedTap<'_>, path: &Path) -> Result<String> {
        let Ok((header, samples)) = &tap.record else { return Ok(String::new()) };
        let (id, count) = (&tap.planned.id, header.sample_count as usize);
        for (k, (channel, unit_per_count)) in header.channels().enumerate() {
            #[expect(clippy::cast_possible_truncation, reason = "24 bits hold a 16-bit count's value finely enough")]
            let values = physical(samples, k, count, unit_per_count).into_iter().map(|value| value as f32).collect();
            match channel {
                Channel::Force => self.force.push(values),
                Channel::Sound => self.sound.push(values),
            }
        }
        let unknown = f64::NAN;
        self.numbers.push([
            id.location.into(),
            tap.planned.angle_deg.unwrap_or(unknown),
            id.offset_mm().unwrap_or(unknown),
            id.velocity_m_per_s().unwrap_or(unknown),
            header.velocity_measured_m_per_s,
            id.repetition.into(),
            header.sample_count.into(),
            header.microphone_distance_m,
            if header.tap_time_ns == 0 { unknown } else { header.tap_time_ns as f64 * 1e-9 },
        ]);
        self.sample_count_max = self.sample_count_max.max(count);
        let bytes = self.sample_count_max.saturating_mul(self.numbers.len()).saturating_mul(size_of::<f32>());
        if bytes > VARIABLE_BYTES_MAX {
            return Err(Error::TooLarge { path: path.to_owned(), bytes, most: VARIABLE_BYTES_MAX });
        }
        Ok(known(Some(self.numbers.len() as f64)))
    }

    fn write(&self, reader: &Reader, scan: &Scan, path: &Path) -> io::Result<()> {
        let mut out = BufWriter::new(File::create(path)?);
        let about = format!("MATLAB 5.0 MAT-file, taps of {} shoulder {}, by tapline", scan.tyre, scan.shoulder);
        write!(out, "{:<116}", plain(&about, 116))?;
        out.write_all(&[0; 8])?;
        // Version 0x0100, and by what a reader knows the order of bytes.
        out.write_all(&[0, 1])?;
        out.write_all(b"IM")?;
        let recording = &reader.plan().recording;
        let scalar = |value: f64| std::iter::once(value.to_le_bytes());
        variable(&mut out, "sample_rate_hz", (1, 1), MX_DOUBLE, MI_DOUBLE, scalar(recording.sample_rate_hz))?;
        text(&mut out, "tyre", scan.tyre.as_str())?;
        variable(&mut out, "shoulder", (1, 1), MX_DOUBLE, MI_DOUBLE, scalar(scan.shoulder.into()))?;
        let before = f64::from(recording.pre_trigger_samples);
        variable(&mut out, "pre_trigger_samples", (1, 1), MX_DOUBLE, MI_DOUBLE, scalar(before))?;
        // Samples run down the columns, also where there are more taps than samples.
        variable(&mut out, "time_axis", (1, 1), MX_DOUBLE, MI_DOUBLE, scalar(1.0))?;
        let tap_count = self.numbers.len();
        for (place, name) in NUMBERS.iter().enumerate() {
            let numbers = self.numbers.iter().map(|numbers| numbers[place].to_le_bytes());
            variable(&mut out, name, (1, tap_count), MX_DOUBLE, MI_DOUBLE, numbers)?;
        }
        for (channel, name, unit_name) in
            [(Channel::Force, "force", "force_unit"), (Channel::Sound, "sound", "sound_unit")]
        {
            let unit = recording.calibration.unit(channel).name();
            let channel = if channel == Channel::Force { &self.force } else { &self.sound };
            if channel.len() == tap_count {
                text(&mut out, unit_name, unit)?;
                let padded = |column: &Vec<f32>| {
                    let missing = self.sample_count_max - column.len();
                    column.clone().into_iter().chain(std::iter::repeat_n(f32::NAN, missing))
                };
                let values = channel.iter().flat_map(padded).map(f32::to_le_bytes);
                variable(&mut out, name, (self.sample_count_max, tap_count), MX_SINGLE, MI_SINGLE, values)?;
            }
        }
        out.flush()
    }
}

/// Writes a line of letters.
fn text(out: &mut BufWriter<File>, name: &str, text: &str) -> io::Result<()> {
    let letters: Vec<[u8; 2]> = text.encode_utf16().map(u16::to_le_bytes).collect();
    variable(out, name, (1, letters.len()), MX_CHAR, MI_UINT16, letters.into_iter())
}

/// Writes a packed matrix, whose values come column by column.
fn variable<const N: usize>(
    out: &mut BufWriter<File>,
    name: &str,
    (rows, columns): (usize, usize),
    class: u32,
    kind: u32,
    values: impl Iterator<Item = [u8; N]>,
) -> io::Result<()> {
    let word = |value: usize| u32::try_from(value).map_err(|_too_large| io::Error::other("a matrix is too large"));
    let (value_bytes, name_bytes) = (word(rows * columns * N)?, word(name.len())?);
    let padded = |bytes: u32| bytes.next_multiple_of(8);
    // Flags, shape, name and values, each with a tag of 8 bytes.
    let matrix_bytes = 16 + 16 + (8 + padded(name_bytes)) + (8 + padded(value_bytes));
    let mut head: Vec<u8> = Vec::new();
    for value in [MI_MATRIX, matrix_bytes, MI_UINT32, 8, class, 0, MI_INT32, 8, word(rows)?, word(columns)?] {
        head.extend(value.to_le_bytes());
    }
    head.extend([MI_INT8, name_bytes].map(u32::to_le_bytes).concat());
    head.extend(name.as_bytes());
    head.resize(head.len().next_multiple_of(8), 0);
    head.extend([kind, value_bytes].map(u32::to_le_bytes).concat());
    // How long it is packed is known at its end.
    let tag_at = out.stream_position()?;
    out.write_all(&[MI_COMPRESSED, 0].map(u32::to_le_bytes).concat())?;
    let mut packed = ZlibEncoder::new(&mut *out, Compression::fast());
    packed.write_all(&head)?;
    for value in values {
        packed.write_all(&value)?;
    }
    packed.write_all(&vec![0; (padded(value_bytes) - value_bytes) as usize])?;
    packed.finish()?;
    let end = out.stream_position()?;
    let bytes =
        u32::try_from(end - tag_at - 8).map_err(|_too_large| io::Error::other("a packed matrix is too large"))?;
    out.seek(SeekFrom::Start(tag_at + 4))?;
    out.write_all(&bytes.to_le_bytes())?;
    out.seek(SeekFrom::Start(end))?;
    Ok(())
}
