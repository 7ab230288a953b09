//! The speed of a whole line: the built program, from simulated taps to verdicts in an archive.
//!
//! The same rounds also measure the line's work in one process, one tap after the other, without shared memory; and
//! the same taps as a tap set in memory, which shows the line without the simulation. Needs the built program:
//! `cargo build --release -p tapline`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context as _, Result, ensure};
use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_bench::{Row, Sheet, Spread, cpu_s, tapline};
use tapline_fuse::{FuseConfig, Fusion, Reference};
use tapline_lab::in_memory::Record;
use tapline_lab::line_cost::{LineCost, Pace, ProcessCost, run_command};
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_store::Writer;
use tapline_wire::{RecordKind, TapTopic, Topic as _};
use tempfile::TempDir;

const ROUNDS: usize = 5;
const STATIONS: [u16; 3] = [1, 2, 4];
/// Full turns of all stations together; every line has the same number of taps, 77568: enough that starting processes is little of the time.
const TURNS: u16 = 64;
/// Most taps per second that a station of a rig makes.
const REAL_TAPS_PER_S: f64 = 2.5;

/// A scan at two offsets and three velocities, its turns distributed over `stations`.
fn scan(stations: u16) -> ScanConfig {
    ScanConfig {
        stations,
        offsets_mm: vec![0.0, 10.0],
        velocities_m_per_s: vec![1.2, 1.5, 1.85],
        repetitions: TURNS / stations,
        confirm: false,
        ..ScanConfig::default()
    }
}

fn main() -> Result<()> {
    // Next to the build, because a temporary folder may be in memory, unlike archives.
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR"))?;
    let mut lines: [Vec<Pace>; 3] = Default::default();
    let (mut halves, mut alone) = (Vec::new(), Vec::new());
    let (recorded, mut replayed) = (recorded(folder.path())?, Vec::new());
    for _ in 0..ROUNDS {
        for (stations, paces) in STATIONS.into_iter().zip(&mut lines) {
            paces.push(run_line(folder.path(), stations, None, None)?);
        }
        // Half of what the same stations just reached.
        let half = lines[2].last().map(|pace| pace.taps_per_s / 2.0 / f64::from(STATIONS[2]));
        halves.push(run_line(folder.path(), STATIONS[2], half, None)?);
        replayed.push(run_line(folder.path(), STATIONS[1], None, Some(recorded.path()))?);
        alone.push(one_process(folder.path())?);
    }
    keep(&lines, &halves, &replayed, &alone)
}

/// Keeps what was measured for the page.
fn keep(lines: &[Vec<Pace>; 3], halves: &[Pace], replayed: &[Pace], alone: &[f64]) -> Result<()> {
    let of = |paces: &[Pace], value: &dyn Fn(&Pace) -> f64| paces.iter().map(value).collect::<Vec<f64>>();
    let rates = [0, 1, 2].map(|k: usize| of(&lines[k], &|pace| pace.taps_per_s));
    let mut rows = Vec::new();
    for (stations, rate) in STATIONS.into_iter().zip(&rates) {
        let word = if stations == 1 { "station" } else { "stations" };
        let mut row = Row::new(format!("{stations} simulated {word}"), "taps/s", rate);
        if stations == STATIONS[2] {
            row = row.beside("of the rate of 2 stations, one a core", Spread::of_ratio(rate, &rates[1]), ">= 1");
        }
        rows.push(row);
    }
    let of_replayed = of(replayed, &|pace| pace.taps_per_s);
    rows.push(Row::new("2 stations that replay recorded taps from memory", "taps/s", &of_replayed).beside(
        "of the rate of 2 simulated stations",
        Spread::of_ratio(&of_replayed, &rates[1]),
        "",
    ));
    let latency = of(halves, &|pace| pace.latency_p99_us / 1e3);
    rows.push(Row::new("tap to discriminators at half of that load, 99 of 100 taps", "ms", &latency).beside(
        "at most, ms",
        Spread::of(&latency),
        "< 5",
    ));
    for (name, paces, what) in [
        ("acquire", &lines[1][..], "`acquire`, which simulates the taps"),
        ("acquire", replayed, "`acquire`, which replays them"),
        ("process", &lines[1], "`process`"),
        ("fuse", &lines[1], "`fuse`"),
        ("store", &lines[1], "`store`"),
        ("line", &lines[1], "`line`"),
    ] {
        let is_it = |process: &ProcessCost| process.name.split(' ').next() == Some(name);
        let all = of(paces, &|pace| us_per_tap(pace, is_it, |of| of.user_s + of.kernel_s));
        let kernel = of(paces, &|pace| us_per_tap(pace, is_it, |of| of.kernel_s));
        let share = Spread::of_ratio(&kernel, &all);
        rows.push(
            Row::new(format!("processor time of {what}"), "us per tap", &all).beside("of it in the kernel", share, ""),
        );
    }
    let beside_source = of(&lines[1], &|pace| us_per_tap(pace, |of| !of.is_source(), |of| of.user_s + of.kernel_s));
    rows.push(Row::new("processor time without the source", "us per tap", &beside_source).beside(
        "of the same work by one process",
        Spread::of_ratio(&beside_source, alone),
        "<= 1.5",
    ));
    rows.push(Row::new("yardstick: the same work by one process", "us per tap", alone));
    let sheet = Sheet {
        title: "The line".to_owned(),
        command: "cargo build --release -p tapline && cargo bench -p tapline-bench --bench line".to_owned(),
        notes: vec![
            format!(
                "`tapline run` on 77568 simulated taps of 50 ms, the default seed, each shoulder compared with itself, {ROUNDS} rounds; \
                 nothing is lost, or the bench fails. Processor times are of 2 stations, by the system's clock of 10 ms."
            ),
            "The same work by one process: discriminators, fusion and the synced archive of the same taps, one after another in memory, \
             without shared memory, ledger or supervisor; packing may use all cores.".to_owned(),
            "Recorded taps are the same ones, written as WAV files into a folder in memory: `tapline export taps`, `tapline run --taps`.".to_owned(),
            format!("A rig makes {REAL_TAPS_PER_S} taps/s."),
        ],
        rows,
    };
    sheet.keep("line")
}

