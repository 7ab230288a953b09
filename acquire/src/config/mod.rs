//! The tables `[acquire]` and `[scan]` of a configuration.

pub(crate) mod calibration;
pub(crate) mod scan_taps;
pub(crate) mod text;

use std::fmt::Display;
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};
use tapline_model::{Crack, SimulationConfig};
use tapline_wire::{CasingLimits, RETAKES_MAX, Serial};

use crate::Error;

/// Most taps of simulated tyres, including second readings.
const TAPS_MAX: u64 = 10_000_000;

/// Fastest impact that is simulated; at 1000 m/s the contact model means nothing.
const VELOCITY_MAX_M_PER_S: f64 = 20.0;

/// Largest offset from the belt edge that a tap's name can hold.
const OFFSET_MAX_MM: f64 = 2000.0;

/// How taps are acquired, whatever their source: the table `[acquire]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AcquireConfig {
    /// Taps per second of each station; if left out, as fast as the line takes them.
    pub taps_per_s: Option<f64>,
    /// How often a tap with an unusable record is taken again, if the source can; the last record counts.
    pub retakes: u16,
}

impl Default for AcquireConfig {
    fn default() -> Self {
        Self { taps_per_s: None, retakes: 2 }
    }
}

impl AcquireConfig {
    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds.
    pub fn validate(&self) -> Result<(), Error> {
        if self.retakes > RETAKES_MAX {
            return refuse("acquire.retakes", self.retakes, &format!("at most {RETAKES_MAX}"));
        }
        match self.taps_per_s {
            Some(taps_per_s) if !(taps_per_s > 0.0 && taps_per_s <= 1e6) => {
                refuse("acquire.taps_per_s", taps_per_s, "above 0 and at most 1000000, or left out")
            }
            _ => Ok(()),
        }
    }
}

/// What to tap on a casing, and the simulated tyres: the table `[scan]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScanConfig {
    /// Seed of everything random.
    pub seed: u64,
    /// Number of stations.
    pub stations: u16,
    /// Offsets x from the belt edge.
    pub offsets_mm: Vec<f64>,
    /// Impact velocities.
    pub velocities_m_per_s: Vec<f64>,
    /// Full turns at each offset and velocity.
    pub repetitions: u16,
    /// Locations of a full turn.
    pub locations: u32,
    /// Shoulders of a tyre that are scanned, 1 or 2.
    pub shoulders: u16,
    /// Whether each turn ends with the first location again.
    pub closing_tap: bool,
    /// Time of the first tap of each station, ns since the Unix epoch: the simulation reads no clock.
    pub start_ns: i64,
    /// Whether places that stand out are tapped again before they are judged.
    pub confirm: bool,
    /// Time from tap to tap of a station.
    pub tap_period_s: f64,
    /// Additional time that the impactor needs to move to another offset.
    pub offset_change_s: f64,
    /// The tyres; if none are listed, each station has one, which is cracked at odd stations.
    pub tyre: Vec<TyreConfig>,
}

/// One simulated tyre: an entry `[[scan.tyre]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TyreConfig {
    /// Serial number.
    pub serial: String,
    /// Station at which it is scanned, from 1.
    #[serde(default = "first_station")]
    pub station: u16,
    /// Its cracks; none when left out.
    #[serde(default)]
    pub crack: Vec<Crack>,
}

fn first_station() -> u16 {
    1
}

impl Default for ScanConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            stations: 1,
            offsets_mm: vec![0.0],
            velocities_m_per_s: vec![1.85],
            repetitions: 1,
            locations: 100,
            shoulders: 2,
            closing_tap: true,
            start_ns: 1_767_225_600_000_000_000, // 2026-01-01T00:00:00Z
            confirm: true,
            tap_period_s: 0.1,
            offset_change_s: 0.0,
            tyre: Vec::new(),
        }
    }
}

impl ScanConfig {
    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds.
    pub fn validate(&self) -> Result<(), Error> {
        within("scan.stations", self.stations, 1..=u16::MAX)?;
        all_distinct("scan.offsets_mm", &self.offsets_mm, 1e3, -OFFSET_MAX_MM..=OFFSET_MAX_MM)?;
        all_distinct("scan.velocities_m_per_s", &self.velocities_m_per_s, 1e6, 0.01..=VELOCITY_MAX_M_PER_S)?;
        within("scan.repetitions", self.repetitions, 1..=u16::MAX)?;
        within("scan.locations", self.locations, 1..=999_999)?;
        if !(1..=2).contains(&self.shoulders) {
            return refuse("scan.shoulders", self.shoulders, "1 or 2");
        }
        if !(self.tap_period_s > 0.0 && self.tap_period_s <= 3600.0) {
            return refuse("scan.tap_period_s", self.tap_period_s, "above 0 and at most 3600");
        }
        within("scan.offset_change_s", self.offset_change_s, 0.0..=3600.0)?;
        within("scan.start_ns", self.start_ns, 0..=i64::MAX / 2)?;
        self.validate_tyres()?;
        match self.tap_count() {
            count if count > u128::from(TAPS_MAX) => {
                refuse("scan: the number of taps", count, &format!("at most {TAPS_MAX}"))
            }
            _ => Ok(()),
        }
    }

