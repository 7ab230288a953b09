//! What a simulated rig does: the file that `tapline rig` plays.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tapline_model::SimulationConfig;
use tapline_wire::Serial;

use crate::config::within;
use crate::{Error, ScanConfig};

/// Longest time that a script may state, in s: a day.
const TIME_MAX_S: f64 = 86_400.0;

/// What a simulated rig does. Fractions are from 0 to 1; from a pair of times, one between them is drawn uniformly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RigScript {
    /// The name in its hello.
    pub name: String,
    /// Seed of all random choices.
    pub seed: u64,
    /// Number of casings; unlimited if left out.
    pub casings: Option<u64>,
    /// Serials of the first casings, in order.
    pub serials: Vec<String>,
    /// Pattern of the serials after those: `{}` is the number of the casing, from 1.
    pub pattern: String,
    /// Range of the time from one casing to the next, in s.
    pub gap_s: [f64; 2],
    /// Time in s to move to a location.
    pub move_s: f64,
    /// Time in s to find its home.
    pub home_s: f64,
    /// Time in s to hit.
    pub hit_s: f64,
    /// Largest relative error of the velocity.
    pub velocity_error: f64,
    /// Fraction of casings whose serial cannot be read.
    pub unknown: f64,
    /// Fraction of casings with the serial of the one before.
    pub repeated: f64,
    /// Fraction of casings that are removed before their last tap.
    pub removed: f64,
    /// Fraction of casings during which the rig is switched off.
    pub switched_off: f64,
    /// Range of the time that it is off, in s.
    pub off_s: [f64; 2],
    /// Fraction of casings during which its emergency stop is pressed, for a time drawn as when it is off.
    pub stopped: f64,
    /// Fraction of those with another casing on the rig when it is switched on again.
    pub swapped: f64,
    /// Fraction of hits that fail.
    pub failed_hits: f64,
    /// The pipe into which the samples of its hits are written for a station that listens; none if left out.
    pub play: Option<PathBuf>,
    /// Fraction of those hits that it reports but does not make.
    pub missed_hits: f64,
    /// Fraction of those hits that it makes twice.
    pub double_hits: f64,
    /// Locations of what is played, and the cracks of the casings it names; others are sound.
    pub scan: ScanConfig,
    /// What is played.
    pub simulation: SimulationConfig,
}

impl Default for RigScript {
    fn default() -> Self {
        Self {
            name: "simulated".to_owned(),
            seed: 1,
            casings: None,
            serials: Vec::new(),
            pattern: "RIG-{}".to_owned(),
            gap_s: [0.0, 0.0],
            move_s: 0.0,
            home_s: 0.0,
            hit_s: 0.0,
            velocity_error: 0.01,
            unknown: 0.0,
            repeated: 0.0,
            removed: 0.0,
            switched_off: 0.0,
            off_s: [0.0, 0.0],
            stopped: 0.0,
            swapped: 0.0,
            failed_hits: 0.0,
            play: None,
            missed_hits: 0.0,
            double_hits: 0.0,
            scan: ScanConfig::default(),
            simulation: SimulationConfig::default(),
        }
    }
}

impl RigScript {
    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds.
    pub fn validate(&self) -> Result<(), Error> {
        let refuse = |key: &str, value: String, bound: &str| Err(Error::setting(format!("rig.{key}"), value, bound));
        if Serial::new(&self.name).is_err() {
            return refuse("name", format!("{:?}", self.name), "1 to 32 bytes of plain text");
        }
        if !self.pattern.contains("{}") || Serial::new(&self.serial_of(u64::MAX)).is_err() {
            return refuse("pattern", format!("{:?}", self.pattern), "a serial of at most 14 bytes with {} in it");
        }
        if let Some(serial) =
            self.serials.iter().find(|serial| serial.is_empty() || serial.len() > 64 || serial.contains(['\n', '\r']))
        {
            return refuse("serials", format!("{serial:?}"), "lines of 1 to 64 bytes");
        }
        for (key, share) in [
            ("velocity_error", self.velocity_error),
            ("unknown", self.unknown),
            ("repeated", self.repeated),
            ("removed", self.removed),
            ("switched_off", self.switched_off),
            ("stopped", self.stopped),
            ("swapped", self.swapped),
            ("failed_hits", self.failed_hits),
            ("missed_hits", self.missed_hits),
            ("double_hits", self.double_hits),
        ] {
            within(&format!("rig.{key}"), share, 0.0..=1.0)?;
        }
        for (key, from, to) in [
            ("gap_s", self.gap_s[0], self.gap_s[1]),
            ("off_s", self.off_s[0], self.off_s[1]),
            ("move_s", self.move_s, self.move_s),
            ("home_s", self.home_s, self.home_s),
            ("hit_s", self.hit_s, self.hit_s),
        ] {
            if !(0.0..=TIME_MAX_S).contains(&from) || !(from..=TIME_MAX_S).contains(&to) {
                return refuse(key, format!("{from} to {to}"), "from 0 to 86400, the second not below the first");
            }
        }
        Ok(())
    }

    /// Serial of casing `number`, from 1, by the pattern.
    pub(super) fn serial_of(&self, number: u64) -> String {
        self.pattern.replacen("{}", &number.to_string(), 1)
    }
}
