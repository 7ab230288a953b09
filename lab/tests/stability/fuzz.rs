//! Any text at all as a run's configuration. The readers of tap sets are tested likewise next to their code, and the
//! extractor's records in the tests of its crate.

use std::cell::Cell;

use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};
use serde::{Deserialize, Serialize};
use tapline_acquire::{AcquireConfig, ScanConfig};
use tapline_fuse::{FuseConfig, Fusion};
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor};

use crate::stability::scatter::{ring_plan, tyre};

/// The tables of a configuration file, as the program has them.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    scan: ScanConfig,
    simulation: SimulationConfig,
    acquire: AcquireConfig,
    process: ProcessConfig,
    fuse: FuseConfig,
}

/// Catches a panic on any configuration, and a number that its own check lets through although nothing can be computed
/// with it: what is accepted must make an extractor and a fusion, with limits in order.
#[test]
fn any_configuration() {
    const CASES: u32 = 3000;
    let small =
        "[process]\nf_c_hz = 400.0\nprecision = \"f64\"\n[fuse]\ndiscriminators = [\"pr\"]\nreference = \"T1/1\"\n";
    let seeds = vec![toml::to_string(&Config::default()).unwrap().into_bytes(), small.into()];
    let config = ProptestConfig { cases: CASES, failure_persistence: None, ..ProptestConfig::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let (plan, accepted) = (ring_plan(&[tyre("T1")], 1, 12), Cell::new(0));
    let outcome = runner.run(&tapline_testing::mutated::mutated(seeds), |bytes| {
        let Ok(text) = String::from_utf8(bytes) else { return Ok(()) };
        let Ok(config) = toml::from_str::<Config>(&text) else { return Ok(()) };
        let is_valid = config.acquire.validate().is_ok() && config.fuse.validate().is_ok();
        if config.process.validate().is_err() || !is_valid {
            return Ok(());
        }
        accepted.set(accepted.get() + 1);
        let ProcessConfig { f_c_hz, f_hi_hz, f_lo_hz, f_top_hz, .. } = config.process;
        prop_assert!(0.0 < f_c_hz && f_c_hz < f_hi_hz && f_hi_hz.is_finite(), "{:?}", config.process);
        prop_assert!(0.0 <= f_lo_hz && f_lo_hz < f_top_hz && f_top_hz.is_finite(), "{:?}", config.process);
        prop_assert!(
            f_hi_hz <= f_top_hz && (f_lo_hz <= f_c_hz || config.process.f_c_follows_tau),
            "{:?}",
            config.process
        );
        prop_assert!(ProcessExtractor::new(&config.process).is_ok());
        let (re_inspect, reject) = (config.fuse.re_inspect_rate, config.fuse.reject_rate);
        prop_assert!(0.0 < reject && reject <= re_inspect && re_inspect < 1.0, "{} {}", re_inspect, reject);
        if let Err(error) = Fusion::new(&config.fuse, &plan) {
            // Of what was valid in itself, only the reference can be none of the plan's.
            prop_assert!(error.to_string().contains("reference"), "{}", error);
        }
        Ok(())
    });
    outcome.unwrap();
    assert!((CASES / 20..CASES * 19 / 20).contains(&accepted.get()), "{} of {CASES} accepted", accepted.get());
}
