//! WAV files of 8, 16, 24 and 32 bit.

use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::path::Path;

use tapline_acquire::{WavKind, WavLayout, read_wav_layout};

use crate::error::Fault;
use crate::format::{Pick, Recorded, no_parts};
use crate::series::{Series, checked_count};

/// The samples that are read, also in words.
const READABLE: (&[(WavKind, u16)], &str) = (
    &[
        (WavKind::Integer, 8),
        (WavKind::Integer, 16),
        (WavKind::Integer, 24),
        (WavKind::Integer, 32),
        (WavKind::Float, 32),
    ],
    "integers of 8, 16, 24 and 32 bits, and floats of 32 bits",
);

/// A WAV file.
#[derive(Debug)]
pub(crate) struct Wav {
    file: BufReader<File>,
    layout: WavLayout,
}

impl Wav {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let mut file = BufReader::new(File::open(path)?);
        let file_bytes = file.get_ref().metadata()?.len();
        let layout = read_wav_layout(&mut file, file_bytes, READABLE);
        Ok(Self { file, layout: layout.map_err(|fault| Fault::Broken(fault.to_string()))? })
    }
}

impl Recorded for Wav {
    fn series(&mut self, part: &str, channel: &Pick, _time_axis: Option<u8>) -> Result<Series, Fault> {
        no_parts(part, "WAV")?;
        let WavLayout { kind, bits, channel_count, sample_rate_hz, sample_count, data_at } = self.layout;
        let names: Vec<String> = (1..=channel_count).map(|number| number.to_string()).collect();
        let place = channel.find(names.iter().map(String::as_str))?;
        let bytes = usize::from(bits / 8);
        let mut frame = vec![0; bytes * usize::from(channel_count)];
        let mut words = Vec::with_capacity(checked_count(sample_count.into())?);
        self.file.seek(SeekFrom::Start(data_at))?;
        for _ in 0..sample_count {
            self.file.read_exact(&mut frame)?;
            // The bits of a sample are the upper ones of its word.
            let mut word = [0; 4];
            word[4 - bytes..].copy_from_slice(&frame[place * bytes..][..bytes]);
            words.push(i32::from_le_bytes(word));
        }
        // Integers of 8 bits have no sign: 128 is silence.
        let sign = if bits == 8 { i32::MIN } else { 0 };
        let mut series = match kind {
            WavKind::Integer => {
                Series::of_integers(words.into_iter().map(|word| i64::from((word ^ sign) >> (32 - bits))), bits.into())
            }
            WavKind::Float => {
                Series::of_floats(words.into_iter().map(|word| f32::from_bits(word.cast_unsigned())).collect())?
            }
        };
        series.sample_rate_hz = Some(sample_rate_hz.into());
        Ok(series)
    }
}
