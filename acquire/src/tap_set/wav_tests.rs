//! Tests of the WAV reader, with `hound` as writer and as oracle.

use std::io::Cursor;

use hound::{Sample, SampleFormat as Kind, WavReader, WavSpec, WavWriter};
use proptest::prelude::*;
use tapline_wire::{CacheLine, SampleFormat, bytes_of, cache_lines_for};

use super::*;

fn spec(channels: u16, bits_per_sample: u16, sample_format: Kind) -> WavSpec {
    WavSpec { channels, sample_rate: 40_960, bits_per_sample, sample_format }
}

fn wav<S: Sample + Copy>(spec: WavSpec, samples: &[S]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = WavWriter::new(&mut bytes, spec).unwrap();
    samples.iter().for_each(|&s| writer.write_sample(s).unwrap());
    writer.finalize().unwrap();
    bytes.into_inner()
}

fn wav_i16(channels: u16, samples: &[i16]) -> Vec<u8> {
    wav(spec(channels, 16, Kind::Int), samples)
}

fn wav_f32(channels: u16, samples: &[f32]) -> Vec<u8> {
    wav(spec(channels, 32, Kind::Float), samples)
}

/// The samples of a WAV file as bytes, planar.
fn read(bytes: &[u8]) -> Result<(WavHeader, Vec<u8>), WavFault> {
    let header = read_header(Cursor::new(bytes), bytes.len() as u64)?;
    let mut buffer = vec![CacheLine::default(); cache_lines_for(header.data_bytes)];
    header.read_samples(Cursor::new(bytes), &mut Vec::new(), &mut buffer)?;
    Ok((header, bytes_of(&buffer)[..header.data_bytes].to_vec()))
}

