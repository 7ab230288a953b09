//! The scales of a tap set: `scan.toml` gives them for all taps, `taps.csv` for one, and `calibration.toml` says since when.

use std::path::Path;

use tapline_wire::{Calibration, Channel, Unit};

use crate::Error;
use crate::config::calibration::{CALIBRATION_FILE, CalibrationFile, day_of};
use crate::config::refuse;
use crate::tap_set::extras::Extras;
use crate::tap_set::scan_toml::{FullScale, ScanToml};
use crate::tap_set::taps_csv::TapRow;

/// The scales of a set.
#[derive(Debug)]
pub(crate) struct Scales {
    file: CalibrationFile,
    /// For the whole set, by the channels of `scan.toml`; `None` if unknown, or given per tap.
    of_set: Vec<Option<FullScale>>,
    /// Unit of each channel.
    units: Vec<Unit>,
}

impl Scales {
    /// Those of the set in `dir`, with the `taps` that `taps_file` lists.
    pub(crate) fn read(dir: &Path, scan: &ScanToml, taps_file: &Path, taps: &[TapRow]) -> Result<Self, Error> {
        let path = dir.join(CALIBRATION_FILE);
        // A link that leads nowhere is one that should be there.
        let is_there = path.symlink_metadata().is_ok();
        let file = if is_there { CalibrationFile::read(&path)? } else { CalibrationFile::default() };
        let mut scales = Self { file, of_set: Vec::new(), units: Vec::new() };
        for &channel in &scan.channels {
            let certified = scales.file.of(channel).map(|scale| (scale.full_scale, scale.unit));
            if let (Some(stated), Some(certified)) = (scan.full_scale(channel), certified)
                && (stated.1 != certified.1 || (stated.0 / certified.0 - 1.0).abs() > 1e-9)
            {
                let bound = format!("{} {}, as in scan.toml", stated.0, stated.1.name());
                let value = format!("{} {}", certified.0, certified.1.name());
                refuse(&format!("{}.full_scale in {}", channel.name(), path.display()), value, &bound)?;
            }
            let of_set = scan.full_scale(channel).or(certified).or_else(|| scan.named_unit(channel));
            scales.units.push(unit_of(channel, of_set, taps_file, taps)?);
            scales.of_set.push(of_set);
        }
        Ok(scales)
    }

    /// Full scale of each channel of the tap with these `extras`; 1 if unknown.
    pub(crate) fn of_tap(&self, channels: &[Channel], extras: &Extras) -> Vec<f64> {
        let of = |(&channel, of_set): (&Channel, &Option<FullScale>)| {
            extras.full_scale(channel).or(*of_set).map_or(1.0, |(full_scale, _)| full_scale)
        };
        channels.iter().zip(&self.of_set).map(of).collect()
    }

    /// The calibration for the plan of `taps`.
    pub(crate) fn calibration<'a>(&self, channels: &[Channel], taps: impl Iterator<Item = &'a TapRow>) -> Calibration {
        let last_ns = taps.map(|tap| tap.extras.tap_time_ns).max().filter(|&time_ns| time_ns != 0);
        let mut calibration = self.file.calibration(None);
        calibration.tapped_on = last_ns.and_then(day_of);
        for channel in Channel::BOTH {
            match channels.iter().position(|&of_set| of_set == channel) {
                Some(place) => calibration.of_mut(channel).unit = self.units[place],
                None => *calibration.of_mut(channel) = Default::default(),
            }
        }
        calibration
    }
}

/// The unit of `channel`: every tap must be in it.
fn unit_of(channel: Channel, of_set: Option<FullScale>, taps_file: &Path, taps: &[TapRow]) -> Result<Unit, Error> {
    let recorded = || taps.iter().filter(|tap| tap.extras.refused.is_none());
    let stated = || recorded().filter_map(|tap| Some((tap, tap.extras.full_scale(channel)?.1)));
    let Some(unit) = of_set.map(|(_, unit)| unit).or_else(|| stated().next().map(|(_, unit)| unit)) else {
        return Ok(Unit::FullScale);
    };
    let is_same = |tap: &&TapRow| tap.extras.full_scale(channel).map_or(of_set.is_some(), |(_, other)| other == unit);
    match recorded().find(|tap| !is_same(tap)) {
        None => Ok(unit),
        Some(tap) => Err(Error::Cell {
            file: taps_file.to_owned(),
            line: tap.line,
            column: match tap.extras.full_scale(channel).map_or(unit, |(_, other)| other) {
                Unit::Pascal => "sound_full_scale_pa",
                Unit::Volt => "sound_full_scale_v",
                Unit::Newton | Unit::FullScale => "force_full_scale_n",
            },
            value: tap.extras.full_scale(channel).map_or_else(String::new, |(full_scale, _)| full_scale.to_string()),
            bound: match of_set {
                Some(_) => format!("a full scale in {}, the unit of the whole set", unit.name()),
                None => format!("a full scale in {}, as for the other taps", unit.name()),
            },
        }),
    }
}
