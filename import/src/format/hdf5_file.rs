//! HDF5 files, and MATLAB files of version 7.3, which are HDF5.

use std::path::Path;

use hdf5::types::{FloatSize, IntSize, TypeDescriptor, VarLenAscii, VarLenUnicode};
use hdf5::{Dataset, File, Group, H5Type, Location};
use ndarray::s;

use crate::error::{Fault, broken, some_of};
use crate::format::{
    Line, PRE_TRIGGER_NAME, Pick, RATE_NAMES, Recorded, TIME_AXIS_NAME, UNIT, UNIT_BOUND, line_of, picked_twice,
    place_of, stated_axis, whole,
};
use crate::series::{Series, checked_count};

/// Attributes that name a unit.
const UNIT_NAMES: [&str; 3] = ["unit", "units", "unit_string"];

/// Attributes of a variable that MATLAB wrote, and of an empty one.
const MATLAB_CLASS: &str = "MATLAB_class";
const MATLAB_EMPTY: &str = "MATLAB_empty";

/// Most characters of a unit.
const UNIT_CHARACTERS_MAX: usize = 64;

/// An HDF5 file.
#[derive(Debug)]
pub(crate) struct Hdf5File {
    file: File,
}

impl Hdf5File {
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let file = File::open(path).map_err(fault_of)?;
        Ok(Self { file })
    }

    /// The dataset of a channel, and the number of its line, if one is picked.
    fn dataset(&self, part: &str, channel: &Pick) -> Result<(Dataset, Option<usize>), Fault> {
        let line_of_part = part.parse::<usize>().ok().filter(|_| !has(&self.file, part));
        let group = match part {
            part if part.is_empty() || line_of_part.is_some() => self.file.as_group().map_err(fault_of)?,
            part => match self.file.dataset(part) {
                Ok(dataset) => {
                    return match channel {
                        Pick::Number(number) => Ok((dataset, Some(*number))),
                        Pick::Name(name) => broken(format!(
                            "part {part:?} is a dataset, which has no channel {name:?}: give channels by number"
                        )),
                    };
                }
                Err(_) if has(&self.file, part) => self.file.group(part).map_err(fault_of)?,
                Err(_) => {
                    let known = names(&self.file.as_group().map_err(fault_of)?)?;
                    let known = some_of(known.iter().map(String::as_str));
                    return Err(Fault::Missing { what: "part", name: format!("{part:?}"), known });
                }
            },
        };
        match channel {
            Pick::Name(name) if has(&group, name) => {
                let dataset = group.dataset(name);
                Ok((dataset.map_err(|_no_dataset| Fault::Broken(format!("{name:?} is not a dataset")))?, line_of_part))
            }
            Pick::Number(number) => {
                // The lines of the only dataset, or the datasets in the order of their names.
                let names = channels(&group)?;
                if names.len() == 1 && line_of_part.is_some() {
                    return Err(picked_twice(part));
                }
                let place = match names.len() {
                    1 => Some((0, Some(*number))),
                    _ => number.checked_sub(1).map(|place| (place, line_of_part)),
                };
                let found = place.and_then(|(place, line)| names.get(place).map(|name| (name, line)));
                let Some((name, line)) = found else { return Err(missing(channel, &names)) };
                Ok((group.dataset(name).map_err(fault_of)?, line))
            }
            Pick::Name(name) => {
                let names = channels(&group)?;
                let Some(place) = place_of(name, names.iter().map(String::as_str)) else {
                    return Err(missing(channel, &names));
                };
                Ok((group.dataset(&names[place]).map_err(fault_of)?, line_of_part))
            }
        }
    }

    /// The number that is called one of `names`: a scalar of the file or of the part, or an attribute of `of` or of the file.
    fn number(&self, part: &str, of: &Location, names: &[&str]) -> Option<f64> {
        let attribute = |place: &Location, name: &str| {
            let attribute = place.attr(name).ok()?;
            if attribute.size() == 1 { attribute.read_raw::<f64>().ok()?.first().copied() } else { None }
        };
        names.iter().find_map(|name| {
            let inner = if part.is_empty() { (*name).to_owned() } else { format!("{part}/{name}") };
            let scalar = [inner.as_str(), name].into_iter().find_map(|path| {
                let dataset = has(&self.file, path).then(|| self.file.dataset(path).ok()).flatten()?;
                if dataset.size() == 1 { dataset.read_raw::<f64>().ok()?.first().copied() } else { None }
            });
            let group = self.file.group(part).ok();
            let of_group = || group.as_deref().and_then(|group| attribute(group, name));
            attribute(of, name).or_else(of_group).or(scalar).or_else(|| attribute(&self.file, name))
        })
    }
}

impl Hdf5File {
    /// The text beside a variable that MATLAB wrote, as `force_unit` beside `force`: 16-bit characters.
    fn matlab_unit(&self, dataset: &Dataset) -> Result<Option<String>, Fault> {
        let path = format!("{}{UNIT}", dataset.name());
        if dataset.attr(MATLAB_CLASS).is_err() || !has(&self.file, &path) {
            return Ok(None);
        }
        let unit = self.file.dataset(&path).map_err(fault_of)?;
        // An empty text is written as the lengths of its axes.
        if unit.attr(MATLAB_EMPTY).is_ok() || unit.size() == 0 {
            return Ok(None);
        }
        let kind = unit.dtype().and_then(|kind| kind.to_descriptor()).map_err(fault_of)?;
        if kind != TypeDescriptor::Unsigned(IntSize::U2) || unit.size() > UNIT_CHARACTERS_MAX {
            return broken(format!("{path:?} is no short text; {UNIT_BOUND}"));
        }
        let unit = String::from_utf16_lossy(&unit.read_raw::<u16>().map_err(fault_of)?);
        Ok(Some(unit.trim().to_owned()).filter(|unit| !unit.is_empty()))
    }
}

