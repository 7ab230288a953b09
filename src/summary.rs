//! What a run ends with: the verdict on every shoulder, how good they are where the truth is known, how fast it went.

use std::collections::BTreeSet;
use std::io::{self, Write as _};
use std::sync::Arc;

use anyhow::Result;
use comfy_table::Table;
use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use serde::Serialize;
use tapline_fuse::{Fusion, Reference, ReferenceSet, Score};
use tapline_store::{Reader, regions};
use tapline_wire::{DamageCell, Discriminator, Judgement, Quality, Reasons, TapState, Verdict};

use crate::config::Job;
use crate::stage::{StageReport, Work};

/// How a run went, as the line saw it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pace {
    /// Taps that were settled before the run; `None` when there was nothing to do.
    pub(crate) settled_before: Option<usize>,
    /// Time that took.
    pub(crate) elapsed_s: f64,
    /// How often each stage was restarted.
    pub(crate) restarts: Vec<(String, u32)>,
    /// What the stages said when they ended.
    pub(crate) reports: Vec<StageReport>,
}

#[derive(Debug, Serialize)]
struct Summary {
    archive: String,
    is_whole: bool,
    archived: usize,
    refused: usize,
    missing: usize,
    verdicts: Vec<ShoulderLine>,
    #[serde(skip_serializing_if = "Option::is_none")]
    auc: Option<Auc>,
    reference_is_self: bool,
    /// What was asked for and could not be learned from a reference, and why; each text once.
    fallbacks: Vec<String>,
    /// How many archived taps have each flag.
    flags: Vec<(&'static str, usize)>,
    pace: PaceLine,
}

#[derive(Debug, Serialize)]
struct ShoulderLine {
    tyre: String,
    shoulder: u16,
    station: u16,
    verdict: Verdict,
    reasons: String,
    regions: usize,
    peak_damage_index: Option<f64>,
    peak_location: Option<u32>,
    limit_reject: Option<f64>,
}

#[derive(Debug, Serialize)]
struct Auc {
    index: Option<f64>,
    discriminators: Vec<(&'static str, Option<f64>)>,
    cracked: u32,
    sound: u32,
}

#[derive(Debug, Default, Serialize)]
struct PaceLine {
    taps: usize,
    elapsed_s: f64,
    taps_per_s: f64,
    gb_per_s: f64,
    latency_p50_us: u64,
    latency_p99_us: u64,
    gaps: u64,
    conflicts: u64,
    sent: u64,
    sent_again: u64,
    taken_again: u64,
    restarts: u32,
    peak_memory_mb: Vec<(String, f64)>,
}

/// Prints the summary of the archive of `job`; whether nothing is missing, refused or contradicted.
pub(crate) fn summarise(job: &Job, pace: Pace, as_json: bool) -> Result<bool> {
    let reader = Reader::open(&job.out)?;
    let ledger = reader.ledger();
    let count = |state| ledger.count(state);
    let settled = ledger.taps().iter().filter(|state| state.is_settled()).count();
    let pace = pace_line(&pace, settled);
    let summary = Summary {
        archive: job.out.display().to_string(),
        is_whole: count(TapState::Archived) == ledger.taps().len() && ledger.is_judged() && pace.conflicts == 0,
        archived: count(TapState::Archived),
        refused: count(TapState::Refused),
        missing: count(TapState::Missing),
        verdicts: shoulders(&reader)?,
        auc: auc(job, &reader)?,
        flags: flags(&reader)?,
        fallbacks: fallbacks(job, &reader)?,
        reference_is_self: job.config.fuse.reference == Some(Reference::Own),
        pace,
    };
    let mut out = io::stdout().lock();
    if as_json {
        writeln!(out, "{}", serde_json::to_string_pretty(&summary)?)?;
    } else {
        print(&mut out, &summary)?;
    }
    Ok(summary.is_whole)
}

/// Why verdicts of the archive fell back. Learned from the archive again, so that it is said also when another `fuse`, or
/// an earlier run, reached them.
fn fallbacks(job: &Job, reader: &Reader) -> Result<Vec<String>> {
    let judgements = reader.judgements()?;
    let fell_back = |judged: &Option<(Judgement, _)>| {
        judged.as_ref().is_some_and(|(judgement, _)| judgement.reasons.contains(Reasons::FELL_BACK))
    };
    let scans: Vec<usize> = (0..judgements.len()).filter(|&scan| fell_back(&judgements[scan])).collect();
    if scans.is_empty() {
        return Ok(Vec::new());
    }
    let mut fusion = match reader.reference() {
        Some(text) => Fusion::with_reference(&job.config.fuse, reader.plan(), Arc::new(ReferenceSet::parse(text)?))?,
        None => Fusion::new(&job.config.fuse, reader.plan())?,
    };
    for record in reader.discriminators()?.iter().flatten() {
        fusion.push(record)?;
    }
    let mut texts = BTreeSet::new();
    for scan in scans {
        texts.extend(fusion.fallbacks(scan)?);
    }
    Ok(texts.into_iter().collect())
}

fn flags(reader: &Reader) -> Result<Vec<(&'static str, usize)>> {
    let found = reader.discriminators()?;
    let count = |flag| found.iter().flatten().filter(|record| record.quality.contains(flag)).count();
    let all = Quality::ALL.iter().map(|&(flag, name)| (name, count(flag)));
    Ok(all.filter(|&(_, count)| count > 0).collect())
}

fn shoulders(reader: &Reader) -> Result<Vec<ShoulderLine>> {
    let plan = reader.plan();
    let judgements = reader.judgements()?;
    Ok(plan.scans().iter().zip(judgements).map(|(scan, judged)| shoulder(reader, scan, judged)).collect())
}

fn shoulder(reader: &Reader, scan: &tapline_wire::Scan, judged: Option<(Judgement, Vec<DamageCell>)>) -> ShoulderLine {
    let mut line = ShoulderLine {
        tyre: scan.tyre.to_string(),
        shoulder: scan.shoulder,
        station: scan.station,
        verdict: Verdict::ReInspect,
        reasons: Reasons::NOT_ENDED.to_string(),
        regions: 0,
        peak_damage_index: None,
        peak_location: None,
        limit_reject: None,
    };
    if let Some((judgement, cells)) = judged {
        let peak = cells
            .iter()
            .filter(|cell| !cell.damage_index.is_nan())
            .max_by(|a, b| a.damage_index.total_cmp(&b.damage_index));
        line.verdict = Verdict::from_code(judgement.verdict).unwrap_or(Verdict::ReInspect);
        line.reasons = judgement.reasons.to_string();
        line.regions = regions(reader.plan().geometry, &cells).len();
        line.peak_damage_index = peak.map(|cell| cell.damage_index);
        line.peak_location = peak.map(|cell| cell.location);
        line.limit_reject = Some(judgement.limit_reject).filter(|l| l.is_finite());
    }
    line
}

fn auc(job: &Job, reader: &Reader) -> Result<Option<Auc>> {
    if reader.truth().is_empty() {
        return Ok(None);
    }
    let records: Vec<_> = reader.discriminators()?.into_iter().flatten().collect();
    let score = match reader.reference() {
        Some(text) => {
            let set = Arc::new(ReferenceSet::parse(text)?);
            Score::by_reference(&job.config.fuse, reader.plan(), set, &records)?
        }
        None => Score::of(&job.config.fuse, reader.plan(), &records)?,
    };
    Ok(Some(Auc {
        index: score.index,
        discriminators: Discriminator::ALL.iter().map(|d| d.name()).zip(score.discriminators).collect(),
        cracked: score.cracked_count,
        sound: score.sound_count,
    }))
}

#[expect(clippy::cast_precision_loss, reason = "figures for people to read")]
fn pace_line(pace: &Pace, settled: usize) -> PaceLine {
    let taps = pace.settled_before.map_or(0, |before| settled.saturating_sub(before));
    let elapsed_s = pace.elapsed_s;
    let per_s = |count: f64| if elapsed_s > 0.0 { count / elapsed_s } else { 0.0 };
    let mut line = PaceLine {
        taps,
        elapsed_s,
        taps_per_s: per_s(taps as f64),
        restarts: pace.restarts.iter().map(|(_, count)| count).sum(),
        ..PaceLine::default()
    };
    for report in &pace.reports {
        let name = match &report.work {
            Work::Acquire(work) => {
                line.gb_per_s += per_s(work.sample_bytes as f64 / 1e9);
                line.sent += work.sent_count;
                line.sent_again += work.resent_count;
                line.taken_again += work.retake_count;
                format!("acquire {}", work.station)
            }
            Work::Process(work) => {
                (line.latency_p50_us, line.latency_p99_us) = (work.latency_p50_us, work.latency_p99_us);
                line.gaps += work.lost_count;
                "process".to_owned()
            }
            Work::Fuse(work) => {
                line.gaps += work.lost_count;
                "fuse".to_owned()
            }
            Work::Store(work) => {
                line.gaps += work.lost_count;
                line.conflicts += work.conflict_count;
                "store".to_owned()
            }
        };
        line.peak_memory_mb.push((name, report.peak_memory_bytes as f64 / 1e6));
    }
    line
}

fn print(out: &mut impl io::Write, summary: &Summary) -> Result<()> {
    let mut table = Table::new();
    table.load_style(UTF8_HORIZONTAL_ONLY);
    table.set_header(["tyre", "shoulder", "station", "verdict", "why", "regions", "peak index", "at", "reject at"]);
    let cell = |value: Option<f64>| value.map_or_else(String::new, |v| format!("{v:.2}"));
    for line in &summary.verdicts {
        table.add_row([
            line.tyre.clone(),
            line.shoulder.to_string(),
            line.station.to_string(),
            line.verdict.to_string(),
            line.reasons.clone(),
            line.regions.to_string(),
            cell(line.peak_damage_index),
            line.peak_location.map_or_else(String::new, |l| l.to_string()),
            cell(line.limit_reject),
        ]);
    }
    writeln!(out, "{table}")?;
    if let Some(auc) = &summary.auc {
        let text = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
        let alone: Vec<String> = auc.discriminators.iter().map(|(name, v)| format!("{name} {}", text(*v))).collect();
        writeln!(
            out,
            "AUC against truth ({} cracked, {} sound locations): index {}; alone: {}",
            auc.cracked,
            auc.sound,
            text(auc.index),
            alone.join(", ")
        )?;
    }
    if summary.reference_is_self {
        writeln!(out, "Each tyre is compared with itself (reference = \"self\"): damage all around would not show.")?;
    }
    for text in &summary.fallbacks {
        writeln!(out, "{text}")?;
    }
    if !summary.flags.is_empty() {
        let flags: Vec<String> = summary.flags.iter().map(|(name, count)| format!("{name} {count}")).collect();
        writeln!(out, "Taps with flags (`export discriminators` has them): {}", flags.join(", "))?;
    }
    print_pace(out, &summary.pace)?;
    let Summary { archived, refused, missing, .. } = summary;
    let whole = if summary.is_whole { "whole" } else { "NOT WHOLE" };
    writeln!(
        out,
        "Archive {} is {whole}: {archived} taps archived, {refused} refused, {missing} missing.",
        summary.archive
    )?;
    if *missing > 0 {
        writeln!(out, "The same command again takes what is missing.")?;
    }
    Ok(())
}

fn print_pace(out: &mut impl io::Write, pace: &PaceLine) -> Result<()> {
    if pace.taps == 0 {
        return Ok(());
    }
    writeln!(
        out,
        "{} taps in {:.1} s: {:.0} taps/s, {:.3} GB/s through shared memory; tap to discriminators p50 {} us, p99 {} us; \
         {} gaps, {} taps sent again, {} taken again, {} restarts",
        pace.taps,
        pace.elapsed_s,
        pace.taps_per_s,
        pace.gb_per_s,
        pace.latency_p50_us,
        pace.latency_p99_us,
        pace.gaps,
        pace.sent_again,
        pace.taken_again,
        pace.restarts
    )?;
    let memory: Vec<String> = pace.peak_memory_mb.iter().map(|(name, mb)| format!("{name} {mb:.0}")).collect();
    writeln!(out, "Peak memory, MB: {}", memory.join(", "))?;
    Ok(())
}
