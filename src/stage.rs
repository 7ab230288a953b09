//! One stage in one process: joins its line, runs until the line is done or it is told to stop, reports.

use std::io::Write as _;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context as _, Result, bail};
use serde::{Deserialize, Serialize};
use tapline_store::RunWriter;
use tapline_wire::{Line, LineAddress, Plan, Role};

use crate::cli::LineArgs;
use crate::config::Job;

/// What a stage says of itself when it ends: one line of JSON on standard output.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct StageReport {
    /// What it did.
    #[serde(flatten)]
    pub(crate) work: Work,
    /// Most memory it had, shared memory it touched included.
    pub(crate) peak_memory_bytes: u64,
}

impl StageReport {
    /// Whether the stage had nothing left to do.
    pub(crate) fn is_complete(&self) -> bool {
        match &self.work {
            Work::Acquire(work) => work.is_complete,
            Work::Process(work) => work.is_complete,
            Work::Fuse(work) => work.is_complete,
            Work::Store(work) => work.is_complete,
        }
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "stage", rename_all = "lowercase")]
pub(crate) enum Work {
    Acquire(tapline_acquire::Outcome),
    Process(tapline_process::Outcome),
    Fuse(tapline_fuse::Outcome),
    Store(tapline_store::Outcome),
}

pub(crate) fn acquire(args: &LineArgs, station: u16) -> Result<bool> {
    follow_parent(args)?;
    let job = Job::of_stage(args)?;
    let mut source = job.source()?;
    let stations = source.plan().stations();
    if !stations.contains(&station) {
        bail!("--station is {station}; the scan plan has stations {stations:?}");
    }
    let line = join(args, Role::Acquire(station), source.plan())?;
    let outcome = tapline_acquire::run(&line, source.as_mut(), &job.config.acquire, station)?;
    report(Work::Acquire(outcome))
}

pub(crate) fn process(args: &LineArgs) -> Result<bool> {
    follow_parent(args)?;
    let job = Job::of_stage(args)?;
    let plan = job.source()?.plan().clone();
    let line = join(args, Role::Process, &plan)?;
    report(Work::Process(tapline_process::run(&line, &plan, &job.config.process)?))
}

pub(crate) fn fuse(args: &LineArgs) -> Result<bool> {
    follow_parent(args)?;
    let job = Job::of_stage(args)?;
    let plan = job.source()?.plan().clone();
    let line = join(args, Role::Fuse, &plan)?;
    report(Work::Fuse(tapline_fuse::run(&line, &plan, job.fusion(&plan)?)?))
}

pub(crate) fn store(args: &LineArgs) -> Result<bool> {
    follow_parent(args)?;
    let job = Job::of_stage(args)?;
    let plan = job.source()?.plan().clone();
    let reference = job.reference()?;
    let writer = RunWriter::open_or_create(&job.out, &plan, job.lineage(reference.as_ref()), &job.config.store)?;
    let line = join(args, Role::Store, &plan)?;
    report(Work::Store(tapline_store::run(&line, &plan, writer)?))
}

fn join(args: &LineArgs, role: Role, plan: &Plan) -> Result<Line> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '-';
    if args.line.is_empty() || args.line.len() > 40 || !args.line.chars().all(is_name) {
        bail!("--line is {:?}; it must be 1 to 40 letters, digits and '-'", args.line);
    }
    let line = Line::join(&LineAddress::new(&args.line), role, plan, stop_flag()?)?;
    Ok(line)
}

/// Ends this process when the line that started it ends. The first thing a child does: a line that is killed while its
/// children still start must not leave them behind.
fn follow_parent(args: &LineArgs) -> Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    let Some(parent) = args.child else { return Ok(()) };
    set_parent_process_death_signal(Some(Signal::TERM)).context("cannot ask to end with the line")?;
    if getppid().is_none_or(|pid| pid.as_raw_nonzero().get() != parent) {
        bail!("the line that started this stage (process {parent}) has ended");
    }
    Ok(())
}

/// A flag that SIGTERM and SIGINT set.
pub(crate) fn stop_flag() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, stop.clone()).context("cannot listen to signals")?;
    }
    Ok(stop)
}

fn report(work: Work) -> Result<bool> {
    let report = StageReport { work, peak_memory_bytes: peak_memory_bytes() };
    let line = serde_json::to_string(&report)?;
    writeln!(std::io::stdout(), "{line}").context("cannot report")?;
    Ok(report.is_complete())
}

/// Most memory this process had, 0 where the system does not tell.
fn peak_memory_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = peak.and_then(|text| text.trim().trim_end_matches(" kB").parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
