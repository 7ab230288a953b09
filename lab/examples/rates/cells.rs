//! One cell: a scene judged by one kind of reference, and what is counted of it.

use std::fmt;
use std::io::Write;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use rayon::prelude::*;
use tapline_fuse::{Built, FuseConfig, Fusion, KnownShoulder, Reference, ReferenceSet, auc, build_reference};
use tapline_lab::statistics::clopper_pearson;
use tapline_wire::{Discriminator, Discriminators, Plan, Reasons, Verdict};

use crate::scenes::Scene;
use crate::sets::{Cache, Policy, Set, Times};

/// What shoulders are compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum By {
    /// Each casing with itself.
    Own,
    /// So many sound casings.
    File(usize),
}

impl By {
    pub(crate) fn casings(&self) -> usize {
        match self {
            Self::Own => 0,
            Self::File(casings) => *casings,
        }
    }
}

impl FromStr for By {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "self" => Ok(Self::Own),
            _ => text.parse().ok().filter(|&n| n > 0).map(Self::File).ok_or("`self` or a number of casings".to_owned()),
        }
    }
}

impl fmt::Display for By {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Own => f.pad("self"),
            Self::File(casings) => f.pad(&casings.to_string()),
        }
    }
}

/// How casings are scanned and judged.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asked {
    pub(crate) policy: Policy,
    pub(crate) re_inspect_rate: Option<f64>,
    pub(crate) confirm_rate: Option<f64>,
    pub(crate) times: Times,
}

/// A shoulder that was judged.
#[derive(Debug)]
struct Judged {
    /// What its casing took, s.
    scan_s: f64,
    is_asked: bool,
    verdict: u32,
    reasons: Reasons,
    index: Vec<f64>,
    /// Ring mean of each discriminator by itself, in the direction of damage.
    alone: Vec<Vec<f64>>,
    is_cracked: Vec<bool>,
}

/// What is counted of a cell.
#[derive(Debug)]
pub(crate) struct Cell {
    scene: Scene,
    by: By,
    repetitions: u16,
    judged: Vec<Judged>,
    seconds: f64,
}

/// Judges `scene` in every group.
pub(crate) fn judge_cell(
    cache: &Cache,
    scene: Scene,
    by: By,
    repetitions: u16,
    casings: usize,
    (seed, groups): (u64, u64),
    asked: Asked,
) -> Result<Cell> {
    let mut judged = Vec::new();
    let mut seconds = 0.0;
    for seed in seed..seed + groups {
        let set = cache.judged(scene, casings, seed)?;
        let known = match by {
            By::Own => None,
            By::File(_) => Some(cache.reference(scene, seed)?),
        };
        let begun = Instant::now();
        let mut config = FuseConfig::by(Reference::Own);
        config.re_inspect_rate = asked.re_inspect_rate.unwrap_or(config.re_inspect_rate);
        config.confirm_rate = asked.confirm_rate.unwrap_or(config.confirm_rate);
        if config.reject_rate > config.re_inspect_rate {
            config.reject_rate = config.re_inspect_rate;
        }
        // Where taps are made again, the reference has as many repetitions more.
        let known_repetitions = if asked.policy == Policy::Fixed { repetitions } else { 2 * repetitions };
        let reference = known.map(|set| reference(&config, &set, by.casings(), known_repetitions)).transpose()?;
        let per_part = casings.div_ceil(rayon::current_num_threads());
        let parts: Vec<_> = (0..casings).step_by(per_part).map(|k| k..casings.min(k + per_part)).collect();
        let of_part = |casings: &std::ops::Range<usize>| {
            judge(&config, &set, (casings.clone(), repetitions), asked, scene, &reference)
        };
        let found: Vec<Vec<Judged>> = parts.par_iter().map(of_part).collect::<Result<_>>()?;
        judged.extend(found.into_iter().flatten());
        seconds += begun.elapsed().as_secs_f64();
    }
    Ok(Cell { scene, by, repetitions, judged, seconds })
}

