//! `scan.toml`: what all taps of a tap set have in common.

use std::ops::{Range, RangeInclusive};
use std::path::Path;

use serde::Deserialize;
use tapline_wire::{Channel, Geometry, Unit};
use toml::{Spanned, Value};

use crate::Error;
use crate::config::calibration::FULL_SCALE_MAX;
use crate::config::text;

/// Largest number of samples per second: the head of a WAV has 32 bits for the bytes per second of two channels of floats.
pub const SAMPLE_RATE_HZ_MAX: f64 = 5e8;

/// A stated full scale: its value and the unit that it is in.
pub(crate) type FullScale = (f64, Unit);

/// Largest distance of the microphone in m.
pub(crate) const MICROPHONE_DISTANCE_M_MAX: f64 = 10.0;

/// What all taps of a set have in common.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ScanToml {
    pub geometry: Geometry,
    pub channels: Vec<Channel>,
    pub sample_rate_hz: f64,
    pub pre_trigger_samples: u32,
    pub force_full_scale: Option<FullScale>,
    pub sound_full_scale: Option<FullScale>,
    pub microphone_distance_m: f64,
    /// For a channel without a full scale, a unit that [`Unit::of_recording`] knows is that of a sample of 1.
    pub force_unit: Option<String>,
    /// Likewise.
    pub sound_unit: Option<String>,
}

/// The file as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    geometry: Spanned<Value>,
    channels: Spanned<Vec<Channel>>,
    sample_rate_hz: Spanned<f64>,
    pre_trigger_samples: u32,
    force_full_scale_n: Option<Spanned<f64>>,
    sound_full_scale_v: Option<Spanned<f64>>,
    sound_full_scale_pa: Option<Spanned<f64>>,
    microphone_distance_m: Option<Spanned<f64>>,
    force_unit: Option<Spanned<String>>,
    sound_unit: Option<Spanned<String>>,
    // For people: nothing reads them.
    #[serde(rename = "description")]
    _description: Option<String>,
    #[serde(rename = "source")]
    _source: Option<String>,
    #[serde(rename = "licence")]
    _licence: Option<String>,
}

impl ScanToml {
    /// Value of a full-scale sample of `channel`, if it is stated.
    pub(crate) fn full_scale(&self, channel: Channel) -> Option<FullScale> {
        match channel {
            Channel::Force => self.force_full_scale,
            Channel::Sound => self.sound_full_scale,
        }
    }

    /// Value of a sample of 1.0 in the named unit, if it is one of `channel`.
    pub(crate) fn named_unit(&self, channel: Channel) -> Option<FullScale> {
        let name = match channel {
            Channel::Force => &self.force_unit,
            Channel::Sound => &self.sound_unit,
        };
        Unit::of_recording(channel, name.as_deref()?)
    }
}

