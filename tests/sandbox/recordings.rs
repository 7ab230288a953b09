//! A tap set from elsewhere: a ring of synthetic taps.

use std::fs;
use std::path::Path;

use crate::sandbox::Sandbox;

/// Its `scan.toml`.
pub(crate) const SCAN: &str = "
geometry = \"ring\"
channels = [\"force\", \"sound\"]
sample_rate_hz = 41000
pre_trigger_samples = 400
force_full_scale_n = 222.0
sound_full_scale_v = 5.0
microphone_distance_m = 0.05
";
/// The columns of its `taps.csv`.
pub(crate) const COLUMNS: &str = "file,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition";
/// Taps that it has.
pub(crate) const LOCATIONS: u32 = 24;

/// A sample of the synthetic tap: a half-sine of force and a decaying sound, both with a little noise.
fn sample(channel: usize, k: u32, location: u32) -> f64 {
    let t = (f64::from(k) - 400.0) / 41e3;
    let noise = f64::from((k * 7919 + location * 104_729 + channel as u32 * 31) % 101) / 101.0 - 0.5;
    let scatter = 1.0 + 0.01 * f64::from(location * 37 % 11);
    let value = match channel {
        0 if (0.0..9e-4).contains(&t) => 0.14 * scatter * (std::f64::consts::PI * t / 9e-4).sin(),
        1 if t >= 1.5e-4 => -0.1 * scatter * (-120.0 * t).exp() * (5000.0 * t).sin(),
        _ => 0.0,
    };
    value + 1e-3 * noise
}

/// Writes the synthetic tap at `location` as a 16-bit WAV of `count` samples a channel.
pub(crate) fn write_wav(path: &Path, channels: u16, rate: u32, count: u32, location: u32) {
    let spec =
        hound::WavSpec { channels, sample_rate: rate, bits_per_sample: 16, sample_format: hound::SampleFormat::Int };
    let mut wav = hound::WavWriter::create(path, spec).unwrap();
    for k in 0..count {
        for channel in 0..usize::from(channels) {
            wav.write_sample((sample(channel, k, location) * 32768.0).round() as i16).unwrap();
        }
    }
    wav.finalize().unwrap();
}

/// Writes the synthetic tap at `location` as a WAV of 32-bit floats.
pub(crate) fn write_float_wav(path: &Path, location: u32) {
    let spec = hound::WavSpec {
        channels: 2,
        sample_rate: 41_000,
        bits_per_sample: 32,
        sample_format: hound::SampleFormat::Float,
    };
    let mut wav = hound::WavWriter::create(path, spec).unwrap();
    for k in 0..4096 {
        for channel in 0..2 {
            wav.write_sample(sample(channel, k, location) as f32).unwrap();
        }
    }
    wav.finalize().unwrap();
}

/// A sound ring of recordings in the folder `taps`.
pub(crate) fn tap_set() -> Sandbox {
    let sandbox = Sandbox::new();
    fs::create_dir(sandbox.path("taps")).unwrap();
    sandbox.write("taps/scan.toml", SCAN);
    let mut table = COLUMNS.to_owned();
    for location in 0..LOCATIONS {
        let file = format!("{location:03}.wav");
        write_wav(&sandbox.path("taps").join(&file), 2, 41_000, 4096, location);
        table += &format!("\n{file},A-17,1,5,1.85,{location},{},0", f64::from(location) * 15.0);
    }
    sandbox.write("taps/taps.csv", &table);
    sandbox
}
