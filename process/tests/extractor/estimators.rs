//! The estimators beside the default ones, against numpy and scipy.

use tapline_process::{Extractor, ProcessConfig, QualityConfig, Real};
use tapline_wire::Discriminators;

use crate::estimators_reference::CASES;
use crate::signal::{Case, assert_close, values};

fn config(case: &Case, settings: &str) -> ProcessConfig {
    let quality = QualityConfig::keeping(); // some cases are clipped or sparse on purpose
    ProcessConfig { f_lo_hz: case.f_lo, quality, ..toml::from_str(settings).unwrap() }
}

fn extract<T: Real>(case: &Case, settings: &str) -> Discriminators {
    let mut extractor = Extractor::<T>::new(&config(case, settings)).unwrap();
    extractor.extract(&case.header(), case.recorded().samples())
}

/// Catches any other reading of an estimator, and a fall-back where there is no need of one or another than is said.
#[test]
fn double_precision_like_scipy() {
    for (case, settings, expected) in CASES {
        assert_close(&extract::<f64>(case, settings), *expected, 1e-9, case.name);
    }
}

/// Catches single precision that costs more digits than the 1e-4 it may.
#[test]
fn single_precision_like_scipy() {
    for (case, settings, expected) in CASES {
        assert_close(&extract::<f32>(case, settings), *expected, 1e-4, case.name);
    }
}

/// Catches an estimator that changes what it has no part in: force estimators leave the powers, spectra the force, bit for
/// bit.
#[test]
fn estimators_keep_to_their_part() {
    let case = Case { count: 4096, ..CASES[0].0 };
    let plain = values(&extract::<f32>(&case, ""));
    for of_force in ["f_max = 'polynomial'", "tau = 'impulse'", "droop_time_constant_s = 0.02"] {
        assert_eq!(values(&extract::<f32>(&case, of_force))[4..], plain[4..], "{of_force}");
    }
    // Noise is taken off A_2 as well.
    assert_eq!(values(&extract::<f32>(&case, "subtract = 'noise'"))[..3], plain[..3]);
    for of_sound in ["spectrum = 'gate'", "band_edges = 'fractional'"] {
        assert_eq!(values(&extract::<f32>(&case, of_sound))[..4], plain[..4], "{of_sound}");
    }
}
