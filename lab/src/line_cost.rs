//! What a run of the built program cost, read from the summary that it prints.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, Result, ensure};
use serde::Deserialize;

/// The costs in what `tapline run --json` prints at its end.
#[derive(Debug, Deserialize)]
pub struct LineCost {
    /// Whether every tap is archived and judged.
    pub is_complete: bool,
    /// Archived taps.
    pub archived: usize,
    /// How fast it was, and what it took.
    pub pace: Pace,
}

/// How fast a line was, and what its processes took.
#[derive(Debug, Deserialize)]
pub struct Pace {
    /// Taps that it has settled.
    pub taps: f64,
    /// How many per second.
    pub taps_per_s: f64,
    /// Time from a tap to its discriminators that 99 of 100 do not exceed.
    pub latency_p99_us: f64,
    /// Records that were lost on the way.
    gaps: u64,
    /// Each process.
    pub processes: Vec<ProcessCost>,
}

/// What a process of a line took.
#[derive(Debug, Deserialize)]
pub struct ProcessCost {
    /// `acquire` with its stations, `process`, `fuse`, `store` or `line`.
    pub name: String,
    /// Peak memory.
    pub peak_memory_mb: f64,
    /// Processor time in user mode.
    pub user_s: f64,
    /// Processor time in the kernel.
    pub kernel_s: f64,
}

impl ProcessCost {
    /// Whether it simulates taps, which costs nothing on a real rig.
    pub fn is_source(&self) -> bool {
        self.name.starts_with("acquire")
    }
}

impl LineCost {
    /// The cost that a run reports in its output `printed`.
    ///
    /// # Errors
    /// There is no summary, or the line has lost records, so that the cost is not that of all its taps.
    pub fn printed(printed: &str) -> Result<Self> {
        let summary = printed.lines().last().unwrap_or_default();
        let cost: Self = serde_json::from_str(summary).with_context(|| format!("no summary of a run: {summary:?}"))?;
        ensure!(cost.pace.gaps == 0, "the line has lost records: {summary}");
        Ok(cost)
    }
}

/// `program run` with the scan in `config`, into `out`.
pub fn run_command(program: impl AsRef<OsStr>, config: &Path, stations: u16, out: &Path) -> Command {
    let mut command = Command::new(program);
    command.args(["run", "--json", "--quiet", "--stations", &stations.to_string()]);
    command.args([Path::new("--config"), config, Path::new("--out"), out]).stdin(Stdio::null());
    command
}
