//! `scan.toml`: what all taps of a tap set have in common.

use std::collections::BTreeMap;
use std::path::Path;

use tapline_wire::{Channel, Geometry, Unit};
use toml::{Spanned, Value};

use crate::Error;
use crate::config::calibration::FULL_SCALE_MAX;
use crate::tap_set::text;

const KNOWN: [&str; 13] = [
    "geometry",
    "channels",
    "sample_rate_hz",
    "pre_trigger_samples",
    "force_full_scale_n",
    "sound_full_scale_v",
    "sound_full_scale_pa",
    "microphone_distance_m",
    "sound_unit",
    "force_unit",
    "description",
    "source",
    "licence",
];

/// Text about the recordings. Of a channel without a full scale, a unit of [`Unit`] is that of a sample of 1; no computation
/// uses the rest.
const REMARKS: [&str; 5] = ["sound_unit", "force_unit", "description", "source", "licence"];

/// Largest number of samples per second; far above any converter, so that times in samples stay exact.
const SAMPLE_RATE_HZ_MAX: f64 = 1e9;

/// A stated full scale: its value and the unit that it is in.
pub(crate) type FullScale = (f64, Unit);

/// Largest distance of the microphone in m.
pub(crate) const MICROPHONE_DISTANCE_M_MAX: f64 = 1e3;

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
    pub remarks: BTreeMap<String, String>,
}

impl ScanToml {
    /// What a full-scale sample of `channel` is worth, where it is stated.
    pub(crate) fn full_scale(&self, channel: Channel) -> Option<FullScale> {
        match channel {
            Channel::Force => self.force_full_scale,
            Channel::Sound => self.sound_full_scale,
        }
    }

    /// The unit that a remark names, where it is one of `channel`.
    pub(crate) fn named_unit(&self, channel: Channel) -> Option<Unit> {
        let unit = Unit::from_name(self.remarks.get(&format!("{}_unit", channel.name()))?)?;
        let units = match channel {
            Channel::Force => &[Unit::Newton][..],
            Channel::Sound => &[Unit::Volt, Unit::Pascal][..],
        };
        Some(unit).filter(|unit| units.contains(unit))
    }
}

/// Reads the `text` of `file`.
pub(crate) fn parse(file: &Path, text: &str) -> Result<ScanToml, Error> {
    let table: BTreeMap<Spanned<String>, Spanned<Value>> = toml::from_str(text).map_err(|e| Error::Syntax {
        file: file.to_owned(),
        line: text::line_at(text, e.span().map_or(0, |s| s.start)),
        reason: e.message().replace('\n', ", "),
    })?;
    // In the order of the lines, so that the first fault of the file is reported.
    let mut keys: Vec<&Spanned<String>> = table.keys().collect();
    keys.sort_by_key(|k| k.span().start);
    if let Some(key) = keys.into_iter().find(|k| !KNOWN.contains(&k.get_ref().as_str())) {
        return Err(Error::UnknownKey {
            file: file.to_owned(),
            line: text::line_at(text, key.span().start),
            key: key.get_ref().clone(),
            known: KNOWN.join(", "),
        });
    }
    Keys { file, text, table }.scan()
}

struct Keys<'a> {
    file: &'a Path,
    text: &'a str,
    table: BTreeMap<Spanned<String>, Spanned<Value>>,
}

