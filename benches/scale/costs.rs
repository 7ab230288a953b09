//! What a tap costs at each step, for different numbers of casings, stations and archives.

use std::fmt::Write as _;
use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use tapline_bench::{children_cpu_s, cpu_s, quantile, root, tapline};
use tapline_lab::line_cost::run_command;

/// How often each is measured.
pub(crate) const ROUNDS: usize = 3;

/// Casings of a run, and archives of a folder.
const CASINGS: [u32; 4] = [4, 16, 64, 256];

/// Stations that share 64 casings.
const STATIONS: [u16; 4] = [1, 4, 16, 64];

/// Taps of a casing: two shoulders, each a turn of 100 locations with its first again.
const TAPS: f64 = 202.0;

/// A step, with its processor time for different numbers of something.
pub(crate) struct Step {
    what: &'static str,
    of: &'static str,
    /// How many, and us per tap.
    pub points: Vec<(u32, f64)>,
}

/// The way to a centre.
pub(crate) struct Way {
    /// Processor time of sender, server and collector, us per tap.
    pub us: [f64; 3],
    /// How fast one collector takes taps from one server, both on this machine.
    pub taps_per_s: f64,
}

/// All that was measured.
pub(crate) struct Costs {
    pub steps: Vec<Step>,
    pub bytes_per_tap: f64,
    pub way: Option<Way>,
}

impl Step {
    /// The exponent with which the cost of a tap grows with the number: the slope of the logarithms.
    fn exponent(&self) -> f64 {
        let logs: Vec<(f64, f64)> = self.points.iter().map(|&(n, us)| (f64::from(n).ln(), us.ln())).collect();
        let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / logs.len() as f64;
        let (x, y) = (mean(|p| p.0), mean(|p| p.1));
        logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / logs.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
    }

    /// At the largest number.
    pub(crate) fn us(&self) -> f64 {
        self.points.last().map_or(f64::NAN, |point| point.1)
    }
}

impl Costs {
    pub(crate) fn measure() -> Result<Self> {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR"))?;
        let made = folder.path().join("made");
        let mut steps = vec![
            Step { what: "scan, judge and archive (`run`)", of: "casings", points: Vec::new() },
            Step { what: "the same", of: "stations", points: Vec::new() },
            Step { what: "check (`verify`)", of: "archives", points: Vec::new() },
            Step { what: "judge again (`reprocess`)", of: "archives", points: Vec::new() },
            Step { what: "table of verdicts (`export`)", of: "archives", points: Vec::new() },
        ];
        let mut bytes_per_tap = f64::NAN;
        for casings in CASINGS {
            let taps = f64::from(casings) * TAPS;
            let mut us = [const { Vec::new() }; 4];
            for _ in 0..ROUNDS {
                us[0].push(run(folder.path(), &made, casings, 2)? * 1e6 / taps);
                bytes_per_tap = bytes_of(&made)? / taps;
                us[1].push(cpu_s_of(Command::new(tapline()).arg("verify").arg(&made))? * 1e6 / taps);
                us[2].push(cpu_s_of(Command::new(tapline()).arg("reprocess").arg(&made))? * 1e6 / taps);
                let table = folder.path().join("verdicts.csv");
                let export = ["export", "--force", "--out"];
                let mut command = Command::new(tapline());
                us[3].push(cpu_s_of(command.args(export).arg(table).arg(&made).arg("verdicts"))? * 1e6 / taps);
            }
            for (step, us) in [0, 2, 3, 4].into_iter().zip(&mut us) {
                steps[step].points.push((casings, quantile(us, 0.5)));
            }
        }
        for stations in STATIONS {
            let mut us = Vec::new();
            for _ in 0..ROUNDS {
                us.push(run(folder.path(), &folder.path().join("shared"), 64, stations)? * 1e6 / (64.0 * TAPS));
            }
            steps[1].points.push((stations.into(), quantile(&mut us, 0.5)));
        }
        let way = match nats_server() {
            Some(server) => Some(Way::measure(&server, folder.path(), &made)?),
            None => None,
        };
        Ok(Self { steps, bytes_per_tap, way })
    }

    pub(crate) fn text(&self) -> Result<String> {
        let mut text = String::from(
            "## What a tap costs\n\n| processor time of a tap, us | run with | | exponent |\n|---|---|---|--:|\n",
        );
        for step in &self.steps {
            let numbers: Vec<String> = step.points.iter().map(|(n, _)| n.to_string()).collect();
            let us: Vec<String> = step.points.iter().map(|(_, us)| format!("{us:.1}")).collect();
            let exponent = step.exponent();
            writeln!(
                text,
                "| {} | {} {} | {} | {exponent:+.2} |",
                step.what,
                numbers.join(", "),
                step.of,
                us.join(", ")
            )?;
        }
        writeln!(
            text,
            "\nWith an exponent of 0 a tap costs the same however many there are; below 0 it costs less, because work that is done once is \
             shared. A tap takes {:.0} bytes in its archive (50 ms, two channels, simulated with noise).\n",
            self.bytes_per_tap
        )?;
        if let Some(Way { us: [sender, server, collector], taps_per_s }) = &self.way {
            writeln!(
                text,
                "On the way to a centre: sender {sender:.1}, server {server:.1}, collector {collector:.1} us per tap; one \
                 collector, with the server and the sender on the same machine, takes {taps_per_s:.0} taps/s.\n"
            )?;
        }
        Ok(text)
    }
}

