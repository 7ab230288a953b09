//! Whether scans of a shoulder have the same verdict, over all scans and between two stations.

use std::collections::BTreeSet;

use tapline_host::messages::counted;
use tapline_wire::Verdict;

use crate::evaluation::{Cell, Table, cell, ends};
use crate::statistics::{Rate, cohen_kappa, fleiss_kappa, mean_count, mean_interval};

use super::archives::{Scanned, Scans};
use super::scatter::{level, mean};

/// Probability of each interval.
const LEVEL: f64 = 0.95;

/// How well verdicts agree, over all scans or between two stations.
#[derive(Debug)]
pub(super) struct Agreement {
    /// The two stations; `None` over all scans.
    stations: Option<[u16; 2]>,
    pub shoulders: usize,
    pub scans: usize,
    /// Shoulders whose verdicts are all the same; between stations those of which a scan at each has the same, on average of all pairs.
    same: f64,
    /// Their part; `None` without shoulders.
    pub rate: Option<Rate>,
    pub kappa: Option<f64>,
    /// How much greater the strongest arc over its limit is at the second station than at the first.
    bias: Option<Rate>,
    remark: String,
}

/// Over all scans, and between each two stations that scanned the same shoulders.
pub(super) fn agreements(scans: &Scans) -> Vec<Agreement> {
    let again: Vec<&[Scanned]> = scans.of_shoulder.values().map(Vec::as_slice).filter(|of| of.len() > 1).collect();
    let stations: BTreeSet<u16> = again.iter().copied().flatten().map(|scan| scan.station).collect();
    let later = |first: u16| stations.iter().filter(move |&&other| other > first).map(move |&other| [first, other]);
    let pairs = stations.iter().flat_map(|&first| later(first));
    let between = pairs.map(|pair| Agreement::between(pair, &again)).filter(|found| found.shoulders > 0);
    [Agreement::of_all(&again)].into_iter().chain(between).collect()
}

impl Agreement {
    fn of_all(again: &[&[Scanned]]) -> Self {
        let counts: Vec<[usize; 3]> = (again.iter())
            .map(|scans| Verdict::ALL.map(|verdict| scans.iter().filter(|scan| scan.result.verdict == verdict).count()))
            .collect();
        let is_same = |scans: &[Scanned]| scans.iter().all(|scan| scan.result.verdict == scans[0].result.verdict);
        // Such verdicts differ for another reason than the strongest arc: the level, the scatter or missing taps.
        let is_low = |scans: &[Scanned]| scans.iter().all(|scan| level(scan) < 1.0);
        let low = again.iter().filter(|scans| !is_same(scans) && is_low(scans)).count();
        let (one, more) = ("shoulder differs", "shoulders differ");
        Self {
            scans: again.iter().map(|scans| scans.len()).sum(),
            ..Self::new(
                (again.len(), again.iter().filter(|scans| is_same(scans)).count() as f64),
                fleiss_kappa(&counts),
                (low > 0).then(|| format!("{} although no scan reaches the limit", counted(low, one, more))),
            )
        }
    }

    /// Each scan at the one station is compared with each at the other; shoulders count the same, however often they were scanned.
    fn between(stations: [u16; 2], again: &[&[Scanned]]) -> Self {
        let shared = again.iter().map(|scans| {
            stations.map(|station| scans.iter().filter(|scan| scan.station == station).collect::<Vec<_>>())
        });
        let (mut verdicts, mut differences, mut scan_count, mut shoulder_count) = ([[0.0; 3]; 3], Vec::new(), 0, 0);
        for [first, second] in shared.filter(|shared| shared.iter().all(|scans| !scans.is_empty())) {
            let weight = 1.0 / (first.len() * second.len()) as f64;
            for (a, b) in first.iter().flat_map(|a| second.iter().map(move |b| (a, b))) {
                verdicts[a.result.verdict as usize][b.result.verdict as usize] += weight;
            }
            differences.push(mean(second.iter().copied().map(level)) - mean(first.iter().copied().map(level)));
            scan_count += first.len() + second.len();
            shoulder_count += 1;
        }
        differences.retain(|difference| difference.is_finite());
        let same = (0..verdicts.len()).map(|verdict| verdicts[verdict][verdict]).sum();
        Self {
            stations: Some(stations),
            scans: scan_count,
            bias: mean_interval(&differences, LEVEL),
            ..Self::new((shoulder_count, same), cohen_kappa(&verdicts), None)
        }
    }

    fn new((shoulders, same): (usize, f64), kappa: Option<f64>, remark: Option<String>) -> Self {
        let without = match shoulders {
            0 => Some("no shoulder was scanned twice".to_owned()),
            _ => kappa.is_none().then(|| "no kappa: there is only one verdict".to_owned()),
        };
        let remark = [without, remark].into_iter().flatten().collect::<Vec<_>>().join("; ");
        let rate = mean_count(same, shoulders, LEVEL).ok();
        Self { stations: None, shoulders, scans: 0, same, rate, kappa, bias: None, remark }
    }

    /// All digits of a count, a few of an average.
    pub(super) fn same_cell(&self) -> Cell {
        if self.stations.is_some() { cell(self.same) } else { Cell::Count(self.same as u64) }
    }
}

pub(super) fn table(agreements: &[Agreement]) -> Table {
    let mut table = Table::new(
        "agreement",
        "Verdicts on shoulders that were scanned again: how many have the same in all scans, or in a scan at each of two \
         stations, with exact intervals (Clopper and Pearson); kappa is 1 where all agree, 0 where they agree as by chance. \
         The bias is in parts of the limit",
        [
            "stations", "shoulders", "scans", "same", "same_low", "same_high", "kappa", "bias", "bias_low",
            "bias_high", "remark",
        ],
    );
    for found in agreements {
        let stations = found.stations.map_or_else(|| "all".to_owned(), |[a, b]| format!("{a} {b}"));
        let mut row: Vec<Cell> = vec![stations.into(), found.shoulders.into(), found.scans.into(), found.same_cell()];
        row.extend(ends(found.rate.map(|rate| (rate.low, rate.high))));
        row.extend([cell(found.kappa), cell(found.bias.map(|bias| bias.rate))]);
        row.extend(ends(found.bias.map(|bias| (bias.low, bias.high))));
        row.push(found.remark.clone().into());
        table.push(row);
    }
    table
}
