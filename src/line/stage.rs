//! One stage in one process: joins its line, works until it is asked to stop, reports.

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use serde::{Deserialize, Serialize};
use tapline_acquire::Wake;
use tapline_host::log;
use tapline_host::signals::stop_flag;
use tapline_wire::{Line, LineAddress, Role};

use crate::cli::line::StageArgs;
use crate::config::job::Job;
use crate::line::process_name::{name_process, stage_name};
use crate::line::setup::Setup;

/// Exit code of a stage that has closed its files on a disk that has failed: the supervisor starts it again when the disk is
/// back.
pub(crate) const DISK_FAILED: u8 = 75;

/// The disk of the archive has failed.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct DiskFailed(String);

/// What a stage reports when it ends: one line of JSON on standard output.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct StageReport {
    /// What it did.
    #[serde(flatten)]
    pub work: Work,
    /// Most memory it had, shared memory it touched included.
    pub peak_memory_bytes: u64,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "stage", rename_all = "lowercase")]
pub(crate) enum Work {
    Acquire(tapline_acquire::Outcome),
    Process(tapline_process::Outcome),
    Fuse(tapline_fuse::Outcome),
    Store(tapline_store::Outcome),
}

/// Runs the stage that `args` name until it is asked to stop.
pub(crate) fn stage(args: &StageArgs) -> Result<bool> {
    follow_parent(args)?;
    name_process(&stage_name(&args.stage));
    let address = LineAddress::at(&args.line)?;
    let _lock = address.lock_folder()?;
    let setup = Setup::read(&address)?;
    let job = Job::of_copy(&setup.config_toml, setup.reference.clone(), setup.out.clone())?;
    let join = |role| -> Result<Line> {
        Ok(Line::join(&address, role, &setup.limits, stop_flag().context("cannot listen to signals")?)?)
    };
    let work = match args.stage.split_once('-') {
        None if args.stage == "process" => {
            Work::Process(tapline_process::run(&join(Role::Process)?, &job.config.process)?)
        }
        None if args.stage == "fuse" => {
            let fusions = job.fusions()?;
            Work::Fuse(tapline_fuse::run(&join(Role::Fuse)?, &|plan| fusions.for_plan(plan))?)
        }
        None if args.stage == "store" => match tapline_store::run(&join(Role::Store)?, &setup.store_run(&job)) {
            Err(error @ tapline_store::RunError::FileSystem { .. }) => {
                tracing::error!("{error}");
                bail!(DiskFailed(error.to_string()))
            }
            outcome => Work::Store(outcome?),
        },
        Some(("acquire", number)) => {
            let number: u16 = number.parse().with_context(|| format!("{} is no stage", args.stage))?;
            let line = join(Role::Acquire(number))?;
            let waker = line.waker()?;
            let wake: Wake = Arc::new(move || waker.wake());
            let stations = setup.arrivals(&job, number, &wake)?;
            Work::Acquire(tapline_acquire::run(&line, stations, &job.config.acquire)?)
        }
        _ => bail!("{} is no stage", args.stage),
    };
    report(work)
}

/// Ends this process when the line that started it ends. The first thing a child does: a line that is killed while its
/// children still start must not leave them behind.
fn follow_parent(args: &StageArgs) -> Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    // `store` makes safe what it has. Who acquires has nothing to keep: it would wait for a `store` that nobody replaces.
    let signal = if args.stage.starts_with("acquire-") { Signal::KILL } else { Signal::TERM };
    set_parent_process_death_signal(Some(signal)).context("cannot ask to end with the line")?;
    if getppid().is_none_or(|pid| pid.as_raw_nonzero().get() != args.child) {
        bail!("the line that started this stage (process {}) has ended", args.child);
    }
    Ok(())
}

fn report(work: Work) -> Result<bool> {
    let report = StageReport { work, peak_memory_bytes: peak_memory_bytes() };
    let line = serde_json::to_string(&report)?;
    writeln!(std::io::stdout(), "{line}").context("cannot report")?;
    Ok(true)
}

/// Most memory this process had, 0 where the system does not report it.
fn peak_memory_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = peak.and_then(|text| text.trim().trim_end_matches(" kB").parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

/// The arguments of the stage `stage` of the line whose folder is `folder`.
pub(crate) fn arguments(stage: &str, folder: &Path) -> Result<Vec<String>> {
    let folder = folder.to_str().with_context(|| format!("{} is not valid UTF-8", folder.display()))?;
    let own = std::process::id().to_string();
    let arguments = ["stage", stage, "--line", folder, "--child", &own].map(str::to_owned);
    Ok(arguments.into_iter().chain(log::arguments()).collect())
}
