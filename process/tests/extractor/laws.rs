//! Laws of any tap: how values depend on the scale, the trigger and the order of channels.

use tapline_process::{Extractor, Precision, ProcessConfig, ProcessExtractor};
use tapline_wire::{Channel, Discriminator, Quality, RecordPart, Samples, TapId};

use crate::reference::CASES;
use crate::signal::{Case, Recorded, assert_close, values};

fn tap() -> Case {
    Case { noise: 0.0, count: 8192, ..CASES[0].0 }
}

/// 1 for discriminators computed from one of `parts`, 0 for the others.
fn only(parts: &[RecordPart]) -> [u8; Discriminator::COUNT] {
    Discriminator::ALL.map(|which| parts.contains(&which.part()).into())
}

/// Catches a scale that is left out or applied twice: F_max, A_1, A_2 are linear in it, P_f, E_f quadratic.
#[test]
fn values_follow_the_scale() {
    let case = CASES[1].0;
    let recorded = case.recorded();
    let mut header = case.header();
    let mut extractor = Extractor::<f64>::new(&case.config()).unwrap();
    let before = values(&extractor.extract(&header, recorded.samples()));
    header.channels[0].unit_per_count *= 3.0;
    header.channels[1].unit_per_count *= -0.1;
    let after = extractor.extract(&header, recorded.samples());
    let mut expected = before;
    for (value, factor) in expected.iter_mut().zip([3.0, 1.0, 0.1, 0.1, 1.0, 0.01, 0.01]) {
        *value = value.map(|x| x * factor);
    }
    assert_close(&after, expected, 1e-12, "scaled");
}

/// Catches dependence on the position of the impact in the record (a window over the record would move PR by 0.2).
#[test]
fn values_stay_when_the_trigger_moves() {
    let early = Case { distance: 0.2, ..tap() }.extract::<f64>();
    let late = Case { distance: 0.2, p: 900, onset: tap().onset + 500.0, ..tap() }.extract::<f64>();
    let early = values(&early);
    // The part of the tail that leaves the record has fallen to 1e-4 for the 310 Hz mode.
    assert_close(&late, early, 1e-4, "later");
    let shared = [early[0], early[1], early[2]];
    for (x, y) in shared.into_iter().zip(values(&late)) {
        let (x, y) = (x.unwrap(), y.unwrap());
        assert!((x / y - 1.0).abs() < 1e-4);
    }
}

/// Catches an offset that changes a value.
#[test]
fn values_stay_under_an_offset() {
    let plain = Case { is_i16: true, force_unit: 0.01, sound_unit: 1e-4, ..tap() };
    let Recorded::I16(mut samples) = plain.recorded() else { unreachable!() };
    let expected = plain.extract::<f64>();
    for x in &mut samples {
        *x += 1234;
    }
    let found = Extractor::<f64>::new(&plain.config()).unwrap().extract(&plain.header(), Samples::I16(&samples));
    assert_close(&found, values(&expected), 1e-12, "offset");
}

/// Catches a distance that is ignored, or a wrong speed of sound: the shifts of both channels cancel.
#[test]
fn microphone_distance_is_travelled() {
    let near = tap().extract::<f64>();
    let far = Case { distance: 0.343, ..tap() }.extract::<f64>(); // 1 ms, 40.96 samples
    assert!((values(&near)[2].unwrap() / values(&far)[2].unwrap() - 1.0).abs() < 1e-3);
    let mut header = Case { distance: 0.343, ..tap() }.header();
    header.microphone_distance_m = 0.0;
    let recorded = Case { distance: 0.343, ..tap() }.recorded();
    let deaf = Extractor::<f64>::new(&tap().config()).unwrap().extract(&header, recorded.samples());
    assert!(values(&deaf)[2].unwrap() < 0.5 * values(&far)[2].unwrap());
}

/// Catches an extractor with memory: taps in any order give the same bits.
#[test]
fn results_do_not_depend_on_what_came_before() {
    let mut extractor = Extractor::<f32>::new(&ProcessConfig::default()).unwrap();
    let taps: Vec<_> = CASES.iter().map(|(case, _)| (case.header(), case.recorded())).collect();
    let alone = taps.iter().map(|(header, recorded)| {
        Extractor::<f32>::new(&ProcessConfig::default()).unwrap().extract(header, recorded.samples())
    });
    let alone: Vec<_> = alone.map(|found| values(&found)).collect();
    for order in [[0, 5, 3, 1, 9, 8], [8, 9, 1, 3, 5, 0]] {
        for i in order {
            assert_eq!(values(&extractor.extract(&taps[i].0, taps[i].1.samples())), alone[i]);
        }
    }
}

