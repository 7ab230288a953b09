//! One stage in one process: joins its line, works until it is asked to stop, reports.

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use serde::{Deserialize, Serialize};
use tapline_acquire::Wake;
use tapline_host::signals::stop_flag;
use tapline_host::stdout::Stdout;
use tapline_host::{log, memory};
use tapline_wire::{Line, LineAddress, Role};

use crate::cli::line::StageArgs;
use crate::config::job::Job;
use crate::line::process_name::{name_process, stage_name};
use crate::line::setup::Setup;

/// Exit code of a stage that has closed its files because their disk failed: the supervisor restarts it once that is
/// back.
pub(crate) const DISK_FAILED: u8 = 75;

/// What a stage reports when it ends: one line of JSON on standard output.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct StageReport {
    /// What it did.
    #[serde(flatten)]
    pub work: Work,
    /// What it used of the machine.
    pub used: Used,
}

/// What a process used of the machine.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(crate) struct Used {
    /// Peak memory, including shared memory that it touched.
    pub peak_memory_bytes: u64,
    /// Processor time of its own code.
    pub user_s: f64,
    /// Processor time of the system on its behalf.
    pub kernel_s: f64,
}

impl Used {
    /// By this process so far; zeros where the system does not report it.
    pub(crate) fn here() -> Self {
        let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        let peak_memory_bytes = memory::bytes(&read("/proc/self/status"), "VmHWM").unwrap_or(0);
        // Times are the 14th and 15th field; the second, a name, may contain anything.
        let stat = read("/proc/self/stat");
        let mut times = stat.rsplit(") ").next().unwrap_or_default().split(' ').skip(11).map(str::parse::<f64>);
        let mut next_s = || times.next().and_then(Result::ok).unwrap_or(0.0) / TICKS_PER_S;
        Self { peak_memory_bytes, user_s: next_s(), kernel_s: next_s() }
    }
}

/// Ticks of the system's clock in `/proc`, on every Linux.
const TICKS_PER_S: f64 = 100.0;

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
    let role = Role::of_stage(&args.stage).with_context(|| format!("{} is no stage", args.stage))?;
    follow_parent(role, args.child)?;
    name_process(&stage_name(&args.stage));
    let address = LineAddress::at(&args.line)?;
    let _lock = address.lock_folder()?;
    let setup = Setup::read(&address)?;
    // Only the stage `fuse` uses it.
    let reference = setup.reference.clone().filter(|_| role == Role::Fuse);
    let job = Job::of_copy(&setup.config_toml, reference, setup.out.clone())?;
    let stop = stop_flag().context("cannot listen for signals")?;
    let line = Line::join(&address, role, &setup.limits, stop)?;
    let work = match role {
        Role::Process => Work::Process(tapline_process::run(&line, &job.config.process)?),
        Role::Fuse => {
            let fusions = job.fusions();
            Work::Fuse(tapline_fuse::run(&line, &|plan| fusions.for_plan(plan))?)
        }
        Role::Store => match tapline_store::run(&line, &setup.store_run(&job)) {
            Err(error @ tapline_store::RunError::FileSystem { .. }) => {
                tracing::error!("{error}");
                bail!(error)
            }
            outcome => Work::Store(outcome?),
        },
        Role::Acquire(number) => {
            let waker = line.waker();
            let wake: Wake = Arc::new(move || waker.wake());
            let stations = setup.arrivals(&job, number, &wake)?;
            Work::Acquire(tapline_acquire::run(&line, stations, &job.config.acquire)?)
        }
        Role::Supervisor => bail!("{} is no stage", args.stage),
    };
    report(work)
}

/// Makes this process end when the line that started it ends. A child does this first: a line that is killed while its
/// children are still starting must not leave them behind.
fn follow_parent(role: Role, parent: i32) -> Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    // `store` saves what it has. `acquire` has nothing to save: it would wait for a `store` that nobody replaces.
    let signal = if matches!(role, Role::Acquire(_)) { Signal::KILL } else { Signal::TERM };
    set_parent_process_death_signal(Some(signal)).context("cannot ask to end with the line")?;
    if getppid().is_none_or(|pid| pid.as_raw_nonzero().get() != parent) {
        bail!("the line that started this stage (process {parent}) has ended");
    }
    Ok(())
}

fn report(work: Work) -> Result<bool> {
    let report = StageReport { work, used: Used::here() };
    let line = serde_json::to_string(&report)?;
    writeln!(Stdout, "{line}")?;
    Ok(true)
}

/// The arguments of the stage `stage` of the line whose folder is `folder`.
pub(crate) fn arguments(stage: &str, folder: &Path) -> Result<Vec<String>> {
    let folder = folder.to_str().with_context(|| format!("{} is not valid UTF-8", folder.display()))?;
    let own = std::process::id().to_string();
    let arguments = ["stage", stage, "--line", folder, "--child", &own].map(str::to_owned);
    Ok(arguments.into_iter().chain(log::arguments()).collect())
}
