//! How well a rig repeats, and two rigs agree: gauge repeatability and reproducibility of what verdicts rest on.
//!
//! Parts are shoulders, read by their strongest arc, or locations, read by their index ([`GaugedBy`]); operators are two rigs,
//! and a repeat is a whole scan with taps of its own. The second rig has its
//! microphone a tenth farther away, twice the noise in both channels, and a velocity that jitters half as much again.

use crate::evaluation::{GAUGE_COLUMNS, GaugedBy, Table, gauge_cells};
use crate::shoulder_result::ShoulderResult;
use crate::statistics::{Crossed, Gauge, Refusal, crossed, one_way};
use anyhow::Result;
use tapline_fuse::{FuseConfig, IndexKind};
use tapline_model::SimulationConfig;

use super::judge::judge;
use super::parallel::each;
use super::sets::{Set, cracked, sound};
use super::size::{Size, Turns};

/// Sound tyres of the reference, scanned on the first rig.
const REFERENCE: usize = 4;
const RIGS: usize = 2;

/// What the study of one index found.
#[derive(Debug)]
pub(super) struct GaugeResult {
    pub index: IndexKind,
    pub reading: GaugedBy,
    pub parts: usize,
    pub of_both: Result<Gauge, Refusal>,
    /// Of the first rig alone.
    pub of_one: Result<Gauge, Refusal>,
}

/// Scans the same tyres again and again on two rigs.
pub(super) fn gauge(set: &Set, size: &Size, seed: u64) -> Result<Vec<GaugeResult>> {
    let first = &set.simulation;
    let second = SimulationConfig {
        microphone_distance_m: 1.1 * first.microphone_distance_m,
        force_noise_n: 2.0 * first.force_noise_n,
        sound_noise_v: 2.0 * first.sound_noise_v,
        velocity_jitter: 1.5 * first.velocity_jitter,
        ..first.clone()
    };
    let parts = (0_u64..).take(size.gauge_tyres);
    let parts = parts.map(|k| cracked(format!("part-{k}"), &set.cracks, size.location_count, seed, 600_000 + k));
    let tyres: Vec<_> = parts.chain((0..REFERENCE).map(|k| sound(format!("reference-{k}")))).collect();
    // Each rig takes repetitions of its own: taps of the same name would have the same random numbers on both.
    let of_a_scan = size.short.repetitions;
    let of_a_rig = of_a_scan * size.gauge_scans;
    let turns = Turns { repetitions: of_a_rig * RIGS as u16, ..size.short.clone() };
    let mut scans = Vec::new();
    let mut reference = None;
    for (rig, simulation) in (0..).zip([first, &second]) {
        let dataset = turns.scan(simulation, tyres.clone(), (seed, size.location_count))?;
        if rig == 0 {
            let first_scan = dataset.only(|tap| tap.id.repetition < of_a_scan)?;
            reference = Some(first_scan.reference(&FuseConfig::default(), |tyre| tyre.starts_with("reference"))?);
        }
        for scan in 0..size.gauge_scans {
            let from = rig * of_a_rig + scan * of_a_scan;
            scans.push(dataset.only(|tap| {
                (from..from + of_a_scan).contains(&tap.id.repetition) && tap.id.tyre.as_str().starts_with("part")
            })?);
        }
    }
    let judged = each(&IndexKind::ALL, |&index| {
        let config = FuseConfig { index, ..FuseConfig::default() };
        scans.iter().map(|scan| judge(&config, scan, reference.as_ref())).collect::<Result<Vec<Vec<ShoulderResult>>>>()
    })?;
    let repeat_count = usize::from(size.gauge_scans);
    let of = |(&index, scans): (&IndexKind, &Vec<Vec<ShoulderResult>>)| {
        GaugedBy::ALL.map(|reading| GaugeResult::new(index, reading, scans, repeat_count))
    };
    Ok(IndexKind::ALL.iter().zip(&judged).flat_map(of).collect())
}

impl GaugeResult {
    /// From `scans`, those of the first rig first.
    fn new(index: IndexKind, reading: GaugedBy, scans: &[Vec<ShoulderResult>], repeat_count: usize) -> Self {
        let maps: Vec<Vec<f64>> = scans.iter().map(|scan| scan.iter().flat_map(|j| reading.of(j)).collect()).collect();
        let part_count = maps.first().map_or(0, Vec::len);
        let value = |part: usize, scan: usize| Some(maps[scan][part]).filter(|x| x.is_finite());
        let of = |scan_count: usize| -> Vec<Option<f64>> {
            (0..part_count).flat_map(|part| (0..scan_count).map(move |scan| value(part, scan))).collect()
        };
        let study = Crossed { part_count, operator_count: RIGS, repeat_count };
        Self {
            index,
            reading,
            parts: part_count,
            of_both: crossed(&of(RIGS * repeat_count), study),
            of_one: one_way(&of(repeat_count), part_count),
        }
    }
}

pub(super) fn table(repeated: &[GaugeResult]) -> Table {
    let mut table = Table::new(
        "gauge",
        "Gauge study: operators are two rigs, repeats whole scans; parts of the total standard deviation in per cent",
        ["index", "parts_read", "parts", "rigs"].into_iter().chain(GAUGE_COLUMNS),
    );
    for r in repeated {
        for (rigs, cells) in [(RIGS, gauge_cells(&r.of_both)), (1, gauge_cells(&r.of_one))] {
            let head = [r.index.name().into(), r.reading.name().into(), r.parts.into(), rigs.into()];
            table.push(head.into_iter().chain(cells));
        }
    }
    table
}
