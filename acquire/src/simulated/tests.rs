//! Tests of the simulated line.

use proptest::prelude::*;
use tapline_wire::{Samples, cache_lines_for};

use super::*;
use crate::TyreConfig;

fn line(scan: &ScanConfig) -> SimulatedLine {
    SimulatedLine::new(scan, &SimulationConfig { sample_count: 2048, ..SimulationConfig::default() }).unwrap()
}

fn small() -> ScanConfig {
    ScanConfig {
        stations: 2,
        offsets_mm: vec![0.0, 5.0],
        velocities_m_per_s: vec![1.2, 1.5, 1.85],
        locations: 12,
        ..ScanConfig::default()
    }
}

/// Header and samples of a tap, the buffer dirty before.
fn render(line: &mut SimulatedLine, row: u32, attempt: u16) -> (TapHeader, Vec<i16>) {
    let mut header = TapHeader { sent_ns: 78, ..TapHeader::default() };
    let mut buffer = vec![CacheLine::default(); cache_lines_for(line.plan().recording.payload_bytes_max()) + 3];
    i16_of_mut(&mut buffer).fill(-77);
    line.render(row, attempt, &mut header, &mut buffer).unwrap();
    let Some(Samples::I16(samples)) = Samples::view(&header, &buffer) else { panic!("not i16") };
    (header, samples.to_vec())
}

/// Catches a plan that is not the scan of section 4 of the method: 2 shoulders x 4 offsets x 3 velocities x 2 x 101.
#[test]
fn the_scan_of_the_method_can_be_asked_for() {
    let line = line(&ScanConfig {
        stations: 2,
        offsets_mm: vec![0.0, 5.0, 10.0, 15.0],
        velocities_m_per_s: vec![1.2, 1.5, 1.85],
        repetitions: 2,
        ..ScanConfig::default()
    });
    let plan = line.plan();
    assert_eq!(plan.taps().len(), 2 * 4848);
    assert_eq!((plan.stations(), plan.scans().len()), (vec![1, 2], 4));
    assert!(plan.scans().iter().all(|s| s.taps.len() == 2424 && s.locations.len() == 100));
    assert_eq!(plan.taps().iter().filter(|t| t.is_closing()).count(), 2 * 2 * 4 * 3 * 2);
    let order: Vec<_> = [0, 99, 100, 101, 202, 606, 2424, 4848]
        .map(|row: usize| {
            let id = plan.taps()[row].id;
            (
                id.station,
                id.shoulder,
                id.offset_mm().unwrap(),
                id.velocity_m_per_s().unwrap(),
                id.repetition,
                id.location,
            )
        })
        .to_vec();
    assert_eq!(
        order,
        [
            (1, 1, 0.0, 1.2, 0, 0),
            (1, 1, 0.0, 1.2, 0, 99),
            (1, 1, 0.0, 1.2, 0, 100),
            (1, 1, 0.0, 1.2, 1, 0),
            (1, 1, 0.0, 1.5, 0, 0),
            (1, 1, 5.0, 1.2, 0, 0),
            (1, 2, 0.0, 1.2, 0, 0),
            (2, 1, 0.0, 1.2, 0, 0),
        ]
    );
    assert_eq!([99, 100].map(|row: usize| plan.taps()[row].angle_deg), [Some(356.4), Some(360.0)]);
    assert_eq!(plan.recording.payload_bytes_max(), 2 * 2048 * 2);
}

/// Catches truth that is missing for a location, and damage at the wrong stations.
#[test]
fn odd_stations_are_damaged_and_even_ones_sound() {
    let line = line(&ScanConfig { stations: 3, ..ScanConfig::default() });
    assert_eq!(line.plan().truth().len(), 3 * 2 * 100);
    let cracked = |serial: &str, shoulder: u16| {
        let is_of = |key: &(Serial, u16, u32)| key.0.as_str() == serial && key.1 == shoulder;
        line.plan().truth().iter().filter(|&(key, &is_cracked)| is_of(key) && is_cracked).count()
    };
    assert!(cracked("SIM-0001", 1) >= 9 && cracked("SIM-0003", 1) >= 9);
    assert_eq!([cracked("SIM-0001", 2), cracked("SIM-0002", 1), cracked("SIM-0002", 2)], [0; 3]);
}

/// Catches a header that does not say what the samples are.
#[test]
fn the_header_describes_the_samples() {
    let mut line = line(&small());
    let (header, samples) = render(&mut line, 14, 2);
    assert_eq!((header.id.attempt, header.id.planned(), header.plan_index), (2, line.plan().taps()[14].id, 14));
    assert_eq!((header.sample_count, header.pre_trigger_samples, header.sent_ns), (2048, 512, 78));
    assert_eq!(SourceKind::from_code(header.source), Some(SourceKind::Simulated));
    let (channels, unit_per_count): (Vec<_>, Vec<f64>) = header.channels().unzip();
    assert_eq!(channels, Channel::BOTH);
    assert!((unit_per_count[0] * 32_768.0 - 222.0).abs() < 1e-9 && (unit_per_count[1] * 32_768.0 - 5.0).abs() < 1e-9);
    assert!((header.velocity_measured_m_per_s / header.id.velocity_m_per_s().unwrap() - 1.0).abs() < 0.1);
    let peak_n = f64::from(*samples[..2048].iter().max().unwrap()) * unit_per_count[0];
    assert!((5.0..100.0).contains(&peak_n), "a force of {peak_n} N");
    assert!(samples.iter().filter(|&&s| s == -77).count() < 200, "samples were left as they lay");
}

