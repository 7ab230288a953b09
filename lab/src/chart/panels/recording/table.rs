//! The AUC by the length of the record, for every scene of both simulators and every set of the study.

use anyhow::{Context as _, Result};

use super::readings::{Heard, LENGTHS_S, RATE_HZ, RECORD_S};
use super::scenes::Found;
use crate::chart::Bench;
use crate::chart::casings::areas_of;
use crate::chart::point::LEVEL;
use crate::evaluation::{Areas, Cell, Table, cell, ends};
use crate::simulated::Simulator;
use crate::statistics::mean_interval;
use crate::study::by_readings;

/// The short length that is compared with the whole record.
const SHORT_S: f64 = 0.05;

pub(super) fn by_length(bench: &Bench, heard: &[Heard], found: &[Found]) -> Result<Table> {
    let columns = "simulator scene seeds cracked auc_0.4 auc_0.2 auc_0.1 auc_0.06 auc_0.05 auc_0.04 auc_0.03 auc_0.025 \
                   gain_0.05 gain_low gain_high";
    let title = "AUC of the default index by the length of the record in s, mean over seeds, and what records of 0.05 s gain over 0.4 s, with \
                 95 % intervals over seeds in pairs";
    let mut table = Table::new("record_length", title, columns.split(' '));
    for simulator in Simulator::ALL {
        let mut scenes: Vec<_> = found.iter().filter(|f| f.simulator == simulator).map(|f| f.scene).collect();
        scenes.dedup();
        scenes.sort_by_key(|scene| scene.set_name());
        scenes.dedup();
        for scene in scenes {
            let of_scene = || found.iter().filter(move |f| f.simulator == simulator && f.scene == scene);
            let areas = |place: usize| -> Vec<Areas> {
                of_scene().map(|f| areas_of(&f.places(place).collect::<Vec<_>>(), None)).collect()
            };
            let by_length: Vec<Vec<Areas>> = (0..LENGTHS_S.len()).map(areas).collect();
            table.push(row(simulator.name(), scene.set_name(), &by_length)?);
        }
    }
    let readings: Vec<_> = heard.iter().take(LENGTHS_S.len()).map(|heard| heard.reading).collect();
    let (tyres, seed_count) = bench.size.study;
    let seeds = bench.seed..bench.seed + seed_count;
    let sample_count = (RECORD_S * RATE_HZ) as u32;
    let of_study = by_readings(&readings, sample_count, tyres, seeds)?;
    for (name, by_length) in of_study.iter().filter(|_| seed_count > 0) {
        table.push(row("model", &format!("study: {name}"), by_length)?);
    }
    Ok(table)
}

/// A row of areas by length, then by seed.
fn row(simulator: &str, scene: &str, by_length: &[Vec<Areas>]) -> Result<Vec<Cell>> {
    let auc = |areas: &Areas| areas.auc().context("a scene has cracked and sound locations");
    let aucs: Vec<Vec<f64>> = by_length.iter().map(|areas| areas.iter().map(auc).collect()).collect::<Result<_>>()?;
    let whole = aucs.first().context("there are lengths")?;
    let short = LENGTHS_S.iter().position(|s| (s - SHORT_S).abs() < 1e-9).context("the short length is tried")?;
    let gains: Vec<f64> = aucs[short].iter().zip(whole).map(|(short, whole)| short - whole).collect();
    let cracked: usize = by_length[0].iter().map(|areas| areas.count(true)).sum();
    let mut row: Vec<Cell> = vec![simulator.into(), scene.into(), whole.len().into(), cracked.into()];
    row.extend(aucs.iter().map(|aucs| cell(tapline_draw::stats::mean(aucs))));
    let gain = mean_interval(&gains, LEVEL);
    row.push(cell(gain.map(|gain| gain.rate)));
    row.extend(ends(gain.map(|gain| (gain.low, gain.high))));
    Ok(row)
}