fn fault(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

fn planar<T: Copy>(samples: &[T], channels: usize) -> Vec<T> {
    (0..channels).flat_map(|c| samples.iter().skip(c).step_by(channels).copied()).collect()
}

proptest! {
    /// Catches samples that are changed, moved or lost, compared with what hound wrote; one channel has its own code.
    #[test]
    fn what_was_written_is_read(channels in 1u16..=4, counts in proptest::collection::vec(any::<i16>(), 4..200)) {
        let whole = counts.len() / usize::from(channels) * usize::from(channels);
        let counts = &counts[..whole];
        let (header, bytes) = read(&wav_i16(channels, counts)).unwrap();
        let want: Vec<u8> = planar(counts, channels.into()).into_iter().flat_map(i16::to_ne_bytes).collect();
        prop_assert_eq!((header.format, header.channel_count, header.sample_rate_hz), (SampleFormat::I16, channels, 40_960));
        prop_assert_eq!(header.sample_count as usize * usize::from(channels), whole);
        prop_assert_eq!(bytes, want);

        let floats: Vec<f32> = counts.iter().map(|&c| f32::from(c) / 300.0).collect();
        let (header, bytes) = read(&wav_f32(channels, &floats)).unwrap();
        let want: Vec<u8> = planar(&floats, channels.into()).into_iter().flat_map(f32::to_ne_bytes).collect();
        prop_assert_eq!(header.format, SampleFormat::F32);
        prop_assert_eq!(bytes, want);
    }

    /// Catches samples read with a damaged header that hound, where it reads the file at all, reads differently.
    #[test]
    fn a_damaged_header_is_refused_or_read_as_the_oracle_reads_it(at in 0usize..44, byte in any::<u8>()) {
        let mut bytes = wav_i16(2, &[1, 2, 3, 4, 5, 6]);
        bytes[at] = byte;
        if let (Ok((_, ours)), Ok(mut theirs)) = (read(&bytes), WavReader::new(Cursor::new(&bytes))) {
            let channels = usize::from(theirs.spec().channels);
            if let Ok(theirs) = theirs.samples::<i16>().collect::<Result<Vec<_>, _>>() {
                let theirs: Vec<u8> = planar(&theirs, channels).into_iter().flat_map(i16::to_ne_bytes).collect();
                prop_assert_eq!(ours, theirs);
            }
        }
    }
}

/// Catches a fault that is ignored, or reported without its numbers.
#[test]
fn every_fault_has_its_reason() {
    let good = wav_i16(2, &[1, 2, 3, 4]);
    let data_at = good.len() - 8;
    let with = |at: usize, new: &[u8]| {
        let mut bytes = good.clone();
        bytes[at..at + new.len()].copy_from_slice(new);
        bytes
    };
    for (bytes, want) in [
        (Vec::new(), "not a WAV file: it is empty"),
        (b"ID3 this is no wave file".to_vec(), "not a WAV file: it does not start with RIFF and WAVE"),
        (with(0, b"RF64"), "RF64 and RIFX are not read"),
        (good[..20].to_vec(), "it ends at byte 20, within its header"),
        (good[..36].to_vec(), "no samples chunk"),
        (with(12, b"junk"), "its samples come before their format"),
        (with(22, &[0, 0]), "it has no channels"),
        (with(32, &[8]), "the header gives 8 bytes to a sample of all 2 channels; 16 bits need 4"),
        (with(20, &[7]), "16-bit mu-law samples are not supported"),
        (with(20, &[0x55]), "16-bit (format 0x0055) samples are not supported; 16-bit integer and 32-bit float are"),
        (good[..data_at].to_vec(), "it is cut short: the header promises 8 bytes of samples, the file holds 0"),
        (good[..good.len() - 3].to_vec(), "the header promises 8 bytes of samples, the file holds 5"),
        (with(data_at - 4, &[0xff; 4]), "promises 4294967295 bytes of samples, the file holds 8"),
        (with(data_at - 4, &[6]), "6 bytes of samples are not a whole number of 4-byte samples"),
        (wav_i16(1, &[]), "it has no samples"),
        (wav_f32(2, &[0.0, 1.0, 2.0, f32::NAN]), "sample 1 of channel 1 (both from 0) is NaN, not a finite number"),
        (wav_f32(1, &[0.0, f32::NEG_INFINITY]), "sample 1 of channel 0 (both from 0) is -inf"),
    ] {
        let got = fault(&bytes);
        assert!(got.contains(want), "{got:?} lacks {want:?}");
    }
}

/// Catches 24- and 32-bit integers that are mistaken for another format, plain or extensible.
#[test]
fn other_depths_are_refused() {
    for (bits, want) in [
        (8, "8-bit integer samples are not supported"),
        (24, "24-bit integer samples are not supported; 16-bit integer and 32-bit float are"),
        (32, "32-bit integer samples are not supported"),
    ] {
        let got = fault(&wav(spec(1, bits, Kind::Int), &[1i32]));
        assert!(got.contains(want), "{got:?} lacks {want:?}");
    }
}

/// Catches a chunk before the samples that is not skipped; hound itself fails at a padded one.
#[test]
fn other_chunks_are_stepped_over() {
    let good = wav_i16(1, &[7, -8]);
    let at = good.len() - 12;
    for chunk in [&b"LIST\x03\0\0\0abc\0"[..], b"fact\x04\0\0\0\x02\0\0\0", b"cue \0\0\0\0"] {
        let bytes: Vec<u8> = [&good[..at], chunk, &good[at..], b"trailing chunk"].concat();
        let (header, samples) = read(&bytes).unwrap();
        assert_eq!((header.sample_count, samples), (2, [7i16, -8].map(i16::to_ne_bytes).concat()));
    }
}

/// Catches an extensible header, which is usual for more than two channels, that is not understood.
#[test]
fn an_extensible_header_is_read() {
    let bytes = wav_i16(3, &[1, 2, 3]);
    assert_eq!(bytes[20..22], [0xfe, 0xff], "hound writes three channels as extensible");
    assert_eq!(read(&bytes).unwrap().0.channel_count, 3);
    let mut strange = bytes;
    strange[50] ^= 1;
    assert!(fault(&strange).contains("are not supported"));
}

/// Catches an endless chain of chunks.
#[test]
fn the_search_for_samples_ends() {
    let chain = [&wav_i16(1, &[1])[..36], &b"junk\0\0\0\0".repeat(1000)].concat();
    assert!(fault(&chain).contains("256 chunks"));
}