/// Catches a sample after `record_s` that changes a value or a flag, and a channel cut at another channel's end: the
/// twin is a record that ended there.
#[test]
fn record_s_is_where_the_record_ends() {
    for (case, _) in CASES {
        let (header, recorded) = (case.header(), case.recorded());
        let used = case.count / 8 * 5;
        let short = tapline_wire::TapHeader { sample_count: used, ..header };
        let (whole, used) = (case.count as usize, used as usize);
        let cut = match &recorded {
            Recorded::I16(all) => Recorded::I16(all.chunks(whole).flat_map(|track| &track[..used]).copied().collect()),
            Recorded::F32(all) => Recorded::F32(all.chunks(whole).flat_map(|track| &track[..used]).copied().collect()),
        };
        let extractor = |record_s| Extractor::<f32>::new(&ProcessConfig { record_s, ..case.config() }).unwrap();
        let record_s = (f64::from(short.sample_count) - 0.5) / case.rate;
        let expected = extractor(0.0).extract(&short, cut.samples());
        for found in [
            extractor(record_s).extract(&header, recorded.samples()),
            extractor(record_s).extract(&short, cut.samples()),
        ] {
            assert_eq!((values(&found), found.quality), (values(&expected), expected.quality), "{}", case.name);
        }
        // A record that ends earlier is used as it is.
        let of_all = extractor(1e9).extract(&header, recorded.samples());
        assert_eq!(values(&of_all), values(&extractor(0.0).extract(&header, recorded.samples())));
        assert_ne!(values(&of_all), values(&expected), "{}: nothing was cut", case.name);
    }
}

/// Catches an identity that is lost, and a configured precision that is ignored.
#[test]
fn identity_and_precision_are_kept() {
    let (case, _) = CASES[0];
    let mut id = TapId::default();
    id.location = 17;
    let header = tapline_wire::TapHeader { id, plan_index: 5, velocity_measured_m_per_s: 1.85, ..case.header() };
    let recorded = case.recorded();
    let extracted = |precision| {
        let config = ProcessConfig { precision, ..case.config() };
        ProcessExtractor::new(&config).unwrap().extract(&header, recorded.samples())
    };
    let (single, double) = (extracted(Precision::F32), extracted(Precision::F64));
    assert_eq!((single.id.location, single.plan_index), (17, 5));
    assert!((single.velocity_measured_m_per_s - 1.85).abs() < 1e-15);
    assert_eq!(values(&double), values(&case.extract::<f64>()));
    assert_eq!(values(&single), values(&case.extract::<f32>()));
    assert_ne!(values(&single), values(&double));
}

/// Catches an f_c that does not follow, follows another tau, or is used above f_hi.
#[test]
fn f_c_follows_tau_or_the_spectrum_is_absent() {
    let follows = ProcessConfig { f_c_follows_tau: true, ..ProcessConfig::default() };
    let pr = |case: Case, config: &ProcessConfig| {
        let found = Extractor::<f64>::new(config).unwrap().extract(&case.header(), case.recorded().samples());
        (found.values.get(Discriminator::Pr), found.quality)
    };
    let tau_s = values(&tap().extract::<f64>())[1].unwrap();
    let fixed = ProcessConfig { f_c_hz: 1.0 / (2.0 * tau_s), ..ProcessConfig::default() };
    assert_eq!(pr(tap(), &follows), pr(tap(), &fixed));
    // 0.2 ms asks for at least 2.5 kHz, which is above f_hi: the band is empty.
    let (none, quality) = pr(Case { tau: 0.2e-3, ..tap() }, &follows);
    assert!(none.is_none() && quality.contains(Quality::NO_BAND), "{quality}");
    // Without tau, the fixed f_c and the flag that says so.
    let no_force = Case { has_force: false, ..tap() };
    assert_eq!(pr(no_force, &follows), pr(no_force, &ProcessConfig::default()));
}

