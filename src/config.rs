//! The configuration file: one TOML table per part of the line.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use tapline_acquire::{AcquireConfig, ScanConfig, StationConfig, StationSource, validate_stations};
use tapline_fuse::{FuseConfig, Fusion, Reference, ReferenceSet};
use tapline_model::SimulationConfig;
use tapline_process::ProcessConfig;
use tapline_store::StoreConfig;
use tapline_wire::{CasingLimits, Plan, Recording};

use crate::cli::{LineArgs, SourceArgs};
use crate::line::setup::{Arriving, Setup};
use crate::lineage::made_by;

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
    /// The archive.
    pub(crate) store: StoreConfig,
    /// A line that never ends.
    pub(crate) line: LineConfig,
    /// Its stations.
    pub(crate) station: Vec<StationConfig>,
}

/// A line that never ends: the table `[line]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct LineConfig {
    /// Command that is run, by the shell, at each verdict, which it gets as a line of JSON on its standard input.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) on_verdict: Option<String>,
    /// Most taps of a casing that comes as a tap set.
    pub(crate) taps_max: usize,
    /// Most samples of one of its taps, all channels together.
    pub(crate) record_samples_max: usize,
    /// Most shoulders, or lines of a slab, that such a casing has.
    pub(crate) scans_max: usize,
}

impl Default for LineConfig {
    fn default() -> Self {
        Self { on_verdict: None, taps_max: 8192, record_samples_max: 65_536, scans_max: 64 }
    }
}

/// Bytes of a sample in the widest format.
const SAMPLE_BYTES_MAX: usize = 4;

impl LineConfig {
    fn validate(&self) -> Result<()> {
        let check = |key: &str, value: usize, most: usize| {
            ensure!((1..=most).contains(&value), "line.{key} = {value}: must be from 1 to {most}");
            Ok(())
        };
        check("taps_max", self.taps_max, 1_000_000)?;
        check("record_samples_max", self.record_samples_max, 8_000_000)?;
        check("scans_max", self.scans_max, 1000)
    }
}

impl Config {
    /// What the largest casing of any station needs.
    pub(crate) fn station_limits(&self) -> Result<CasingLimits> {
        let tap_sets = CasingLimits {
            taps: self.line.taps_max,
            scans: self.line.scans_max,
            locations: self.line.taps_max,
            record_bytes: self.line.record_samples_max * SAMPLE_BYTES_MAX,
        };
        let of = |station: &StationConfig| match station.source {
            StationSource::Folder => tap_sets,
            StationSource::Rig | StationSource::Simulated => self.scan.limits(&self.simulation),
        };
        Ok(self.station.iter().map(of).fold(CasingLimits::default(), CasingLimits::and))
    }
}

/// A run as it was asked for: configuration, source and archive.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) config: Config,
    /// The configuration as it was written, or the defaults spelled out where nothing was.
    pub(crate) config_toml: String,
    pub(crate) taps: Option<PathBuf>,
    pub(crate) out: PathBuf,
    reference: ReferenceSource,
    pub(crate) stations: Option<u16>,
    /// What its results are made by.
    made_by: String,
}

/// Where a reference is read from.
#[derive(Debug)]
enum ReferenceSource {
    /// It is in no file.
    None,
    File(PathBuf),
    /// It was read before.
    Text(String),
}

/// A reference as it was read.
#[derive(Debug)]
pub(crate) struct ReferenceFile {
    pub(crate) text: String,
    pub(crate) set: Arc<ReferenceSet>,
}

impl Job {
    /// Reads the configuration that `args` name and checks it.
    pub(crate) fn resolve(args: &SourceArgs) -> Result<Self> {
        let (mut config, mut config_toml) = read_config(args.config.as_deref())?;
        if let Some(text) = &args.reference {
            config.fuse.reference = Some(Reference::try_from(text.clone()).context("--reference")?);
            config_toml = with_value(&config_toml, "fuse", "reference", text.clone().into())?;
        }
        if let (Some(stations), None) = (args.stations, &args.taps) {
            config.scan.stations = stations;
            config_toml = with_value(&config_toml, "scan", "stations", i64::from(stations).into())?;
        }
        config.acquire.validate()?;
        config.process.validate()?;
        config.fuse.validate()?;
        config.store.validate()?;
        config.line.validate()?;
        if args.stations == Some(0) {
            bail!("--stations is 0; at least one is needed");
        }
        let out = match (&args.out, &args.taps) {
            // A folder's name may end in a slash, and is the same run's.
            (Some(out), _) => out.components().collect(),
            (None, None) => PathBuf::from("simulated"),
            (None, Some(taps)) => {
                let folder =
                    taps.canonicalize().with_context(|| format!("cannot find the tap set {}", taps.display()))?;
                PathBuf::from(folder.file_name().unwrap_or_default())
            }
        };
        let reference = match &config.fuse.reference {
            Some(Reference::File(path)) => ReferenceSource::File(path.clone()),
            _ => ReferenceSource::None,
        };
        let (taps, stations, made_by) = (args.taps.clone(), args.stations, made_by(&config)?);
        Ok(Self { config, config_toml, taps, out, reference, stations, made_by })
    }