fn reference(config: &FuseConfig, set: &Set, casings: usize, repetitions: u16) -> Result<Arc<ReferenceSet>> {
    let (plan, records) = set.part(0..casings, repetitions, Policy::Fixed, Scene::SoundSmooth)?;
    let shoulders = (0..plan.scans().len()).map(|scan| KnownShoulder::of(&plan, &records, scan, None));
    let built = Built { config: config.clone(), lineage: Vec::new(), process: String::new(), learns_directions: false };
    let shoulders: Option<Vec<_>> = shoulders.collect();
    Ok(Arc::new(build_reference(&built, shoulders.context("a shoulder is not planned")?)?))
}

/// The shoulders that count of some casings of `set`.
fn judge(
    config: &FuseConfig,
    set: &Set,
    (casings, repetitions): (std::ops::Range<usize>, u16),
    asked: Asked,
    scene: Scene,
    reference: &Option<Arc<ReferenceSet>>,
) -> Result<Vec<Judged>> {
    let first_casing = casings.start;
    let (mut plan, mut records) = set.part(casings, repetitions, asked.policy, scene)?;
    let whole = |plan: &Plan, records: &[Discriminators]| -> Result<Fusion> {
        let mut fusion = match reference {
            None => Fusion::new(config, plan)?,
            Some(set) => Fusion::with_reference(config, plan, set.clone())?,
        };
        records.iter().try_for_each(|record| fusion.push(record))?;
        (0..plan.scans().len()).try_for_each(|number| fusion.end(number))?;
        Ok(fusion)
    };
    let mut fusion = whole(&plan, &records)?;
    if asked.policy != Policy::Fixed {
        let mut wanted = Vec::new();
        for casing in (0..plan.scans().len()).step_by(2) {
            wanted.extend(fusion.wanted(casing, usize::MAX)?);
        }
        records.extend(set.again(&wanted, first_casing, &plan)?);
        plan = plan.grown(&wanted)?;
        fusion = whole(&plan, &records)?;
    }
    let both_count = scene.is_sound() && !scene.changes_a_turn();
    let wanted = plan.scans().iter().enumerate().filter(|(_, scan)| both_count || scan.shoulder == 1);
    wanted
        .map(|(number, scan)| {
            let (judgement, cells) = fusion.judge(number)?;
            let truth = |location| plan.truth().get(&(scan.tyre, scan.shoulder, location)).copied();
            Ok(Judged {
                scan_s: asked.times.of(&plan, scan.tyre),
                is_asked: scan.taps.iter().any(|&row| plan.taps()[row as usize].is_second_reading()),
                verdict: judgement.verdict,
                reasons: judgement.reasons,
                index: cells.iter().map(|cell| cell.damage_index).collect(),
                alone: if asked.policy == Policy::Fixed {
                    Discriminator::ALL.map(|which| alone(&plan, &records, number, which)).to_vec()
                } else {
                    Vec::new()
                },
                is_cracked: cells.iter().map(|cell| truth(cell.location).unwrap_or(false)).collect(),
            })
        })
        .collect()
}

