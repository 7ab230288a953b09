//! Every index, combination and reference on every set, beside the best discriminator alone.

use crate::statistics::clopper_pearson;
use anyhow::{Context as _, Result};
use tapline_fuse::{Combine, Extent, FuseConfig, IndexKind, Score};
use tapline_wire::Discriminator;

use super::auc::Areas;
use super::dataset::{Dataset, Turns};
use super::judge::{ComparedWith, ShoulderResult, judge, overlap};
use super::parallel::each;
use super::sets::{Set, cracked, sound};
use super::size::Size;
use super::table::{Table, cell, ends, yes_or_no};

/// Largest magnitude of a robust z of a discriminator alone: none is clipped that matters to a rank.
const UNCLIPPED: f64 = 1e3;

/// Indices on which every combination is tried; the others have the default one.
const COMBINED: [IndexKind; 4] =
    [IndexKind::Repeatability, IndexKind::Robust, IndexKind::Mahalanobis, IndexKind::LogOdds];

/// One set with its tyres in two split, of which no tyre is in both.
#[derive(Debug)]
pub(super) struct TrainTest {
    pub(super) name: &'static str,
    pub(super) dataset: Dataset,
    /// Sound tyres that train, cracked ones that train.
    train_sound: Vec<String>,
    train_cracked: Vec<String>,
    test: Vec<String>,
}

/// One way of judging the second half.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub set: &'static str,
    pub reference: &'static str,
    pub index: IndexKind,
    pub combine: Combine,
    pub judged: Vec<ShoulderResult>,
    pub areas: Areas,
}

/// What a discriminator does alone.
#[derive(Debug, Clone)]
pub(super) struct SingleDiscriminator {
    pub set: &'static str,
    pub which: Discriminator,
    /// AUC of its location means.
    pub auc: Option<f64>,
    /// The same averaged along the ring, as an index is.
    pub areas: Areas,
}

impl TrainTest {
    /// Scans the tyres of `set`, which is number `number`.
    pub(super) fn scan(set: &Set, number: u64, size: &Size, turns: &Turns, seed: u64, threads: usize) -> Result<Self> {
        let name = |half: &str, k: usize| format!("{}-{half}-{k:03}", set.name);
        let (half, quarter) = (size.tyres / 2, size.tyres / 4);
        let names = |half_name: &str, from: usize, to: usize| -> Vec<String> {
            (from..to).map(|k| name(half_name, k)).collect()
        };
        let (train_sound, train_cracked) = (names("A", 0, quarter), names("A", quarter, half));
        let (test_sound, test_cracked) = (names("B", 0, quarter), names("B", quarter, half));
        let with_cracks = train_cracked.iter().chain(&test_cracked).zip(1000 * number..);
        let with_cracks = with_cracks.map(|(s, k)| cracked(s.clone(), &set.cracks, size.location_count, seed, k));
        let tyres = train_sound.iter().chain(&test_sound).cloned().map(sound).chain(with_cracks).collect();
        let dataset = Dataset::scan(&set.simulation, tyres, turns, (seed, size.location_count, threads))?;
        Ok(Self { name: set.name, dataset, train_sound, train_cracked, test: [test_sound, test_cracked].concat() })
    }

    /// The same tyres, of which only `turns` were made.
    pub(super) fn with(&self, turns: &Turns) -> Result<Self> {
        Ok(Self {
            name: self.name,
            dataset: self.dataset.only(|tap| turns.has(tap))?,
            train_sound: self.train_sound.clone(),
            train_cracked: self.train_cracked.clone(),
            test: self.test.clone(),
        })
    }

    /// The half that is judged.
    pub(super) fn test(&self) -> Result<Dataset> {
        self.dataset.of_tyres(|tyre| self.test.iter().any(|t| t == tyre))
    }

    /// The sound tyres that train, stated to be so.
    pub(super) fn healthy(&self) -> Result<ComparedWith> {
        Ok(ComparedWith::File(self.dataset.reference(false, |tyre| self.train_sound.iter().any(|t| t == tyre))?))
    }

    /// All tyres that train, labelled.
    pub(super) fn labelled(&self) -> Result<ComparedWith> {
        let trains = |tyre: &str| self.train_sound.iter().chain(&self.train_cracked).any(|t| t == tyre);
        Ok(ComparedWith::File(self.dataset.reference(true, trains)?))
    }

    /// The tyres that are cracked, of both split.
    pub(super) fn cracked(&self) -> Vec<String> {
        let is_cracked = |tyre: &&String| {
            let truth = self.dataset.plan.truth().iter();
            truth.into_iter().any(|((serial, _, _), &cracked)| cracked && serial.as_str() == tyre.as_str())
        };
        self.train_cracked.iter().chain(&self.test).filter(is_cracked).cloned().collect()
    }
}

/// How well regions lie over cracks, by how far they reach: intersection over union.
#[derive(Debug, Clone, Copy)]
pub(super) struct Overlaps {
    pub set: &'static str,
    /// As long as the index stays above half of its limit.
    pub half: Option<f64>,
    /// By hidden states.
    pub hidden: Option<f64>,
}

/// The overlaps of the default index by the healthy reference.
pub(super) fn overlaps(split: &TrainTest) -> Result<Overlaps> {
    let (test, by) = (split.test()?, split.healthy()?);
    let of =
        |extent| Ok::<_, anyhow::Error>(overlap(&judge(&FuseConfig { extent, ..FuseConfig::default() }, &test, &by)?));
    Ok(Overlaps { set: split.name, half: of(Extent::Half)?, hidden: of(Extent::Hidden)? })
}

