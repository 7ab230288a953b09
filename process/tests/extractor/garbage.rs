//! Random headers and samples without meaning.

use proptest::prelude::*;
use tapline_process::{Extractor, ProcessConfig, Real};
use tapline_wire::{ChannelHeader, Discriminator, Discriminators, Quality, Samples, TapHeader};

use crate::signal::values;

fn any_scale() -> impl Strategy<Value = f64> {
    prop_oneof![4 => 1e-6..1e3_f64, 1 => any::<f64>(), 1 => Just(0.0), 1 => Just(f64::NAN), 1 => Just(f64::MAX)]
}

fn any_header(total: usize) -> impl Strategy<Value = TapHeader> {
    let channels = prop_oneof![8 => 1..=4_u32, 1 => any::<u32>()];
    let exact = prop_oneof![8 => Just(true), 1 => Just(false)];
    let rate = prop_oneof![4 => 1e3..1e6_f64, 1 => any_scale(), 1 => Just(-1.0), 1 => Just(f64::MIN_POSITIVE / 8.0)];
    let distance = prop_oneof![4 => Just(0.0), 4 => 0.0..0.1_f64, 1 => any::<f64>()];
    let pre_trigger = prop_oneof![4 => 0..=(total as u32), 1 => any::<u32>()];
    let codes = prop::array::uniform4((prop_oneof![8 => 1..=2_u32, 1 => any::<u32>()], any_scale()));
    (channels, exact, rate, distance, pre_trigger, any::<u32>(), codes).prop_map(
        move |(channel_count, is_exact, sample_rate_hz, microphone_distance_m, pre_trigger_samples, wild, codes)| {
            TapHeader {
                sample_rate_hz,
                microphone_distance_m,
                pre_trigger_samples,
                channel_count,
                sample_count: if is_exact { (total / channel_count.clamp(1, 4) as usize) as u32 } else { wild },
                channels: codes.map(|(code, unit_per_count)| ChannelHeader { code, unit_per_count, reserved: 0 }),
                ..TapHeader::default()
            }
        },
    )
}

fn any_f32() -> impl Strategy<Value = Vec<f32>> {
    let sample = prop_oneof![20 => -1.0..1.0_f32, 1 => Just(0.0), 1 => -1e38..1e38_f32];
    let wild = prop_oneof![4 => -1.0..1.0_f32, 1 => any::<f32>(), 1 => Just(f32::NAN), 1 => Just(f32::MAX)];
    prop_oneof![
        4 => prop::collection::vec(sample, 0..240),
        2 => prop::collection::vec(wild, 0..24),
        1 => prop::collection::vec(Just(0.5), 0..240),
        1 => prop::collection::vec(prop::num::f32::SUBNORMAL, 0..240),
    ]
}

fn any_i16() -> impl Strategy<Value = Vec<i16>> {
    let any_length = prop::collection::vec(any::<i16>(), 0..240);
    prop_oneof![4 => any_length, 1 => prop::collection::vec(Just(i16::MIN), 0..240)]
}

/// Sets a channel count of one to four for which `total` samples are mostly whole records.
fn whole(mut header: TapHeader, total: usize) -> TapHeader {
    while (1..=4).contains(&header.channel_count) && !(total as u32).is_multiple_of(header.channel_count) {
        header.channel_count -= 1;
        header.sample_count = total as u32 / header.channel_count;
    }
    header
}

/// Configurations that together use every estimator that is not the default.
const OTHERS: [&str; 3] = [
    "f_max = 'polynomial'\ntau = 'impulse'\nsubtract = 'both'\nband_edges = 'fractional'",
    "f_max = 'raw'\ntau = 'width_02'\nsubtract = 'noise'\ndroop_time_constant_s = 0.01",
    "f_max = 'raw'\ntau = 'width_50'\nsubtract = 'hum'\nmains_hz = 900.0\ndroop_time_constant_s = 1e-9\nf_lo_hz = 0.0",
];

fn check<T: Real>(header: &TapHeader, samples: Samples<'_>) -> Result<Discriminators, TestCaseError> {
    for others in OTHERS {
        let config: ProcessConfig = toml::from_str(others).unwrap();
        let found = Extractor::<T>::new(&config).unwrap().extract(header, samples);
        prop_assert!(values(&found).iter().flatten().all(|value| value.is_finite() && *value >= 0.0), "{:?}", found);
    }
    let config = ProcessConfig { f_lo_hz: 0.0, f_top_hz: 1e5, f_hi_hz: 5e4, ..ProcessConfig::default() };
    let found = Extractor::<T>::new(&config).unwrap().extract(header, samples);
    let absent = values(&found).iter().filter(|value| value.is_none()).count();
    prop_assert!(values(&found).iter().flatten().all(|value| value.is_finite() && *value >= 0.0), "{:?}", found);
    prop_assert!(absent == 0 || !found.quality.is_empty(), "{:?}", found);
    prop_assert!(!found.quality.contains(Quality::REFUSED) || absent == Discriminator::COUNT);
    Ok(found)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Catches a panic, a value that is not a number, and a value absent without a flag, of any `f32` record.
    #[test]
    fn any_f32_record((samples, header) in any_f32().prop_flat_map(|s| { let n = s.len(); (Just(s), any_header(n)) })) {
        for header in [header, whole(header, samples.len())] {
            let single = check::<f32>(&header, Samples::F32(&samples))?;
            let double = check::<f64>(&header, Samples::F32(&samples))?;
            prop_assert_eq!(values(&single)[..3].to_vec(), values(&double)[..3].to_vec());
        }
    }

    /// The same of any `i16` record.
    #[test]
    fn any_i16_record((samples, header) in any_i16().prop_flat_map(|s| { let n = s.len(); (Just(s), any_header(n)) })) {
        for header in [header, whole(header, samples.len())] {
            check::<f32>(&header, Samples::I16(&samples))?;
            check::<f64>(&header, Samples::I16(&samples))?;
        }
    }
}
