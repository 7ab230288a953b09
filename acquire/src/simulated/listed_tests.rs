//! Tests of the list of simulated tyres.

use tapline_wire::{CacheLine, CasingLimits, TapHeader, bytes_of, cache_lines_for};

use super::*;
use crate::{Source, TyreConfig};

fn simulation() -> SimulationConfig {
    SimulationConfig { sample_count: 1024, ..SimulationConfig::default() }
}

/// Five tyres over two stations, mixed, with a short turn around each shoulder.
fn scan() -> ScanConfig {
    let tyre = |(serial, station): (&str, u16)| {
        let crack = tapline_model::plant_cracks(5, serial, 12, u32::from(station % 2));
        TyreConfig { serial: serial.to_owned(), station, crack }
    };
    ScanConfig {
        stations: 2,
        locations: 12,
        confirm: false,
        tyre: [("A", 1), ("B", 2), ("C", 2), ("D", 1), ("E", 2)].map(tyre).to_vec(),
        ..ScanConfig::default()
    }
}

/// All that is known of a tap but its place in the plan, and its samples.
pub(crate) fn tap_of(source: &mut dyn Source, row: u32, attempt: u16) -> (String, Vec<u8>) {
    let mut header = TapHeader::default();
    let mut buffer = vec![CacheLine::default(); cache_lines_for(source.plan().recording.payload_bytes_max())];
    source.render(row, attempt, &mut header, &mut buffer).unwrap();
    header.plan_index = 0;
    let bytes = header.payload_bytes();
    (format!("{header:?}"), bytes_of(&buffer)[..bytes].to_vec())
}

fn casings(mut arrivals: Box<dyn Arrivals>) -> Vec<Casing> {
    let mut casings = Vec::new();
    while let Arrival::Casing(casing) = arrivals.next().unwrap() {
        casings.push(casing);
    }
    assert!(matches!(arrivals.next().unwrap(), Arrival::Ended));
    casings
}

/// Catches a tap, or a time, that differs where each tyre has a source of its own, and one that is left out.
#[test]
fn every_casing_has_the_taps_of_the_whole_scan() {
    let list = listed_simulated(&scan(), &simulation()).unwrap();
    let mut whole = SimulatedLine::new(&scan(), &simulation()).unwrap();
    let mut seen = 0;
    for station in list.stations() {
        for mut casing in casings(list.arrivals(station)) {
            let taps = casing.taps.plan().taps().to_vec();
            for (row, tap) in (0..).zip(&taps) {
                let of_whole = whole.plan().taps().iter().position(|t| t == tap).unwrap();
                let want = tap_of(&mut whole, u32::try_from(of_whole).unwrap(), 1);
                assert_eq!(tap_of(&mut *casing.taps, row, 1), want, "{} row {row}", casing.name);
                seen += 1;
            }
        }
    }
    assert_eq!(seen, whole.plan().taps().len());
}

/// Catches a list that names other casings, stations or plans than those that come.
#[test]
fn what_is_listed_comes() {
    for scan in [scan(), ScanConfig { tyre: Vec::new(), ..scan() }] {
        let list = listed_simulated(&scan, &simulation()).unwrap();
        let listed: Vec<_> = list.listed().map(Result::unwrap).collect();
        assert_eq!((listed.len(), list.stations()), (scan.tyre_count(), vec![1, 2]));
        let whole = SimulatedLine::new(&scan, &simulation()).unwrap();
        let mut truth = tapline_wire::Truth::new();
        for station in [1, 2] {
            let of_station: Vec<_> = listed.iter().filter(|l| l.1 == station).collect();
            let came = casings(list.arrivals(station));
            assert_eq!(came.len(), of_station.len());
            for (casing, (name, _, plan)) in came.iter().zip(of_station) {
                assert_eq!((&casing.name, casing.taps.plan()), (name, plan));
                assert_eq!(CasingLimits::from_plan(plan), list.limits().unwrap());
                truth.extend(plan.truth());
            }
        }
        assert_eq!(truth, *whole.plan().truth());
    }
    assert!(casings(listed_simulated(&scan(), &simulation()).unwrap().arrivals(9)).is_empty());
}

/// Catches a bad crack that is found only when the turn of its tyre comes.
#[test]
fn faults_are_found_at_the_start() {
    let mut bad = scan();
    bad.tyre[0].crack[0].depth_mm = f64::NAN;
    assert!(listed_simulated(&bad, &simulation()).unwrap_err().to_string().contains("tyre A crack 1: depth_mm"));
    let impossible = SimulationConfig { sample_rate_hz: 0.0, ..simulation() };
    assert!(listed_simulated(&scan(), &impossible).unwrap_err().to_string().contains("sample_rate_hz"));
}

/// Catches tyres of a line that runs on which repeat, stand still in time, or differ after a new start.
#[test]
fn tyres_without_a_list_go_on() {
    let of = |count| Box::new(SimulatedTyres::unlisted(&scan(), &simulation(), 3, Some(count)).unwrap());
    let mut three = casings(of(3));
    assert_eq!(three.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["S3-1", "S3-2", "S3-3"]);
    let is_cracked = |casing: &Casing| casing.taps.plan().truth().values().any(|&is| is);
    assert_eq!(three.iter().map(is_cracked).collect::<Vec<_>>(), [true, false, true]);
    let mut again = casings(of(1));
    assert_eq!(tap_of(&mut *three[0].taps, 0, 0), tap_of(&mut *again[0].taps, 0, 0));
    assert_ne!(tap_of(&mut *three[2].taps, 0, 0), tap_of(&mut *again[0].taps, 0, 0));
}

/// Catches a tyre that has no room for its second reading, or room for one that is not made.
#[test]
fn there_is_room_for_what_is_tapped_again() {
    let twice = ScanConfig { velocities_m_per_s: vec![1.5, 1.85], repetitions: 2, confirm: true, ..scan() };
    let list = listed_simulated(&twice, &simulation()).unwrap();
    let (_, _, plan) = list.listed().next().unwrap().unwrap();
    // At one offset, as often as the scan taps there.
    let room = 2 * 12 * 2 * 2;
    let limits = CasingLimits { room, taps: plan.taps().len() + room, ..CasingLimits::from_plan(&plan) };
    assert_eq!(list.limits().unwrap(), limits);
}
