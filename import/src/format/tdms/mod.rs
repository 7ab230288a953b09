//! TDMS files of LabVIEW and DIAdem.
//!
//! Source: National Instruments, *TDMS File Format Internal Structure*. No crate that reads these files takes interleaved
//! samples, several chunks of a segment, or big-endian ones.
//!
//! - here: channels, their properties and scales
//! - `segments`: which objects a file has, and where their samples are; `metadata`: how that is written
//! - `raw_data`: the samples

mod metadata;
mod raw_data;
mod segments;

use std::collections::HashMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use crate::error::{Fault, broken, some_of};
use crate::format::tdms::metadata::{Property, kind_name};
use crate::format::tdms::raw_data::samples;
use crate::format::tdms::segments::{Contents, Object, Segment};
use crate::format::{Pick, Recorded};
use crate::series::{Series, checked_count, to_floats};

/// A TDMS file: its objects, and where their samples are.
#[derive(Debug)]
pub(crate) struct Tdms {
    file: BufReader<File>,
    objects: Vec<Object>,
    places: HashMap<Vec<String>, usize>,
    segments: Vec<Segment>,
}

impl Tdms {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let mut file = BufReader::new(File::open(path)?);
        let Contents { objects, segments, .. } = Contents::read(&mut file)?;
        let places = objects.iter().enumerate().map(|(place, object)| (object.path.clone(), place)).collect();
        Ok(Self { file, objects, places, segments })
    }

    /// Places of the channels of the group `part`, or of all.
    fn channels(&self, part: &str) -> Vec<usize> {
        let is_of = |object: &Object| object.path.len() == 2 && (part.is_empty() || object.path[0] == part);
        (0..self.objects.len()).filter(|&place| is_of(&self.objects[place])).collect()
    }

    fn place(&self, part: &str, channel: &Pick) -> Result<usize, Fault> {
        let all = self.channels(part);
        if all.is_empty() {
            let known = some_of(self.objects.iter().filter(|o| o.path.len() == 1).map(|o| o.path[0].as_str()));
            return Err(Fault::Missing { what: "part", name: format!("{part:?}"), known });
        }
        let name = |&place: &usize| self.objects[place].path[1].as_str();
        match channel {
            Pick::Number(_) => Ok(all[channel.find(all.iter().map(name))?]),
            Pick::Name(wanted) => {
                let is_it = |place: &&usize| {
                    let path = &self.objects[**place].path;
                    path[1] == *wanted || wanted.split_once('/') == Some((&path[0], &path[1]))
                };
                let mut found = all.iter().filter(is_it);
                match (found.next(), found.count()) {
                    (None, _) => channel.find(all.iter().map(name)),
                    (Some(&place), 0) => Ok(place),
                    (Some(_), more) => broken(format!(
                        "has {} channels called {wanted:?}; say which as \"GROUP/{wanted}\", or by the part, a group",
                        more + 1
                    )),
                }
            }
        }
    }

    /// All samples of the object at `place`, each of `N` bytes.
    fn samples<const N: usize, T>(&mut self, place: usize, number: impl Fn([u8; N]) -> T) -> Result<Vec<T>, Fault> {
        let count = checked_count(self.objects[place].sample_count)?;
        samples(&mut self.file, &self.segments, place, count, number)
    }

    /// A property of a channel, or else of its group, or of the file.
    fn property(&self, place: usize, name: &str) -> Option<&Property> {
        let path = &self.objects[place].path;
        (0..=path.len()).rev().find_map(|depth| {
            let place = self.places.get(&path[..depth])?;
            self.objects[*place].properties.get(name)
        })
    }

    fn number(&self, place: usize, name: &str) -> Option<f64> {
        match self.property(place, name) {
            Some(Property::Number(number)) => Some(*number),
            _ => None,
        }
    }

    fn text(&self, place: usize, name: &str) -> Option<&str> {
        match self.property(place, name) {
            Some(Property::Text(text)) => Some(text),
            _ => None,
        }
    }

    /// The polynomial that turns stored values into physical ones; `None` if they are physical.
    fn polynomial(&self, place: usize) -> Result<Option<Vec<f64>>, Fault> {
        let scale_count = self.number(place, "NI_Number_Of_Scales").unwrap_or(0.0);
        if scale_count < 1.0 || self.text(place, "NI_Scaling_Status") == Some("scaled") {
            return Ok(None);
        }
        let kind = self.text(place, "NI_Scale[0]_Scale_Type").unwrap_or("of DAQmx");
        let value = |name: &str| {
            let name = format!("NI_Scale[0]_{name}");
            self.number(place, &name).ok_or_else(|| Fault::Broken(format!("a scale lacks the property {name}")))
        };
        match kind {
            "Linear" if scale_count < 2.0 => Ok(Some(vec![value("Linear_Y_Intercept")?, value("Linear_Slope")?])),
            "Polynomial" if scale_count < 2.0 => {
                let term_count = value("Polynomial_Coefficients_Size")?;
                let terms = (0_u32..16).take_while(|&k| f64::from(k) < term_count);
                Ok(Some(terms.map(|k| value(&format!("Polynomial_Coefficients[{k}]"))).collect::<Result<_, _>>()?))
            }
            kind => broken(format!(
                "channel {:?} has {scale_count} scales, the first {kind}; one, Linear or Polynomial, is read: save it scaled",
                self.objects[place].path[1]
            )),
        }
    }
}

