//! `tapline-lab headroom`: how many stations this host supports, and what limits them.
//!
//! The built program runs two lines of simulated stations at the pace of real ones for a short time: with few stations, and with
//! many. What the second used more of processors, memory, `/dev/shm` and disk, divided by its additional stations, is what one
//! takes; the rest is what any line takes. Both are compared with what the host has. The stations of a line share a process for
//! each core (for 16 stations if that is more), so the first line has a station for each core: its processes count for the line.

use std::fs::{self, File};
use std::io::Write as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use serde_json::{Value, json};
use tapline_host::memory;
use tapline_host::messages::say;
use tapline_host::progress::{Progress, Unit};
use tapline_host::stdout::Stdout;
use tapline_host::table::table;
use tapline_wire::LineAddress;

use crate::line_cost::{LineCost, Pace, run_command};

/// Fraction of the processors that stations may use: the rest is for other work of the host.
const USABLE: f64 = 0.8;

/// Longest run of the line with few stations.
const FEW_S_MAX: f64 = 60.0;

/// Bytes that are written to measure the speed of the disk.
const WRITTEN: usize = 1 << 26;

/// Where processes of a line share memory.
const SHARED: &str = "/dev/shm";

/// How the host is measured.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct HeadroomArgs {
    /// Stations of the second line; the first has one for each core. With few stations the need of one is overstated: up to the
    /// number of cores each starts a process, and eight take nearly as much of /dev/shm as 256.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u16).range(2..=1024))]
    stations: u16,
    /// Taps per second of a station.
    #[arg(long, default_value_t = 2.5)]
    taps_per_s: f64,
    /// Seconds that the second line runs; the first runs as long, but at most 60.
    #[arg(long, default_value_t = 20.0)]
    seconds: f64,
    /// Per cent of a core that listening adds at each station: `benches/scripts/listen.py` measures it.
    #[arg(long, default_value_t = 0.4)]
    listening_percent: f64,
    /// Folder on the disk that archives will be written to.
    #[arg(long, default_value = ".")]
    folder: PathBuf,
    /// Print a line of JSON.
    #[arg(long)]
    json: bool,
}

/// Something that stations share.
struct Resource {
    name: &'static str,
    unit: &'static str,
    /// What the host has.
    total: f64,
    /// What a line takes without its stations.
    of_line: f64,
    /// What a station takes.
    of_station: f64,
}

impl Resource {
    fn stations(&self) -> f64 {
        ((self.total - self.of_line) / self.of_station).floor().clamp(0.0, f64::INFINITY)
    }
}

