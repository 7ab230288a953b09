//! Prints the discriminators of recorded taps, as CSV with all digits; `tests/scipy_compare.py` compares them with
//! scipy's.
//!
//! ```text
//! cargo run --release -p tapline-process --example recorded -- f64 200000 500 sound a.wav b.wav
//! ```
#![expect(clippy::print_stdout, reason = "its output is its purpose")]

use std::error::Error;

use tapline_process::{Precision, ProcessConfig, ProcessExtractor};
use tapline_wire::{Channel, ChannelHeader, Discriminator, SampleFormat, Samples, TapHeader};

/// Samples of a WAV file, planar.
enum Recorded {
    I16(Vec<i16>),
    F32(Vec<f32>),
}

fn planar<S: Copy>(interleaved: &[S], channel_count: usize) -> Vec<S> {
    (0..channel_count).flat_map(|c| interleaved.iter().skip(c).step_by(channel_count).copied()).collect()
}

fn read(path: &str, channel_count: usize) -> Result<(Recorded, usize, f64), hound::Error> {
    let mut wav = hound::WavReader::open(path)?;
    Ok(match wav.spec().sample_format {
        hound::SampleFormat::Int => {
            let samples = wav.samples::<i16>().collect::<Result<Vec<_>, _>>()?;
            (Recorded::I16(planar(&samples, channel_count)), samples.len() / channel_count, 1.0 / 32768.0)
        }
        hound::SampleFormat::Float => {
            let samples = wav.samples::<f32>().collect::<Result<Vec<_>, _>>()?;
            (Recorded::F32(planar(&samples, channel_count)), samples.len() / channel_count, 1.0)
        }
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [precision, rate, pre_trigger, channels, paths @ ..] = arguments.as_slice() else {
        return Err("expected: f32|f64 RATE_HZ PRE_TRIGGER CHANNEL[,CHANNEL] FILE.wav...".into());
    };
    let precision = if precision == "f64" { Precision::F64 } else { Precision::F32 };
    let mut extractor = ProcessExtractor::new(&ProcessConfig { precision, ..ProcessConfig::default() })?;
    let channels: Vec<Channel> =
        channels.split(',').map(|name| if name == "force" { Channel::Force } else { Channel::Sound }).collect();
    println!("file,{},quality", Discriminator::ALL.map(Discriminator::column).join(","));
    for path in paths {
        let (recorded, count, unit_per_count) = read(path, channels.len())?;
        let (format, samples) = match &recorded {
            Recorded::I16(samples) => (SampleFormat::I16, Samples::I16(samples)),
            Recorded::F32(samples) => (SampleFormat::F32, Samples::F32(samples)),
        };
        let mut header = TapHeader {
            sample_rate_hz: rate.parse()?,
            pre_trigger_samples: pre_trigger.parse()?,
            sample_count: u32::try_from(count)?,
            sample_format: format.code(),
            channel_count: u32::try_from(channels.len())?,
            ..TapHeader::default()
        };
        for (slot, kind) in header.channels.iter_mut().zip(&channels) {
            *slot = ChannelHeader { code: kind.code(), unit_per_count, ..ChannelHeader::default() };
        }
        let found = extractor.extract(&header, samples);
        let cells = Discriminator::ALL.map(|d| found.values.get(d).map_or(String::new(), |x| format!("{x:e}")));
        println!("{path},{},{}", cells.join(","), found.quality);
    }
    Ok(())
}
