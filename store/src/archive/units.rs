//! Units of the tables: attributes of their datasets, written once and checked whenever an archive is opened.
//!
//! Each table has them twice: as one list for people, and field by field under `units_<field>` for programs.

use std::path::Path;

use hdf5::{Dataset, File};
use tapline_wire::{Calibration, Channel};

use crate::error::{Context, Error, Result};
use crate::format::layout::{NOTES, attribute, table, units_of};
use crate::h5::text::{read_text, write_text};

/// Writes `units`, a list as in [`NOTES`], as attributes of `dataset`; nothing if it is empty.
pub(crate) fn write_units(dataset: &Dataset, units: &str) -> hdf5::Result<()> {
    if units.is_empty() {
        return Ok(());
    }
    write_text(dataset, attribute::UNITS, units)?;
    by_field(units).try_for_each(|(name, unit)| write_text(dataset, &name, unit))
}

/// Checks that every table's numbers are in the units that its calibration states: a force in mN would go unnoticed in
/// ratios within one tyre, and be a thousand times that of another.
///
/// # Errors
/// [`Error::OtherUnits`] with the table and both units, or what the library returns.
pub(crate) fn check_units(file: &File, taps_file: &File, calibration: &Calibration, path: &Path) -> Result<()> {
    for (name, _, units) in NOTES.into_iter().filter(|(_, _, units)| !units.is_empty()) {
        let file = if name.starts_with(table::TAPS) { taps_file } else { file };
        let table = file.dataset(name).context("find a table", path)?;
        let units = units_of(name, units, calibration);
        for (attribute, known) in std::iter::once((attribute::UNITS.to_owned(), &*units)).chain(by_field(&units)) {
            let archived = read_text(&table, &attribute).unwrap_or_default();
            if archived != known {
                let known = known.to_owned();
                return Err(Error::OtherUnits { path: path.to_owned(), table: name, archived, known });
            }
        }
    }
    check_channels(taps_file, calibration, path)
}

/// Checks that each channel of `taps_file` is in its unit.
fn check_channels(taps_file: &File, calibration: &Calibration, path: &Path) -> Result<()> {
    let samples = taps_file.dataset(table::SAMPLES).context("find the samples", path)?;
    let [names, archived] =
        [attribute::CHANNELS, attribute::CHANNEL_UNITS].map(|name| read_text(&samples, name).unwrap_or_default());
    let mut units = archived.split(',');
    for name in names.split(',') {
        let channel = Channel::from_name(name);
        let known = channel.map_or("", |channel| calibration.unit(channel).name());
        let is_known = units.next() == Some(known);
        if !is_known {
            let known = known.to_owned();
            return Err(Error::OtherUnits { path: path.to_owned(), table: table::SAMPLES, archived, known });
        }
    }
    Ok(())
}

/// Attribute and unit of each field of the list `units`; none for the unit of a dataset of plain numbers.
fn by_field(units: &str) -> impl Iterator<Item = (String, &str)> {
    let fields = units.split(", ").filter_map(|field| field.split_once(' '));
    fields.map(|(field, unit)| (format!("{}{field}", attribute::UNITS_OF_FIELD), unit))
}

#[cfg(test)]
mod tests {
    use hdf5::types::FixedUnicode;

    use super::*;
    use crate::archive::create::create;
    use crate::testing::two_scans;

    /// Catches a unit of a field or of a channel that is not compared.
    #[test]
    fn other_units_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        create(&path, &two_scans(), 2, "".into()).unwrap();
        let file = File::open_rw(&path).unwrap();
        for (name, attribute, other) in [
            (table::DISCRIMINATORS, "units_f_max", "mN"),
            (table::HEADER, "units_sample_rate_hz", "kHz"),
            (table::SAMPLES, attribute::CHANNEL_UNITS, "N,mV"),
        ] {
            assert!(check_units(&file, &file, &two_scans().recording.calibration, &path).is_ok());
            let attribute = file.dataset(name).unwrap().attr(attribute).unwrap();
            let known: FixedUnicode<32> = attribute.read_scalar().unwrap();
            attribute.write_scalar(&other.parse::<FixedUnicode<32>>().unwrap()).unwrap();
            assert!(
                matches!(
                    check_units(&file, &file, &two_scans().recording.calibration, &path),
                    Err(Error::OtherUnits { .. })
                ),
                "{name} in {other}"
            );
            attribute.write_scalar(&known).unwrap();
        }
    }
}