/// Catches zeros and NaN instead of absent values: dead channels, broken scales, bad samples.
#[test]
fn bad_channels_take_only_their_own_values() {
    let case = tap();
    let header = case.header();
    let Recorded::F32(good) = case.recorded() else { unreachable!() };
    let n = case.count as usize;
    let present = |change: &dyn Fn(&mut tapline_wire::TapHeader, &mut [f32])| {
        let (mut header, mut samples) = (header, good.clone());
        change(&mut header, &mut samples);
        let found = Extractor::<f32>::new(&case.config()).unwrap().extract(&header, Samples::F32(&samples));
        (values(&found).map(|value| u8::from(value.is_some())), found.quality)
    };
    assert_eq!(present(&|_, _| {}), ([1; Discriminator::COUNT], Quality::default()));
    assert_eq!(
        present(&|_, x| x[..n].fill(0.0)),
        (only(&[RecordPart::SoundSpectrum]), Quality::NO_FORCE | Quality::NO_PULSE)
    );
    assert_eq!(present(&|_, x| x[n..].fill(0.25)), (only(&[RecordPart::Pulse]), Quality::NO_SOUND | Quality::NO_ONSET));
    assert_eq!(present(&|_, x| x[5000] = f32::NAN), (only(&[RecordPart::SoundSpectrum]), Quality::NON_FINITE));
    assert_eq!(present(&|_, x| x[n + 5000] = f32::INFINITY), (only(&[RecordPart::Pulse]), Quality::NON_FINITE));
    assert_eq!(
        present(&|h, _| h.channels[1].unit_per_count = f64::NAN),
        (only(&[RecordPart::Pulse]), Quality::NON_FINITE)
    );
    assert_eq!(present(&|h, _| h.channels[1].unit_per_count = 0.0).1, Quality::NO_SOUND | Quality::NO_ONSET);
    assert_eq!(
        present(&|h, _| h.channels[0].unit_per_count = 0.0),
        (only(&[RecordPart::SoundSpectrum]), Quality::NO_PULSE)
    );
    assert_eq!(
        present(&|h, _| h.channels[0].unit_per_count = -1.0),
        (only(&[RecordPart::SoundSpectrum]), Quality::NO_PULSE)
    );
    assert_eq!(present(&|h, _| h.channels[1].code = 0), (only(&[RecordPart::Pulse]), Quality::NO_SOUND));
    assert_eq!(present(&|h, _| h.channels[0].code = Channel::Sound.code()).1, Quality::NO_FORCE);
    assert_eq!(present(&|h, _| h.pre_trigger_samples = 1), (only(&[RecordPart::SoundSpectrum]), Quality::NO_BASELINE));
    assert_eq!(
        present(&|h, _| h.pre_trigger_samples = 9000),
        (only(&[RecordPart::SoundSpectrum]), Quality::NO_BASELINE)
    );
    assert_eq!(
        present(&|h, _| h.microphone_distance_m = f64::NAN),
        (only(&[RecordPart::Pulse, RecordPart::SoundSpectrum]), Quality::NO_ONSET)
    );
    assert_eq!(
        present(&|h, _| h.microphone_distance_m = -9.0),
        (only(&[RecordPart::Pulse, RecordPart::SoundSpectrum]), Quality::NO_ONSET)
    );
    assert_eq!(present(&|h, _| h.sample_rate_hz = 500.0).1.to_string(), "no_band|undersampled|rate_implausible");
    assert_eq!(present(&|h, _| h.sample_rate_hz = f64::NAN), ([0; Discriminator::COUNT], Quality::REFUSED));
    assert_eq!(present(&|h, _| h.sample_count = 8191), ([0; Discriminator::COUNT], Quality::REFUSED));
}

/// Catches noise on a dead hammer channel that counts as an impact, in both formats.
#[test]
fn noise_is_no_pulse() {
    for (is_i16, unit) in [(true, 0.01), (false, 1.0)] {
        let case = Case { f_max: 1e-9, noise: 1e7, is_i16, force_unit: unit, sound_unit: 1e4, ..tap() };
        assert!(case.extract::<f64>().quality.contains(Quality::NO_PULSE), "{case:?}");
    }
}