/// The table of them.
pub(super) fn overlaps_table(overlaps: &[Overlaps]) -> Table {
    let title =
        "Regions of the default index over planted cracks, intersection over union, by how far a region reaches";
    let mut table = Table::new("overlap", title, &["set", "half", "hidden"]);
    for o in overlaps {
        table.push([o.set.into(), cell(o.half), cell(o.hidden)]);
    }
    table
}

/// Whether `index` needs labels to be what it is called.
pub(super) fn needs_labels(index: IndexKind) -> bool {
    matches!(index, IndexKind::Auc | IndexKind::Lda | IndexKind::LogOdds)
}

/// Every candidate on one set, and every discriminator alone by the healthy reference.
pub(super) fn candidates(split: &TrainTest, threads: usize) -> Result<(Vec<Candidate>, Vec<SingleDiscriminator>)> {
    let test = split.test()?;
    let references = [("self", ComparedWith::Itself), ("healthy", split.healthy()?), ("labelled", split.labelled()?)];
    let mut jobs = Vec::new();
    for (name, by) in &references {
        for index in IndexKind::ALL {
            for combine in Combine::ALL {
                let is_learned = needs_labels(index) || combine == Combine::Fitted;
                let is_combined = combine == Combine::default() || COMBINED.contains(&index);
                if (*name == "labelled" || !is_learned) && is_combined {
                    jobs.push((*name, by, index, combine));
                }
            }
        }
    }
    let candidates = each(&jobs, threads, |&(reference, by, index, combine)| {
        let config = FuseConfig { index, combine, ..FuseConfig::default() };
        let judged = judge(&config, &test, by).with_context(|| format!("{} by {reference}", index.name()))?;
        let areas = Areas::new(&judged);
        Ok(Candidate { set: split.name, reference, index, combine, judged, areas })
    })?;
    let ComparedWith::File(healthy) = &references[1].1 else { return Ok((candidates, Vec::new())) };
    let config = FuseConfig::by(tapline_fuse::Reference::File("study.json".into()));
    let score = Score::by_reference(&config, &test.plan, healthy.clone(), &test.records)?;
    let alone = each(&Discriminator::ALL, threads, |&which| {
        let config = FuseConfig { discriminators: vec![which], z_clip: UNCLIPPED, ..FuseConfig::default() };
        let areas = Areas::new(&judge(&config, &test, &references[1].1)?);
        Ok(SingleDiscriminator { set: split.name, which, auc: score.discriminators[which as usize], areas })
    })?;
    Ok((candidates, alone))
}

/// The discriminator that alone does best on `set`, averaged along the ring.
pub(super) fn best_alone<'a>(alone: &'a [SingleDiscriminator], set: &str) -> Option<&'a SingleDiscriminator> {
    let area = |a: &SingleDiscriminator| a.areas.auc().unwrap_or(0.0);
    alone.iter().filter(|a| a.set == set).max_by(|a, b| area(a).total_cmp(&area(b)))
}

/// The table of discriminators alone.
pub(super) fn alone_table(alone: &[SingleDiscriminator]) -> Table {
    let title = "Discriminators alone, by the healthy reference: AUC of location means, and averaged along the ring";
    let mut table = Table::long("alone", title, &["set", "discriminator", "auc", "auc_ring"]);
    for a in alone {
        table.push([a.set.into(), a.which.name().into(), cell(a.auc), cell(a.areas.auc())]);
    }
    table
}

/// The table of all candidates.
pub(super) fn table(candidates: &[Candidate], alone: &[SingleDiscriminator], seed: u64) -> Result<Table> {
    let mut table = Table::long(
        "indices",
        "Every index on every set: AUC with intervals by blocks of locations and by tyres, and what it gains over the best \
         discriminator alone",
        &[
            "set",
            "reference",
            "index",
            "combine",
            "auc",
            "blocks_low",
            "blocks_high",
            "tyres_low",
            "tyres_high",
            "best_alone",
            "gain",
            "gain_low",
            "gain_high",
            "overlap",
            "false_calls",
            "sound_shoulders",
            "rate_low",
            "rate_high",
            "fell_back",
        ],
    );
    for candidate in candidates {
        let best = best_alone(alone, candidate.set).context("no discriminator alone")?;
        let auc = candidate.areas.auc();
        let gain = auc.zip(best.areas.auc()).map(|(a, b)| a - b);
        let sound: Vec<&ShoulderResult> = candidate.judged.iter().filter(|j| j.is_sound()).collect();
        let calls = sound.iter().filter(|j| !j.is_passed).count();
        let rate = clopper_pearson(calls, sound.len(), 0.95)?;
        let mut row = vec![
            candidate.set.into(),
            candidate.reference.into(),
            candidate.index.name().into(),
            candidate.combine.name().into(),
            cell(auc),
        ];
        row.extend(ends(candidate.areas.by_blocks(seed)));
        row.extend(ends(candidate.areas.by_tyres(seed)));
        row.extend([best.which.name().into(), cell(gain)]);
        row.extend(ends(candidate.areas.above_by_tyres(&best.areas, seed)));
        row.extend([cell(overlap(&candidate.judged)), calls.into(), sound.len().into()]);
        row.extend(ends(Some((rate.low, rate.high))));
        row.push(yes_or_no(candidate.judged.iter().any(|j| j.has_fallen_back)));
        table.push(row);
    }
    Ok(table)
}
