//! Single precision compared with double, for taps of every kind.

use proptest::prelude::*;
use tapline_process::{Precision, ProcessConfig, ProcessExtractor, without_avx512};
use tapline_wire::{Channel, Quality, Samples, TapHeader};

use crate::reference::CASES;
use crate::signal::{Case, assert_close, values};

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Catches a sum that loses digits with the record's length, offset or scale, and a square out of the range of
    /// `f32`: scales are from 1e-30 to 1e30.
    #[test]
    fn single_within_1e_4_of_double(
        (seed, count, p, lag) in (any::<u32>(), 1000..20_000_u32, 20..500_u32, 0.0..12.0_f64),
        (is_i16, has_force, sound_first) in any::<(bool, bool, bool)>(),
        (tau, noise, offset, power) in (0.3e-3..3e-3_f64, 0.0..0.05_f64, -0.5..0.5_f64, -30..30_i32),
    ) {
        let unit = 10.0_f64.powi(power);
        let case = Case {
            seed, count, p, is_i16, has_force, sound_first, tau, noise, offset,
            rate: 40_960.0,
            onset: f64::from(p) + lag,
            force_unit: if is_i16 { 0.004 } else { unit },
            sound_unit: if is_i16 { 1e-4 } else { unit },
            ..CASES[0].0
        };
        let double = case.extract::<f64>();
        let single = case.extract::<f32>();
        prop_assert_eq!(single.quality, double.quality);
        // With noise up to 5 %, one clean tap in thousands looks like two hits; the tests of that flag check how
        // rarely.
        prop_assume!(!double.quality.contains(Quality::DOUBLE_HIT));
        prop_assert!(values(&double)[3..].iter().all(Option::is_some), "{:?}", double);
        assert_close(&single, values(&double), 1e-4, "single precision");
    }
}

/// Rounding in single precision must not hide the flexural band beside a loud sound in other bands, on any processor.
#[test]
fn a_faint_band_beside_a_loud_sound() {
    let count = 16_384_u32;
    for level_db in [-20, -50, -70, -90, -110] {
        let faint = 10.0_f64.powf(f64::from(level_db) / 20.0);
        let samples: Vec<f32> = (0..count)
            .map(|k| {
                let t = f64::from(k) / 40_960.0;
                let loud = (std::f64::consts::TAU * 9_013.0 * t).sin();
                let ring = faint * (-30.0 * t).exp() * (std::f64::consts::TAU * 1_003.7 * t).sin();
                if k < 512 { 0.0 } else { (loud + ring) as f32 }
            })
            .collect();
        let header = TapHeader::in_units(40_960.0, 512, count, &[Channel::Sound]);
        let extract = |precision| {
            let config = ProcessConfig { precision, ..ProcessConfig::default() };
            ProcessExtractor::new(&config).unwrap().extract(&header, Samples::F32(&samples))
        };
        let double = extract(Precision::F64);
        for is_narrow in [true, false] {
            without_avx512(is_narrow);
            let what = format!("without AVX-512: {is_narrow}, {level_db} dB");
            assert_close(&extract(Precision::F32), values(&double), 1e-4, &what);
        }
    }
}
