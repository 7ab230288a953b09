//! The setup of a line: a copy of its options for every process, in the line's private folder.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use serde::{Deserialize, Serialize};
use tapline_acquire::{Arrivals, CasingList, StationSource, Wake, listed_simulated, listed_tap_set, open_station};
use tapline_store::{Places, StoreRun};
use tapline_wire::{Limits, LineAddress, Plan, Truth, line_bytes};

use crate::config::job::Job;
use crate::line::limits::{self, Needs};

/// Stations that one `acquire` process serves at most.
const STATIONS_PER_PROCESS: usize = 16;

/// Where the casings of a line come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) enum Arriving {
    /// The simulated tyres of the configuration.
    Simulated,
    /// The casings of a tap set.
    TapSet {
        /// Its folder.
        folder: PathBuf,
        /// Stations among which its casings are divided.
        stations: u16,
    },
    /// From the stations of the configuration, for as long as the line runs.
    Stations,
}

impl Arriving {
    /// The list that the casings come from; `None` where they come from stations.
    pub(crate) fn list(&self, job: &Job) -> Result<Option<Box<dyn CasingList>>> {
        Ok(match self {
            Self::Simulated => Some(Box::new(listed_simulated(&job.config.scan, &job.config.simulation)?)),
            Self::TapSet { folder, stations } => Some(Box::new(listed_tap_set(folder, *stations)?)),
            Self::Stations => None,
        })
    }
}

/// The options of a line. Its stages read this copy, even when they are restarted after an edit of the original.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Setup {
    pub arriving: Arriving,
    /// Working folder in which the line was started.
    pub started_in: PathBuf,
    /// Output folder, absolute.
    pub out: PathBuf,
    pub limits: Limits,
    /// Stations whose casings are on rigs.
    pub rigs: Vec<u16>,
    pub config_toml: String,
    /// The text of the reference file.
    pub reference: Option<String>,
}

const SETUP: &str = "setup.json";

/// The file in which the line at `address` shows its status.
pub(crate) fn status_file(address: &LineAddress) -> PathBuf {
    address.root().join("status.json")
}

impl Setup {
    /// The setup of `job` on the casings of `arriving`, with results in `out`.
    pub(crate) fn new(job: &Job, arriving: Arriving, out: &Path) -> Result<Self> {
        let limits = limits_of(job, &arriving)?;
        let reference = job.reference.as_ref().map(|file| file.text.clone());
        Ok(Self {
            arriving,
            started_in: std::env::current_dir().context("cannot find the folder this was started in")?,
            out: out.to_owned(),
            limits,
            rigs: job.config.station.iter().filter(|station| station.rig.is_some()).map(|s| s.number).collect(),
            config_toml: job.config_toml.clone(),
            reference,
        })
    }

    /// The setup of the line at `address`.
    pub(crate) fn read(address: &LineAddress) -> Result<Self> {
        let path = address.root().join(SETUP);
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{} is no setup of a line", path.display()))
    }

    /// Writes it for the stages of the line at `address`.
    pub(crate) fn write(&self, address: &LineAddress) -> Result<()> {
        let path = address.root().join(SETUP);
        fs::write(&path, serde_json::to_string(self)?).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Checks that the machine has what the line will need.
    pub(crate) fn check_machine(&self) -> Result<()> {
        limits::check(&Needs {
            stations: self.limits.stations.len(),
            acquire_processes: self.limits.acquire_count.into(),
            shared_bytes: line_bytes(&self.limits) as u64,
        })
    }

    /// Whether the casings are a list that ends.
    pub(crate) fn is_list(&self) -> bool {
        self.arriving != Arriving::Stations
    }

    /// Where the files are: all files of a list in one folder; a line that never ends has a folder for each day.
    pub(crate) fn places(&self) -> Places {
        Places::new(&self.out, !self.is_list())
    }

    /// What `store` begins each file with.
    pub(crate) fn store_run(&self, job: &Job) -> StoreRun {
        StoreRun {
            places: self.places(),
            skips_finished: self.is_list(),
            notes_unreported: !self.is_list(),
            config_toml: self.config_toml.clone(),
            reference: self.reference.clone(),
            made_by: job.made_by().to_owned(),
            codec: job.config.store.codec,
        }
    }

    /// The plans of casings at stations that tap as the table `[scan]` says: one plan for each kind of record.
    pub(crate) fn plans_of_stations(&self, job: &Job) -> Result<Vec<Plan>> {
        let list = listed_simulated(&job.config.scan.for_line(), &job.config.simulation)?;
        let Some((_name, _station, simulated)) = list.listed().next().transpose()? else { return Ok(Vec::new()) };
        let mut plans: Vec<Plan> = Vec::new();
        for station in &job.config.station {
            let recording = match station.source {
                StationSource::Folder => continue,
                StationSource::Alsa | StationSource::Uldaq => station.heard_with(&job.config.capture)?.recording(),
                StationSource::Rig | StationSource::Simulated => simulated.recording.clone(),
            };
            if plans.iter().all(|plan| plan.recording != recording) {
                plans.push(Plan::new(simulated.geometry, recording, simulated.taps().to_vec(), Truth::new())?);
            }
        }
        Ok(plans)
    }

    /// The stations of the `acquire` process with number `acquire`.
    pub(crate) fn arrivals(&self, job: &Job, acquire: u16, wake: &Wake) -> Result<Vec<Box<dyn Arrivals>>> {
        let ours = self.limits.stations.iter().copied().filter(|&s| self.limits.acquire_of(s) == Some(acquire));
        if let Some(list) = self.arriving.list(job)? {
            return Ok(ours.map(|station| list.arrivals(station)).collect());
        }
        let config = &job.config;
        let opened = |number| {
            let station = config.station.iter().find(|station| station.number == number);
            let Some(station) = station else { bail!("station {number} is not in the configuration") };
            let mut station = station.clone();
            // Relative to where the line was started; its stages run elsewhere.
            station.folder = station.folder.map(|folder| self.started_in.join(folder));
            station.serial_file = station.serial_file.map(|file| self.started_in.join(file));
            station.calibration = station.calibration.map(|file| self.started_in.join(file));
            Ok(open_station(
                &station,
                &config.acquire,
                &config.scan.for_line(),
                &config.simulation,
                &config.capture,
                &self.out,
                wake.clone(),
            )?)
        };
        ours.map(opened).collect()
    }
}

fn limits_of(job: &Job, arriving: &Arriving) -> Result<Limits> {
    let (mut stations, largest) = match arriving.list(job)? {
        Some(list) => (list.stations(), list.limits()?),
        None => (job.config.station.iter().map(|s| s.number).collect(), job.config.station_limits()?),
    };
    stations.sort_unstable();
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
    // A station that listens has a process of its own.
    let captures = *arriving == Arriving::Stations && job.config.station.iter().any(|station| station.device.is_some());
    let cores = if captures { stations.len() } else { cores };
    let processes = stations.len().min(cores.max(stations.len().div_ceil(STATIONS_PER_PROCESS)));
    Ok(Limits { acquire_count: u16::try_from(processes).context("too many stations")?, stations, casing: largest })
}

/// The path from the root.
pub(super) fn absolute(path: &Path) -> Result<PathBuf> {
    std::path::absolute(path).with_context(|| format!("{} is no usable path", path.display()))
}
