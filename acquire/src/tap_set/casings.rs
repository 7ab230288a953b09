//! The casings of a tap set, and their stations.

use std::collections::HashMap;
use std::path::Path;

use tapline_wire::{Geometry, Serial, digest_of_parts};

use crate::Error;
use crate::config::within;
use crate::tap_set::recordings::Recordings;

/// A casing of a set, or a whole slab, with the taps of one plan.
#[derive(Debug, Clone)]
pub(crate) struct SetCasing {
    /// Its serial, or for a slab the name of its folder.
    pub name: String,
    pub station: u16,
    /// Its rows of the set, ascending.
    pub rows: Vec<u32>,
}

/// The casings of `set` in order of first appearance, at the stations that the list names. Those without a station go
/// to stations 1, 2, ... in turn.
pub(crate) fn casings_of(set: &Recordings, station_count: u16) -> Result<Vec<SetCasing>, Error> {
    within("stations", station_count, 1..=u16::MAX)?;
    let is_slab = set.scan.geometry == Geometry::Line;
    let mut casings: Vec<SetCasing> = Vec::new();
    // For each casing, its station in the list, and the line that names it.
    let mut named: Vec<Option<(u16, usize)>> = Vec::new();
    let mut number_of: HashMap<Serial, usize> = HashMap::new();
    for (number, row) in (0..).zip(&set.taps) {
        let key = if is_slab { Serial::default() } else { row.tap.id.tyre };
        let place = *number_of.entry(key).or_insert_with(|| {
            let name = if is_slab { folder_name(&set.dir) } else { key.to_string() };
            casings.push(SetCasing { name, station: 0, rows: Vec::new() });
            named.push(None);
            casings.len() - 1
        });
        casings[place].rows.push(number);
        let here = row.extras.station.map(|station| (station, row.line));
        match (named[place], here) {
            (Some(first), Some(second)) if first.0 != second.0 => {
                let what = if is_slab { "this slab".to_owned() } else { format!("tyre {key}") };
                return Err(Error::TwoStations { file: set.taps_file(), what, first, second });
            }
            (None, Some(_)) => named[place] = here,
            _ => {}
        }
    }
    let mut last = station_count;
    for (casing, named) in casings.iter_mut().zip(named) {
        casing.station = named.map_or_else(
            || {
                last = if last >= station_count { 1 } else { last + 1 };
                last
            },
            |(station, _)| station,
        );
    }
    Ok(casings)
}

/// Longest name of a slab; it becomes part of file names.
const FOLDER_NAME_BYTES_MAX: usize = 64;

/// The name of the folder `dir`, shortened if it is too long.
fn folder_name(dir: &Path) -> String {
    let whole = std::fs::canonicalize(dir).unwrap_or_else(|_| dir.to_owned());
    let name = whole.file_name().map_or_else(|| "slab".to_owned(), |name| name.to_string_lossy().into_owned());
    let mut cut = name.clone();
    cut.truncate(name.floor_char_boundary(FOLDER_NAME_BYTES_MAX));
    // The digest distinguishes two long names with the same beginning.
    if cut == name { name } else { format!("{cut}~{:08x}", digest_of_parts([name.as_bytes()]) >> 32) }
}
