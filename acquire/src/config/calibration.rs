//! A calibration file: the values of full-scale samples of a station or a tap set, and since when they are known.

use std::path::Path;

use jiff::Timestamp;
use jiff::civil::Date;
use jiff::tz::TimeZone;
use serde::{Deserialize, Serialize};
use tapline_wire::{Calibration, Certificate, Channel, ChannelCalibration, METHOD_BYTES_MAX, Unit};

use crate::Error;
use crate::config::refuse;
use crate::config::text::read_toml;

/// Name of the file in a tap set.
pub const CALIBRATION_FILE: &str = "calibration.toml";

/// Largest value of a full-scale sample, in any unit.
pub(crate) const FULL_SCALE_MAX: f64 = 1e12;

/// Both channels of a station.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFile {
    /// The force; unknown where left out.
    pub force: Option<ChannelScale>,
    /// The sound, likewise.
    pub sound: Option<ChannelScale>,
}

/// The value of a full-scale sample of a channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelScale {
    /// `N`; of the sound `V` or `Pa`.
    pub unit: Unit,
    /// Value of a full-scale sample in that unit.
    pub full_scale: f64,
    /// Volts of a full-scale sample at the device, where they are known: the range of a module.
    pub full_scale_v: Option<f64>,
    /// Where it comes from.
    pub certificate: Certificate,
}

impl CalibrationFile {
    /// Reads and checks the file `path`.
    ///
    /// # Errors
    /// [`Error::Unreadable`], [`Error::Syntax`], or [`Error::Setting`] for the first value out of its bounds.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let file: Self = read_toml(path)?;
        file.validate(&path.display().to_string())?;
        Ok(file)
    }

    /// Checks every value against its bounds; `name` is the file's in errors.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of its bounds.
    pub fn validate(&self, name: &str) -> Result<(), Error> {
        for channel in Channel::BOTH {
            let Some(ChannelScale { unit, full_scale, full_scale_v, certificate }) = self.of(channel) else { continue };
            let key = |key: &str| format!("{}.{key} in {name}", channel.name());
            let (units, bound) = match channel {
                Channel::Force => (&[Unit::Newton][..], "N"),
                Channel::Sound => (&[Unit::Volt, Unit::Pascal][..], "V or Pa"),
            };
            if !units.contains(unit) {
                return refuse(&key("unit"), unit.name(), bound);
            }
            let numbers = [
                ("full_scale", Some(*full_scale)),
                ("full_scale_v", *full_scale_v),
                ("certificate.sensitivity_mv_per_unit", certificate.sensitivity_mv_per_unit),
                ("certificate.gain", certificate.gain),
            ];
            for (field, value) in numbers.into_iter().filter_map(|(field, value)| Some((field, value?))) {
                if !(value > 0.0 && value <= FULL_SCALE_MAX) {
                    return refuse(&key(field), value, "above 0 and at most 1e12");
                }
            }
            let bytes = certificate.method.len();
            if bytes == 0 || bytes > METHOD_BYTES_MAX || certificate.method.chars().any(char::is_control) {
                let bound = format!("from 1 to {METHOD_BYTES_MAX} bytes of text on one line");
                return refuse(&key("certificate.method"), format!("{:?}", certificate.method), &bound);
            }
            let dates = [("date", Some(&certificate.date)), ("valid_until", certificate.valid_until.as_ref())];
            for (field, text) in dates.into_iter().filter_map(|(field, text)| Some((field, text?))) {
                // Dates are compared as text.
                if text.parse::<Date>().is_ok_and(|date| date.to_string() == *text) {
                    continue;
                }
                return refuse(&key(&format!("certificate.{field}")), format!("{text:?}"), "a date like 2026-11-24");
            }
            if let Some(until) = certificate.valid_until.as_ref().filter(|until| **until < certificate.date) {
                let bound = format!("not before the date of the calibration, {}", certificate.date);
                return refuse(&key("certificate.valid_until"), until, &bound);
            }
        }
        Ok(())
    }

    /// Of `channel`.
    pub fn of(&self, channel: Channel) -> Option<&ChannelScale> {
        match channel {
            Channel::Force => self.force.as_ref(),
            Channel::Sound => self.sound.as_ref(),
        }
    }

    /// Value of a full-scale sample of `channel`: 1 if it is unknown.
    pub fn full_scale(&self, channel: Channel) -> f64 {
        self.of(channel).map_or(1.0, |scale| scale.full_scale)
    }

    /// The part of this calibration that is stored with a casing tapped at `tap_time_ns` since the Unix epoch, if that time is
    /// known.
    pub fn calibration(&self, tap_time_ns: Option<i64>) -> Calibration {
        let of = |scale: &Option<ChannelScale>| match scale {
            Some(scale) => ChannelCalibration { unit: scale.unit, certificate: Some(scale.certificate.clone()) },
            None => ChannelCalibration::default(),
        };
        Calibration { force: of(&self.force), sound: of(&self.sound), tapped_on: tap_time_ns.and_then(day_of) }
    }
}

