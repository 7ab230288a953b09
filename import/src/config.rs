//! `import.toml`: what recordings do not say about themselves.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use tapline_acquire::{SAMPLE_RATE_HZ_MAX, TriggerConfig, read_toml};
use tapline_wire::{Channel, Geometry, Unit};

use crate::error::{Error, Result};
use crate::format::Pick;

/// Where the channels of a tap are, and what its samples mean.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    /// Pattern of the names of files, and of their parts.
    pub name: Option<String>,
    /// Table of the taps, beside this file.
    pub table: Option<PathBuf>,
    channels: Channels,
    #[serde(default)]
    pub geometry: Geometry,
    pub sample_rate_hz: Option<f64>,
    pub pre_trigger_samples: Option<u32>,
    pub force_full_scale_n: Option<f64>,
    pub sound_full_scale_v: Option<f64>,
    pub sound_full_scale_pa: Option<f64>,
    pub microphone_distance_m: Option<f64>,
    pub time_axis: Option<u8>,
    /// Columns that are the same for all taps.
    #[serde(default)]
    pub tap: BTreeMap<String, toml::Value>,
    /// How continuous records are cut.
    pub cut: Option<Cut>,
    /// The taps of a continuous record.
    pub plan: Option<TapPlan>,
    #[serde(skip)]
    pub path: PathBuf,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Channels {
    force: Option<Pick>,
    sound: Option<Pick>,
}

/// How a continuous record is cut: where the trigger fires, as in live capture, there is a tap.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Cut {
    /// Samples of each tap.
    pub sample_count: u32,
    /// The channel that shows the taps; the force, if there is one.
    pub channel: Option<Channel>,
    /// Its level is a fraction of the largest possible sample, or of the largest found for floats.
    #[serde(default)]
    pub trigger: TriggerConfig,
}

/// The taps of a continuous record, in their order: shoulder, offset, velocity, repetition, location.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TapPlan {
    pub shoulders: Option<u16>,
    #[serde(default)]
    pub offsets_mm: Vec<f64>,
    #[serde(default)]
    pub velocities_m_per_s: Vec<f64>,
    pub repetitions: Option<u16>,
    pub locations: u32,
    #[serde(default)]
    pub closing_tap: bool,
}

