//! The configuration file: one TOML table per part of the line.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use serde::{Deserialize, Serialize};
use tapline_acquire::{AcquireConfig, ScanConfig, SimulatedLine, Source, TapSet};
use tapline_fuse::FuseConfig;
use tapline_model::SimulationConfig;
use tapline_process::ProcessConfig;

use crate::cli::SourceArgs;

/// What a configuration file says; every key has a default, and unknown keys are refused.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Config {
    /// The simulated scan.
    pub(crate) scan: ScanConfig,
    /// The simulated tyre and its sensors.
    pub(crate) simulation: SimulationConfig,
    /// How taps are taken.
    pub(crate) acquire: AcquireConfig,
    /// The discriminators.
    pub(crate) process: ProcessConfig,
    /// Damage maps and verdicts.
    pub(crate) fuse: FuseConfig,
}

/// A run as it was asked for: configuration, source and archive.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) config: Config,
    /// The configuration as it was written, or the defaults spelled out where nothing was.
    pub(crate) config_toml: String,
    pub(crate) taps: Option<PathBuf>,
    pub(crate) out: PathBuf,
    stations: Option<u16>,
}

impl Job {
    /// Reads the configuration that `args` name and checks it.
    pub(crate) fn resolve(args: &SourceArgs) -> Result<Self> {
        let (mut config, config_toml) = read_config(args.config.as_deref())?;
        if let (Some(stations), None) = (args.stations, &args.taps) {
            config.scan.stations = stations;
        }
        config.acquire.validate()?;
        config.process.validate()?;
        config.fuse.validate()?;
        if args.stations == Some(0) {
            bail!("--stations is 0; at least one is needed");
        }
        let out = match (&args.out, &args.taps) {
            (Some(out), _) => out.clone(),
            (None, None) => PathBuf::from("simulated.h5"),
            (None, Some(taps)) => {
                let folder =
                    taps.canonicalize().with_context(|| format!("cannot find the tap set {}", taps.display()))?;
                PathBuf::from(format!("{}.h5", folder.file_name().unwrap_or_default().to_string_lossy()))
            }
        };
        Ok(Self { config, config_toml, taps: args.taps.clone(), out, stations: args.stations })
    }

    /// Opens the source of the taps.
    pub(crate) fn source(&self) -> Result<Box<dyn Source>> {
        Ok(match &self.taps {
            Some(folder) => Box::new(TapSet::open(folder, self.stations.unwrap_or(1))?),
            None => Box::new(SimulatedLine::new(&self.config.scan, &self.config.simulation)?),
        })
    }
}

fn read_config(path: Option<&Path>) -> Result<(Config, String)> {
    let Some(path) = path else {
        let config = Config::default();
        let text = toml::to_string(&config).context("the default configuration does not fit TOML")?;
        return Ok((config, text));
    };
    let text =
        std::fs::read_to_string(path).with_context(|| format!("cannot read the configuration {}", path.display()))?;
    let config = toml::from_str(&text).with_context(|| format!("{} is not a configuration", path.display()))?;
    Ok((config, text))
}
