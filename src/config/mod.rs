//! The configuration file: one TOML table per part of the line.

pub(crate) mod job;
pub(crate) mod lineage;
mod parse;
pub(crate) mod reference;
pub(crate) mod report;
pub(crate) mod wires;

use std::fs;
use std::io::Read as _;
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use tapline_acquire::{AcquireConfig, CaptureConfig, ScanConfig, StationConfig, StationSource, validate_stations};
use tapline_fuse::FuseConfig;
use tapline_model::SimulationConfig;
use tapline_process::ProcessConfig;
use tapline_store::StoreConfig;
use tapline_wire::CasingLimits;

use crate::config::report::ReportConfig;
use crate::config::wires::{ModbusConfig, MqttConfig, OpcUaConfig};

/// A configuration file: every key has a default, and unknown keys are refused.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Config {
    /// The simulated scan.
    pub scan: ScanConfig,
    /// The simulated tyre and its sensors.
    pub simulation: SimulationConfig,
    /// How stations with a sound card hear.
    pub capture: CaptureConfig,
    /// How taps are taken.
    pub acquire: AcquireConfig,
    /// The discriminators.
    pub process: ProcessConfig,
    /// Damage maps and verdicts.
    pub fuse: FuseConfig,
    /// The archive.
    pub store: StoreConfig,
    /// A line that never ends.
    pub line: LineConfig,
    /// Its stations.
    pub station: Vec<StationConfig>,
    /// What is printed on reports.
    pub report: ReportConfig,
}

/// A line that never ends: the table `[line]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct LineConfig {
    /// Command that is run, by the shell, at each verdict, which it gets as a line of JSON on its standard input.
    pub on_verdict: Option<String>,
    /// Most taps of a casing that comes as a tap set.
    pub taps_max: usize,
    /// Most samples of one of its taps, all channels together.
    pub record_samples_max: usize,
    /// Most shoulders, or lines of a slab, that such a casing has.
    pub scans_max: usize,
    /// Verdicts to an MQTT broker.
    pub mqtt: Option<MqttConfig>,
    /// Verdicts to OPC UA clients.
    pub opcua: Option<OpcUaConfig>,
    /// Verdicts to controllers, over Modbus TCP.
    pub modbus: Option<ModbusConfig>,
}

impl Default for LineConfig {
    fn default() -> Self {
        Self {
            on_verdict: None,
            taps_max: 8192,
            record_samples_max: 65_536,
            scans_max: 64,
            mqtt: None,
            opcua: None,
            modbus: None,
        }
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
        check("scans_max", self.scans_max, 1000)?;
        if let Some(command) = self.on_verdict.as_ref().filter(|command| command.trim().is_empty()) {
            bail!("line.on_verdict = {command:?}: must be a command, or left out");
        }
        self.mqtt.iter().try_for_each(MqttConfig::validate)?;
        self.opcua.iter().try_for_each(OpcUaConfig::validate)?;
        self.modbus.iter().try_for_each(ModbusConfig::validate)?;
        if let (Some(opcua), Some(modbus)) = (&self.opcua, &self.modbus) {
            let (address, other) = (modbus.listen, opcua.listen);
            ensure!(address != other, "line.modbus.listen = \"{address}\": line.opcua.listen has the same address");
        }
        Ok(())
    }
}

/// Largest configuration or reference that is read.
const TEXT_BYTES_MAX: u64 = 1 << 28;

/// The text of the file at `path`, which may be a pipe, without the byte-order mark that some editors put before it.
fn text_of(path: &Path) -> Result<String> {
    let mut text = String::new();
    let read = fs::File::open(path)?.take(TEXT_BYTES_MAX + 1).read_to_string(&mut text)?;
    ensure!(read as u64 <= TEXT_BYTES_MAX, "it has more than {TEXT_BYTES_MAX} bytes, and no more are read");
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

impl Config {
    /// Reads the TOML `text`.
    pub(crate) fn parse(text: &str) -> Result<Self> {
        let mut config: Self = parse::parse(text)?;
        // No station waits, and no file reserves room, for taps that nobody asks for.
        config.scan.confirm &= config.fuse.confirms();
        Ok(config)
    }

    /// Reads the file at `path`: the configuration, and its text.
    pub(crate) fn read(path: &Path) -> Result<(Self, String)> {
        let text = text_of(path).with_context(|| format!("cannot read the configuration {}", path.display()))?;
        let config = Self::parse(&text).with_context(|| format!("{} is not a configuration", path.display()))?;
        Ok((config, text))
    }

    /// Checks the values of the tables against their bounds.
    pub(crate) fn validate(&self) -> Result<()> {
        // The number of stations may also come from `--stations`, or from the tables of a line.
        self.scan.for_line().validate()?;
        self.simulation.validate().context("[simulation]")?;
        self.capture.validate()?;
        validate_stations(&self.station)?;
        self.acquire.validate()?;
        self.process.validate()?;
        self.fuse.validate()?;
        self.store.validate()?;
        self.line.validate()?;
        self.report.validate()
    }

    /// What the largest casing of any station needs.
    pub(crate) fn station_limits(&self) -> Result<CasingLimits> {
        let tap_sets = CasingLimits {
            taps: self.line.taps_max,
            room: 0,
            scans: self.line.scans_max,
            locations: self.line.taps_max,
            known_locations: self.line.taps_max,
            record_bytes: self.line.record_samples_max * SAMPLE_BYTES_MAX,
        };
        let of = |station: &StationConfig| match station.source {
            StationSource::Folder => tap_sets,
            StationSource::Alsa | StationSource::Uldaq => self.capture.limits(&self.scan),
            StationSource::Rig | StationSource::Simulated => self.scan.limits(&self.simulation),
        };
        Ok(self.station.iter().map(of).fold(CasingLimits::default(), CasingLimits::and))
    }
}
