//! How well a rig repeats, and two rigs agree: gauge repeatability and reproducibility of the index.
//!
//! Parts are locations, operators two rigs, and a repeat is a whole scan with taps of its own. The second rig has its
//! microphone a tenth farther away, twice the noise in both channels, and a velocity that jitters half as much again.

use crate::statistics::{Crossed, Gauge, OneWay, crossed, one_way};
use anyhow::Result;
use tapline_fuse::{FuseConfig, IndexKind};
use tapline_model::SimulationConfig;

use super::dataset::{Dataset, Turns};
use super::judge::{ComparedWith, ShoulderResult, judge};
use super::parallel::each;
use super::sets::{Set, cracked, sound};
use super::size::Size;
use super::table::{Cell, Table, cell};

/// Sound tyres of the reference, scanned on the first rig.
const REFERENCE: usize = 4;
const RIGS: usize = 2;

/// What the study of one index found.
#[derive(Debug)]
pub(super) struct GaugeResult {
    pub index: IndexKind,
    pub of_both: Result<Gauge, crate::statistics::Refusal>,
    /// Of the first rig alone.
    pub of_one: Result<OneWay, crate::statistics::Refusal>,
}

/// Scans the same tyres again and again on two rigs.
pub(super) fn gauge(set: &Set, size: &Size, seed: u64, threads: usize) -> Result<Vec<GaugeResult>> {
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
        let dataset = Dataset::scan(simulation, tyres.clone(), &turns, (seed, size.location_count, threads))?;
        if rig == 0 {
            let first_scan = dataset.only(|tap| tap.id.repetition < of_a_scan)?;
            reference = Some(first_scan.reference(|tyre| tyre.starts_with("reference"))?);
        }
        for scan in 0..size.gauge_scans {
            let from = rig * of_a_rig + scan * of_a_scan;
            scans.push(dataset.only(|tap| {
                (from..from + of_a_scan).contains(&tap.id.repetition) && tap.id.tyre.as_str().starts_with("part")
            })?);
        }
    }
    let by = reference.map_or(ComparedWith::Itself, ComparedWith::File);
    each(&IndexKind::ALL, threads, |&index| {
        let config = FuseConfig { index, ..FuseConfig::default() };
        let read = |scan: &Dataset| judge(&config, scan, &by);
        let scans: Vec<Vec<ShoulderResult>> = scans.iter().map(read).collect::<Result<_>>()?;
        let maps: Vec<Vec<f64>> =
            scans.iter().map(|s| s.iter().flat_map(|j| j.index.iter().copied()).collect()).collect();
        let part_count = maps.first().map_or(0, Vec::len);
        let repeat_count = usize::from(size.gauge_scans);
        let reading = |part: usize, scan: usize| Some(maps[scan][part]).filter(|x| x.is_finite());
        let of = |scan_count: usize| -> Vec<Option<f64>> {
            (0..part_count).flat_map(|part| (0..scan_count).map(move |scan| reading(part, scan))).collect()
        };
        let study = Crossed { part_count, operator_count: RIGS, repeat_count };
        Ok(GaugeResult {
            index,
            of_both: crossed(&of(RIGS * repeat_count), study),
            of_one: one_way(&of(repeat_count), part_count),
        })
    })
}

/// The table of them.
pub(super) fn table(repeated: &[GaugeResult]) -> Table {
    let mut table = Table::new(
        "gauge",
        "Gauge study of the index: parts are locations, operators two rigs, repeats whole scans; parts of the total \
         standard deviation in per cent",
        &[
            "index",
            "rigs",
            "repeatability_percent",
            "reproducibility_percent",
            "gauge_percent",
            "part_percent",
            "ndc",
            "remark",
        ],
    );
    for r in repeated {
        let name = r.index.name();
        let ndc = |ndc: Option<u64>| ndc.map_or(Cell::Empty, Cell::Count);
        match &r.of_both {
            Ok(g) => {
                let parts = [g.repeatability, g.reproducibility, g.gauge, g.part].map(|c| cell(c.study_percent));
                let remark = if g.is_pooled { "interaction pooled" } else { "" };
                table.push([name.into(), RIGS.into()].into_iter().chain(parts).chain([ndc(g.ndc), remark.into()]));
            }
            Err(why) => table.push(refused(name, RIGS, &why.to_string())),
        }
        match &r.of_one {
            Ok(g) => {
                let [repeat, part] = [g.repeatability, g.part].map(|c| cell(c.study_percent));
                table.push([name.into(), 1.into(), repeat.clone(), Cell::Empty, repeat, part, ndc(g.ndc), Cell::Empty]);
            }
            Err(why) => table.push(refused(name, 1, &why.to_string())),
        }
    }
    table
}

fn refused(name: &str, rigs: usize, why: &str) -> Vec<Cell> {
    let empty = (0..5).map(|_| Cell::Empty);
    [name.into(), rigs.into()].into_iter().chain(empty).chain([why.into()]).collect()
}