/// The day of a time since the Unix epoch, in UTC.
pub(crate) fn day_of(time_ns: i64) -> Option<String> {
    let time = Timestamp::from_nanosecond(time_ns.into()).ok()?;
    Some(time.to_zoned(TimeZone::UTC).date().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "[force]\nunit = \"N\"\nfull_scale = 222.0\n[force.certificate]\nmethod = \"5 blows of 52.3 N\"\n\
                        date = \"2026-11-24\"\nvalid_until = \"2027-11-24\"\nsensitivity_mv_per_unit = 22.5\ngain = 10.0\n";

    fn read(text: &str) -> Result<CalibrationFile, Error> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.toml");
        std::fs::write(&path, text).unwrap();
        CalibrationFile::read(&path)
    }

    /// Catches a value that is dropped between the file and the plan, and a channel that is taken for the other.
    #[test]
    fn what_a_file_says_is_what_a_plan_carries() {
        let file = read(GOOD).unwrap();
        let calibration = file.calibration(Some(1_795_564_800_000_000_000));
        assert_eq!(calibration.tapped_on.as_deref(), Some("2026-11-25"));
        assert_eq!(
            (calibration.unit(Channel::Force), calibration.unit(Channel::Sound)),
            (Unit::Newton, Unit::FullScale)
        );
        let certificate = calibration.force.certificate.clone().unwrap();
        assert_eq!((certificate.gain, certificate.sensitivity_mv_per_unit), (Some(10.0), Some(22.5)));
        assert_eq!((file.full_scale(Channel::Force), file.full_scale(Channel::Sound)), (222.0, 1.0));
        assert!(!calibration.is_certified(&Channel::BOTH) && !calibration.is_out_of_date(&[Channel::Force]));
        assert_eq!(read(&toml::to_string(&file).unwrap()).unwrap(), file);
    }

    /// Catches a value out of its bounds that is taken, or that is not named.
    #[test]
    fn what_is_no_calibration_is_refused_by_name() {
        for (was, is, named) in [
            ("\"N\"", "\"Pa\"", "force.unit"),
            ("222.0", "0.0", "force.full_scale"),
            ("222.0", "nan", "force.full_scale"),
            ("\"2026-11-24\"", "\"24.11.2026\"", "force.certificate.date"),
            ("\"2026-11-24\"", "\"2026-13-24\"", "certificate.date"),
            ("2027-11-24", "2025-11-24", "not before the date of the calibration, 2026-11-24"),
            ("gain = 10.0", "gain = -1.0", "certificate.gain"),
            ("5 blows of 52.3 N", "", "certificate.method"),
            ("gain", "gian", "line 9"),
            ("[force]", "[farce]", "line 1"),
        ] {
            let text = GOOD.replace(was, is);
            let error = read(&text).unwrap_err().to_string();
            assert!(error.contains(named), "{is}: {error}");
        }
    }
}
