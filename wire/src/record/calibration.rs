//! The units of a channel's samples, and where the scale comes from.

use serde::{Deserialize, Serialize};

use crate::Channel;

/// Longest text of a certificate in bytes.
pub const METHOD_BYTES_MAX: usize = 400;

/// The unit of a channel's samples once they are scaled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub enum Unit {
    /// Fraction of full scale: the value of a sample is unknown.
    #[default]
    #[serde(rename = "FS")]
    FullScale,
    /// Newton.
    #[serde(rename = "N")]
    Newton,
    /// Volt.
    #[serde(rename = "V")]
    Volt,
    /// Pascal.
    #[serde(rename = "Pa")]
    Pascal,
}

named!(Unit, FullScale = "FS", Newton = "N", Volt = "V", Pascal = "Pa");

impl Unit {
    /// Whether a sample has a physical unit.
    pub fn is_known(self) -> bool {
        self != Self::FullScale
    }

    /// How many newtons, volts or pascals a recording's unit `name` is; `None` if `channel` has no such unit.
    ///
    /// Capitals count only in M and m: mega is not milli.
    pub fn of_recording(channel: Channel, name: &str) -> Option<(f64, Self)> {
        use crate::Channel::{Force, Sound};
        let name = name.trim();
        let lower = name.to_lowercase();
        Some(match (channel, if name.starts_with('M') { name } else { &lower }) {
            (Force, "n") => (1.0, Self::Newton),
            (Force, "mn") => (1e-3, Self::Newton),
            (Force, "kn") => (1e3, Self::Newton),
            (Force, "lbf") => (4.448_221_615_260_5, Self::Newton),
            (Sound, "v") => (1.0, Self::Volt),
            (Sound, "mv") => (1e-3, Self::Volt),
            (Sound, "kv") => (1e3, Self::Volt),
            (Sound, "uv" | "\u{b5}v" | "\u{3bc}v") => (1e-6, Self::Volt),
            (Sound, "pa") => (1.0, Self::Pascal),
            (Sound, "mpa") => (1e-3, Self::Pascal),
            _ => return None,
        })
    }
}

/// Where the scale of a channel comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// What was done, in words; at most [`METHOD_BYTES_MAX`] bytes.
    pub method: String,
    /// Day of the calibration, such as `2026-11-24`.
    pub date: String,
    /// Last day on which it is valid; no end if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valid_until: Option<String>,
    /// Sensitivity of the sensor, mV/N or mV/Pa, where it is known separately.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity_mv_per_unit: Option<f64>,
    /// Gain of the amplifier behind it, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
}

/// Unit and certificate of one channel.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ChannelCalibration {
    /// The unit of its samples once they are scaled.
    pub unit: Unit,
    /// Where the scale comes from; `None` if it is unknown, or stated without a certificate.
    pub certificate: Option<Certificate>,
}

/// What the samples of a casing are worth.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Calibration {
    /// Of the force.
    pub force: ChannelCalibration,
    /// Of the sound.
    pub sound: ChannelCalibration,
    /// Day on which the casing was tapped, such as `2026-11-24`; `None` if unknown.
    pub tapped_on: Option<String>,
}

impl Calibration {
    /// Newtons and volts without a certificate: a scale was stated.
    pub fn stated() -> Self {
        let of = |unit| ChannelCalibration { unit, certificate: None };
        Self { force: of(Unit::Newton), sound: of(Unit::Volt), tapped_on: None }
    }

    /// Newtons and volts that are exact because the samples were computed.
    pub fn computed() -> Self {
        let certificate = Certificate {
            method: "computed".to_owned(),
            date: "1970-01-01".to_owned(),
            valid_until: None,
            sensitivity_mv_per_unit: None,
            gain: None,
        };
        let of = |unit| ChannelCalibration { unit, certificate: Some(certificate.clone()) };
        Self { force: of(Unit::Newton), sound: of(Unit::Volt), tapped_on: None }
    }

    /// Of `channel`.
    pub fn of(&self, channel: Channel) -> &ChannelCalibration {
        match channel {
            Channel::Force => &self.force,
            Channel::Sound => &self.sound,
        }
    }

    /// Of `channel`, to change it.
    pub fn of_mut(&mut self, channel: Channel) -> &mut ChannelCalibration {
        match channel {
            Channel::Force => &mut self.force,
            Channel::Sound => &mut self.sound,
        }
    }

    /// The unit of `channel`.
    pub fn unit(&self, channel: Channel) -> Unit {
        self.of(channel).unit
    }

    /// The certificate of `channel`, from a day on which it was calibrated; computed samples need none.
    pub fn certificate(&self, channel: Channel) -> Option<&Certificate> {
        let is_computed = *self.of(channel) == *Self::computed().of(channel);
        self.of(channel).certificate.as_ref().filter(|_| !is_computed)
    }

    /// Whether each of `channels` has a certificate.
    pub fn is_certified(&self, channels: &[Channel]) -> bool {
        channels.iter().all(|&channel| self.of(channel).certificate.is_some())
    }

    /// Whether the certificate of one of `channels` is not known to be valid on the day of the taps: it is of a later day, or
    /// expired, or it expires and that day is unknown.
    pub fn is_out_of_date(&self, channels: &[Channel]) -> bool {
        // Dates of this form sort as text.
        let is_out = |certificate: &Certificate| match (&self.tapped_on, &certificate.valid_until) {
            (Some(day), until) => *day < certificate.date || until.as_ref().is_some_and(|until| day > until),
            (None, until) => until.is_some(),
        };
        channels.iter().filter_map(|&channel| self.of(channel).certificate.as_ref()).any(is_out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a certificate that expires on its last day, that of a channel that is not there, one that never expires, one of
    /// a later day, and taps of an unknown day that any certificate would do for.
    #[test]
    fn a_certificate_holds_from_its_date_until_its_last_day() {
        let mut calibration = Calibration::computed();
        let both = Channel::BOTH;
        let sound = calibration.of_mut(Channel::Sound).certificate.as_mut().unwrap();
        (sound.date, sound.valid_until) = ("2026-01-02".to_owned(), Some("2026-11-24".to_owned()));
        for (day, is_out) in [
            ("2026-01-01", true),
            ("2026-01-02", false),
            ("2026-11-24", false),
            ("2026-11-25", true),
            ("2027-01-01", true),
        ] {
            calibration.tapped_on = Some(day.to_owned());
            assert_eq!(calibration.is_out_of_date(&both), is_out, "{day}");
            assert!(!calibration.is_out_of_date(&[Channel::Force]) && calibration.is_certified(&both));
        }
        calibration.tapped_on = None;
        assert!(calibration.is_out_of_date(&both) && !calibration.is_out_of_date(&[Channel::Force]));
        assert!(!Calibration::stated().is_certified(&[Channel::Sound]));
    }
}
