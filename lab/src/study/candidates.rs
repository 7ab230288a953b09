//! Each index with each reference on every set, and every discriminator alone.

use std::sync::Arc;

use crate::statistics::{Rate, clopper_pearson};
use anyhow::{Context as _, Result};
use tapline_fuse::{FuseConfig, IndexKind, ReferenceSet};
use tapline_wire::Discriminator;

use super::judge::{alone, judge};
use super::parallel::each;
use super::sets::{Set, cracked, sound};
use super::size::Size;
use crate::evaluation::{Areas, Call, Table, cell, ends};
use crate::shoulder_result::{ShoulderResult, overlap};
use crate::simulated::{Dataset, Reading};

/// Part of the name of each tyre that is the reference.
const REFERENCE: &str = "reference";

/// One set: sound tyres that are the reference, and others that are judged.
#[derive(Debug)]
pub(super) struct Split {
    pub(super) name: &'static str,
    dataset: Dataset,
}

/// One way of judging.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub set: &'static str,
    pub reference: &'static str,
    pub index: IndexKind,
    pub judged: Vec<ShoulderResult>,
    pub areas: Areas,
}

/// Results of one discriminator with the healthy reference, averaged over three neighbours.
#[derive(Debug, Clone)]
pub(super) struct SingleDiscriminator {
    pub set: &'static str,
    pub which: Discriminator,
    pub areas: Areas,
}

impl Split {
    /// Scans the tyres of `set`, which is number `number`.
    pub(super) fn scan(set: &Set, number: u64, size: &Size, seed: u64) -> Result<Self> {
        let read = Self::scan_read(set, number, size, seed, &[Reading::default()])?;
        read.into_iter().next().context("one reading gives one split")
    }

    /// The same for each of `readings`.
    pub(super) fn scan_read(set: &Set, number: u64, size: &Size, seed: u64, readings: &[Reading]) -> Result<Vec<Self>> {
        let (half, quarter) = (size.tyres / 2, size.tyres / 4);
        let serial = |part: &str, k: usize| format!("{}-{part}-{k:03}", set.name);
        let references = (0..half).map(|k| sound(serial(REFERENCE, k)));
        let without = (0..half - quarter).map(|k| sound(serial("sound", k)));
        let with_cracks = (0..quarter).zip(1000 * number..);
        let with_cracks =
            with_cracks.map(|(k, drawn)| cracked(serial("cracked", k), &set.cracks, size.location_count, seed, drawn));
        let tyres = references.chain(without).chain(with_cracks).collect();
        let datasets = size.turns.scan_read(&set.simulation, tyres, (seed, size.location_count), readings)?;
        Ok(datasets.into_iter().map(|dataset| Self { name: set.name, dataset }).collect())
    }

    pub(super) fn judged(&self) -> Result<Dataset> {
        self.dataset.of_tyres(|tyre| !tyre.contains(REFERENCE))
    }

    /// The tyres of the reference.
    pub(super) fn healthy(&self) -> Result<Arc<ReferenceSet>> {
        self.dataset.reference(&FuseConfig::default(), |tyre| tyre.contains(REFERENCE))
    }
}

/// Every candidate on one set, and every discriminator alone.
pub(super) fn candidates(split: &Split) -> Result<(Vec<Candidate>, Vec<SingleDiscriminator>)> {
    let (judged, healthy) = (split.judged()?, split.healthy()?);
    let references = [("healthy", Some(&healthy)), ("self", None)];
    let jobs: Vec<_> = references.into_iter().flat_map(|by| IndexKind::ALL.map(|index| (by, index))).collect();
    let candidates = each(&jobs, |&((reference, by), index)| {
        let config = FuseConfig { index, ..FuseConfig::default() };
        let judged = judge(&config, &judged, by).with_context(|| format!("{} by {reference}", index.name()))?;
        let areas = Areas::new(&judged);
        Ok(Candidate { set: split.name, reference, index, judged, areas })
    })?;
    let alone = alone(&judged, Some(&healthy))?.into_iter();
    Ok((candidates, alone.map(|(which, areas)| SingleDiscriminator { set: split.name, which, areas }).collect()))
}

/// The best single discriminator on `set`.
pub(super) fn best_alone<'a>(alone: &'a [SingleDiscriminator], set: &str) -> Option<&'a SingleDiscriminator> {
    let area = |a: &SingleDiscriminator| a.areas.auc().unwrap_or(0.0);
    alone.iter().filter(|a| a.set == set).max_by(|a, b| area(a).total_cmp(&area(b)))
}

/// The candidate for `index` with `reference` on `set`.
pub(super) fn find<'a>(
    candidates: &'a [Candidate],
    set: &str,
    reference: &str,
    index: IndexKind,
) -> Option<&'a Candidate> {
    candidates.iter().find(|r| r.set == set && r.reference == reference && r.index == index)
}

pub(super) fn alone_table(alone: &[SingleDiscriminator], seed: u64) -> Table {
    let title = "AUC of each discriminator alone, by the healthy reference, averaged over three neighbours, with intervals by tyres";
    let mut table = Table::long("alone", title, ["set", "discriminator", "auc", "tyres_low", "tyres_high"]);
    for a in alone {
        let row = [a.set.into(), a.which.name().into(), cell(a.areas.auc())];
        table.push(row.into_iter().chain(ends(a.areas.by_tyres(seed))));
    }
    table
}

pub(super) fn overlap_table(candidates: &[Candidate]) -> Table {
    let title = "Regions of the default index over planted cracks: locations in both over locations in either";
    let mut table = Table::new("overlap", title, ["set", "overlap"]);
    for c in candidates.iter().filter(|c| c.reference == "healthy" && c.index == IndexKind::default()) {
        table.push([c.set.into(), cell(overlap(&c.judged))]);
    }
    table
}

pub(super) fn table(candidates: &[Candidate], seed: u64) -> Result<Table> {
    let title = "Each index by each reference on every set: AUC with intervals by tyres, and what the default rates made of sound \
                 shoulders";
    let columns = "set reference index auc tyres_low tyres_high sound_shoulders not_passed not_passed_low not_passed_high \
                   rejected rejected_low rejected_high";
    let mut table = Table::long("indices", title, columns.split(' '));
    for candidate in candidates {
        let mut row = vec![
            candidate.set.into(),
            candidate.reference.into(),
            candidate.index.name().into(),
            cell(candidate.areas.auc()),
        ];
        row.extend(ends(candidate.areas.by_tyres(seed)));
        let sound: Vec<&ShoulderResult> = candidate.judged.iter().filter(|j| j.is_sound()).collect();
        row.push(sound.len().into());
        for call in Call::ALL {
            let calls = sound.iter().filter(|j| call.is(j.verdict)).count();
            let Rate { low, high, .. } = clopper_pearson(calls, sound.len(), 0.95)?;
            row.push(calls.into());
            row.extend(ends(Some((low, high))));
        }
        table.push(row);
    }
    Ok(table)
}