    /// The job of `tapline line`.
    pub(crate) fn of_line(args: &LineArgs) -> Result<Self> {
        let source = SourceArgs {
            config: Some(args.config.clone()),
            taps: None,
            out: Some(args.out.clone()),
            reference: args.reference.clone(),
            stations: None,
        };
        let job = Self::resolve(&source)?;
        validate_stations(&job.config.station)?;
        if let Some(Reference::Shoulder { tyre, shoulder }) = &job.config.fuse.reference {
            bail!(
                "the reference is {tyre}/{shoulder}, and a shoulder named so is one of the same casing, which no casing of a \
                 line is known to have. Make a reference file of casings that are known to be sound (`tapline reference \
                 FOLDER --out sound.json`) and give `--reference sound.json`; to compare each casing with itself, give \
                 `--reference self`"
            );
        }
        Ok(job)
    }

    /// The job of a stage, from the copy that its line made.
    pub(crate) fn of_setup(setup: &Setup) -> Result<Self> {
        let config: Config = toml::from_str(&setup.config_toml).context("the copy of the configuration is none")?;
        let (taps, stations) = match &setup.arriving {
            Arriving::TapSet { folder, stations } => (Some(folder.clone()), Some(*stations)),
            Arriving::Simulated | Arriving::Stations => (None, None),
        };
        Ok(Self {
            made_by: made_by(&config)?,
            config,
            config_toml: setup.config_toml.clone(),
            taps,
            out: setup.out.clone(),
            reference: match &setup.reference {
                Some(text) => ReferenceSource::Text(text.clone()),
                None => ReferenceSource::None,
            },
            stations,
        })
    }

    /// What its results are made by.
    pub(crate) fn made_by(&self) -> &str {
        &self.made_by
    }

    /// Reads the reference, if it is in a file.
    pub(crate) fn reference(&self) -> Result<Option<ReferenceFile>> {
        let (text, name) = match &self.reference {
            ReferenceSource::None => return Ok(None),
            ReferenceSource::Text(text) => (text.clone(), "the copy of the reference".to_owned()),
            ReferenceSource::File(path) => {
                let name = path.display().to_string();
                (std::fs::read_to_string(path).with_context(|| format!("cannot read the reference {name}"))?, name)
            }
        };
        let set = ReferenceSet::parse(&text).with_context(|| format!("cannot use {name}"))?;
        Ok(Some(ReferenceFile { text, set: Arc::new(set) }))
    }

    /// What makes the fusion of each casing.
    pub(crate) fn fusions(&self) -> Result<Fusions> {
        let set = self.reference()?.map(|file| file.set);
        Ok(Fusions { fuse: self.config.fuse.clone(), process: self.config.process, set })
    }
}

/// Makes the fusion of each casing, by the reference that the configuration names.
#[derive(Debug)]
pub(crate) struct Fusions {
    fuse: FuseConfig,
    process: ProcessConfig,
    set: Option<Arc<ReferenceSet>>,
}

impl Fusions {
    /// The fusion of the taps of `plan`.
    pub(crate) fn of(&self, plan: &Plan) -> Result<Fusion, tapline_fuse::Error> {
        match &self.set {
            Some(set) => Fusion::with_reference(&self.fuse, plan, Arc::clone(set)),
            None => Fusion::new(&self.fuse, plan),
        }
    }

    /// The fusion of the taps of `plan`, if they are recorded and looked at as those of the reference are.
    pub(crate) fn check(&self, plan: &Plan) -> Result<Fusion> {
        check_record_s(&self.process, &plan.recording)?;
        if let Some(set) = &self.set {
            check_reference(set, &self.process, &plan.recording)?;
        }
        self.check_shoulder(plan)?;
        Ok(self.of(plan)?)
    }

    /// Whether the casing of `plan` has the shoulder that the reference names: one named so is of the same casing.
    pub(crate) fn check_shoulder(&self, plan: &Plan) -> Result<()> {
        let Some(Reference::Shoulder { tyre, shoulder }) = &self.fuse.reference else { return Ok(()) };
        let has_it = plan.scans().iter().any(|scan| scan.tyre == *tyre && scan.shoulder == *shoulder);
        ensure!(
            has_it,
            "the reference is {tyre}/{shoulder}, and a shoulder named so is one of the same casing, but {} does not have \
             it. To compare casings with a sound one, make a reference file of its archive (`tapline reference FOLDER \
             --shoulder {tyre}/{shoulder} --out sound.json`) and give `--reference sound.json`; to compare each with \
             itself, give `--reference self`",
            plan.scans().first().map_or_else(|| "a casing".to_owned(), |scan| format!("casing {}", scan.tyre))
        );
        Ok(())
    }
}

/// How discriminators come about: rate and channels of the records, and the table `[process]` with every default spelled
/// out.
pub(crate) fn process_of(config: &ProcessConfig, recording: &Recording) -> Result<String> {
    let channels: Vec<&str> = recording.channels.iter().map(|channel| channel.name()).collect();
    spelled_out(config, recording.sample_rate_hz, &channels)
}

