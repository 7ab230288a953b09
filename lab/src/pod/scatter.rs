//! How far shoulders lie below the limit, against the scatter of their scans.
//!
//! A gauge study compares its error with what parts differ by. A few cracked shoulders differ from the others by so much that any
//! gauge looks good beside it, while verdicts on the others change from scan to scan.

use crate::evaluation::{Table, cell};

use super::archives::{Scanned, Scans};
use super::repeats::{AtStation, scanned_again};

/// How far shoulders lie below the limit, and how much their strongest arc changes from scan to scan at one station.
#[derive(Debug, Default)]
pub(super) struct Scatter {
    pub shoulders: usize,
    scans: usize,
    /// Mean of the strongest arc over its limit.
    pub level: Option<f64>,
    /// Standard deviation of repeated scans, in parts of the limit.
    pub sd: Option<f64>,
    /// The distance from the level to the limit over the standard deviation; `None` if scans repeat exactly.
    pub distance: Option<f64>,
}

/// The strongest arc over the limit: scans with different references can be compared.
pub(super) fn level(scan: &Scanned) -> f64 {
    scan.result.strongest_arc / scan.result.limit
}

pub(super) fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().sum::<f64>() / values.count() as f64
}

/// Of the shoulders that were scanned again at one station and whose scans have a mean below the limit. The mean decides, not each
/// verdict: without the scans that reached the limit by chance the scatter would seem too small.
pub(super) fn scatter(scans: &Scans) -> Scatter {
    let at_stations = |at: &AtStation<'_>| -> Vec<Vec<f64>> {
        let of_station = at.values().map(|scans| scans.iter().copied().map(level).filter(|x| x.is_finite()).collect());
        of_station.filter(|levels: &Vec<f64>| levels.len() > 1).collect()
    };
    let all: Vec<Vec<Vec<f64>>> = scanned_again(scans).iter().map(at_stations).collect();
    let of_shoulder = |stations: &[Vec<f64>]| mean(stations.iter().flatten().copied());
    let low: Vec<&Vec<Vec<f64>>> = all.iter().filter(|stations| of_shoulder(stations) < 1.0).collect();
    if low.is_empty() {
        return Scatter::default();
    }
    let (mut squares, mut degrees, mut scan_count) = (0.0, 0, 0);
    for levels in low.iter().copied().flatten() {
        let middle = mean(levels.iter().copied());
        squares += levels.iter().map(|level| (level - middle).powi(2)).sum::<f64>();
        degrees += levels.len() - 1;
        scan_count += levels.len();
    }
    let (level, sd) = (mean(low.iter().map(|stations| of_shoulder(stations))), (squares / degrees as f64).sqrt());
    Scatter {
        shoulders: low.len(),
        scans: scan_count,
        level: Some(level),
        sd: Some(sd),
        distance: Some((1.0 - level) / sd).filter(|distance| distance.is_finite()),
    }
}

pub(super) fn table(scatter: &Scatter) -> Table {
    let mut table = Table::new(
        "scatter",
        "Shoulders scanned again at one station whose mean strongest arc lies below the re-inspect limit: where they lie, and the \
         standard deviation of their repeated scans, in parts of the limit; and the distance to the limit over this deviation",
        ["shoulders", "scans", "level", "sd", "distance_in_sd"],
    );
    let numbers = [scatter.level, scatter.sd, scatter.distance].map(cell);
    table.push([scatter.shoulders.into(), scatter.scans.into()].into_iter().chain(numbers));
    table
}
