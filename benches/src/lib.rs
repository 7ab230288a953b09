//! What the benches share: order statistics, processor times, and the rows that are printed and make the page `docs/performance.md`.
#![expect(clippy::print_stdout, reason = "the figures are what these programs are for")]

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};

/// Clock ticks per second in `/proc`, on every Linux.
const TICKS_PER_S: f64 = 100.0;

/// Value below which the fraction `q` of `values` lies, NaN if there are none; sorts them.
pub fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a place in the list, q being 0 to 1"
    )]
    let place = (q * last as f64).round() as usize;
    values.get(place).copied().unwrap_or(f64::NAN)
}

/// Median and quartiles over rounds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Half of the rounds are below.
    pub median: f64,
    /// A quarter of the rounds is below.
    pub low: f64,
    /// A quarter of the rounds is above.
    pub high: f64,
}

impl Spread {
    /// Of `values`, one per round.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        let [low, median, high] = [0.25, 0.5, 0.75].map(|q| quantile(&mut sorted, q));
        Self { median, low, high }
    }

    /// Of `ours` as a multiple of `theirs`, round by round.
    pub fn of_ratio(ours: &[f64], theirs: &[f64]) -> Self {
        Self::of(&ours.iter().zip(theirs).map(|(ours, theirs)| ours / theirs).collect::<Vec<_>>())
    }
}

/// The median with the digits that count, and the quartiles in brackets.
impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { median, low, high } = *self;
        let digits = match median.abs() {
            size if size < 0.095 => 3,
            size if size < 9.95 => 2,
            size if size < 99.5 => 1,
            _ => 0,
        };
        write!(f, "{median:.digits$} ({low:.digits$}–{high:.digits$})")
    }
}

/// One thing that was measured.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    /// What it is.
    pub what: String,
    /// Unit of the value.
    pub unit: String,
    /// The value.
    pub value: Spread,
    /// What it is compared with, in the same rounds.
    pub beside: Vec<Beside>,
}

/// A comparison.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Beside {
    /// What the ratio means, such as "times as fast as ...".
    pub what: String,
    /// The ratio, round by round.
    pub ratio: Spread,
    /// What it should be, such as ">= 6".
    pub aim: String,
}

impl Beside {
    /// The aim, and whether it is missed; empty if there is none.
    pub fn aim_text(&self) -> String {
        let Self { ratio: Spread { median, .. }, aim, .. } = self;
        let is_met = match aim.split_once(' ').map(|(sign, bound)| (sign, bound.parse::<f64>())) {
            Some((">=", Ok(bound))) => *median >= bound,
            Some(("<=", Ok(bound))) => *median <= bound,
            Some(("<", Ok(bound))) => *median < bound,
            _ => true,
        };
        if is_met { aim.clone() } else { format!("{aim}, missed") }
    }
}

impl Row {
    /// `what`, with one of `values` in `unit` per round.
    pub fn new(what: impl Into<String>, unit: &str, values: &[f64]) -> Self {
        Self { what: what.into(), unit: unit.to_owned(), value: Spread::of(values), beside: Vec::new() }
    }

    /// Adds a comparison.
    #[must_use]
    pub fn beside(mut self, what: &str, ratio: Spread, aim: &str) -> Self {
        self.beside.push(Beside { what: what.to_owned(), ratio, aim: aim.to_owned() });
        self
    }
}

/// What one bench has measured.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Sheet {
    /// Heading of its rows.
    pub title: String,
    /// The command that measures them.
    pub command: String,
    /// What is needed to read them: what was measured, how often, with which seed.
    pub notes: Vec<String>,
    /// The rows.
    pub rows: Vec<Row>,
}

impl Sheet {
    /// Prints its rows, each with its comparisons below it.
    pub fn print(&self) {
        println!("\n{}", self.title);
        for Row { what, unit, value, beside } in &self.rows {
            println!("  {what}: {value} {unit}");
            for compared in beside {
                let Beside { what, ratio, aim } = compared;
                let aim = if aim.is_empty() { String::new() } else { format!(", aim {}", compared.aim_text()) };
                println!("    {ratio} {what}{aim}");
            }
        }
    }

    /// Prints it, and keeps it for the page, as the bench called `name`.
    ///
    /// # Errors
    /// What the system returns.
    pub fn keep(&self, name: &str) -> Result<()> {
        self.print();
        fs::create_dir_all(folder())?;
        fs::write(folder().join(format!("{name}.json")), serde_json::to_string_pretty(self)?)?;
        Ok(())
    }

    /// The sheet that the bench `name` kept.
    ///
    /// # Errors
    /// It has not run, or its file cannot be read.
    pub fn kept(name: &str) -> Result<Self> {
        let path = folder().join(format!("{name}.json"));
        let text = fs::read_to_string(&path)
            .with_context(|| format!("{}: `cargo bench -p tapline-bench --bench {name}` writes it", path.display()))?;
        Ok(serde_json::from_str(&text)?)
    }
}

/// The folder of the project.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."))
}

/// The built program, which `make bench` builds first.
pub fn tapline() -> PathBuf {
    root().join("target/release/tapline")
}

/// Processor time of the process `pid` so far, without its children.
///
/// # Errors
/// There is no such process.
pub fn cpu_s(pid: u32) -> Result<f64> {
    two_times_s(pid, 11)
}

/// Processor time of all children of this process that have ended, and of their children.
///
/// # Errors
/// What the system returns.
pub fn children_cpu_s() -> Result<f64> {
    two_times_s(std::process::id(), 13)
}

/// The two times from place `first` on after the name in `/proc/PID/stat`.
fn two_times_s(pid: u32, first: usize) -> Result<f64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat"))?;
    // The name may contain anything; the fields after it are counted: state is field 3, own times are 14 and 15, the
    // children's 16 and 17.
    let fields = stat.rsplit(") ").next().unwrap_or_default().split(' ');
    let ticks: Vec<f64> = fields.skip(first).take(2).map(str::parse).collect::<Result<_, _>>()?;
    Ok(ticks.iter().sum::<f64>() / TICKS_PER_S)
}

fn folder() -> PathBuf {
    root().join("target/performance")
}
