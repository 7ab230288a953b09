//! The output at the end of a run: all verdicts, how good they are where the truth is known, and how fast it was.

use std::collections::BTreeMap;
use std::io::{self, Write as _};

use anyhow::Result;
use serde::Serialize;
use tapline_fuse::{Fusion, Reference, Score, ScorePool};
use tapline_host::colour::Colour;
use tapline_host::messages::counted;
use tapline_host::stdout::Stdout;
use tapline_host::table::{break_last_column, table};
use tapline_store::Reader;
use tapline_wire::{Discriminator, Ledger, Quality, Reasons, TapState};

use crate::config::job::Job;
use crate::config::reference::KeptReferences;
use crate::line::setup::Setup;
use crate::line::stage::{Used, Work};
use crate::line::supervisor::LineOutcome;
use crate::shown::rig::{ASKS, Rigs, StationSign};
use crate::shown::verdict::ShoulderVerdict;

/// Casings over which the index is scored against the truth: that takes as long as judging them eight times.
const SCORED_MAX: usize = 64;

#[derive(Debug, Serialize)]
struct Summary {
    kind: &'static str,
    out: String,
    is_complete: bool,
    casings: usize,
    /// Casings without a finished file.
    unfinished: usize,
    archived: usize,
    refused: usize,
    missing: usize,
    verdicts: Vec<ShoulderVerdict>,
    /// `None` if nothing is known of the truth.
    auc: Option<Auc>,
    reference_is_self: bool,
    /// Which of the configured rates the reference cannot support; each text once.
    remarks: Vec<String>,
    /// Signs that the rigs of stations had changed.
    rig: Vec<StationSign>,
    /// How many archived taps have each flag.
    flags: Vec<(&'static str, usize)>,
    pace: PaceLine,
}

#[derive(Debug, Serialize)]
struct Auc {
    index: Option<f64>,
    discriminators: Vec<(&'static str, Option<f64>)>,
    cracked: u32,
    sound: u32,
    /// Casings that are scored.
    casings: usize,
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
    /// Each process of the line, this one last.
    processes: Vec<ProcessLine>,
}

/// What a process of the line used of the machine.
#[derive(Debug, Serialize)]
struct ProcessLine {
    name: String,
    peak_memory_mb: f64,
    user_s: f64,
    kernel_s: f64,
}

impl ProcessLine {
    fn new(name: String, used: &Used) -> Self {
        Self { name, peak_memory_mb: used.peak_memory_bytes as f64 / 1e6, user_s: used.user_s, kernel_s: used.kernel_s }
    }
}

/// What is summed up over the casings, one file at a time.
#[derive(Default)]
struct Sum {
    verdicts: Vec<ShoulderVerdict>,
    references: KeptReferences,
    rigs: Rigs,
    /// Signs of rigs that are over.
    over: Vec<StationSign>,
    unfinished: usize,
    counts: [usize; 3],
    is_judged: bool,
    flags: BTreeMap<&'static str, usize>,
    scores: ScorePool,
    has_truth: bool,
    scored: usize,
}

/// Prints the summary of the casings `names` of `job`; whether nothing is missing, refused or contradicted.
pub(crate) fn summarise(
    job: &Job,
    setup: &Setup,
    names: &[String],
    outcome: LineOutcome,
    as_json: bool,
) -> Result<bool> {
    // Before the scores, which are not the line's work.
    let used = Used::here();
    let mut sum = Sum { is_judged: true, ..Sum::default() };
    let places = setup.places();
    for name in names {
        match places.finished(name) {
            Some(path) => add(&mut sum, job, name, &Reader::open(path)?)?,
            None => {
                sum.unfinished += 1;
                add_counts(&mut sum, setup, name);
            }
        }
    }
    let [archived, refused, missing] = sum.counts;
    // From the files: a line that is asked to end does not learn of the last ones.
    let settled = outcome.settled_before.map_or(0, |before| (archived + refused).saturating_sub(before));
    let pace = pace_line(&outcome, settled, &used);
    let is_complete = sum.unfinished == 0 && refused == 0 && missing == 0 && sum.is_judged && pace.conflicts == 0;
    let summary = Summary {
        kind: "summary",
        out: job.out.display().to_string(),
        is_complete,
        casings: names.len(),
        unfinished: sum.unfinished,
        archived,
        refused,
        missing,
        rig: sum.over.into_iter().chain(sum.rigs.all()).collect(),
        verdicts: sum.verdicts,
        auc: sum.has_truth.then(|| Auc::new(&sum.scores.score(), sum.scored)).filter(Auc::has_locations),
        flags: Quality::ALL.iter().filter_map(|&(_, name)| Some((name, *sum.flags.get(name)?))).collect(),
        remarks: job.fusions().unsupported(),
        reference_is_self: job.config.fuse.reference == Some(Reference::Own),
        pace,
    };
    let mut out = Stdout;
    if as_json {
        writeln!(out, "{}", serde_json::to_string(&summary)?)?;
    } else {
        print(&mut out, &summary)?;
    }
    Ok(summary.is_complete)
}

/// Adds the taps so far of a casing whose file is under way.
fn add_counts(sum: &mut Sum, setup: &Setup, name: &str) {
    let open = setup.places().under_way(name);
    let Some(reader) = open.and_then(|path| Reader::open_unfinished(path).ok()) else { return };
    sum.count(reader.ledger());
}

impl Sum {
    fn count(&mut self, ledger: &Ledger) {
        let states = [TapState::Archived, TapState::Refused, TapState::Missing];
        for (count, state) in self.counts.iter_mut().zip(states) {
            *count += ledger.count(state);
        }
    }
}

/// Adds the casing of one file.
fn add(sum: &mut Sum, job: &Job, name: &str, reader: &Reader) -> Result<()> {
    let ledger = reader.ledger();
    sum.count(ledger);
    sum.is_judged &= ledger.is_judged();
    let found = reader.discriminators()?;
    for &(flag, name) in Quality::ALL {
        let count = found.iter().flatten().filter(|record| record.quality.contains(flag)).count();
        if count > 0 {
            *sum.flags.entry(name).or_default() += count;
        }
    }
    let records: Vec<_> = found.into_iter().flatten().collect();
    if !reader.truth().is_empty() && sum.scored < SCORED_MAX {
        (sum.has_truth, sum.scored) = (true, sum.scored + 1);
        let set = sum.references.of(reader)?;
        sum.scores.add(Fusion::by(&job.config.fuse, reader.plan(), set)?, &records)?;
    }
    let shoulders = ShoulderVerdict::all(reader, false)?;
    let station = shoulders.first().map_or(0, |shoulder| shoulder.station);
    let of_each = shoulders.iter().map(|shoulder| (Reasons::named(&shoulder.reasons), &shoulder.whole));
    sum.over.extend(sum.rigs.add(station, name, of_each).into_iter().filter(|sign| sign.is_over));
    sum.verdicts.extend(shoulders);
    Ok(())
}

impl Auc {
    fn new(score: &Score, casings: usize) -> Self {
        Self {
            index: score.index,
            discriminators: Discriminator::ALL.iter().map(|d| d.name()).zip(score.discriminators).collect(),
            cracked: score.cracked_count,
            sound: score.sound_count,
            casings,
        }
    }

