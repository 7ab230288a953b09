//! Every index, combination and reference on every set, beside the best discriminator alone.

use crate::statistics::clopper_pearson;
use anyhow::{Context as _, Result};
use tapline_fuse::{Combine, Extent, FuseConfig, IndexKind, Score};
use tapline_wire::Discriminator;

use super::areas::Areas;
use super::judged::{By, Judged, judge, overlap};
use super::sets::{Set, cracked, sound};
use super::size::Size;
use super::table::{Table, cell, ends};
use super::taken::{Taken, Turns};
use super::work::each;

/// Largest magnitude of a robust z of a discriminator alone: none is clipped that matters to a rank.
const UNCLIPPED: f64 = 1e3;

/// Indices on which every combination is tried; the others have the default one.
const COMBINED: [IndexKind; 4] =
    [IndexKind::Repeatability, IndexKind::Robust, IndexKind::Mahalanobis, IndexKind::LogOdds];

/// One set with its tyres in two halves, of which no tyre is in both.
#[derive(Debug)]
pub(super) struct Halves {
    pub(super) name: &'static str,
    pub(super) taken: Taken,
    /// Sound tyres that train, cracked ones that train.
    train_sound: Vec<String>,
    train_cracked: Vec<String>,
    test: Vec<String>,
}

/// One way of judging the second half.
#[derive(Debug, Clone)]
pub(super) struct Rival {
    pub(super) set: &'static str,
    pub(super) reference: &'static str,
    pub(super) index: IndexKind,
    pub(super) combine: Combine,
    pub(super) judged: Vec<Judged>,
    pub(super) areas: Areas,
}

/// What a discriminator does alone.
#[derive(Debug, Clone)]
pub(super) struct Alone {
    pub(super) set: &'static str,
    pub(super) which: Discriminator,
    /// AUC of its location means.
    pub(super) auc: Option<f64>,
    /// The same averaged along the ring, as an index is.
    pub(super) areas: Areas,
}

impl Halves {
    /// Scans the tyres of `set`, which is number `number`.
    pub(super) fn of(set: &Set, number: u64, size: &Size, turns: &Turns, seed: u64, threads: usize) -> Result<Self> {
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
        let taken = Taken::of(&set.simulation, tyres, turns, (seed, size.location_count, threads))?;
        Ok(Self { name: set.name, taken, train_sound, train_cracked, test: [test_sound, test_cracked].concat() })
    }

    /// The same tyres, of which only `turns` were made.
    pub(super) fn with(&self, turns: &Turns) -> Result<Self> {
        Ok(Self {
            name: self.name,
            taken: self.taken.only(|tap| turns.has(tap))?,
            train_sound: self.train_sound.clone(),
            train_cracked: self.train_cracked.clone(),
            test: self.test.clone(),
        })
    }

    /// The half that is judged.
    pub(super) fn test(&self) -> Result<Taken> {
        self.taken.of_tyres(|tyre| self.test.iter().any(|t| t == tyre))
    }

    /// The sound tyres that train, stated to be so.
    pub(super) fn healthy(&self) -> Result<By> {
        Ok(By::File(self.taken.reference(false, |tyre| self.train_sound.iter().any(|t| t == tyre))?))
    }

    /// All tyres that train, labelled.
    pub(super) fn labelled(&self) -> Result<By> {
        let trains = |tyre: &str| self.train_sound.iter().chain(&self.train_cracked).any(|t| t == tyre);
        Ok(By::File(self.taken.reference(true, trains)?))
    }

    /// The tyres that are cracked, of both halves.
    pub(super) fn cracked(&self) -> Vec<String> {
        let is_cracked = |tyre: &&String| {
            let truth = self.taken.plan.truth().iter();
            truth.into_iter().any(|((serial, _, _), &cracked)| cracked && serial.as_str() == tyre.as_str())
        };
        self.train_cracked.iter().chain(&self.test).filter(is_cracked).cloned().collect()
    }
}

/// How well regions lie over cracks, by how far they reach: intersection over union.
#[derive(Debug, Clone, Copy)]
pub(super) struct Overlaps {
    pub(super) set: &'static str,
    /// As long as the index stays above half of its limit.
    pub(super) half: Option<f64>,
    /// By hidden states.
    pub(super) hidden: Option<f64>,
}

/// The overlaps of the default index by the healthy reference.
pub(super) fn overlaps(halves: &Halves) -> Result<Overlaps> {
    let (test, by) = (halves.test()?, halves.healthy()?);
    let of =
        |extent| Ok::<_, anyhow::Error>(overlap(&judge(&FuseConfig { extent, ..FuseConfig::default() }, &test, &by)?));
    Ok(Overlaps { set: halves.name, half: of(Extent::Half)?, hidden: of(Extent::Hidden)? })
}