fn has(group: &Group, path: &str) -> bool {
    // The library requires that each step of a path exists before the next is looked up.
    let mut upto = String::new();
    path.trim_matches('/').split('/').all(|step| {
        upto = if upto.is_empty() { step.to_owned() } else { format!("{upto}/{step}") };
        !step.is_empty() && group.link_exists(&upto)
    })
}

fn fault_of(error: hdf5::Error) -> Fault {
    let text = error.to_string();
    Fault::Broken(format!("is not valid HDF5: {}", text.lines().next().unwrap_or_default()))
}

fn missing(channel: &Pick, known: &[String]) -> Fault {
    Fault::Missing { what: "channel", name: channel.to_string(), known: some_of(known.iter().map(String::as_str)) }
}

fn names(group: &Group) -> Result<Vec<String>, Fault> {
    let mut names = group.member_names().map_err(fault_of)?;
    names.sort();
    Ok(names)
}

/// Names of the datasets of a group that are no scalars.
fn channels(group: &Group) -> Result<Vec<String>, Fault> {
    let is_unit = |name: &str, dataset: &Dataset| name.ends_with(UNIT) && dataset.attr(MATLAB_CLASS).is_ok();
    let is_channel =
        |name: &String| group.dataset(name).is_ok_and(|dataset| dataset.size() > 1 && !is_unit(name, &dataset));
    Ok(names(group)?.into_iter().filter(is_channel).collect())
}

impl Recorded for Hdf5File {
    fn parts(&self, depth: usize) -> Result<Vec<String>, Fault> {
        let mut found = vec![String::new()];
        for _ in 0..depth {
            let mut deeper = Vec::new();
            for part in &found {
                let Ok(group) = self.file.group(if part.is_empty() { "/" } else { part }) else { continue };
                let below = names(&group)?;
                deeper.extend(
                    below.into_iter().map(|name| if part.is_empty() { name } else { format!("{part}/{name}") }),
                );
            }
            found = deeper;
        }
        Ok(found)
    }

    fn series(&mut self, part: &str, channel: &Pick, time_axis: Option<u8>) -> Result<Series, Fault> {
        let (dataset, number) = self.dataset(part, channel)?;
        let mut shape: Vec<u64> = dataset.shape().iter().map(|&n| n as u64).collect();
        // MATLAB keeps columns together, HDF5 rows: what MATLAB wrote is turned, so that its axes are those of other versions.
        let is_turned = shape.len() == 2 && dataset.attr(MATLAB_CLASS).is_ok();
        if is_turned {
            shape.reverse();
        }
        let stated = || self.number(part, &dataset, &[TIME_AXIS_NAME]).and_then(stated_axis);
        let mut line = line_of(&shape, number, time_axis.or_else(stated))?;
        if is_turned {
            line.time_axis = 1 - line.time_axis;
        }
        checked_count(line.sample_count)?;
        let kind = dataset.dtype().and_then(|kind| kind.to_descriptor()).map_err(fault_of)?;
        let mut series = match kind {
            TypeDescriptor::Integer(IntSize::U1) => integers::<i8>(&dataset, line, 8)?,
            TypeDescriptor::Integer(IntSize::U2) => integers::<i16>(&dataset, line, 16)?,
            TypeDescriptor::Integer(IntSize::U4) => integers::<i32>(&dataset, line, 32)?,
            TypeDescriptor::Integer(IntSize::U8) => integers::<i64>(&dataset, line, 64)?,
            TypeDescriptor::Float(FloatSize::U4) => Series::of_floats(read(&dataset, line)?)?,
            TypeDescriptor::Float(FloatSize::U8) => Series::of_doubles(&read(&dataset, line)?)?,
            other => {
                return broken(format!(
                    "channel {channel} holds values of type {other}; signed integers and floats are read"
                ));
            }
        };
        series.sample_rate_hz = self.number(part, &dataset, &RATE_NAMES);
        series.pre_trigger_samples = self.number(part, &dataset, &[PRE_TRIGGER_NAME]).and_then(whole);
        series.unit = UNIT_NAMES.iter().find_map(|name| text(&dataset, name));
        if series.unit.is_none() {
            series.unit = self.matlab_unit(&dataset)?;
        }
        Ok(series)
    }
}

fn integers<T: H5Type + Clone + Into<i64>>(dataset: &Dataset, line: Line, bits: u32) -> Result<Series, Fault> {
    Ok(Series::of_integers(read::<T>(dataset, line)?.into_iter().map(Into::into), bits))
}

/// The samples of a line of a dataset.
fn read<T: H5Type + Clone>(dataset: &Dataset, line: Line) -> Result<Vec<T>, Fault> {
    let Line { time_axis, place, sample_count } = line;
    let read = match (dataset.ndim(), time_axis) {
        (1, _) => dataset.read_raw(),
        (_, 0) => dataset.read_slice_1d(s![.., place]).map(|samples| samples.to_vec()),
        _ => dataset.read_slice_1d(s![place, ..]).map(|samples| samples.to_vec()),
    };
    let samples = read.map_err(fault_of)?;
    if samples.len() as u64 != sample_count {
        return broken(format!("{} has {} samples where its shape has {sample_count}", dataset.name(), samples.len()));
    }
    Ok(samples)
}

/// The attribute `name`, if it is text.
fn text(place: &Location, name: &str) -> Option<String> {
    let attribute = place.attr(name).ok()?;
    let unicode = attribute.read_scalar::<VarLenUnicode>().map(|text| text.to_string());
    unicode.or_else(|_| attribute.read_scalar::<VarLenAscii>().map(|text| text.to_string())).ok()
}
