//! The speed of a whole line: the built program, from simulated taps to verdicts in an archive.
//!
//! The same rounds also measure the taps simulated in one thread and sent nowhere, which is work that a real rig would
//! do, and their bytes written to one file and synced to the disk.
#![expect(clippy::print_stdout, reason = "the figures are what this program is for")]

mod common;

use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use serde_json::Value;
use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_model::SimulationConfig;
use tapline_wire::{CacheLine, TapHeader, bytes_of, cache_lines_for};

use common::{print_table, quantile};

const ROUNDS: usize = 3;
const STATIONS: [u16; 3] = [1, 2, 4];
/// Full turns of all stations together; every line has the same number of taps, 9696.
const TURNS: u16 = 8;
/// Clock ticks per second in `/proc/self/stat`, on every Linux.
const TICKS_PER_S: f64 = 100.0;

/// The default scan with two offsets, its turns distributed over `stations`.
fn scan(stations: u16) -> ScanConfig {
    ScanConfig { stations, offsets_mm: vec![0.0, 10.0], repetitions: TURNS / stations, ..ScanConfig::default() }
}

fn main() -> Result<()> {
    // Beside the build, because a temporary folder may be in memory, which no archive is.
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR"))?;
    let mut lines: [Vec<Pace>; 3] = Default::default();
    let (mut renders, mut writes) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        for (stations, paces) in STATIONS.into_iter().zip(&mut lines) {
            paces.push(run_line(folder.path(), stations)?);
        }
        renders.push(render()?);
        writes.push(write(folder.path())?);
    }
    let (render, write) = (quantile(&mut renders, 0.5), quantile(&mut writes, 0.5));
    report(&lines, render, write);
    Ok(())
}

/// The result of one line.
#[derive(Debug)]
struct Pace {
    taps_per_s: f64,
    gb_per_s: f64,
    cpu_us_per_tap: f64,
    latency_us: (f64, f64),
    peak_memory_mb: f64,
}

fn run_line(folder: &Path, stations: u16) -> Result<Pace> {
    let ScanConfig { offsets_mm, repetitions, .. } = scan(stations);
    let config = folder.join("line.toml");
    let text =
        format!("[scan]\noffsets_mm = {offsets_mm:?}\nrepetitions = {repetitions}\n[fuse]\nreference = \"self\"\n");
    std::fs::write(&config, text)?;
    let out = folder.join("line");
    let before_s = children_cpu_s()?;
    let output = Command::new(env!("CARGO_BIN_EXE_tapline"))
        .args(["run", "--json", "--stations", &stations.to_string()])
        .args([Path::new("--config"), &config, Path::new("--out"), &out])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()?;
    let cpu_s = children_cpu_s()? - before_s;
    ensure!(output.status.success(), "a line of {stations} stations ended with {}", output.status);
    std::fs::remove_dir_all(&out)?;
    let printed = String::from_utf8(output.stdout)?;
    let summary: Value = serde_json::from_str(printed.lines().last().unwrap_or_default())?;
    let pace = |key: &str| summary["pace"][key].as_f64().with_context(|| format!("no {key} in {summary}"));
    let taps = SimulatedLine::new(&scan(stations), &SimulationConfig::default())?.plan().taps().len();
    ensure!(summary["is_complete"] == true && summary["archived"] == taps, "not all of {taps} taps: {summary}");
    ensure!(summary["pace"]["gaps"] == 0, "records were lost: {summary}");
    let memory = summary["pace"]["peak_memory_mb"].as_array().into_iter().flatten();
    Ok(Pace {
        taps_per_s: pace("taps_per_s")?,
        gb_per_s: pace("gb_per_s")?,
        cpu_us_per_tap: cpu_s * 1e6 / pace("taps")?,
        latency_us: (pace("latency_p50_us")?, pace("latency_p99_us")?),
        peak_memory_mb: memory.filter_map(|stage| stage[1].as_f64()).sum(),
    })
}

/// Processor time of all children that have ended, and of their children.
fn children_cpu_s() -> Result<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    // The name may contain anything; the fields after it are counted: state is field 3, the children's times are 16 and
    // 17.
    let fields = stat.rsplit(") ").next().unwrap_or_default().split(' ');
    let ticks: Vec<f64> = fields.skip(13).take(2).map(str::parse).collect::<Result<_, _>>()?;
    Ok(ticks.iter().sum::<f64>() / TICKS_PER_S)
}

/// Taps per second when one thread only simulates them.
fn render() -> Result<f64> {
    let mut source = SimulatedLine::new(&scan(STATIONS[2]), &SimulationConfig::default())?;
    let mut buffer = record_of(&source);
    let mut header = TapHeader::default();
    let count = u32::try_from(source.plan().taps().len())?;
    let begin = Instant::now();
    for row in 0..count {
        source.render(row, 0, &mut header, &mut buffer)?;
    }
    Ok(f64::from(count) / begin.elapsed().as_secs_f64())
}

/// Taps per second when their bytes are written to one file and synced to the disk.
fn write(folder: &Path) -> Result<f64> {
    let source = SimulatedLine::new(&scan(STATIONS[2]), &SimulationConfig::default())?;
    let buffer = record_of(&source);
    let count = u32::try_from(source.plan().taps().len())?;
    let path = folder.join("plain");
    let begin = Instant::now();
    let mut file = File::create(&path)?;
    for _ in 0..count {
        file.write_all(bytes_of(&buffer))?;
    }
    file.sync_data()?;
    let elapsed = begin.elapsed();
    std::fs::remove_file(&path)?;
    Ok(f64::from(count) / elapsed.as_secs_f64())
}

fn record_of(source: &SimulatedLine) -> Vec<CacheLine> {
    vec![CacheLine::default(); cache_lines_for(source.plan().recording.payload_bytes_max())]
}

fn report(lines: &[Vec<Pace>; 3], render: f64, write: f64) {
    let rows: Vec<[String; 9]> = STATIONS
        .into_iter()
        .zip(lines)
        .map(|(stations, paces)| {
            let median = |of: fn(&Pace) -> f64| quantile(&mut paces.iter().map(of).collect::<Vec<_>>(), 0.5);
            let taps_per_s = median(|pace| pace.taps_per_s);
            [
                stations.to_string(),
                format!("{taps_per_s:.0}"),
                format!("{:.3}", median(|pace| pace.gb_per_s)),
                format!("{:.2}", taps_per_s / render),
                format!("{:.2}", taps_per_s / write),
                format!("{:.0}", median(|pace| pace.cpu_us_per_tap)),
                format!("{:.0}", median(|pace| pace.latency_us.0)),
                format!("{:.0}", median(|pace| pace.latency_us.1)),
                format!("{:.0}", median(|pace| pace.peak_memory_mb)),
            ]
        })
        .collect();
    let title = format!("whole lines, simulated taps as fast as they go, medians of {ROUNDS} rounds; no gaps");
    let head =
        ["stations", "taps/s", "GB/s", "/ render", "/ write", "CPU us/tap", "p50 us", "p99 us", "memory of all MB"];
    print_table(&title, head, &rows);
    println!("  yardstick, render: one thread simulates {render:.0} taps/s and sends them nowhere");
    println!("  yardstick, write: write and fdatasync of the same bytes, {write:.0} taps/s");
}