/// The table of them.
pub(super) fn overlaps_table(overlaps: &[Overlaps]) -> Table {
    let title =
        "Regions of the default index over planted cracks, intersection over union, by how far a region reaches";
    let mut table = Table::new("overlap", title, &["set", "half", "hidden"]);
    for o in overlaps {
        table.push([o.set.to_owned(), cell(o.half), cell(o.hidden)]);
    }
    table
}

/// Whether `index` needs labels to be what it is called.
pub(super) fn needs_labels(index: IndexKind) -> bool {
    matches!(index, IndexKind::Auc | IndexKind::Lda | IndexKind::LogOdds)
}

/// Every rival on one set, and every discriminator alone by the healthy reference.
pub(super) fn rivals(halves: &Halves, threads: usize) -> Result<(Vec<Rival>, Vec<Alone>)> {
    let test = halves.test()?;
    let references = [("self", By::Own), ("healthy", halves.healthy()?), ("labelled", halves.labelled()?)];
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
    let rivals = each(&jobs, threads, |&(reference, by, index, combine)| {
        let config = FuseConfig { index, combine, ..FuseConfig::default() };
        let judged = judge(&config, &test, by).with_context(|| format!("{} by {reference}", index.name()))?;
        let areas = Areas::of(&judged);
        Ok(Rival { set: halves.name, reference, index, combine, judged, areas })
    })?;
    let By::File(healthy) = &references[1].1 else { return Ok((rivals, Vec::new())) };
    let config = FuseConfig::by(tapline_fuse::Reference::File("study.json".into()));
    let score = Score::by_reference(&config, &test.plan, healthy.clone(), &test.records)?;
    let alone = each(&Discriminator::ALL, threads, |&which| {
        let config = FuseConfig { discriminators: vec![which], z_clip: UNCLIPPED, ..FuseConfig::default() };
        let areas = Areas::of(&judge(&config, &test, &references[1].1)?);
        Ok(Alone { set: halves.name, which, auc: score.discriminators[which as usize], areas })
    })?;
    Ok((rivals, alone))
}

/// The discriminator that alone does best on `set`, averaged along the ring.
pub(super) fn best_alone<'a>(alone: &'a [Alone], set: &str) -> Option<&'a Alone> {
    let area = |a: &Alone| a.areas.auc().unwrap_or(0.0);
    alone.iter().filter(|a| a.set == set).max_by(|a, b| area(a).total_cmp(&area(b)))
}

/// The table of discriminators alone.
pub(super) fn alone_table(alone: &[Alone]) -> Table {
    let title = "Discriminators alone, by the healthy reference: AUC of location means, and averaged along the ring";
    let mut table = Table::long("alone", title, &["set", "discriminator", "auc", "auc_ring"]);
    for a in alone {
        table.push([a.set.to_owned(), a.which.name().to_owned(), cell(a.auc), cell(a.areas.auc())]);
    }
    table
}

/// The table of all rivals.
pub(super) fn table(rivals: &[Rival], alone: &[Alone], seed: u64) -> Result<Table> {
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
    for rival in rivals {
        let best = best_alone(alone, rival.set).context("no discriminator alone")?;
        let auc = rival.areas.auc();
        let gain = auc.zip(best.areas.auc()).map(|(a, b)| a - b);
        let sound: Vec<&Judged> = rival.judged.iter().filter(|j| j.is_sound()).collect();
        let calls = sound.iter().filter(|j| !j.is_passed).count();
        let rate = clopper_pearson(calls, sound.len(), 0.95)?;
        let mut row = vec![
            rival.set.to_owned(),
            rival.reference.to_owned(),
            rival.index.name().to_owned(),
            rival.combine.name().to_owned(),
            cell(auc),
        ];
        row.extend(ends(rival.areas.by_blocks(seed)));
        row.extend(ends(rival.areas.by_tyres(seed)));
        row.extend([best.which.name().to_owned(), cell(gain)]);
        row.extend(ends(rival.areas.above_by_tyres(&best.areas, seed)));
        row.extend([cell(overlap(&rival.judged)), calls.to_string(), sound.len().to_string()]);
        row.extend(ends(Some((rate.low, rate.high))));
        row.push(if rival.judged.iter().any(|j| j.has_fallen_back) { "yes" } else { "no" }.to_owned());
        table.push(row);
    }
    Ok(table)
}