impl Recorded for Tdms {
    fn parts(&self, depth: usize) -> Result<Vec<String>, Fault> {
        if depth != 1 {
            return broken(format!("a TDMS file has groups, one step below it, not {depth}"));
        }
        Ok(self.objects.iter().filter(|object| object.path.len() == 1).map(|object| object.path[0].clone()).collect())
    }

    fn series(&mut self, part: &str, channel: &Pick, _time_axis: Option<u8>) -> Result<Series, Fault> {
        let place = self.place(part, channel)?;
        let object = &self.objects[place];
        let name = &object.path[1];
        let integers = |integers: Vec<i64>, bits| Series::of_integers(integers, bits);
        let mut series = match object.kind.unwrap_or(0) {
            0 => return Err(Fault::Empty),
            1 => integers(self.samples(place, |b| i8::from_le_bytes(b).into())?, 8),
            2 => integers(self.samples(place, |b| i16::from_le_bytes(b).into())?, 16),
            3 => integers(self.samples(place, |b| i32::from_le_bytes(b).into())?, 32),
            4 => integers(self.samples(place, i64::from_le_bytes)?, 64),
            9 | 0x19 => Series::of_floats(self.samples(place, f32::from_le_bytes)?)?,
            10 | 0x1a => Series::of_doubles(&self.samples(place, f64::from_le_bytes)?)?,
            kind => {
                return broken(format!(
                    "channel {name:?} holds {}; signed integers and floats are read",
                    kind_name(kind)
                ));
            }
        };
        if let Some(terms) = self.polynomial(place)? {
            let full_scale = series.full_scale;
            let scaled = |stored: f32| {
                let stored = f64::from(stored) * full_scale;
                terms.iter().rev().fold(0.0, |sum, term| sum * stored + term)
            };
            series = Series::of_doubles(&to_floats(&series.samples).into_iter().map(scaled).collect::<Vec<_>>())?;
        }
        let increment_s = self.number(place, "wf_increment").filter(|&s| s > 0.0);
        series.sample_rate_hz = increment_s.map(rate_of);
        series.unit = self.text(place, "unit_string").filter(|unit| !unit.is_empty()).map(str::to_owned);
        Ok(series)
    }
}

/// The rate of a time step: whole hertz if it equals them within the precision of a double.
fn rate_of(step_s: f64) -> f64 {
    let rate_hz = 1.0 / step_s;
    let whole = rate_hz.round();
    if ((whole - rate_hz) / rate_hz).abs() < 1e-12 { whole } else { rate_hz }
}
