//! Quality flags of recordings that are stored beside the repository.

use tapline_process::{Extractor, ProcessConfig};
use tapline_wire::{Channel, Quality, Samples, TapHeader};

use crate::plant::{Flags, N, RATE_HZ, TAPS, Tap, peak};
use crate::signal::values;

/// Contents of a recording beside the repository; `None` if it is not there.
fn shared(file: &str) -> Option<Vec<u8>> {
    tapline_testing::shared(file).map(|path| std::fs::read(path).unwrap())
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// Element at `at` of a MATLAB 5 file: type, range of its data, which may be in the tag itself, and end.
fn element(bytes: &[u8], at: usize) -> (usize, std::ops::Range<usize>, usize) {
    let (kind, size) = (u32_at(bytes, at), u32_at(bytes, at + 4));
    if kind >> 16 != 0 {
        return (kind & 0xffff, at + 4..at + 4 + (kind >> 16), at + 8);
    }
    (kind, at + 8..at + 8 + size, at + 8 + size.next_multiple_of(8))
}

/// The array `name` of a MATLAB 5 file, of any numeric type.
fn matlab_array(bytes: &[u8], name: &str) -> Vec<f32> {
    let mut at = 128;
    loop {
        let (_, matrix, next) = element(bytes, at);
        let (_, _, dims) = element(bytes, matrix.start);
        let (_, _, named) = element(bytes, dims);
        let (_, text, values) = element(bytes, named);
        if &bytes[text] == name.as_bytes() {
            let (kind, data, _) = element(bytes, values);
            return match kind {
                7 => bytes[data].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect(),
                9 => bytes[data].chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap()) as f32).collect(),
                _ => panic!("numbers of type {kind}"),
            };
        }
        at = next;
    }
}

/// Catches a value of a real record that contains none: a pulse of two or three samples, cut at its beginning, with
/// nothing before it.
#[test]
fn the_recorded_bad_impact_is_refused_for_the_right_reasons() {
    let Some(file) = shared("vibrationtesting-impact/case1.mat") else { return };
    let samples: Vec<f32> = ["Time_chan_1", "Time_chan_2"].iter().flat_map(|name| matlab_array(&file, name)).collect();
    assert_eq!(samples.len(), 2 * 4096);
    for pre_trigger_samples in [0, 100] {
        let header = TapHeader::in_units(1280.0, pre_trigger_samples, 4096, &Channel::BOTH);
        let found = Extractor::<f64>::new(&ProcessConfig::default()).unwrap().extract(&header, Samples::F32(&samples));
        assert!(found.quality.contains(Quality::UNDERSAMPLED), "{}", found.quality);
        assert!(found.quality.contains(Quality::LATE_TRIGGER), "{}", found.quality);
        assert_eq!(found.quality.contains(Quality::NO_BASELINE), pre_trigger_samples == 0);
        assert_eq!(values(&found), [None; tapline_wire::Discriminator::COUNT], "{}", found.quality);
    }
}

/// Catches noise that is underestimated because a real room is quiet by chance. Background recorded by a microphone,
/// mostly rumble below the bands, is flagged if it is loud, and not if it is quiet.
#[test]
fn recorded_background() {
    let Some(file) = shared("pyuff-microphone/Sample_UFF58b_bin.uff") else { return };
    const COUNT: usize = 79_292;
    const BACKGROUND_HZ: f64 = 65_536.0;
    let data = &file[572..572 + 4 * COUNT];
    let pa: Vec<f64> = data.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
    let background = |k: usize| {
        let from = k * 331 % (COUNT - 27_000);
        let at = |i: usize| from as f64 + i as f64 * BACKGROUND_HZ / RATE_HZ;
        let part: Vec<f64> = (0..N)
            .map(|i| pa[at(i) as usize] * (1.0 - at(i).fract()) + pa[at(i) as usize + 1] * at(i).fract())
            .collect();
        let mean = part.iter().sum::<f64>() / N as f64;
        let sigma = (part.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / N as f64).sqrt();
        part.into_iter().map(move |x| (x - mean) / sigma)
    };
    let loud = |part: f64| {
        let background = &background;
        move |k: usize, tap: &mut Tap| {
            let sigma = part * peak(&tap.sound);
            tap.sound.iter_mut().zip(background(k)).for_each(|(x, e)| *x += sigma * e);
        }
    };
    for part in [0.05, 0.1, 0.3] {
        Flags::with_fault(&TAPS, loud(part)).assert_raised(Quality::LOW_SNR, &format!("background {part}"));
    }
    for (k, tap) in TAPS.iter().enumerate() {
        let mut tap = tap.clone();
        loud(0.003)(k, &mut tap);
        assert!(tap.flags().is_empty(), "{}", tap.flags());
    }
}