    /// Without an index no location counts.
    fn has_locations(&self) -> bool {
        self.cracked + self.sound > 0
    }
}

#[expect(clippy::cast_precision_loss, reason = "figures for people to read")]
fn pace_line(outcome: &LineOutcome, taps: usize, used: &Used) -> PaceLine {
    let elapsed_s = outcome.elapsed_s;
    let per_s = |count: f64| if elapsed_s > 0.0 { count / elapsed_s } else { 0.0 };
    let mut line =
        PaceLine { taps, elapsed_s, taps_per_s: per_s(taps as f64), restarts: outcome.restarts, ..PaceLine::default() };
    for report in &outcome.reports {
        let name = match &report.work {
            Work::Acquire(work) => {
                line.gb_per_s += per_s(work.sample_bytes as f64 / 1e9);
                line.sent += work.sent_count;
                line.sent_again += work.resent_count;
                line.taken_again += work.retake_count;
                format!("acquire {}", stations(&work.stations))
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
        line.processes.push(ProcessLine::new(name, &report.used));
    }
    line.processes.push(ProcessLine::new("line".to_owned(), used));
    line
}

/// One station by its number; several by first, last and count.
fn stations(numbers: &[u16]) -> String {
    match numbers {
        [number] => number.to_string(),
        [first, .., last] => format!("{first}..{last} ({} stations)", numbers.len()),
        [] => "(no station)".to_owned(),
    }
}

fn print(out: &mut impl io::Write, summary: &Summary) -> Result<()> {
    if !summary.verdicts.is_empty() {
        print_verdicts(out, &summary.verdicts, &summary.rig)?;
    }
    if !summary.rig.is_empty() {
        writeln!(out, "Several casings show signs that the rig has changed: {ASKS} (docs/rig.md):")?;
        summary.rig.iter().try_for_each(|sign| writeln!(out, "  {sign}"))?;
    }
    if let Some(auc) = summary.auc.as_ref().filter(|auc| auc.cracked > 0 && auc.sound > 0) {
        let text = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
        let casings = match summary.casings {
            all if auc.casings < all => format!("{} of {all} casings", auc.casings),
            all => counted(all, "casing", "casings"),
        };
        let alone: Vec<String> = auc.discriminators.iter().map(|(name, v)| format!("{name} {}", text(*v))).collect();
        writeln!(
            out,
            "AUC against truth ({casings}, {} cracked, {} sound locations): index {}; alone: {}",
            auc.cracked,
            auc.sound,
            text(auc.index),
            alone.join(", ")
        )?;
    }
    if !summary.flags.is_empty() {
        let flags: Vec<String> = summary.flags.iter().map(|(name, count)| format!("{name} {count}")).collect();
        writeln!(out, "Taps with flags (`export discriminators` lists them): {}", flags.join(", "))?;
    }
    print_pace(out, &summary.pace)?;
    let Summary { casings, unfinished, archived, refused, missing, .. } = summary;
    let state = match summary.is_complete {
        true => Colour::Good.on_stdout("complete"),
        false => Colour::Bad.on_stdout("INCOMPLETE"),
    };
    writeln!(
        out,
        "{} is {state}: {} of {} finished; {} archived, {refused} refused, {missing} missing.",
        summary.out,
        casings - unfinished,
        counted(*casings, "casing", "casings"),
        counted(*archived, "tap", "taps")
    )?;
    if *unfinished > 0 {
        writeln!(out, "Run the same command again to take what is missing.")?;
    }
    Ok(())
}

/// The verdicts as a table. Remarks that apply to all are printed once, below it, as are the numbers of a rig's signs, whose reasons stand bare in the rows.
fn print_verdicts(out: &mut impl io::Write, verdicts: &[ShoulderVerdict], rig: &[StationSign]) -> Result<()> {
    let holds_for_all = |name: &str| verdicts.iter().all(|verdict| verdict.reasons.split('|').any(|r| r == name));
    // Flags have shares, which differ. A single shoulder has everything in its row.
    let remarks = Reasons::REMARKS.difference(Reasons::FLAGGED);
    let remarks = Reasons::ALL.iter().filter(|(reason, _)| verdicts.len() > 1 && remarks.contains(*reason));
    let common: Vec<&str> = remarks.map(|&(_, name)| name).filter(|name| holds_for_all(name)).collect();
    let mut table = table(["shoulder", "verdict", "arcs", "strongest / limits", "at", "why"]);
    let below = |station| -> Vec<&str> {
        rig.iter().filter(|sign| sign.station == station).map(|sign| sign.sign.name.as_str()).collect()
    };
    for line in verdicts {
        table.add_row([
            format!("{}/{}", line.tyre, line.shoulder),
            line.verdict.to_string(),
            line.regions.to_string(),
            line.strongest_arc.map_or_else(String::new, |arc| match (line.limit_re_inspect, line.limit_reject) {
                (Some(re_inspect), Some(reject)) => format!("{arc:.2} / {re_inspect:.2}, {reject:.2}"),
                _ => format!("{arc:.2}"),
            }),
            line.peak_location.map_or_else(String::new, |l| l.to_string()),
            // With spaces between them, where lines may break.
            line.why(", ", &common, &below(line.station)),
        ]);
    }
    break_last_column(&mut table);
    writeln!(out, "{table}")?;
    if !common.is_empty() {
        writeln!(out, "All shoulders: {}", common.join(", "))?;
    }
    Ok(())
}

fn print_pace(out: &mut impl io::Write, pace: &PaceLine) -> Result<()> {
    if pace.taps == 0 {
        return Ok(());
    }
    writeln!(
        out,
        "{} in {:.1} s: {:.0} taps/s, {:.3} GB/s through shared memory; tap to discriminators p50 {} us, p99 {} us; \
         {}, {} sent again, {} taken again, {}",
        counted(pace.taps, "tap", "taps"),
        pace.elapsed_s,
        pace.taps_per_s,
        pace.gb_per_s,
        pace.latency_p50_us,
        pace.latency_p99_us,
        counted(pace.gaps as usize, "gap", "gaps"),
        counted(pace.sent_again as usize, "tap", "taps"),
        pace.taken_again,
        counted(pace.restarts as usize, "restart", "restarts")
    )?;
    Ok(())
}