impl Way {
    fn measure(program: &Path, folder: &Path, made: &Path) -> Result<Self> {
        let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
        let config = folder.join("nats.conf");
        let store = folder.join("nats");
        fs::write(
            &config,
            format!(
                "listen: 127.0.0.1:{port}\njetstream {{ store_dir: \"{}\", sync_interval: always }}\n",
                store.display()
            ),
        )?;
        let mut rounds = [const { Vec::new() }; 4];
        let count = f64::from(CASINGS[CASINGS.len() - 1]) * TAPS;
        for round in 0..ROUNDS {
            let server = Command::new(program).arg("-c").arg(&config).stderr(Stdio::null()).spawn()?;
            let mut server = Ended(server);
            std::thread::sleep(Duration::from_secs(1));
            let address = format!("127.0.0.1:{port}");
            let centre = folder.join(format!("centre-{round}"));
            let mut collector = Command::new(tapline());
            collector.arg("collect").arg(&centre).args(["--from", &address]);
            let mut collector = Ended(collector.stdout(Stdio::null()).spawn()?);
            let since = Instant::now();
            let site = format!("site-{round}");
            let mut sender = Command::new(tapline());
            sender.arg("uplink").arg(made).args(["--to", &address, "--site", &site, "--once"]);
            rounds[0].push(cpu_s_of(&mut sender)? * 1e6 / count);
            rounds[3].push(count / since.elapsed().as_secs_f64());
            rounds[1].push(cpu_s(server.0.id())? * 1e6 / count);
            rounds[2].push(cpu_s(collector.0.id())? * 1e6 / count);
            collector.end()?;
            server.end()?;
            fs::remove_dir_all(&centre)?;
            fs::remove_dir_all(&store)?;
        }
        let [sender, server, collector, rate] = rounds.map(|mut round| quantile(&mut round, 0.5));
        Ok(Self { us: [sender, server, collector], taps_per_s: rate })
    }
}

/// A process that ends with its owner.
struct Ended(Child);

impl Ended {
    fn end(&mut self) -> Result<()> {
        self.0.kill()?;
        self.0.wait()?;
        Ok(())
    }
}

impl Drop for Ended {
    fn drop(&mut self) {
        // It has already ended, or nobody is left to be told.
        drop(self.end());
    }
}

/// Processor time of `tapline run` on `casings` at `stations`, s.
fn run(folder: &Path, out: &Path, casings: u32, stations: u16) -> Result<f64> {
    let tyres: String = (1..=casings).map(|n| format!("[[scan.tyre]]\nserial = \"C{n}\"\n")).collect();
    let config = folder.join("scale.toml");
    let scan = "[fuse]\nreference = \"self\"\n[scan]\nconfirm = false\n";
    fs::write(&config, format!("{scan}{tyres}"))?;
    if out.exists() {
        fs::remove_dir_all(out)?;
    }
    cpu_s_of(&mut run_command(tapline(), &config, stations, out))
}

/// Processor time of a command and its children, s.
fn cpu_s_of(command: &mut Command) -> Result<f64> {
    let before = children_cpu_s()?;
    let status = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    let status = status.with_context(|| format!("{}: build it first", tapline().display()))?;
    ensure!(status.success(), "{command:?} ended with {status}");
    Ok(children_cpu_s()? - before)
}

/// Bytes of the archives in `folder`.
fn bytes_of(folder: &Path) -> Result<f64> {
    let mut bytes = 0.0;
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        // Results of judging again are no part of what was scanned: their names have two dots.
        let is_archive = path.file_name().is_some_and(|name| name.to_string_lossy().matches('.').count() == 1);
        if is_archive && path.extension().is_some_and(|ending| ending == "h5") {
            bytes += path.metadata()?.len() as f64;
        }
    }
    if bytes <= 0.0 {
        bail!("{} has no archive", folder.display());
    }
    Ok(bytes)
}

/// A NATS server, if there is one.
fn nats_server() -> Option<PathBuf> {
    let candidates =
        [root().join("target/python/bin/nats-server"), "nats-server".into(), "/usr/sbin/nats-server".into()];
    candidates.into_iter().find(|program| Command::new(program).arg("--version").output().is_ok())
}
