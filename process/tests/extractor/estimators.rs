//! The estimators beside the default ones, against numpy and scipy.

use tapline_process::{Extractor, Precision, ProcessConfig, ProcessExtractor, QualityConfig, Real, SpectrumEstimator};
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
        // A decimated spectrum keeps what little is folded into it; a search for the least squares ends near them.
        let tolerance = match config(case, settings).spectrum {
            SpectrumEstimator::Decimated => 2e-6,
            _ => 1e-9,
        };
        assert_close(&extract::<f64>(case, settings), *expected, tolerance, case.name);
    }
}

/// Catches single precision, with or without decimation, that costs more digits than the 1e-4 it may.
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
    for of_force in ["f_max = 'polynomial'", "f_max = 'half_sine'", "tau = 'impulse'", "droop_time_constant_s = 0.02"] {
        assert_eq!(values(&extract::<f32>(&case, of_force))[4..], plain[4..], "{of_force}");
    }
    // Noise is taken off A_2 as well.
    assert_eq!(values(&extract::<f32>(&case, "subtract = 'noise'"))[..3], plain[..3]);
    for of_sound in ["spectrum = 'gate'", "spectrum = 'decimated'", "band_edges = 'fractional'"] {
        assert_eq!(values(&extract::<f32>(&case, of_sound))[..4], plain[..4], "{of_sound}");
    }
}

/// Catches a decimated spectrum of a faint band, on which what is loud above 7 kHz is folded, that is not done again.
#[test]
fn a_faint_band_is_not_decimated() {
    let case = Case { noise: 0.0, count: 16_384, ..CASES[0].0 };
    let header = case.header();
    let crate::signal::Recorded::F32(quiet) = case.recorded() else { unreachable!() };
    for level_db in [0, 20, 40, 45, 50, 60, 80] {
        let loud = 10.0_f64.powf(f64::from(level_db) / 20.0);
        let mut samples = quiet.clone();
        for (k, x) in samples[case.count as usize..].iter_mut().enumerate().skip(case.p as usize).take(8000) {
            *x += (loud * (std::f64::consts::TAU * 8_737.0 * k as f64 / case.rate).sin()) as f32;
        }
        let of = |precision, spectrum| {
            let config =
                ProcessConfig { precision, spectrum, quality: QualityConfig::keeping(), ..ProcessConfig::default() };
            let mut extractor = ProcessExtractor::new(&config).unwrap();
            let found = extractor.extract(&header, tapline_wire::Samples::F32(&samples));
            values(&found).map(|value| value.unwrap_or(f64::NAN))
        };
        let (fast, slow) =
            (of(Precision::F32, SpectrumEstimator::Decimated), of(Precision::F64, SpectrumEstimator::Whole));
        for (x, y) in fast.iter().zip(slow).skip(4) {
            assert!((x / y - 1.0).abs() < 1e-4, "{level_db} dB: {x} for {y}");
        }
    }
}
