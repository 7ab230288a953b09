//! Single precision against double, over taps of every kind.

use proptest::prelude::*;

use crate::reference::CASES;
use crate::signal::{Case, assert_close, values};

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Catches a sum that loses digits with the record's length, offset or scale, and a square that leaves the range
    /// of `f32`: scales go from 1e-30 to 1e30.
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
        prop_assert!(values(&double)[3..].iter().all(Option::is_some), "{:?}", double);
        assert_close(&single, values(&double), 1e-4, "single precision");
    }
}