fn spelled_out<Name: std::fmt::Debug>(config: &ProcessConfig, rate_hz: f64, channels: &[Name]) -> Result<String> {
    let config = toml::to_string(config).context("the configuration of process does not fit TOML")?;
    Ok(format!("sample_rate_hz = {rate_hz:?}\nchannels = {channels:?}\n{config}"))
}

/// Whether what is looked at of each record reaches beyond its trigger.
pub(crate) fn check_record_s(config: &ProcessConfig, recording: &Recording) -> Result<()> {
    let (pre_trigger, rate_hz) = (recording.pre_trigger_samples, recording.sample_rate_hz);
    ensure!(
        config.samples_looked_at(u32::MAX, rate_hz) > pre_trigger,
        "process.record_s = {} s: must be 0, or above the {:.4} s of each record before the trigger",
        config.record_s,
        f64::from(pre_trigger) / rate_hz
    );
    Ok(())
}

/// What [`process_of`] gave in a program that lacked some keys of today's, which it treated as their defaults do.
fn with_todays_keys(process: &str) -> Option<String> {
    let mut table: toml::Table = toml::from_str(process).ok()?;
    let rate_hz = table.remove("sample_rate_hz")?.as_float()?;
    let channels: Vec<String> = table.remove("channels")?.try_into().ok()?;
    spelled_out(&table.try_into().ok()?, rate_hz, &channels).ok()
}

/// Whether the taps of `set` were recorded and analysed as those of a run are.
pub(crate) fn check_reference(set: &ReferenceSet, config: &ProcessConfig, recording: &Recording) -> Result<()> {
    check_process(&set.process, &process_of(config, recording)?)
}

fn check_process(there: &str, here: &str) -> Result<()> {
    let there = with_todays_keys(there).unwrap_or_else(|| there.to_owned());
    if there != here {
        bail!(
            "the taps of the reference were recorded or analysed otherwise than this run's: {}",
            differences(&there, here)
        );
    }
    Ok(())
}

/// The lines of two texts that differ.
pub(crate) fn differences(was: &str, is: &str) -> String {
    let only = |of: &str, other: &str| -> Vec<String> {
        of.lines().filter(|line| !other.lines().any(|l| l == *line)).map(str::to_owned).collect()
    };
    format!("{} there, {} here", only(was, is).join(", "), only(is, was).join(", "))
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

#[cfg(test)]
mod tests {
    use tapline_wire::{Channel, SampleFormat};

    use super::*;

    #[test]
    fn what_differs_is_named() {
        // Catches a difference that is not looked at, as of the rate or the channels, one that is not named, and lines that
        // are alike and named.
        let recording = Recording {
            sample_rate_hz: 40_960.0,
            pre_trigger_samples: 512,
            sample_count_max: 16_384,
            sample_format: SampleFormat::I16,
            channels: vec![Channel::Force, Channel::Sound],
        };
        let config = ProcessConfig::default();
        let was = process_of(&config, &recording).unwrap();
        let told =
            |config: &ProcessConfig, recording: &Recording| differences(&was, &process_of(config, recording).unwrap());
        let faster = Recording { sample_rate_hz: 48_000.0, ..recording.clone() };
        assert_eq!(told(&config, &faster), "sample_rate_hz = 40960.0 there, sample_rate_hz = 48000.0 here");
        let deaf = Recording { channels: vec![Channel::Force], ..recording.clone() };
        assert_eq!(told(&config, &deaf), "channels = [\"force\", \"sound\"] there, channels = [\"force\"] here");
        let other = ProcessConfig { f_c_hz: 600.0, f_hi_hz: 1900.0, ..config };
        assert_eq!(
            told(&other, &recording),
            "f_c_hz = 550.0, f_hi_hz = 2000.0 there, f_c_hz = 600.0, f_hi_hz = 1900.0 here"
        );
        // A key that its program did not have had no other value than the default.
        let of_old = was.replace("record_s = 0.0\n", "");
        assert!(of_old != was && check_process(&of_old, &was).is_ok());
        let short = process_of(&ProcessConfig { record_s: 0.1, ..config }, &recording).unwrap();
        let refused = check_process(&of_old, &short).unwrap_err().to_string();
        assert!(refused.ends_with("record_s = 0.0 there, record_s = 0.1 here"), "{refused}");
        // How long the records are, and in what numbers, does not count.
        let longer = Recording { sample_count_max: 32_768, sample_format: SampleFormat::F32, ..recording };
        assert_eq!(process_of(&ProcessConfig::default(), &longer).unwrap(), was);
        assert!(check_record_s(&config, &longer).is_ok());
        let refused = check_record_s(&ProcessConfig { record_s: 0.0125, ..config }, &longer).unwrap_err().to_string();
        assert_eq!(
            refused,
            "process.record_s = 0.0125 s: must be 0, or above the 0.0125 s of each record before the trigger"
        );
    }
}