/// Processor time of the processes of a line that `is_it` selects, us per tap.
fn us_per_tap(pace: &Pace, is_it: impl Fn(&ProcessCost) -> bool, time_s: fn(&ProcessCost) -> f64) -> f64 {
    pace.processes.iter().filter(|of| is_it(of)).map(time_s).sum::<f64>() * 1e6 / pace.taps
}

/// Processor time of a tap, us, when one process does all the work of the line.
fn one_process(folder: &Path) -> Result<f64> {
    let mut source = SimulatedLine::new(&scan(2), &SimulationConfig::default())?;
    let plan = source.plan().clone();
    let count = plan.taps().len();
    let mut taps = Record::render_all(&mut source, 0..count)?;
    taps.iter_mut().for_each(|tap| tap.header.stamp.kind = RecordKind::Data.code());
    let path = folder.join("alone.h5");
    let before_s = cpu_s(std::process::id())?;
    let mut writer = Writer::create(&path, &plan, 0, "[store]\n")?;
    let mut extractor = ProcessExtractor::new(&ProcessConfig::default())?;
    let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan)?;
    for batch in taps.chunks(TapTopic::BORROWED) {
        let borrowed: Vec<_> = batch.iter().map(|tap| (&tap.header, tap.bytes())).collect();
        writer.put_taps(&borrowed)?;
        for tap in batch {
            let found = extractor.extract(&tap.header, tap.samples());
            writer.put_discriminators(&found)?;
            fusion.push(&found)?;
        }
    }
    for scan in 0..plan.scans().len() {
        fusion.end(scan)?;
    }
    for number in 0..plan.scans().len() {
        let (judgement, cells) = fusion.judge(number)?;
        let scan = u32::try_from(number)?;
        writer.end_scan(scan)?;
        writer.put_judgement(scan, &judgement, &cells)?;
    }
    writer.finish()?;
    let us = (cpu_s(std::process::id())? - before_s) * 1e6 / count as f64;
    std::fs::remove_file(&path)?;
    Ok(us)
}

/// The taps of two stations as a tap set, in memory if there is a folder for it.
fn recorded(folder: &Path) -> Result<TempDir> {
    let memory = Path::new("/dev/shm");
    let taps = tempfile::tempdir_in(if memory.is_dir() { memory } else { folder })?;
    let (config, out) = (line_toml(folder, STATIONS[1], None)?, folder.join("recorded"));
    let run =
        run_command(tapline(), &config, STATIONS[1], &out).stdout(Stdio::null()).stderr(Stdio::null()).status()?;
    ensure!(run.success(), "the line to be recorded ended with {run}");
    let export = Command::new(tapline())
        .args(["export", "--quiet", "--out"])
        .args([taps.path(), &out])
        .arg("taps")
        .stdout(Stdio::null())
        .status()?;
    ensure!(export.success(), "the export of taps ended with {export}");
    std::fs::remove_dir_all(&out)?;
    Ok(taps)
}

/// The configuration of a line of `stations` that make `taps_per_s` each, or as many as they can.
fn line_toml(folder: &Path, stations: u16, taps_per_s: Option<f64>) -> Result<PathBuf> {
    let ScanConfig { offsets_mm, velocities_m_per_s, repetitions, confirm, .. } = scan(stations);
    let pace = taps_per_s.map_or_else(String::new, |rate| format!("taps_per_s = {rate:.3}\n"));
    let config = folder.join("line.toml");
    let text = format!(
        "[acquire]\n{pace}[scan]\noffsets_mm = {offsets_mm:?}\nvelocities_m_per_s = {velocities_m_per_s:?}\n\
         repetitions = {repetitions}\nconfirm = {confirm}\n[fuse]\nreference = \"self\"\n"
    );
    std::fs::write(&config, text)?;
    Ok(config)
}

/// A line of `stations` that make `taps_per_s` each, or as many as they can, from `recorded` or simulated taps.
fn run_line(folder: &Path, stations: u16, taps_per_s: Option<f64>, recorded: Option<&Path>) -> Result<Pace> {
    let config = line_toml(folder, stations, taps_per_s)?;
    let out = folder.join("line");
    let mut command = run_command(tapline(), &config, stations, &out);
    if let Some(taps) = recorded {
        command.arg("--taps").arg(taps);
    }
    let output =
        command.stderr(Stdio::null()).output().with_context(|| format!("{}: build it first", tapline().display()))?;
    ensure!(output.status.success(), "a line of {stations} stations ended with {}", output.status);
    std::fs::remove_dir_all(&out)?;
    let cost = LineCost::printed(&String::from_utf8(output.stdout)?)?;
    let taps = SimulatedLine::new(&scan(stations), &SimulationConfig::default())?.plan().taps().len();
    ensure!(cost.is_complete && cost.archived == taps, "not all of {taps} taps: {cost:?}");
    Ok(cost.pace)
}
