//! The estimators other than the default ones, compared with numpy and scipy.

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

/// Catches another reading of an estimator, and a fall-back that is wrong or not needed.
#[test]
fn double_precision_like_scipy() {
    for (case, settings, expected) in CASES {
        assert_close(&extract::<f64>(case, settings), *expected, 1e-9, case.name);
    }
}

/// Catches single precision that is off by more than the allowed 1e-4.
#[test]
fn single_precision_like_scipy() {
    for (case, settings, expected) in CASES {
        assert_close(&extract::<f32>(case, settings), *expected, 1e-4, case.name);
    }
}

/// Catches an estimator that changes unrelated values: force estimators keep the powers, and spectra keep the force,
/// bit for bit.
#[test]
fn estimators_keep_to_their_part() {
    let case = Case { count: 4096, ..CASES[0].0 };
    let plain = values(&extract::<f32>(&case, ""));
    for of_force in ["f_max = 'polynomial'", "tau = 'impulse'", "droop_time_constant_s = 0.02"] {
        assert_eq!(values(&extract::<f32>(&case, of_force))[4..], plain[4..], "{of_force}");
    }
    // Noise is subtracted from A_2 as well.
    assert_eq!(values(&extract::<f32>(&case, "subtract = 'noise'"))[..3], plain[..3]);
    assert_eq!(values(&extract::<f32>(&case, "band_edges = 'fractional'"))[..4], plain[..4]);
}