/// Measures this host, and prints how many stations it supports.
///
/// # Errors
/// A value out of its bounds, a program that is not built, a line that fails, or an error of the system.
pub fn headroom(args: &HeadroomArgs) -> Result<()> {
    let HeadroomArgs { stations, taps_per_s, seconds, listening_percent, folder, json } = args;
    for (name, value, bounds) in [
        ("--taps-per-s", *taps_per_s, 0.01..=1000.0),
        ("--seconds", *seconds, 5.0..=3600.0),
        ("--listening-percent", *listening_percent, 0.0..=100.0),
    ] {
        ensure!(bounds.contains(&value), "{name} is {value}; it must be from {} to {}", bounds.start(), bounds.end());
    }
    let folder = tempfile::Builder::new()
        .prefix("headroom-")
        .tempdir_in(folder)
        .with_context(|| format!("--folder {}", folder.display()))?;
    let try_line = |stations: u16, seconds| {
        Used::by_line(&folder.path().join(stations.to_string()), stations, *taps_per_s, seconds)
    };
    let core_count = std::thread::available_parallelism().map_or(1, usize::from);
    let few_stations = u16::try_from(core_count).unwrap_or(u16::MAX).min(stations / 2);
    if usize::from(few_stations) < core_count {
        say(&format!(
            "with --stations {stations} on {core_count} cores, a station is counted with a part of a process: choose at least twice \
             as many stations as cores"
        ));
    }
    let (few, many) = (try_line(few_stations, seconds.clamp(0.0, FEW_S_MAX))?, try_line(*stations, *seconds)?);
    let disk_mb_per_s = disk_mb_per_s(&folder.path().join("plain"))?;
    let shared_free_mb = shared_free_mb();
    let more_stations = f64::from(stations - few_stations);
    let resource = |name, unit, total, used: &dyn Fn(&Used) -> f64, besides: f64| {
        let more = used(&many) - used(&few);
        // If noise hides what stations take, the line's share is divided too: too few stations rather than too many.
        let of_station = if more > 0.0 { more / more_stations } else { used(&many) / f64::from(*stations) };
        let of_line = (used(&few) - f64::from(few_stations) * of_station).clamp(0.0, f64::INFINITY);
        Resource { name, unit, total, of_line, of_station: of_station + besides }
    };
    let processors = 100.0 * core_count as f64 * USABLE;
    let resources = [
        resource("processors", "% of a core", processors, &|used| used.cpu_percent, *listening_percent),
        resource("memory", "MB", free_memory_mb(), &|used| used.memory_mb, 0.0),
        resource(SHARED, "MB", shared_free_mb, &|used| used.shared_mb, 0.0),
        resource("disk", "MB/s", disk_mb_per_s, &|used| used.disk_mb_per_s, 0.0),
    ];
    let of_tap_us = (resources[0].of_station - listening_percent) * 1e4 / taps_per_s;
    let least = resources.iter().min_by(|a, b| a.stations().total_cmp(&b.stations())).context("there are resources")?;
    let mut out = Stdout;
    if *json {
        let each = resources.iter().map(|of| {
            json!({
                "resource": of.name, "unit": of.unit, "total": of.total, "of_line": of.of_line, "of_station": of.of_station,
                "stations": of.stations(),
            })
        });
        let text = json!({
            "stations": least.stations(), "binds": least.name, "taps_per_s": taps_per_s,
            "cpu_us_per_tap": of_tap_us, "resources": each.collect::<Vec<Value>>(),
        });
        writeln!(out, "{text}")?;
        return Ok(());
    }
    let mut rows = table(["what", "the host has", "a line takes", "a station takes", "stations"]);
    for of in &resources {
        rows.add_row([
            of.name.to_owned(),
            format!("{:.0} {}", of.total, of.unit),
            format!("{:.3} {}", of.of_line, of.unit),
            format!("{:.3} {}", of.of_station, of.unit),
            format!("{:.0}", of.stations()),
        ]);
    }
    writeln!(out, "{rows}")?;
    writeln!(
        out,
        "This host supports about {:.0} stations of {taps_per_s} taps/s; the limit: {}.",
        least.stations(),
        least.name
    )?;
    writeln!(
        out,
        "Measured with {few_stations} and with {stations} simulated stations: {of_tap_us:.0} us of processor time per tap, simulation excluded; \
         listening to a sound card is assumed to take {listening_percent} % of a core per station. {:.0} % of the cores may be used.",
        100.0 * USABLE
    )?;
    Ok(())
}

/// What a line used.
struct Used {
    /// Processor time of all processes but those that simulate, in per cent of a core.
    cpu_percent: f64,
    /// Sum of the processes' peak memory.
    memory_mb: f64,
    /// Most that the line's own files took of `/dev/shm`.
    shared_mb: f64,
    /// What it archives.
    disk_mb_per_s: f64,
}

impl Used {
    /// Runs a line of `stations` that make `taps_per_s` each, for about `seconds`.
    fn by_line(folder: &Path, stations: u16, taps_per_s: f64, seconds: f64) -> Result<Self> {
        let program = program()?;
        fs::create_dir(folder)?;
        // Two shoulders, each with one tap more than it has locations.
        let locations = (taps_per_s * seconds / 2.0).clamp(16.0, 10_000.0) as u32;
        let config = folder.join("line.toml");
        let text = format!(
            "[acquire]\ntaps_per_s = {taps_per_s:?}\n[scan]\nlocations = {locations}\nconfirm = false\n[fuse]\nreference = \"self\"\n"
        );
        fs::write(&config, text)?;
        let out = folder.join("line");
        let printed = folder.join("printed");
        let child = run_command(&program, &config, stations, &out)
            .stdout(File::create(&printed)?)
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let shared_mb = watch(child, f64::from(2 * locations) / taps_per_s, &out)?;
        let Pace { taps, processes, .. } = LineCost::printed(&fs::read_to_string(printed)?)?.pace;
        let cpu_s: f64 = processes.iter().filter(|of| !of.is_source()).map(|of| of.user_s + of.kernel_s).sum();
        let tapped_s = taps / (f64::from(stations) * taps_per_s);
        Ok(Self {
            cpu_percent: 100.0 * cpu_s / tapped_s,
            memory_mb: processes.iter().map(|of| of.peak_memory_mb).sum(),
            shared_mb,
            disk_mb_per_s: bytes_in(&out)? / 1e6 / tapped_s,
        })
    }
}

