//! A scan within one process, compared with the same scan by the processes of a line.

#[path = "../../lab/src/in_memory.rs"]
#[expect(dead_code, unreachable_pub, reason = "the lab, whose module it is, uses the rest of it")]
mod scan;

use scan::scanned;
use serde::Deserialize;
use tapline_acquire::{ScanConfig, SimulatedLine};
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_store::Reader;
use tapline_wire::{Discriminator, Discriminators, Plan, Quality, Samples, TapHeader};

use crate::sandbox::Sandbox;

/// Two stations, a tyre of each kind, and a rig whose faults cause retakes; two retakes are not always enough.
const SCAN: &str = "
[scan]
stations = 2
offsets_mm = [0.0, 10.0]
velocities_m_per_s = [1.5]
repetitions = 2
locations = 20
confirm = false

[[simulation.fault]]
kind = \"double_hit\"
fraction = 0.3
";

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Config {
    scan: ScanConfig,
    simulation: SimulationConfig,
    process: ProcessConfig,
}

impl Config {
    /// The plan, and the discriminators of each of its taps.
    fn taps(&self) -> anyhow::Result<(Plan, Vec<Discriminators>)> {
        let read = |extractor: &mut ProcessExtractor, header: &TapHeader, samples: Samples<'_>| {
            let found = extractor.extract(header, samples);
            (!found.quality.contains(Quality::RETAKE)).then_some(found)
        };
        let source = || Ok(SimulatedLine::new(&self.scan, &self.simulation)?);
        scanned(source, || Ok(ProcessExtractor::new(&self.process)?), read)
    }
}

/// The record with its values as bits, so that absent values compare equal.
fn bits(record: &Discriminators) -> String {
    let values = Discriminator::ALL.map(|which| record.values.get(which).map(f64::to_bits));
    let velocity = record.velocity_measured_m_per_s.to_bits();
    format!("{:?} {} {:?} {velocity} {values:?}", record.id, record.plan_index, record.quality)
}

/// Catches a value, flag, attempt or order that differs from the processes of a line, and a result that depends on the
/// number of threads.
#[test]
fn a_scan_in_memory_finds_what_the_line_finds() {
    let sandbox = Sandbox::new();
    sandbox.write("scan.toml", SCAN);
    sandbox.run("run --config scan.toml --out run").expect(0);
    let casings =
        ["SIM-0001", "SIM-0002"].map(|casing| Reader::open(sandbox.path(&format!("run/{casing}.h5"))).unwrap());
    let records = casings.iter().flat_map(|casing| casing.discriminators().unwrap()).map(Option::unwrap);
    let records: Vec<Discriminators> = records.collect();
    let archived: Vec<String> = records.iter().map(bits).collect();
    let config: Config = toml::from_str(SCAN).unwrap();
    for thread_count in [1, 2, 5] {
        let threads = rayon::ThreadPoolBuilder::new().num_threads(thread_count).build().unwrap();
        let (plan, mut found) = threads.install(|| config.taps()).unwrap();
        assert!(plan.taps().iter().eq(casings.iter().flat_map(|casing| casing.plan().taps())));
        // On a line, each casing has its own plan.
        found.iter_mut().for_each(|record| record.plan_index %= 2 * 2 * 2 * 21);
        let found: Vec<String> = found.iter().map(bits).collect();
        assert_eq!(found.len(), 2 * 2 * 2 * 2 * 21);
        assert!(found == archived, "on {thread_count} threads");
    }
    // Without faults, retakes would not be compared.
    let attempts = records.iter().filter(|record| record.id.attempt == 1).count();
    assert!((50..200).contains(&attempts), "{attempts} taps were taken again");
}

/// Catches a configuration that is not checked, and an error that does not say what is wrong.
#[test]
fn what_cannot_be_scanned_is_refused() {
    let mut config = Config::default();
    config.scan.repetitions = 0;
    let error = config.taps().unwrap_err();
    assert!(format!("{error:#}").contains("scan.repetitions is 0"), "{error:#}");
    let mut config = Config::default();
    config.process.f_c_hz = -1.0;
    let error = config.taps().unwrap_err();
    assert!(format!("{error:#}").contains("f_c_hz"), "{error:#}");
}
