//! WAV files of 8, 16, 24 and 32 bit, by hound.

use std::fs::File;
use std::io::{BufReader, Chain, Cursor, Read, Seek, SeekFrom, Take};
use std::path::Path;

use hound::{SampleFormat, WavReader};

use crate::error::{Fault, broken};
use crate::format::{Pick, Recorded, no_parts};
use crate::series::{Series, checked_count};

/// Most chunks before the samples.
const CHUNKS_MAX: usize = 256;

/// Longest description of a format; extensible ones have 40 bytes.
const FORMAT_BYTES_MAX: u32 = 1024;

/// The header and the samples of a file, without the chunks between them.
type Plain = Chain<Cursor<Vec<u8>>, Take<BufReader<File>>>;

/// A WAV file.
#[derive(Debug)]
pub(crate) struct Wav {
    file: File,
}

impl Wav {
    pub(crate) fn open(file: &Path) -> Result<Self, Fault> {
        let wav = Self { file: File::open(file)? };
        wav.reader()?;
        Ok(wav)
    }

    /// A reader at the first sample.
    ///
    /// hound is given a file of two chunks: it does not skip the byte behind a chunk of odd length, which editors write.
    fn reader(&self) -> Result<WavReader<Plain>, Fault> {
        let file_bytes = self.file.metadata()?.len();
        let mut file = BufReader::new(self.file.try_clone()?);
        file.seek(SeekFrom::Start(0))?;
        let mut header: [u8; 12] = take(&mut file)?;
        match (&header[..4], &header[8..]) {
            (b"RIFF", b"WAVE") => {}
            (b"RF64" | b"RIFX", _) => return broken("RF64 and RIFX are not read, only RIFF"),
            _ => return broken("is not WAV: it does not start with RIFF and WAVE"),
        }
        let mut plain = Vec::new();
        for _ in 0..CHUNKS_MAX {
            let start: [u8; 8] = take(&mut file)?;
            let [k0, k1, k2, k3, length @ ..] = start;
            let length = u32::from_le_bytes(length);
            match &[k0, k1, k2, k3] {
                b"fmt " if length > FORMAT_BYTES_MAX => {
                    return broken(format!("its format has {length} bytes; at most {FORMAT_BYTES_MAX} are read"));
                }
                b"fmt " => {
                    plain = start.to_vec();
                    let before = plain.len();
                    file.by_ref().take(length.into()).read_to_end(&mut plain)?;
                    if plain.len() - before < length as usize {
                        return broken("it ends within its format");
                    }
                    file.seek_relative(i64::from(length % 2))?;
                }
                b"data" => {
                    let at = file.stream_position()?;
                    let got = file_bytes.saturating_sub(at);
                    if u64::from(length) > got {
                        return broken(format!("its header promises {length} bytes of samples; it holds {got}"));
                    }
                    if plain.is_empty() {
                        return broken("its samples come before their format");
                    }
                    let all = u32::try_from(plain.len()).unwrap_or(0).saturating_add(length).saturating_add(12);
                    header[4..8].copy_from_slice(&all.to_le_bytes());
                    let beginning = [&header[..], &plain, &start].concat();
                    let reader = WavReader::new(Cursor::new(beginning).chain(file.take(length.into())));
                    return reader.map_err(|error| fault_of(&error));
                }
                _ => file.seek_relative(i64::from(length) + i64::from(length % 2))?,
            }
        }
        broken(format!("no samples come within its first {CHUNKS_MAX} chunks"))
    }
}

fn take<const N: usize>(file: &mut impl Read) -> Result<[u8; N], Fault> {
    let mut bytes = [0; N];
    match file.read_exact(&mut bytes) {
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => broken("it ends within its header"),
        Err(error) => Err(error.into()),
        Ok(()) => Ok(bytes),
    }
}

fn fault_of(error: &hound::Error) -> Fault {
    match error {
        hound::Error::Unsupported => {
            Fault::Broken("its kind of samples is not read: only integers of 8, 16, 24 and 32 bits, and floats".into())
        }
        error => Fault::Broken(format!("is not valid WAV: {error}")),
    }
}

impl Recorded for Wav {
    fn parts(&self, _depth: usize) -> Result<Vec<String>, Fault> {
        Ok(Vec::new())
    }

    fn series(&mut self, part: &str, channel: &Pick, _time_axis: Option<u8>) -> Result<Series, Fault> {
        no_parts(part, "WAV")?;
        let mut reader = self.reader()?;
        let spec = reader.spec();
        let names: Vec<String> = (1..=spec.channels).map(|number| number.to_string()).collect();
        let place = channel.find(names.iter().map(String::as_str))?;
        let sample_count = checked_count(reader.duration().into())?;
        let step = usize::from(spec.channels);
        let mut series = match spec.sample_format {
            SampleFormat::Int => {
                let mut integers = Vec::with_capacity(sample_count);
                for sample in reader.samples::<i32>().skip(place).step_by(step) {
                    integers.push(i64::from(sample.map_err(|error| fault_of(&error))?));
                }
                Series::of_integers(integers, spec.bits_per_sample.into())
            }
            SampleFormat::Float => {
                let samples = reader.samples::<f32>().skip(place).step_by(step);
                Series::of_floats(samples.collect::<Result<_, _>>().map_err(|error| fault_of(&error))?)?
            }
        };
        series.sample_rate_hz = Some(spec.sample_rate.into());
        Ok(series)
    }
}
