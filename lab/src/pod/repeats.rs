//! Gauge study of casings that were scanned again: stations are the operators, whole scans the repeats.
//!
//! Parts are shoulders, read by their strongest arc, and locations, read by their damage index: see [`GaugedBy`].

use std::collections::BTreeMap;

use crate::evaluation::{GAUGE_COLUMNS, GaugedBy, Table, gauge_cells};
use crate::statistics::{Crossed, Gauge, crossed, one_way};

use super::archives::{Scanned, Scans};
use super::roc::reference_remarks;

/// Parts that AIAG asks for.
const PARTS: usize = 10;

/// The study of one kind of parts.
#[derive(Debug)]
pub(super) struct Repeated {
    pub quantity: &'static str,
    stations: Vec<u16>,
    parts: usize,
    repeats: usize,
    /// What they find, across stations or at one; or why nothing.
    pub found: Result<Gauge, String>,
    remark: String,
}

/// The scans of a shoulder at one station.
pub(super) type AtStation<'a> = BTreeMap<u16, Vec<&'a Scanned>>;

/// The shoulders that were scanned again at a station, each with its scans at those stations.
pub(super) fn scanned_again(scans: &Scans) -> Vec<AtStation<'_>> {
    let mut again: Vec<AtStation<'_>> = Vec::new();
    for scans in scans.of_shoulder.values() {
        let mut at = AtStation::new();
        scans.iter().for_each(|scan| at.entry(scan.station).or_default().push(scan));
        at.retain(|_, scans| scans.len() >= 2);
        again.extend(Some(at).filter(|at| !at.is_empty()));
    }
    again
}

/// The studies of both kinds of parts: across stations where shoulders were scanned again at several, and at one.
pub(super) fn repeated(scans: &Scans) -> Vec<Repeated> {
    let again = scanned_again(scans);
    let mut studies = Vec::new();
    for reading in GaugedBy::ALL {
        if let Some(stations) = shared_stations(&again) {
            studies.push(Repeated::across(reading, &again, stations));
        }
        studies.push(Repeated::at_one(reading, &again));
    }
    studies
}