    /// How many tyres are scanned.
    pub(crate) fn tyre_count(&self) -> usize {
        if self.tyre.is_empty() { usize::from(self.stations) } else { self.tyre.len() }
    }

    /// Most taps of the whole scan.
    fn tap_count(&self) -> u128 {
        (self.tyre_count() as u128).saturating_mul(self.taps_of_tyre().saturating_add(self.room().into()))
    }

    fn taps_of_tyre(&self) -> u128 {
        let of_turn = u128::from(self.locations) + u128::from(self.closing_tap);
        (self.offsets_mm.len() as u128)
            .saturating_mul(self.turns_at_an_offset() as u128)
            .saturating_mul(of_turn)
            .saturating_mul(self.shoulders.into())
    }

    fn turns_at_an_offset(&self) -> usize {
        self.velocities_m_per_s.len() * usize::from(self.repetitions)
    }

    /// A remark for people if the scan may miss cracks.
    pub fn remark(&self) -> Option<String> {
        let is_at_edge = self.offsets_mm.contains(&0.0);
        (!is_at_edge)
            .then(|| "scan.offsets_mm lacks 0: nothing is tapped at the belt edge, where cracks begin".to_owned())
    }

    /// The same for a line, with as many stations as its tyres name: a line lists its stations elsewhere.
    pub fn for_line(&self) -> Self {
        let stations = self.tyre.iter().fold(self.stations, |most, tyre| most.max(tyre.station));
        Self { stations, ..self.clone() }
    }

    /// How many taps may be added for a tyre: those of the whole scan at one offset, once more.
    pub(crate) fn room(&self) -> u32 {
        if !self.confirm {
            return 0;
        }
        let turns = u32::try_from(self.turns_at_an_offset()).unwrap_or(u32::MAX);
        self.locations.saturating_mul(self.shoulders.into()).saturating_mul(turns)
    }

    /// Taps of one tyre, without second readings.
    pub fn taps_per_tyre(&self) -> u64 {
        u64::try_from(self.taps_of_tyre()).unwrap_or(u64::MAX)
    }

    /// What a tyre needs under this scan if the rig of `simulation` records it.
    pub fn limits(&self, simulation: &SimulationConfig) -> CasingLimits {
        self.limits_of(2 * size_of::<i16>() * simulation.sample_count as usize)
    }

    /// What a tyre needs under this scan, with records of `record_bytes` bytes.
    pub(crate) fn limits_of(&self, record_bytes: usize) -> CasingLimits {
        CasingLimits {
            taps: usize::try_from(self.taps_of_tyre()).unwrap_or(usize::MAX).saturating_add(self.room() as usize),
            room: self.room() as usize,
            scans: self.shoulders.into(),
            locations: self.locations as usize,
            known_locations: usize::from(self.shoulders) * self.locations as usize,
            record_bytes,
        }
    }

    fn validate_tyres(&self) -> Result<(), Error> {
        for (place, tyre) in self.tyre.iter().enumerate() {
            let serial = &tyre.serial;
            if Serial::new(serial).is_err() {
                let bound = "1 to 32 bytes without white space at its ends, '/', control or invisible characters";
                return refuse(
                    &format!("the serial of [[scan.tyre]] number {}", place + 1),
                    format!("{serial:?}"),
                    bound,
                );
            }
            if self.tyre[..place].iter().any(|other| other.serial == *serial) {
                return refuse(&format!("tyre {serial}: serial"), format!("{serial:?}"), "unique among the tyres");
            }
            if !(1..=self.stations).contains(&tyre.station) {
                return refuse(
                    &format!("tyre {serial}: station"),
                    tyre.station,
                    &format!("from 1 to scan.stations = {}", self.stations),
                );
            }
            for (crack, number) in tyre.crack.iter().zip(1..) {
                self.validate_crack(crack, |field| format!("tyre {serial} crack {number}: {field}"))?;
                crack.validate(serial, number)?;
            }
        }
        Ok(())
    }

