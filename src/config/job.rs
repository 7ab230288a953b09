//! The options of a line: configuration, source of casings, output folder.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use tapline_fuse::Reference;

use crate::cli::line::{LineArgs, SourceArgs};
use crate::config::Config;
use crate::config::lineage::made_by;
use crate::config::reference::{Fusions, ReferenceFile};

/// The options of a line or a run.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) config: Config,
    /// The configuration as written, or all defaults if none was given.
    pub(crate) config_toml: String,
    pub(crate) taps: Option<PathBuf>,
    pub(crate) out: PathBuf,
    /// The reference, if it is in a file.
    pub(crate) reference: Option<ReferenceFile>,
    pub(crate) stations: Option<u16>,
    /// What its results are made by.
    made_by: String,
}

impl Job {
    /// Reads the configuration that `args` name and checks it.
    pub(crate) fn resolve(args: &SourceArgs) -> Result<Self> {
        if args.stations == Some(0) {
            bail!("--stations is 0; it must be at least 1");
        }
        let (mut config, mut config_toml) = read_config(args.config.as_deref())?;
        if let Some(text) = &args.reference {
            config.fuse.reference = Some(Reference::try_from(text.clone()).context("--reference")?);
            config_toml = with_value(&config_toml, "fuse", "reference", text.clone().into())?;
        }
        if let (Some(stations), None) = (args.stations, &args.taps) {
            config.scan.stations = stations;
            config_toml = with_value(&config_toml, "scan", "stations", i64::from(stations).into())?;
        }
        match &args.config {
            Some(path) => config.validate().with_context(|| path.display().to_string())?,
            None => config.validate()?,
        }
        let out = match (&args.out, &args.taps) {
            // The name of a folder may end in a slash; it is the same folder.
            (Some(out), _) => out.components().collect(),
            (None, None) => PathBuf::from("simulated"),
            (None, Some(taps)) => {
                let folder =
                    taps.canonicalize().with_context(|| format!("cannot find the tap set {}", taps.display()))?;
                PathBuf::from(folder.file_name().unwrap_or_default())
            }
        };
        let is_out =
            |taps: &PathBuf| out.canonicalize().is_ok_and(|out| taps.canonicalize().is_ok_and(|taps| taps == out));
        if let Some(taps) = args.taps.as_ref().filter(|taps| is_out(taps)) {
            bail!("the results would go into the tap set {} itself: give --out another folder", taps.display());
        }
        let reference = match &config.fuse.reference {
            Some(Reference::File(path)) => Some(ReferenceFile::read(path)?),
            _ => None,
        };
        let (taps, stations, made_by) = (args.taps.clone(), args.stations, made_by(&config)?);
        Ok(Self { config, config_toml, taps, out, reference, stations, made_by })
    }

    /// The job of a configuration by itself.
    pub(crate) fn of_config(path: &Path) -> Result<Self> {
        Self::resolve(&SourceArgs { config: Some(path.to_owned()), ..SourceArgs::default() })
    }

    /// The job of `tapline line`.
    pub(crate) fn of_line(args: &LineArgs) -> Result<Self> {
        Self::resolve(&SourceArgs {
            config: Some(args.config.clone()),
            out: Some(args.out.clone()),
            reference: args.reference.clone(),
            ..SourceArgs::default()
        })
    }

    /// The job of a stage, from the copy that its line made.
    pub(crate) fn of_copy(config_toml: &str, reference: Option<String>, out: PathBuf) -> Result<Self> {
        let config = Config::parse(config_toml).context("the line's copy of its configuration cannot be read")?;
        let reference = reference.map(ReferenceFile::of).transpose().context("cannot use the copy of the reference")?;
        Ok(Self {
            made_by: made_by(&config)?,
            config,
            config_toml: config_toml.to_owned(),
            taps: None,
            out,
            reference,
            stations: None,
        })
    }

    /// What its results are made by.
    pub(crate) fn made_by(&self) -> &str {
        &self.made_by
    }

    /// What makes the fusion of each casing.
    pub(crate) fn fusions(&self) -> Fusions {
        let set = self.reference.as_ref().map(|file| Arc::clone(&file.set));
        Fusions::new(self.config.fuse.clone(), self.config.process, set)
    }
}

/// The configuration `config_toml` with another value of `key` in the table `name`.
fn with_value(config_toml: &str, name: &str, key: &str, value: toml::Value) -> Result<String> {
    let mut table: toml::Table = toml::from_str(config_toml).context("the configuration is no TOML")?;
    let part = table.entry(name).or_insert_with(|| toml::Value::Table(toml::Table::new()));
    let part = part.as_table_mut().with_context(|| format!("[{name}] is no table"))?;
    part.insert(key.to_owned(), value);
    toml::to_string(&table).context("the configuration does not fit TOML")
}

fn read_config(path: Option<&Path>) -> Result<(Config, String)> {
    if let Some(path) = path {
        return Config::read(path);
    }
    let config = Config::default();
    let text = toml::to_string(&config).context("the default configuration does not fit TOML")?;
    Ok((config, text))
}