/// Catches clocks that are read, shared by stations, or that stand still.
#[test]
fn times_depend_on_the_place_in_the_scan_alone() {
    let mut line = line(&small());
    let start_ns = ScanConfig::default().start_ns;
    let per_tyre = u32::try_from(line.plan().taps().len() / 2).unwrap();
    for (row, period) in [(0, 0), (7, 7), (per_tyre - 1, i64::from(per_tyre) - 1), (per_tyre, 0), (per_tyre + 2, 2)] {
        assert_eq!(render(&mut line, row, 0).0.tap_time_ns, start_ns + period * 100_000_000, "row {row}");
    }
}

/// Catches retakes that are copies, a seed without effect, and a closing tap that is not location 0 again.
#[test]
fn what_should_differ_differs() {
    let mut here = line(&small());
    assert_ne!(render(&mut here, 5, 0).1, render(&mut here, 5, 1).1, "attempts");
    assert_ne!(render(&mut here, 0, 0).1, render(&mut here, 12, 0).1, "first and closing tap");
    let mut elsewhere = line(&ScanConfig { seed: 2, ..small() });
    assert_ne!(render(&mut here, 5, 0).1, render(&mut elsewhere, 5, 0).1, "seeds");
}

/// Catches written tyres that are ignored, and cracks that do not fit the scan.
#[test]
fn written_tyres_are_scanned() {
    let text = "stations = 2\nlocations = 20\n[[tyre]]\nserial = \"A\"\n[[tyre]]\nserial = \"B\"\nstation = 2\n\
                [[tyre.crack]]\nshoulder = 2\nfirst_location = 18\nlocation_count = 4\n";
    let scan: ScanConfig = toml::from_str(text).unwrap();
    let plan = line(&scan).plan().clone();
    assert_eq!(
        plan.scans().iter().map(|s| (s.tyre.as_str(), s.station)).collect::<Vec<_>>()[1..3],
        [("A", 1), ("B", 2)]
    );
    let cracked: Vec<_> = plan.truth().iter().filter(|&(_, &c)| c).map(|(k, _)| (k.0.as_str(), k.1, k.2)).collect();
    assert_eq!(cracked, [("B", 2, 0), ("B", 2, 1), ("B", 2, 18), ("B", 2, 19)]);
    for (from, to, want) in [
        ("shoulder = 2", "shoulder = 3", "tyre B crack 1: shoulder is 3; it must be from 1 to scan.shoulders = 2"),
        ("= 18", "= 20", "tyre B crack 1: first_location is 20; it must be from 0 to scan.locations - 1 = 19"),
        ("_count = 4", "_count = 21", "tyre B crack 1: location_count is 21; it must be from 1 to scan.locations = 20"),
        ("_count = 4", "_count = 4\ndepth_mm = nan", "tyre B crack 1: depth_mm is NaN; it must lie in"),
    ] {
        let scan: ScanConfig = toml::from_str(&text.replace(from, to)).unwrap();
        let error = SimulatedLine::new(&scan, &SimulationConfig::default()).unwrap_err().to_string();
        assert!(error.contains(want), "{error:?} lacks {want:?}");
    }
    let bad = SimulationConfig { sample_rate_hz: 0.0, ..SimulationConfig::default() };
    let error = SimulatedLine::new(&scan, &bad).unwrap_err().to_string();
    assert!(error.contains("sample_rate_hz is 0; it must lie in"), "{error}");
}

/// Catches more tyres than there are names for being a panic, and a loan or row that does not fit.
#[test]
fn a_wrong_request_is_refused() {
    let scan = TyreConfig { serial: "A".to_owned(), station: 1, crack: Vec::new() };
    let mut line = line(&ScanConfig { tyre: vec![scan], shoulders: 1, ..small() });
    let refusal = line.render(99_999, 0, &mut TapHeader::default(), &mut []).unwrap_err();
    assert_eq!(refusal.to_string(), "plan: row 99999 does not exist; the plan has 78 rows");
    let refusal = line.render(0, 0, &mut TapHeader::default(), &mut []).unwrap_err();
    assert_eq!(refusal.to_string(), "plan: the loan has 0 bytes; the samples need 8192");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// Law 6: a tap depends on its row and attempt alone. Catches a source that carries something from tap to tap.
    #[test]
    fn any_order_gives_the_same_taps(rows in proptest::collection::vec((0u32..156, 0u16..3), 1..8)) {
        let mut in_order = line(&small());
        let mut alone: Vec<_> = rows.iter().map(|&(row, attempt)| render(&mut line(&small()), row, attempt)).collect();
        for (&(row, attempt), want) in rows.iter().zip(&mut alone) {
            let got = render(&mut in_order, row, attempt);
            prop_assert_eq!(got.0.velocity_measured_m_per_s.to_bits(), want.0.velocity_measured_m_per_s.to_bits());
            prop_assert_eq!(got, want.clone());
        }
    }
}