    /// Checks where `crack` lies in the scan.
    fn validate_crack(&self, crack: &Crack, key: impl Fn(&str) -> String) -> Result<(), Error> {
        let &Self { shoulders, locations, .. } = self;
        if !(1..=shoulders).contains(&crack.shoulder) {
            return refuse(&key("shoulder"), crack.shoulder, &format!("from 1 to scan.shoulders = {shoulders}"));
        }
        if crack.first_location >= locations {
            let bound = format!("from 0 to scan.locations - 1 = {}", locations - 1);
            return refuse(&key("first_location"), crack.first_location, &bound);
        }
        if !(1..=locations).contains(&crack.location_count) {
            let bound = format!("from 1 to scan.locations = {locations}");
            return refuse(&key("location_count"), crack.location_count, &bound);
        }
        Ok(())
    }
}

/// Refuses an empty list, a value out of bounds, and two values that a tap's name cannot distinguish.
fn all_distinct(key: &str, values: &[f64], scale: f64, bounds: RangeInclusive<f64>) -> Result<(), Error> {
    if values.is_empty() {
        return refuse(key, "[]", "at least one value");
    }
    for (place, &value) in values.iter().enumerate() {
        let key = format!("value {} of {key}", place + 1);
        within(&key, value, bounds.clone())?;
        if values[..place].iter().any(|other| ((value - other) * scale).abs() < 1.0) {
            return refuse(&key, value, "unique in the list");
        }
    }
    Ok(())
}

/// Refuses a value out of `bounds`.
pub(crate) fn within<T: PartialOrd + Display>(key: &str, value: T, bounds: RangeInclusive<T>) -> Result<(), Error> {
    match bounds.contains(&value) {
        true => Ok(()),
        false => refuse(key, value, &format!("from {} to {}", bounds.start(), bounds.end())),
    }
}

pub(crate) fn refuse(key: &str, value: impl ToString, bound: &str) -> Result<(), Error> {
    Err(Error::setting(key, value, bound))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(text: &str) -> Result<ScanConfig, String> {
        let config: ScanConfig = toml::from_str(text).map_err(|e| e.message().to_owned())?;
        config.validate().map_err(|e| e.to_string())?;
        Ok(config)
    }

    /// Catches a default that is out of its own bounds, or does not survive being written.
    #[test]
    fn defaults_are_valid_and_survive_toml() {
        let config = ScanConfig::default();
        assert_eq!(scan("").unwrap(), config);
        assert_eq!(scan(&toml::to_string(&config).unwrap()).unwrap(), config);
        AcquireConfig::default().validate().unwrap();
        assert_eq!(config.tap_count(), 202 + 200);
    }

    /// Catches a value that is let through, or refused without its key, value and bound.
    #[test]
    fn what_is_out_of_bounds_is_refused() {
        for (text, want) in [
            ("speed = 3", "unknown field `speed`"),
            ("stations = 0", "scan.stations is 0; it must be from 1 to 65535"),
            ("offsets_mm = []", "scan.offsets_mm is []; it must be at least one value"),
            ("offsets_mm = [0.0, nan]", "value 2 of scan.offsets_mm is NaN; it must be from -2000 to 2000"),
            ("offsets_mm = [5.0, 5.0]", "value 2 of scan.offsets_mm is 5; it must be unique"),
            ("velocities_m_per_s = [0.0]", "value 1 of scan.velocities_m_per_s is 0; it must be from 0.01 to 20"),
            ("repetitions = 0", "scan.repetitions is 0"),
            ("locations = 0", "scan.locations is 0; it must be from 1 to 999999"),
            ("shoulders = 3", "scan.shoulders is 3; it must be 1 or 2"),
            ("tap_period_s = 0.0", "scan.tap_period_s is 0"),
            ("start_ns = -1", "scan.start_ns is -1"),
            (
                "locations = 999999\nstations = 60000",
                "scan: the number of taps is 239999880000; it must be at most 10000000",
            ),
            ("[[tyre]]\nserial = \"\"", "the serial of [[scan.tyre]] number 1 is \"\""),
            ("[[tyre]]\nserial = \"A\"\n[[tyre]]\nserial = \"A\"", "tyre A: serial is \"A\"; it must be unique"),
            ("[[tyre]]\nserial = \"A\"\nstation = 2", "tyre A: station is 2; it must be from 1 to scan.stations = 1"),
            ("[[tyre]]\nserial = \"A\"\ncolour = 2", "unknown field `colour`"),
        ] {
            let error = scan(text).unwrap_err();
            assert!(error.contains(want), "{error:?} lacks {want:?}");
        }
        // A run is given so many stations; those of a line are in its configuration.
        let of_line: ScanConfig = toml::from_str("[[tyre]]\nserial = \"A\"\nstation = 2").unwrap();
        assert!(of_line.validate().is_err() && of_line.for_line().validate().is_ok());
        for taps_per_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = AcquireConfig { taps_per_s: Some(taps_per_s), ..AcquireConfig::default() }
                .validate()
                .unwrap_err()
                .to_string();
            assert!(error.contains("acquire.taps_per_s is "), "{error}");
        }
    }
}
