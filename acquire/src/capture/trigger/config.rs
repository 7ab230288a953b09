//! When a force pulse is a tap: the table `[capture.trigger]`.

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::config::within;

/// When a force pulse is a tap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TriggerConfig {
    /// Trigger level of the force above its baseline, as a fraction of full scale.
    pub level: f64,
    /// Release level, as a fraction of the trigger level.
    pub release: f64,
    /// Shortest time above the release level: a shorter pulse is a click.
    pub pulse_min_s: f64,
    /// Longest time above the release level: a longer one is a step.
    pub pulse_max_s: f64,
    /// Time after a tap in which no other begins: a rebound belongs to the tap before it.
    pub hold_off_s: f64,
}

impl Default for TriggerConfig {
    fn default() -> Self {
        Self { level: 0.05, release: 0.5, pulse_min_s: 1e-4, pulse_max_s: 0.006, hold_off_s: 0.1 }
    }
}

impl TriggerConfig {
    /// Checks every value against its bounds; `table` is the prefix of their names in an error.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds.
    pub fn validate(&self, table: &str) -> Result<(), Error> {
        let within = |key: &str, value: f64, bounds| within(&format!("{table}.{key}"), value, bounds);
        within("level", self.level, 1e-4..=0.9)?;
        within("release", self.release, 0.05..=0.95)?;
        within("pulse_min_s", self.pulse_min_s, 0.0..=0.01)?;
        within("pulse_max_s", self.pulse_max_s, 1e-3..=0.1)?;
        within("hold_off_s", self.hold_off_s, 0.0..=10.0)
    }
}
