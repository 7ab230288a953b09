//! One cell: a scene judged with one kind of reference, and its counts.

use std::io::Write;
use std::time::Instant;

use anyhow::Result;
use clap::ValueEnum;
use rayon::prelude::*;
use tapline_fuse::{FuseConfig, auc};
use tapline_lab::simulated::{Judged, Judging, ScanTaps, Scene, Times, judge};
use tapline_lab::statistics::clopper_pearson;
use tapline_plate::ScanShape;
use tapline_wire::{Discriminator, Reasons, Verdict};

use crate::sets::Sets;

/// How a casing is scanned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Policy {
    /// All taps and no others.
    Fixed,
    /// All taps, then again what stands out.
    Full,
    /// Some of the taps, then again what stands out.
    Adaptive,
}

impl Policy {
    /// The taps of a scan of `shape` with `repetitions`.
    fn taps(self, shape: &ScanShape, repetitions: u16) -> ScanTaps {
        let full = ScanTaps::full(&shape.offsets_mm, &shape.velocities_m_per_s, repetitions);
        match self {
            Self::Fixed => full,
            Self::Full => full.confirmed(),
            Self::Adaptive => {
                let velocity = shape.velocities_m_per_s.iter().copied().max_by(f64::total_cmp).unwrap_or(f64::NAN);
                ScanTaps::adaptive(velocity)
            }
        }
    }
}

/// The sound casings of a reference; 0 compares each casing with itself.
pub(crate) fn casings(text: &str) -> Result<usize, String> {
    match text {
        "self" => Ok(0),
        _ => text.parse().ok().filter(|&n| n > 0).ok_or("`self` or a number of casings".to_owned()),
    }
}

/// What [`casings`] reads.
pub(crate) fn named(casings: usize) -> String {
    if casings == 0 { "self".to_owned() } else { casings.to_string() }
}

/// How casings are scanned and judged.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asked {
    pub policy: Policy,
    pub times: Times,
}

/// The counts of a cell.
#[derive(Debug)]
pub(crate) struct SceneCounts {
    scene: Scene,
    /// Casings of the reference, as [`casings`] has them.
    by: usize,
    repetitions: u16,
    judged: Vec<Judged>,
    /// Casings of references that stand out from the others in theirs.
    standing_out: usize,
    seconds: f64,
}

/// Judges `scene` in every group.
pub(crate) fn judge_cell(
    sets: &mut Sets,
    scene: Scene,
    by: usize,
    repetitions: u16,
    casings: usize,
    (seed, groups): (u64, u64),
    asked: Asked,
) -> Result<SceneCounts> {
    let mut judged = Vec::new();
    let (mut standing_out, mut seconds) = (0, 0.0);
    for seed in seed..seed + groups {
        let set = sets.judged(scene, casings, seed)?;
        let known = (by > 0).then(|| sets.reference(scene, seed)).transpose()?;
        let begun = Instant::now();
        let taps = asked.policy.taps(&set.shape, repetitions);
        let judging = Judging::new(FuseConfig::default(), known.as_deref().map(|known| (known, by)), taps)?;
        let judging = Judging { times: asked.times, ..judging };
        standing_out += judging.reference.as_ref().map_or(0, |set| set.summary.standing_out.len());
        let per_part = casings.div_ceil(rayon::current_num_threads());
        let parts: Vec<_> = (0..casings).step_by(per_part).map(|k| k..casings.min(k + per_part)).collect();
        let of_part = |casings: &std::ops::Range<usize>| judge(&judging, &set, casings.clone(), scene);
        let found: Vec<Vec<Judged>> = parts.par_iter().map(of_part).collect::<Result<_>>()?;
        judged.extend(found.into_iter().flatten());
        seconds += begun.elapsed().as_secs_f64();
    }
    Ok(SceneCounts { scene, by, repetitions, judged, standing_out, seconds })
}

impl SceneCounts {
    pub(crate) fn write_head(out: &mut impl Write) -> Result<()> {
        let verdicts = Verdict::ALL.map(|v| format!("{:>30}", format!("{v}"))).concat();
        writeln!(
            out,
            "{:13}{:>5}{:>4}{:>6}{verdicts}{:>7}{:>7}{:>7}",
            "scene", "ref", "rep", "n", "AUC", "apart", "s"
        )?;
        Ok(())
    }

    /// Writes its lines: counts and AUCs, why shoulders were not passed, which cracked ones passed, and discriminators alone.
    pub(crate) fn write(&self, out: &mut impl Write) -> Result<()> {
        let all = self.judged.len();
        let scene = format!("{:?}", self.scene);
        write!(out, "{scene:13}{:>5}{:>4}{all:>6}", named(self.by), self.repetitions)?;
        for verdict in Verdict::ALL {
            let count = self.judged.iter().filter(|j| j.result.verdict == verdict).count();
            let rate = clopper_pearson(count, all, 0.95)?;
            let percent = |x: f64| 100.0 * x;
            let text =
                format!("{count} {:.1} % ({:.1}-{:.1})", percent(rate.rate), percent(rate.low), percent(rate.high));
            write!(out, "{text:>30}")?;
        }
        let index = |j: &Judged| j.result.index.clone();
        let [whole, apart] = [false, true].map(|apart| self.auc(&index, apart));
        writeln!(out, "{}{}{:>7.1}", area(whole), area(apart), self.seconds)?;
        if self.by > 0 {
            writeln!(out, "    casings of the references that stand out from the others: {}", self.standing_out)?;
        }
        let called = || self.judged.iter().filter(|j| j.result.verdict != Verdict::Pass);
        let reasons: Vec<String> = Reasons::ALL
            .iter()
            .map(|&(reason, name)| (name, called().filter(|j| j.reasons.contains(reason)).count()))
            .filter(|&(_, count)| count > 0)
            .map(|(name, count)| format!("{name} {count}"))
            .collect();
        if !reasons.is_empty() {
            writeln!(out, "    not passed for: {}", reasons.join(", "))?;
        }
        let passed = self.judged.iter().enumerate().filter(|(_, j)| j.result.verdict == Verdict::Pass);
        let passed: Vec<String> = passed.map(|(number, _)| number.to_string()).collect();
        if !self.scene.is_sound() && !passed.is_empty() {
            writeln!(out, "    passed, by number: {}", passed.join(", "))?;
        }
        let mut times: Vec<f64> = self.judged.iter().map(|judged| judged.scan_s).collect();
        times.sort_by(f64::total_cmp);
        writeln!(
            out,
            "    seconds per casing: mean {:.1}, p95 {:.1}; tapped again {}",
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

    /// AUC of all locations together; if `apart`, without sound locations next to cracked ones.
    fn auc(&self, score: &impl Fn(&Judged) -> Vec<f64>, apart: bool) -> Option<f64> {
        let (mut scores, mut labels) = (Vec::new(), Vec::new());
        for judged in &self.judged {
            let cracked = &judged.result.is_cracked;
            let n = cracked.len();
            for (place, score) in score(judged).into_iter().enumerate() {
                let is_cracked = cracked[place];
                let is_beside = cracked[(place + 1) % n] || cracked[(place + n - 1) % n];
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