impl Config {
    /// Reads `path`.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let mut config: Self = read_toml(path)?;
        path.clone_into(&mut config.path);
        config.check().map_err(|reason| config.refuse(reason))?;
        Ok(config)
    }

    /// The error that the configuration is wrong.
    pub(crate) fn refuse(&self, reason: String) -> Error {
        Error::Text { file: self.path.clone(), line: None, reason }
    }

    fn check(&self) -> Result<(), String> {
        let positive = f64::MIN_POSITIVE..=1e12;
        in_bounds("sample_rate_hz", self.sample_rate_hz, 1.0..=SAMPLE_RATE_HZ_MAX)?;
        in_bounds("force_full_scale_n", self.force_full_scale_n, positive.clone())?;
        in_bounds("sound_full_scale_v", self.sound_full_scale_v, positive.clone())?;
        in_bounds("sound_full_scale_pa", self.sound_full_scale_pa, positive)?;
        if let Some((_, pascals)) = self.sound_full_scale_v.zip(self.sound_full_scale_pa) {
            return Err(format!(
                "sound_full_scale_pa is {pascals}; it must be left out, as sound_full_scale_v is given"
            ));
        }
        in_bounds("microphone_distance_m", self.microphone_distance_m, 0.0..=1e3)?;
        if let Some(axis) = self.time_axis.filter(|axis| ![1, 2].contains(axis)) {
            return Err(format!("time_axis is {axis}; it must be 1 (samples run down columns) or 2 (along rows)"));
        }
        if let (Some(force), Some(sound)) = (&self.channels.force, &self.channels.sound)
            && force == sound
        {
            return Err(format!("channels.sound is {sound}; it must differ from channels.force"));
        }
        if self.channels().next().is_none() {
            return Err(
                "channels is empty; it must name force, sound or both, each by its name or its number".to_owned()
            );
        }
        if self.name.is_some() && self.table.is_some() {
            return Err("there are both name and table; there must be one of them, or none".to_owned());
        }
        if self.plan.is_some() && self.table.is_some() {
            return Err("there are both plan and table; each lists the taps, so only one may be there".to_owned());
        }
        match (&self.cut, &self.plan) {
            (Some(cut), _) => self.check_cut(cut)?,
            (None, Some(_)) => {
                return Err("there is a plan, but no [cut] that cuts the records into its taps".to_owned());
            }
            (None, None) => {}
        }
        if let Some(TapPlan { locations, shoulders, repetitions, offsets_mm, velocities_m_per_s, .. }) = &self.plan {
            let taps = [offsets_mm.len().max(1), velocities_m_per_s.len().max(1)].iter().product::<usize>() as u64;
            let turns = u64::from(repetitions.unwrap_or(1)) * u64::from(shoulders.unwrap_or(1)) * taps;
            if turns.saturating_mul(u64::from(*locations) + 1) > TAPS_MAX || *locations == 0 || turns == 0 {
                return Err(format!(
                    "plan has {turns} turns of {locations} locations; from 1 to {TAPS_MAX} taps are read"
                ));
            }
        }
        Ok(())
    }

    fn check_cut(&self, cut: &Cut) -> Result<(), String> {
        if let Some(channel) = cut.channel.filter(|channel| !self.channels().any(|(known, _)| known == *channel)) {
            return Err(format!("cut.channel is {:?}, which channels does not name", channel.name()));
        }
        cut.trigger.validate("cut.trigger").map_err(|error| error.to_string())?;
        let before = self
            .pre_trigger_samples
            .ok_or("pre_trigger_samples is missing; a record is cut that many before each trigger")?;
        if cut.sample_count <= before || u64::from(cut.sample_count) > TAP_SAMPLES_MAX {
            return Err(format!(
                "cut.sample_count is {}; it must be above pre_trigger_samples = {before} and at most {TAP_SAMPLES_MAX}",
                cut.sample_count
            ));
        }
        Ok(())
    }

    /// The channels of the set, in their order.
    pub(crate) fn channels(&self) -> impl Iterator<Item = (Channel, &Pick)> {
        let Channels { force, sound } = &self.channels;
        let named = [(Channel::Force, force), (Channel::Sound, sound)];
        named.into_iter().filter_map(|(channel, pick)| Some((channel, pick.as_ref()?)))
    }

    /// What a full-scale sample of `channel` is, where it is known.
    pub(crate) fn full_scale(&self, channel: Channel) -> Option<(f64, Unit)> {
        match channel {
            Channel::Force => self.force_full_scale_n.map(|n| (n, Unit::Newton)),
            Channel::Sound => {
                let pascals = self.sound_full_scale_pa.map(|pa| (pa, Unit::Pascal));
                self.sound_full_scale_v.map(|v| (v, Unit::Volt)).or(pascals)
            }
        }
    }
}

/// Most samples of one channel of a tap: what a tap set may have.
pub(crate) const TAP_SAMPLES_MAX: u64 = 1 << 22;

/// Most taps of an import.
pub(crate) const TAPS_MAX: u64 = 10_000_000;

fn in_bounds(key: &str, value: Option<f64>, bounds: RangeInclusive<f64>) -> Result<(), String> {
    match value {
        Some(value) if !bounds.contains(&value) => {
            let low = if bounds.start().is_normal() && *bounds.start() < 1e-300 {
                "above 0".to_owned()
            } else {
                format!("from {}", bounds.start())
            };
            Err(format!("{key} is {value}; it must be {low} to {}", bounds.end()))
        }
        _ => Ok(()),
    }
}