impl Keys<'_> {
    fn scan(&self) -> Result<ScanToml, Error> {
        let any = f64::MIN_POSITIVE..=FULL_SCALE_MAX;
        let required =
            |key, bound: &str| Error::MissingKey { file: self.file.to_owned(), key, bound: bound.to_owned() };
        Ok(ScanToml {
            geometry: self.geometry()?,
            channels: self.channels()?,
            sample_rate_hz: self
                .number("sample_rate_hz", 1.0..=SAMPLE_RATE_HZ_MAX)?
                .ok_or_else(|| required("sample_rate_hz", "the samples per second and channel"))?,
            pre_trigger_samples: self
                .count("pre_trigger_samples")?
                .ok_or_else(|| required("pre_trigger_samples", "the samples before the trigger"))?,
            force_full_scale: self.number("force_full_scale_n", any.clone())?.map(|n| (n, Unit::Newton)),
            sound_full_scale: self.sound_full_scale(any)?,
            microphone_distance_m: self
                .number("microphone_distance_m", 0.0..=MICROPHONE_DISTANCE_M_MAX)?
                .unwrap_or(0.0),
            remarks: self.remarks()?,
        })
    }

    fn value(&self, key: &str) -> Option<&Value> {
        self.table.iter().find(|(k, _)| k.get_ref() == key).map(|(_, v)| v.get_ref())
    }

    fn refuse(&self, key: &'static str, value: &Value, bound: String) -> Error {
        let at = self.table.keys().find(|k| k.get_ref() == key).map_or(0, |k| k.span().start);
        let line = text::line_at(self.text, at);
        Error::Key { file: self.file.to_owned(), line, key, value: value.to_string(), bound }
    }

    fn geometry(&self) -> Result<Geometry, Error> {
        let bound = "\"ring\" or \"line\"";
        let key = "geometry";
        let value = self.value(key).ok_or_else(|| Error::MissingKey {
            file: self.file.to_owned(),
            key,
            bound: bound.into(),
        })?;
        match value.as_str() {
            Some("ring") => Ok(Geometry::Ring),
            Some("line") => Ok(Geometry::Line),
            _ => Err(self.refuse(key, value, bound.to_owned())),
        }
    }

    fn channels(&self) -> Result<Vec<Channel>, Error> {
        let bound = "a list of \"force\" and \"sound\" in the order of the WAV channels, each at most once";
        let key = "channels";
        let value = self.value(key).ok_or_else(|| Error::MissingKey {
            file: self.file.to_owned(),
            key,
            bound: bound.into(),
        })?;
        let refused = || self.refuse(key, value, bound.to_owned());
        let mut channels = Vec::new();
        for name in value.as_array().ok_or_else(refused)? {
            let channel = name.as_str().and_then(Channel::from_name).ok_or_else(refused)?;
            // No discriminator could tell two channels of one kind apart.
            if channels.contains(&channel) {
                return Err(refused());
            }
            channels.push(channel);
        }
        if channels.is_empty() { Err(refused()) } else { Ok(channels) }
    }

    fn number(&self, key: &'static str, bounds: std::ops::RangeInclusive<f64>) -> Result<Option<f64>, Error> {
        let Some(value) = self.value(key) else { return Ok(None) };
        #[expect(clippy::cast_precision_loss, reason = "integers beyond 2^53 are out of every bound used here")]
        let number = value.as_float().or_else(|| value.as_integer().map(|i| i as f64));
        match number.filter(|n| bounds.contains(n)) {
            Some(number) => Ok(Some(number)),
            None if *bounds.start() > 0.0 && *bounds.start() < 1.0 => {
                Err(self.refuse(key, value, format!("a number above 0 and at most {}", bounds.end())))
            }
            None => Err(self.refuse(key, value, format!("a number from {} to {}", bounds.start(), bounds.end()))),
        }
    }

    /// In volts or in pascals.
    fn sound_full_scale(&self, any: std::ops::RangeInclusive<f64>) -> Result<Option<FullScale>, Error> {
        let volts = self.number("sound_full_scale_v", any.clone())?.map(|v| (v, Unit::Volt));
        match (volts, self.number("sound_full_scale_pa", any)?, self.value("sound_full_scale_pa")) {
            (Some(_), Some(_), Some(value)) => {
                Err(self.refuse("sound_full_scale_pa", value, "left out, as sound_full_scale_v is given".to_owned()))
            }
            (volts, pascals, _) => Ok(volts.or(pascals.map(|pa| (pa, Unit::Pascal)))),
        }
    }

    fn count(&self, key: &'static str) -> Result<Option<u32>, Error> {
        let Some(value) = self.value(key) else { return Ok(None) };
        let count = value.as_integer().and_then(|i| u32::try_from(i).ok());
        count.map(Some).ok_or_else(|| self.refuse(key, value, format!("a whole number from 0 to {}", u32::MAX)))
    }

    fn remarks(&self) -> Result<BTreeMap<String, String>, Error> {
        let mut remarks = BTreeMap::new();
        for key in REMARKS {
            let Some(value) = self.value(key) else { continue };
            let text = value.as_str().ok_or_else(|| self.refuse(key, value, "text in quotes".to_owned()))?;
            remarks.insert(key.to_owned(), text.to_owned());
        }
        Ok(remarks)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

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
        assert_eq!(scan.named_unit(Channel::Force), Some(Unit::Newton));
        let pascals = parsed(&format!("{GOOD}sound_full_scale_pa = 20.0\n")).unwrap();
        assert_eq!(pascals.full_scale(Channel::Sound), Some((20.0, Unit::Pascal)));
        assert_eq!(scan.remarks.len(), REMARKS.len());
    }

    /// Catches a fault that is accepted, or reported without its line, key, value or bound.
    #[test]
    fn every_fault_names_line_key_value_and_bound() {
        for (from, to, want) in [
            ("= 512", "= 512\nsample_rate = 1", "line 5: unknown key sample_rate; known are geometry, channels, "),
            ("= 512", "= -1", "line 4: pre_trigger_samples is -1; it must be a whole number from 0 to 4294967295"),
            ("= 512", "= 5.5", "line 4: pre_trigger_samples is 5.5; it must be a whole"),
            ("= 40960", "= 0", "line 3: sample_rate_hz is 0; it must be a number from 1 to 1000000000"),
            ("= 40960", "= nan", "line 3: sample_rate_hz is nan"),
            ("= 40960", "= inf", "line 3: sample_rate_hz is inf"),
            ("= 40960", "= \"fast\"", "line 3: sample_rate_hz is \"fast\""),
            ("\"ring\"", "\"disc\"", "line 1: geometry is \"disc\"; it must be \"ring\" or \"line\""),
            ("\"force\", \"sound\"", "\"force\", \"light\"", "line 2: channels is [\"force\", \"light\"]; it must be"),
            ("\"force\", \"sound\"", "", "line 2: channels is []"),
            ("\"force\", \"sound\"", "\"sound\", \"sound\"", "each at most once"),
            ("pre_trigger_samples = 512", "", "the key pre_trigger_samples is missing"),
            ("geometry = \"ring\"", "", "the key geometry is missing; it must be \"ring\" or \"line\""),
            ("= 512", "= 512\nforce_full_scale_n = 0", "line 5: force_full_scale_n is 0; it must be a number above 0"),
            (
                "= 512",
                "= 512\nsound_full_scale_v = 1\nsound_full_scale_pa = 1",
                "line 6: sound_full_scale_pa is 1; it must be left out",
            ),
            ("= 512", "= 512\nsource = 3", "line 5: source is 3; it must be text"),
            ("= 512", "= 512\ngeometry = \"line\"", "line 5: duplicate key"),
            ("= 512", "= ", "scan.toml line 4: "),
        ] {
            assert!(GOOD.contains(from));
            let error = error_of(&GOOD.replace(from, to));
            assert!(error.starts_with("scan.toml") && error.contains(want), "{error:?} lacks {want:?}");
            assert!(!error.contains('\n'), "one fault, one line: {error:?}");
        }
    }

    proptest! {
        /// Catches a panic on nonsensical text.
        #[test]
        fn no_text_makes_it_panic(text in "(geometry|channels|= |\\[|\"ring\"|[\\x00-\\x7f]|\n|é){0,40}") {
            let _unused = parsed(&text);
        }

        /// Catches a panic on a good file with one byte changed.
        #[test]
        fn no_slip_of_the_pen_makes_it_panic(at in 0..GOOD.len(), byte in 0u8..128) {
            let mut bytes = GOOD.as_bytes().to_vec();
            bytes[at] = byte;
            let _unused = parsed(std::str::from_utf8(&bytes).unwrap());
        }
    }
}