/// The built program beside this one.
fn program() -> Result<PathBuf> {
    let path = std::env::current_exe()?.with_file_name("tapline");
    ensure!(path.is_file(), "{} does not exist: `cargo build --release -p tapline` builds it", path.display());
    Ok(path)
}

/// Waits for the line into `out`, which takes about `expected_s`; returns the most MB that its files took of `/dev/shm`.
fn watch(mut child: Child, expected_s: f64, out: &Path) -> Result<f64> {
    let begun = Instant::now();
    let mut progress = Progress::new(Some(expected_s.ceil() as u64), Unit::Things("seconds"));
    let mut most: f64 = 0.0;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        let taken = address_of(out).map_or(0.0, |address| shared_mb(&address));
        most = if taken > most { taken } else { most };
        progress.update(begun.elapsed().as_secs());
        sleep(Duration::from_millis(200));
    };
    ensure!(status.success(), "the line ended with {status}");
    ensure!(most > 0.0, "no file of the line was seen in {SHARED}");
    Ok(most)
}

/// The address of the line that writes to `out`, once it has one.
fn address_of(out: &Path) -> Option<LineAddress> {
    let lock: toml::Table = fs::read_to_string(out.join(".line")).ok()?.parse().ok()?;
    LineAddress::at(Path::new(lock.get("folder")?.as_str()?)).ok()
}

/// What the files of the line at `address` take of `/dev/shm`; files of other lines and of other programs do not count.
fn shared_mb(address: &LineAddress) -> f64 {
    let files = fs::read_dir(SHARED).into_iter().flatten().flatten();
    let own = files.filter(|file| file.file_name().to_string_lossy().starts_with(address.prefix()));
    // What is reserved of a file, in blocks of 512 bytes.
    own.filter_map(|file| file.metadata().ok()).map(|of| of.blocks() as f64 * 512.0 / 1e6).sum()
}

fn shared_free_mb() -> f64 {
    rustix::fs::statvfs(SHARED).map_or(f64::NAN, |of| (of.f_bavail * of.f_frsize) as f64 / 1e6)
}

/// Memory that the system can use without swapping.
fn free_memory_mb() -> f64 {
    let text = fs::read_to_string("/proc/meminfo").unwrap_or_default();
    memory::bytes(&text, "MemAvailable").map_or(f64::NAN, |bytes| bytes as f64 / 1e6)
}

fn disk_mb_per_s(path: &Path) -> Result<f64> {
    // Not zeros, which some file systems do not write.
    let bytes: Vec<u8> = (0..WRITTEN).map(|k| ((k * 31) >> 3) as u8).collect();
    let begun = Instant::now();
    let mut file = File::create(path)?;
    file.write_all(&bytes)?;
    file.sync_data()?;
    Ok(WRITTEN as f64 / 1e6 / begun.elapsed().as_secs_f64())
}

/// Bytes of the files in `folder`.
fn bytes_in(folder: &Path) -> Result<f64> {
    let mut bytes = 0.0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let of = entry.metadata()?;
        bytes += if of.is_dir() { bytes_in(&entry.path())? } else { of.len() as f64 };
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches shared memory of another line, or of another program, that counts for the line.
    #[test]
    fn only_the_files_of_the_line_count() {
        let folder = tempfile::tempdir().unwrap();
        assert!(address_of(folder.path()).is_none());
        let root = folder.path().join("tapline-0123456789abcdef");
        fs::write(folder.path().join(".line"), format!("pid = 1\nfolder = {root:?}\n")).unwrap();
        let address = address_of(folder.path()).unwrap();
        // Its token is not that of the address: unique to this process.
        let others = Path::new(SHARED).join(format!("tapline_test_{}", std::process::id()));
        let own = Path::new(SHARED).join(format!("{}test_{}", address.prefix(), std::process::id()));
        fs::write(&others, vec![1; 1 << 20]).unwrap();
        fs::write(&own, vec![1; 1 << 16]).unwrap();
        let counted = shared_mb(&address);
        fs::remove_file(others).unwrap();
        fs::remove_file(own).unwrap();
        assert!((counted - 0.065_536).abs() < 1e-9, "{counted}");
    }
}