/// Reads the `text` of `file`.
pub(crate) fn parse(file: &Path, text: &str) -> Result<ScanToml, Error> {
    let written: Written = text::toml(file, text)?;
    let refuse = |key, at: Range<usize>, value: String, bound: &str| Error::Key {
        file: file.to_owned(),
        line: text::line_at(text, at.start),
        key,
        value,
        bound: bound.to_owned(),
    };
    let number = |key, number: &Spanned<f64>, bounds: RangeInclusive<f64>, bound: &str| {
        let value = *number.get_ref();
        if bounds.contains(&value) { Ok(value) } else { Err(refuse(key, number.span(), format!("{value:?}"), bound)) }
    };
    let full_scale = |key, full_scale: &Option<Spanned<f64>>, unit: Unit| -> Result<Option<FullScale>, Error> {
        let Some(full_scale) = full_scale else { return Ok(None) };
        let bound = format!("a number above 0 and at most {FULL_SCALE_MAX}");
        Ok(Some((number(key, full_scale, f64::MIN_POSITIVE..=FULL_SCALE_MAX, &bound)?, unit)))
    };
    let geometry = &written.geometry;
    let Some(geometry) = geometry.get_ref().as_str().and_then(Geometry::from_name) else {
        let (at, value) = (geometry.span(), geometry.get_ref().to_string());
        return Err(refuse("geometry", at, value, "\"ring\" or \"line\""));
    };
    let channels = written.channels.get_ref();
    // No discriminator could choose between two channels of one kind.
    if channels.is_empty() || (1..channels.len()).any(|at| channels[..at].contains(&channels[at])) {
        let names: Vec<&str> = channels.iter().map(|channel| channel.name()).collect();
        let bound = "a list of \"force\" and \"sound\", or of one of them, in the order of the WAV channels";
        return Err(refuse("channels", written.channels.span(), format!("{names:?}"), bound));
    }
    let of_rate = format!("a number from 1 to {SAMPLE_RATE_HZ_MAX}");
    let sample_rate_hz = number("sample_rate_hz", &written.sample_rate_hz, 1.0..=SAMPLE_RATE_HZ_MAX, &of_rate)?;
    let force_full_scale = full_scale("force_full_scale_n", &written.force_full_scale_n, Unit::Newton)?;
    let volts = full_scale("sound_full_scale_v", &written.sound_full_scale_v, Unit::Volt)?;
    let pascals = full_scale("sound_full_scale_pa", &written.sound_full_scale_pa, Unit::Pascal)?;
    if let (Some(_), Some(pascals)) = (volts, &written.sound_full_scale_pa) {
        let bound = "left out, as sound_full_scale_v is given";
        return Err(refuse("sound_full_scale_pa", pascals.span(), format!("{:?}", pascals.get_ref()), bound));
    }
    let unit = |key, channel, unit: Option<Spanned<String>>, full_scale: Option<FullScale>| {
        let Some(unit) = unit else { return Ok(None) };
        match (Unit::of_recording(channel, unit.get_ref()), full_scale) {
            (Some((_, named)), Some((_, stated))) if named != stated => {
                let bound = format!("left out, as the full scale is in {}", stated.name());
                Err(refuse(key, unit.span(), format!("{:?}", unit.get_ref()), &bound))
            }
            _ => Ok(Some(unit.into_inner())),
        }
    };
    let sound_full_scale = volts.or(pascals);
    let force_unit = unit("force_unit", Channel::Force, written.force_unit, force_full_scale)?;
    let sound_unit = unit("sound_unit", Channel::Sound, written.sound_unit, sound_full_scale)?;
    let microphone_distance_m = match &written.microphone_distance_m {
        Some(distance_m) => {
            let bound = format!("a number from 0 to {MICROPHONE_DISTANCE_M_MAX}");
            number("microphone_distance_m", distance_m, 0.0..=MICROPHONE_DISTANCE_M_MAX, &bound)?
        }
        None => 0.0,
    };
    Ok(ScanToml {
        geometry,
        channels: written.channels.into_inner(),
        sample_rate_hz,
        pre_trigger_samples: written.pre_trigger_samples,
        force_full_scale,
        sound_full_scale,
        microphone_distance_m,
        force_unit,
        sound_unit,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str =
        "geometry = \"ring\"\nchannels = [\"force\", \"sound\"]\nsample_rate_hz = 40960\npre_trigger_samples = 512\n";

    fn parsed(text: &str) -> Result<ScanToml, Error> {
        parse(Path::new("scan.toml"), text)
    }

    fn error_of(text: &str) -> String {
        parsed(text).unwrap_err().to_string()
    }

    /// Catches wrong defaults, and a rate without a decimal point that is refused.
    #[test]
    fn what_is_left_out_has_its_default() {
        let scan = parsed(GOOD).unwrap();
        assert_eq!(scan.geometry, Geometry::Ring);
        assert_eq!(scan.channels, Channel::BOTH);
        assert_eq!(scan.pre_trigger_samples, 512);
        let numbers = [scan.sample_rate_hz, scan.microphone_distance_m];
        assert_eq!(numbers.map(f64::to_bits), [40960.0, 0.0].map(f64::to_bits));
        assert_eq!(Channel::BOTH.map(|channel| scan.full_scale(channel)), [None; 2]);
    }

    /// Catches full scales that are swapped, and free text that is refused.
    #[test]
    fn every_key_is_taken() {
        let more = "force_full_scale_n = 222.0\nsound_full_scale_v = 5\nmicrophone_distance_m = 0.05\n\
                    sound_unit = \"V\"\nforce_unit = \"N\"\ndescription = \"d\"\nsource = \"s\"\nlicence = \"CC0\"\n";
        let scan = parsed(&format!("{GOOD}{more}")).unwrap();
        assert_eq!(scan.full_scale(Channel::Force), Some((222.0, Unit::Newton)));
        assert_eq!(scan.full_scale(Channel::Sound), Some((5.0, Unit::Volt)));
        let named = Channel::BOTH.map(|channel| scan.named_unit(channel));
        assert_eq!(named, [Some((1.0, Unit::Newton)), Some((1.0, Unit::Volt))]);
        let named = |unit| parsed(&format!("{GOOD}force_unit = \"{unit}\"\n")).unwrap().named_unit(Channel::Force);
        assert_eq!((named("kN"), named("V"), named("counts")), (Some((1e3, Unit::Newton)), None, None));
        assert_eq!(named("KN"), named("kN"));
        let stated = parsed(&format!("{GOOD}force_full_scale_n = 9\nforce_unit = \"counts\"\n")).unwrap();
        assert_eq!(stated.full_scale(Channel::Force), Some((9.0, Unit::Newton)));
        let pascals = parsed(&format!("{GOOD}sound_full_scale_pa = 20.0\n")).unwrap();
        assert_eq!(pascals.full_scale(Channel::Sound), Some((20.0, Unit::Pascal)));
    }

    /// Catches a fault that is accepted, or reported without its line, key, value or bound.
    #[test]
    fn every_fault_names_line_key_value_and_bound() {
        for (from, to, want) in [
            (
                "= 512",
                "= 512\nsample_rate = 1",
                "line 5: `sample_rate = 1`: unknown field `sample_rate`, expected one of `geometry`, `channels`, ",
            ),
            (
                "= 512",
                "= -1",
                "line 4: `pre_trigger_samples = -1`: invalid value: integer `-1`, expected a whole number from 0 to 4294967295",
            ),
            (
                "= 512",
                "= 5.5",
                "line 4: `pre_trigger_samples = 5.5`: invalid type: floating point `5.5`, expected a whole number",
            ),
            ("= 40960", "= 0", "line 3: sample_rate_hz is 0.0; it must be a number from 1 to 500000000"),
            ("= 40960", "= nan", "line 3: sample_rate_hz is NaN"),
            ("= 40960", "= inf", "line 3: sample_rate_hz is inf"),
            (
                "= 40960",
                "= \"fast\"",
                "line 3: `sample_rate_hz = \"fast\"`: invalid type: string \"fast\", expected a number",
            ),
            ("\"ring\"", "\"disc\"", "line 1: geometry is \"disc\"; it must be \"ring\" or \"line\""),
            (
                "\"force\", \"sound\"",
                "\"force\", \"light\"",
                "line 2: `channels = [\"force\", \"light\"]`: unknown variant `light`, expected `force` or `sound`",
            ),
            ("\"force\", \"sound\"", "", "line 2: channels is []"),
            ("\"force\", \"sound\"", "\"sound\", \"sound\"", "line 2: channels is [\"sound\", \"sound\"]; it must be"),
            ("pre_trigger_samples = 512", "", "scan.toml: missing field `pre_trigger_samples`"),
            ("geometry = \"ring\"", "", "scan.toml: missing field `geometry`"),
            (
                "= 512",
                "= 512\nforce_full_scale_n = 0",
                "line 5: force_full_scale_n is 0.0; it must be a number above 0",
            ),
            (
                "= 512",
                "= 512\nsound_full_scale_v = 1\nsound_full_scale_pa = 1",
                "line 6: sound_full_scale_pa is 1.0; it must be left out",
            ),
            (
                "= 512",
                "= 512\nsound_full_scale_v = 5\nsound_unit = \"Pa\"",
                "line 6: sound_unit is \"Pa\"; it must be left out, as the full scale is in V",
            ),
            ("= 512", "= 512\nsource = 3", "line 5: `source = 3`: invalid type: integer `3`, expected a string"),
            ("= 512", "= 512\ngeometry = \"line\"", "line 5: `geometry = \"line\"`: duplicate key"),
            ("= 512", "= ", "scan.toml line 4: "),
        ] {
            assert!(GOOD.contains(from));
            let error = error_of(&GOOD.replace(from, to));
            assert!(error.starts_with("scan.toml") && error.contains(want), "{error:?} lacks {want:?}");
            assert!(!error.contains('\n'), "one fault, one line: {error:?}");
        }
    }
}
