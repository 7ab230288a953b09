//! `tapline status`: the state of a running line.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use comfy_table::Table;
use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use serde::{Deserialize, Serialize};
use tapline_wire::{Line, Role, STATUS_BYTES_MAX, StatusTopic, Subscriber, now_ns};

use crate::cli::StatusArgs;
use crate::host::signals::stop_flag;
use crate::line::out_folder::OutFolder;
use crate::line::setup::Setup;
use crate::line::verdicts::CasingVerdict;

/// How long a running line may take to show its status.
const ANSWERS_WITHIN: Duration = Duration::from_secs(15);

/// A line that has shown nothing for this long is stuck.
const STANDS_AFTER_NS: i64 = 30_000_000_000;

/// The state of a line.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Status {
    pub out: PathBuf,
    pub pid: u32,
    /// When it was taken, in ns since the Unix epoch.
    pub at_ns: i64,
    pub is_ending: bool,
    /// Whether the archive cannot be written, so that the line waits.
    pub is_held: bool,
    pub taps_per_s: f64,
    pub settled_count: u64,
    pub closed_count: u64,
    pub lost_count: u64,
    pub stations: Vec<StationStatus>,
    pub stages: Vec<StageStatus>,
    /// The last verdicts, the newest first.
    pub verdicts: Vec<CasingVerdict>,
    /// What someone should look at, the newest first.
    pub alarms: Vec<String>,
}

/// The state of a station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct StationStatus {
    pub number: u16,
    /// The casing that it taps.
    pub casing: Option<CasingStatus>,
    /// What it waits for; empty while it taps.
    pub waits_for: String,
}

/// The progress of a casing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct CasingStatus {
    pub name: String,
    pub planned: usize,
    pub archived: usize,
    pub refused: usize,
}

/// The state of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct StageStatus {
    pub name: String,
    pub pid: Option<u32>,
    pub restarts: u32,
}

impl Status {
    /// The status as bytes for shared memory. Where it is too long, old verdicts are left out.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut status = self.clone();
        loop {
            let bytes = serde_json::to_vec(&status).unwrap_or_default(); // it has no key that is no text
            if bytes.len() <= STATUS_BYTES_MAX {
                return bytes;
            }
            if status.verdicts.pop().is_none() && status.alarms.pop().is_none() {
                return Vec::new();
            }
        }
    }
}

/// `tapline status`: shows how a running line is, once or until it ends.
pub(crate) fn status(args: &StatusArgs) -> Result<bool> {
    let Some(found) = OutFolder::find_line(&args.out)? else {
        bail!("no line runs on {}", args.out.display());
    };
    let setup = Setup::read(&found.address)?;
    let stop = stop_flag()?;
    let line = Line::join(&found.address, Role::Viewer(std::process::id()), &setup.limits, Arc::clone(&stop))?;
    let shown = Subscriber::<StatusTopic>::open(&line)?;
    let since = Instant::now();
    let mut last = None;
    loop {
        if let Some(record) = shown.receive_newest()? {
            let status: Status = serde_json::from_slice(&record).context("what the line shows cannot be read")?;
            drop(record);
            print(&status, args)?;
            last = Some(status);
            if !args.follow {
                return Ok(true);
            }
        }
        if last.is_none() && since.elapsed() > ANSWERS_WITHIN {
            bail!("the line (process {}) does not show how it is: it may be held up", found.pid);
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(true);
        }
        // A folder that cannot be read, since its disk is away, does not mean that the line has ended.
        if last.is_some() && matches!(OutFolder::find_line(&args.out), Ok(None)) {
            writeln!(io::stderr(), "the line has ended").context("cannot write to standard output")?;
            return Ok(true);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

fn print(status: &Status, args: &StatusArgs) -> Result<()> {
    let mut out = io::stdout().lock();
    if args.json {
        writeln!(out, "{}", serde_json::to_string(status)?)?;
    } else {
        if args.follow && io::IsTerminal::is_terminal(&out) {
            write!(out, "\x1b[H\x1b[2J")?;
        }
        writeln!(out, "{}", text(status))?;
    }
    Ok(out.flush()?)
}

fn text(status: &Status) -> String {
    let mut text = format!(
        "Line on {} (process {}): {:.1} taps/s, {} casings closed",
        status.out.display(),
        status.pid,
        status.taps_per_s,
        status.closed_count
    );
    let mut add = |line: &str| text.push_str(line);
    if status.is_ending {
        add("\nIt is ending.");
    }
    if status.is_held {
        add("\nThe archive cannot be written: the line waits. Its log has the reason.");
    }
    if status.lost_count > 0 {
        add(&format!("\n{} records were lost in transit; their taps are taken again.", status.lost_count));
    }
    let age_ns = now_ns().saturating_sub(status.at_ns);
    if status.stations.iter().any(|s| s.casing.is_some()) && age_ns > STANDS_AFTER_NS {
        add(&format!("\nIt has shown nothing for {} s.", age_ns / 1_000_000_000));
    }
    let mut table = Table::new();
    table.load_style(UTF8_HORIZONTAL_ONLY);
    table.set_header(["station", "casing", "taps", "refused", "waits for"]);
    for station in &status.stations {
        let of = |value: &dyn Fn(&CasingStatus) -> String| station.casing.as_ref().map_or_else(String::new, value);
        table.add_row([
            station.number.to_string(),
            of(&|casing| casing.name.clone()),
            of(&|casing| format!("{} of {}", casing.archived + casing.refused, casing.planned)),
            of(&|casing| if casing.refused > 0 { casing.refused.to_string() } else { String::new() }),
            station.waits_for.clone(),
        ]);
    }
    let written = write!(text, "\n{table}");
    debug_assert!(written.is_ok(), "texts take all that is written to them");
    let restarts: Vec<String> = status
        .stages
        .iter()
        .filter(|stage| stage.restarts > 0)
        .map(|stage| format!("{} {}", stage.name, stage.restarts))
        .collect();
    if !restarts.is_empty() {
        text.push_str(&format!("\nRestarts: {}", restarts.join(", ")));
    }
    for alarm in &status.alarms {
        text.push_str(&format!("\nALARM {alarm}"));
    }
    if !status.verdicts.is_empty() {
        text.push_str("\nLast verdicts:");
    }
    for verdict in &status.verdicts {
        let shoulders: Vec<String> =
            verdict.shoulders.iter().map(|s| format!("{}/{} {}", s.tyre, s.shoulder, s.verdict)).collect();
        text.push_str(&format!(
            "\n  {:<10} {}  {}",
            verdict.verdict.to_string(),
            shoulders.join(", "),
            verdict.file.display()
        ));
    }
    text
}