/// The mean over turns and three neighbours of one discriminator's logarithm, less each turn's median.
fn alone(plan: &Plan, records: &[Discriminators], scan: usize, which: Discriminator) -> Vec<f64> {
    let scan = &plan.scans()[scan];
    let count = scan.locations.len();
    let mut sums = vec![(0.0, 0.0); count];
    for turn in scan.taps.chunks(count) {
        let logs: Vec<f64> = turn
            .iter()
            .map(|&row| records[row as usize].values.get(which).filter(|&x| x > 0.0).map_or(f64::NAN, f64::ln))
            .collect();
        let mut sorted: Vec<f64> = logs.iter().copied().filter(|x| x.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let Some(&median) = sorted.get(sorted.len() / 2) else { continue };
        for (sum, log) in sums.iter_mut().zip(logs).filter(|(_, log)| log.is_finite()) {
            *sum = (sum.0 + which.direction().sign() * (log - median), sum.1 + 1.0);
        }
    }
    let at = |place: usize| sums[place % count];
    let mean = |place: usize| {
        let three = [at(place + count - 1), at(place), at(place + 1)];
        three.iter().map(|s| s.0).sum::<f64>() / three.iter().map(|s| s.1).sum::<f64>()
    };
    (0..count).map(mean).collect()
}

impl Cell {
    pub(crate) fn write_head(out: &mut impl Write) -> Result<()> {
        let verdicts = Verdict::ALL.map(|v| format!("{:>30}", format!("{v}"))).concat();
        writeln!(
            out,
            "{:13}{:>5}{:>4}{:>6}{verdicts}{:>7}{:>7}{:>7}",
            "scene", "ref", "rep", "n", "AUC", "apart", "s"
        )?;
        Ok(())
    }

    /// Writes its lines: counts and areas, why shoulders were not passed, and the discriminators alone.
    pub(crate) fn write(&self, out: &mut impl Write) -> Result<()> {
        let all = self.judged.len();
        let scene = format!("{:?}", self.scene);
        write!(out, "{scene:13}{:>5}{:>4}{all:>6}", self.by, self.repetitions)?;
        for verdict in Verdict::ALL {
            let count = self.judged.iter().filter(|j| j.verdict == verdict.code()).count();
            let rate = clopper_pearson(count, all, 0.95)?;
            let percent = |x: f64| 100.0 * x;
            let text =
                format!("{count} {:.1} % ({:.1}-{:.1})", percent(rate.rate), percent(rate.low), percent(rate.high));
            write!(out, "{text:>30}")?;
        }
        let index = |j: &Judged| j.index.clone();
        let [whole, apart] = [false, true].map(|apart| self.auc(&index, apart));
        writeln!(out, "{}{}{:>7.1}", area(whole), area(apart), self.seconds)?;
        let called = || self.judged.iter().filter(|j| j.verdict != Verdict::Pass.code());
        let reasons: Vec<String> = Reasons::ALL
            .iter()
            .map(|&(reason, name)| (name, called().filter(|j| j.reasons.contains(reason)).count()))
            .filter(|&(_, count)| count > 0)
            .map(|(name, count)| format!("{name} {count}"))
            .collect();
        if !reasons.is_empty() {
            writeln!(out, "    not passed for: {}", reasons.join(", "))?;
        }
        let mut times: Vec<f64> = self.judged.iter().map(|judged| judged.scan_s).collect();
        times.sort_by(f64::total_cmp);
        writeln!(
            out,
            "    seconds a casing: mean {:.1}, p95 {:.1}; tapped again {}",
            times.iter().sum::<f64>() / all as f64,
            times[(95 * all / 100).min(all - 1)],
            self.judged.iter().filter(|judged| judged.is_asked).count()
        )?;
        if whole.is_some() && self.judged.iter().all(|judged| !judged.alone.is_empty()) {
            let alone = Discriminator::ALL.iter().enumerate().map(|(place, which)| {
                let auc = self.auc(&|j: &Judged| j.alone[place].clone(), false);
                format!("{}{}", which.name(), area(auc))
            });
            writeln!(out, "    alone, ring mean: {}", alone.collect::<Vec<_>>().join("  "))?;
        }
        Ok(())
    }

    /// Area under the curve of all locations together; without sound ones beside cracked ones where they are `apart`.
    fn auc(&self, score: &impl Fn(&Judged) -> Vec<f64>, apart: bool) -> Option<f64> {
        let (mut scores, mut labels) = (Vec::new(), Vec::new());
        for judged in &self.judged {
            let n = judged.is_cracked.len();
            for (place, score) in score(judged).into_iter().enumerate() {
                let is_cracked = judged.is_cracked[place];
                let is_beside = judged.is_cracked[(place + 1) % n] || judged.is_cracked[(place + n - 1) % n];
                if is_cracked || !apart || !is_beside {
                    scores.push(score);
                    labels.push(is_cracked);
                }
            }
        }
        auc(&scores, &labels)
    }
}

fn area(auc: Option<f64>) -> String {
    auc.map_or_else(|| format!("{:>7}", "-"), |auc| format!("{auc:>7.3}"))
}