/// The stations that most shoulders were scanned at twice or more, by how many shoulders share them; `None` where no two do.
fn shared_stations(again: &[AtStation<'_>]) -> Option<Vec<u16>> {
    let mut count: BTreeMap<u16, usize> = BTreeMap::new();
    again.iter().flat_map(BTreeMap::keys).for_each(|&station| *count.entry(station).or_default() += 1);
    let mut stations: Vec<u16> = count.keys().copied().collect();
    stations.sort_by_key(|station| (std::cmp::Reverse(count[station]), *station));
    let shared = |stations: &[u16]| again.iter().filter(|at| stations.iter().all(|s| at.contains_key(s))).count();
    let best = (2..=stations.len()).map(|k| (shared(&stations[..k]) * k, k)).filter(|&(readings, _)| readings > 0);
    best.max_by_key(|&(readings, k)| (readings, std::cmp::Reverse(k))).map(|(_, k)| {
        let mut shared = stations[..k].to_vec();
        shared.sort_unstable();
        shared
    })
}

impl Repeated {
    /// The same shoulders, read again at each of `stations`.
    fn across(reading: GaugedBy, again: &[AtStation<'_>], stations: Vec<u16>) -> Self {
        let shared: Vec<Vec<&[&Scanned]>> = (again.iter())
            .filter_map(|at| stations.iter().map(|station| at.get(station).map(Vec::as_slice)).collect())
            .collect();
        let design = Design::new(reading, &shared);
        let study = Crossed {
            part_count: design.part_count,
            operator_count: stations.len(),
            repeat_count: design.repeat_count,
        };
        let found = crossed(&design.readings, study).map_err(|why| why.to_string());
        Self::new(reading, stations, &design, found)
    }

    /// Shoulders that were read again at one station, each at the one that read it most often.
    fn at_one(reading: GaugedBy, again: &[AtStation<'_>]) -> Self {
        let most = |at: &AtStation<'_>| {
            at.iter().max_by_key(|(s, scans)| (scans.len(), std::cmp::Reverse(**s))).map(|(s, _)| *s)
        };
        let mut stations: Vec<u16> = again.iter().filter_map(most).collect();
        let at_one: Vec<Vec<&[&Scanned]>> =
            again.iter().filter_map(|at| Some(vec![at.get(&most(at)?)?.as_slice()])).collect();
        stations.sort_unstable();
        stations.dedup();
        let design = Design::new(reading, &at_one);
        let found = if again.is_empty() {
            Err("no shoulder was scanned twice at one station: a gauge cannot be judged without a repeat".to_owned())
        } else {
            one_way(&design.readings, design.part_count).map_err(|why| why.to_string())
        };
        Self { stations, ..Self::new(reading, Vec::new(), &design, found) }
    }

    fn new(reading: GaugedBy, stations: Vec<u16>, design: &Design, found: Result<Gauge, String>) -> Self {
        let mut remarks = Vec::new();
        if design.part_count > 0 && design.part_count < PARTS {
            remarks.push(format!("{} parts; AIAG asks for {PARTS} or more", design.part_count));
        }
        if design.left_out > 0 {
            remarks.push(format!("{} parts left out for which not every scan has a value", design.left_out));
        }
        remarks.extend(design.references.iter().cloned());
        Self {
            quantity: reading.name(),
            stations,
            parts: design.part_count,
            repeats: design.repeat_count,
            found,
            remark: remarks.join("; "),
        }
    }
}

/// The readings of a complete design, part by part, station by station.
struct Design {
    readings: Vec<Option<f64>>,
    part_count: usize,
    repeat_count: usize,
    left_out: usize,
    /// Remarks if not all scans were compared with the same reference.
    references: Vec<String>,
}

impl Design {
    /// Of `shoulders`, each with its scans at each station; if one has more than others, only its first ones count.
    fn new(reading: GaugedBy, shoulders: &[Vec<&[&Scanned]>]) -> Self {
        let counts = shoulders.iter().flatten().map(|scans| scans.len());
        let repeat_count = counts.min().unwrap_or(0);
        let (mut readings, mut part_count, mut left_out) = (Vec::new(), 0, 0);
        for stations in shoulders {
            let scans: Vec<&Scanned> = stations.iter().flat_map(|scans| &scans[..repeat_count]).copied().collect();
            let is_same = scans.iter().all(|scan| scan.locations == scans[0].locations);
            let maps: Vec<Vec<f64>> = scans.iter().map(|scan| reading.of(&scan.result)).collect();
            for part in 0..maps.first().map_or(0, Vec::len) {
                // Different locations are different parts.
                let values = maps.iter().map(|map| map.get(part).copied().filter(|x| is_same && x.is_finite()));
                let values: Vec<Option<f64>> = values.collect();
                match values.contains(&None) {
                    true => left_out += 1,
                    false => {
                        readings.extend(values);
                        part_count += 1;
                    }
                }
            }
        }
        let scans = shoulders.iter().flatten().copied().flatten().copied();
        let references = reference_remarks(scans, "scan", "not all scans had the same reference");
        Self { readings, part_count, repeat_count, left_out, references }
    }
}

pub(super) fn table(repeated: &[Repeated]) -> Table {
    let mut table = Table::new(
        "gauge",
        "Gauge study of casings that were scanned again: operators are stations, repeats whole scans; parts of the total standard \
         deviation in per cent",
        ["parts_read", "stations", "parts", "repeats"].into_iter().chain(GAUGE_COLUMNS),
    );
    for r in repeated {
        let stations = r.stations.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
        let mut row = vec![r.quantity.into(), stations.into(), r.parts.into(), r.repeats.into()];
        row.extend(gauge_cells(&r.found));
        if let Some(last) = row.last_mut() {
            let remarks = [last.to_string(), r.remark.clone()];
            *last = remarks.into_iter().filter(|remark| !remark.is_empty()).collect::<Vec<_>>().join("; ").into();
        }
        table.push(row);
    }
    table
}
