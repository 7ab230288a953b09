//! `truth.csv`: what other means (cutting, shearography) found in the casings that a plant has scanned.
//!
//! A row is a crack, or a shoulder that was inspected and is sound: its `location_count` is 0. A shoulder without a row was not
//! inspected.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use jiff::civil::Date;
use tapline_acquire::{Error, TableRow, columns_of, read_rows};
use tapline_wire::{Geometry, Serial};

/// Columns that the file must have.
const COLUMNS: &[&str] = &["tyre", "shoulder", "first_location", "location_count"];
/// Columns that it may have.
const OPTIONAL: &[&str] = &["size_mm", "scanned_on"];
/// Column that is ignored without a remark.
const NOTE: &str = "note";

/// Largest size of a crack: no casing is as large.
const SIZE_MAX_MM: f64 = 10_000.0;

/// A shoulder: the serial number of its casing, its side and, where its truth changes, the day from which on it is as it is.
pub(super) type Shoulder = (String, u16, Option<Date>);

/// A crack that was found by other means.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Crack {
    pub first_location: u32,
    pub location_count: u32,
    pub size_mm: Option<f64>,
    /// Its line in the file.
    line: usize,
}

/// A shoulder that was inspected.
#[derive(Debug, Clone, Default)]
pub(super) struct Inspected {
    /// The cracks found; none if it is sound.
    pub cracks: Vec<Crack>,
    /// First line of the file that names it.
    line: usize,
}

impl Inspected {
    /// With an archive's truth.
    pub(super) fn of_archive(cracks: Vec<Crack>) -> Self {
        Self { cracks, line: 0 }
    }
}

/// The shoulders that were inspected.
#[derive(Debug, Clone, Default)]
pub(super) struct KnownTruth {
    pub shoulders: BTreeMap<Shoulder, Inspected>,
    /// Shoulders that the file has, and none of the archives that were read.
    pub not_scanned: Vec<Shoulder>,
    /// Columns of the file that mean nothing here.
    pub ignored: Vec<&'static str>,
}

/// Where the locations of a shoulder lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Extent {
    pub geometry: Geometry,
    /// Least and greatest number of a location.
    pub first: u32,
    pub last: u32,
}

impl Extent {
    /// How many numbers there are.
    pub(super) fn count(self) -> u32 {
        (self.last - self.first).saturating_add(1)
    }
}

impl Crack {
    /// A crack whose size no file states.
    pub(super) fn of_archive(first_location: u32, location_count: u32) -> Self {
        Self { first_location, location_count, size_mm: None, line: 0 }
    }

    /// Whether `location` lies on its arc, which continues across the seam of a ring.
    pub(super) fn covers(&self, extent: Extent, location: u32) -> bool {
        let (first, count) = (self.first_location, extent.count());
        let ahead = if location >= first { location - first } else { count - (first - location) };
        ahead < self.location_count && (location >= first || extent.geometry == Geometry::Ring)
    }
}

impl KnownTruth {
    /// Reads `file`.
    ///
    /// # Errors
    /// A file that cannot be read, or the first error in it: its line, the value, and what it may be.
    pub(super) fn read(file: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
        Self::parse(file, &text)
    }

    /// A list of inspections has columns of its own: these are ignored. If one looks like a known column that is missing, it may be
    /// that column, misspelt.
    fn parse(file: &Path, text: &str) -> Result<Self> {
        let text = text.trim_start_matches('\u{feff}');
        let header = columns_of(text);
        let has = |known: &str| header.iter().any(|column| column == known);
        let is_misspelt = |column: &str| OPTIONAL.iter().any(|known| !has(known) && is_like(column, known));
        let is_other = |column: &&String| ![COLUMNS, OPTIONAL].concat().contains(&column.as_str());
        let others = header.iter().filter(is_other).filter(|column| !is_misspelt(column));
        // Columns are known by names that are never freed: these are few.
        let others: Vec<&'static str> = others.map(|column| &*column.clone().leak()).collect();
        let mut truth = Self::default();
        read_rows(file, text, (COLUMNS, &[OPTIONAL, &others].concat()), |row| {
            let (shoulder, crack) = read_row(row)?;
            let took = truth.take(shoulder, crack, row.line());
            took.with_context(|| format!("{} line {}", file.display(), row.line()))
        })?;
        let is_empty = truth.shoulders.is_empty();
        ensure!(!is_empty, "{}: it has no row; it must state at least one shoulder", file.display());
        truth.ignored = others.into_iter().filter(|&column| column != NOTE).collect();
        Ok(truth)
    }

    fn take(&mut self, shoulder: Shoulder, crack: Option<Crack>, line: usize) -> Result<()> {
        let what = format!("tyre {} shoulder {}", shoulder.0, shoulder.1);
        let Some(Inspected { cracks, line: first }) = self.shoulders.get_mut(&shoulder) else {
            self.shoulders.insert(shoulder, Inspected { cracks: crack.into_iter().collect(), line });
            return Ok(());
        };
        // A shoulder without cracks was stated to be sound.
        match (cracks.first(), crack) {
            (None, None) => bail!("{what} is stated to be sound twice; line {first} has it already"),
            (None, Some(_)) => bail!("{what} has a crack, and line {first} states that it is sound"),
            (Some(one), None) => bail!("{what} is stated to be sound, and line {} names a crack of it", one.line),
            (Some(_), Some(crack)) => {
                let arc = |c: &Crack| (c.first_location, c.location_count);
                if let Some(same) = cracks.iter().find(|c| arc(c) == arc(&crack)) {
                    let at = crack.first_location;
                    bail!("names the crack of {what} at location {at} again; line {} has it already", same.line);
                }
                cracks.push(crack);
            }
        }
        Ok(())
    }

    /// The last day from which on the truth of a shoulder holds that is not after `day`; `None` if there is none.
    pub(super) fn day_of(&self, tyre: &str, side: u16, day: Option<Date>) -> Option<Date> {
        let of_shoulder = self.shoulders.range((tyre.to_owned(), side, None)..);
        let of_shoulder = of_shoulder.map(|(key, _)| key).take_while(|key| key.0 == tyre && key.1 == side);
        of_shoulder.filter_map(|key| key.2).take_while(|&from| day.is_some_and(|day| from <= day)).last()
    }

    /// Leaves out the shoulders that are not in `scanned` and may be in an archive that was left out.
    pub(super) fn leave_out(
        &mut self,
        scanned: &BTreeMap<Shoulder, Extent>,
        may_be_left_out: impl Fn(&Shoulder) -> bool,
    ) {
        let is_out = |key: &Shoulder| !scanned.contains_key(key) && may_be_left_out(key);
        self.not_scanned = self.shoulders.keys().filter(|key| is_out(key)).cloned().collect();
        self.shoulders.retain(|key, _| !is_out(key));
    }

    /// Checks each row against the shoulders that were scanned.
    ///
    /// # Errors
    /// The first tyre, shoulder or location that was not scanned, or two cracks that share a location.
    pub(super) fn check(&self, scanned: &BTreeMap<Shoulder, Extent>) -> Result<()> {
        for (key, Inspected { cracks, line }) in &self.shoulders {
            let (tyre, shoulder, day) = key;
            let Some(extent) = scanned.get(key) else {
                let mut sides: Vec<u16> = scanned.keys().filter(|k| k.0 == *tyre).map(|k| k.1).collect();
                sides.dedup();
                let is_scanned = sides.contains(shoulder);
                let sides: Vec<String> = sides.iter().map(ToString::to_string).collect();
                match day {
                    _ if sides.is_empty() => bail!(
                        "line {line}: tyre {tyre:?} is in none of the archives, which have {} tyres",
                        tyres(scanned)
                    ),
                    Some(day) if is_scanned => bail!(
                        "line {line}: tyre {tyre} shoulder {shoulder}: scanned_on is {day}; no scan is of that day, or later and before \
                         its next scanned_on"
                    ),
                    None if is_scanned => {
                        bail!("line {line}: tyre {tyre} shoulder {shoulder}: no scan is before its first scanned_on")
                    }
                    _ => bail!(
                        "line {line}: tyre {tyre}: shoulder is {shoulder}; the archives have {}",
                        sides.join(" and ")
                    ),
                }
            };
            for (number, crack) in cracks.iter().enumerate() {
                crack
                    .check(*extent)
                    .with_context(|| format!("line {}: tyre {tyre} shoulder {shoulder}", crack.line))?;
                let shares = |other: &&Crack| {
                    (extent.first..=extent.last).any(|l| crack.covers(*extent, l) && other.covers(*extent, l))
                };
                if let Some(other) = cracks[..number].iter().find(shares) {
                    bail!(
                        "lines {} and {}: two cracks of tyre {tyre} shoulder {shoulder} share a location; make them one row",
                        other.line,
                        crack.line
                    );
                }
            }
        }
        Ok(())
    }
}

impl Crack {
    fn check(&self, extent: Extent) -> Result<()> {
        let (Extent { first, last, geometry }, count) = (extent, extent.count());
        let at = self.first_location;
        ensure!((first..=last).contains(&at), "first_location is {at}; it must lie in {first} to {last}");
        let most = if geometry == Geometry::Ring { count } else { last - at + 1 };
        ensure!(
            self.location_count <= most,
            "location_count is {}; from location {at} on it must be at most {most}",
            self.location_count
        );
        Ok(())
    }
}

/// Whether a column named `name` may be the column `known`, misspelt: but for case and signs it has the same letters, up to two.
fn is_like(name: &str, known: &str) -> bool {
    let letters = |text: &str| text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect();
    let (name, mut rest): (Vec<char>, Vec<char>) = (letters(name), letters(known));
    let before = rest.len();
    for letter in &name {
        if let Some(place) = rest.iter().position(|other| other == letter) {
            rest.swap_remove(place);
        }
    }
    rest.len() + name.len() - (before - rest.len()) <= 2
}

fn tyres(scanned: &BTreeMap<Shoulder, Extent>) -> usize {
    let mut tyres: Vec<&str> = scanned.keys().map(|(tyre, ..)| tyre.as_str()).collect();
    tyres.dedup();
    tyres.len()
}

/// The shoulder that `row` names, and its crack; `None` if it is sound.
fn read_row(row: &TableRow<'_>) -> Result<(Shoulder, Option<Crack>), Error> {
    let tyre = Serial::new(row.text("tyre")).map_err(|error| row.refuse("tyre", error.bound()))?;
    let side = row.needed("shoulder", 1, u32::from(u16::MAX))?;
    let day = row.text("scanned_on");
    let date = Date::strptime("%Y-%m-%d", day).ok();
    if date.is_none() && !day.is_empty() {
        return Err(row.refuse("scanned_on", "a day such as 2026-11-24, or empty"));
    }
    let shoulder = (tyre.to_string(), u16::try_from(side).unwrap_or(u16::MAX), date);
    let location_count = row.whole("location_count", 0, u32::MAX)?.ok_or_else(|| {
        let bound = "the number of cracked locations, or 0 for a shoulder that was inspected and is sound";
        row.refuse("location_count", bound)
    })?;
    if location_count == 0 {
        let stated = ["first_location", "size_mm"].into_iter().find(|column| !row.text(column).is_empty());
        let refused = stated.map(|column| row.refuse(column, "empty where location_count is 0 (sound)"));
        return refused.map_or(Ok((shoulder, None)), Err);
    }
    let size_mm = row.number("size_mm", (0.0, false), SIZE_MAX_MM)?;
    let first_location = row.needed("first_location", 0, u32::MAX)?;
    Ok((shoulder, Some(Crack { first_location, location_count, size_mm, line: row.line() })))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "tyre,shoulder,first_location,location_count,size_mm\n";

    fn parsed(text: &str) -> Result<KnownTruth> {
        KnownTruth::parse(Path::new("truth.csv"), text)
    }

    fn refusal(rows: &str) -> String {
        format!("{:#}", parsed(&format!("{HEAD}{rows}")).unwrap_err())
    }

    fn ring(last: u32) -> Extent {
        Extent { geometry: Geometry::Ring, first: 0, last }
    }

    /// Catches a sound shoulder that is assumed, a size that is needed, columns by place, and a crack that is lost.
    #[test]
    fn cracks_and_sound_shoulders_are_read() {
        let truth = parsed(&format!("\u{feff}{HEAD}A,1,98,4,12.5\nA,1,40,2,\nA,2,,0,\n")).unwrap();
        let cracked = &truth.shoulders[&("A".to_owned(), 1, None)];
        assert_eq!(cracked.cracks.iter().map(|c| c.size_mm).collect::<Vec<_>>(), [Some(12.5), None]);
        assert!(truth.shoulders[&("A".to_owned(), 2, None)].cracks.is_empty());
        assert_eq!(truth.shoulders.len(), 2);
        let turned = parsed("note,location_count,first_location,shoulder,tyre\ncut,3,7,2,B\n").unwrap();
        assert_eq!(turned.shoulders[&("B".to_owned(), 2, None)].cracks[0].first_location, 7);
    }

    /// Catches an arc that ends at the seam, one that goes over the end of a line, and rings that are numbered from 1.
    #[test]
    fn an_arc_goes_over_the_seam_of_a_ring() {
        let covered = |extent: Extent, first| -> Vec<u32> {
            let crack = Crack::of_archive(first, 3);
            (extent.first..=extent.last).filter(|&l| crack.covers(extent, l)).collect()
        };
        assert_eq!(covered(ring(9), 8), [0, 8, 9]);
        assert_eq!(covered(Extent { first: 1, ..ring(10) }, 10), [1, 2, 10]);
        assert_eq!(covered(Extent { geometry: Geometry::Line, ..ring(9) }, 7), [7, 8, 9]);
        assert_eq!(covered(Extent { geometry: Geometry::Line, ..ring(9) }, 8), [8, 9]);
    }

    /// Each names line, thing, value and bound.
    #[test]
    fn what_is_wrong_is_named() {
        for (rows, expected) in [
            ("A,1,3,2,-2\n", "line 2: size_mm is \"-2\"; it must be a number above 0 and at most 10000, or empty"),
            ("A,1,3,2,NaN\n", "line 2: size_mm is \"NaN\"; it must be a number above 0 and at most 10000, or empty"),
            ("A,0,3,2,\n", "line 2: shoulder is \"0\"; it must be a whole number from 1 to 65535"),
            ("A,1,-3,2,\n", "line 2: first_location is \"-3\"; it must be a whole number from 0 to 4294967295"),
            (
                "A,1,3,2,\nA,1,3,2,7\n",
                "line 3: names the crack of tyre A shoulder 1 at location 3 again; line 2 has it",
            ),
            ("A,1,,0,\nA,1,,0,\n", "line 3: tyre A shoulder 1 is stated to be sound twice; line 2 has it already"),
            ("A,1,,0,\nA,1,3,2,\n", "line 3: tyre A shoulder 1 has a crack, and line 2 states that it is sound"),
            ("A,1,3,2,\nA,1,,0,\n", "line 3: tyre A shoulder 1 is stated to be sound, and line 2 names a crack of it"),
            ("A,1,3,0,\n", "line 2: first_location is \"3\"; it must be empty where location_count is 0 (sound)"),
            ("A,1,,0,5\n", "line 2: size_mm is \"5\"; it must be empty where location_count is 0 (sound)"),
            ("A,1,,,\n", "0 for a shoulder that was inspected and is sound"),
            ("", "it has no row; it must state at least one shoulder"),
        ] {
            assert!(refusal(rows).contains(expected), "{rows}: {}", refusal(rows));
            assert!(refusal(rows).starts_with("truth.csv"), "{rows}: {}", refusal(rows));
        }
        let missing = format!("{:#}", parsed("tyre,shoulder,first_location\n").unwrap_err());
        assert!(missing.contains("truth.csv line 1: missing column \"location_count\""), "{missing}");
    }

    /// Catches a list of inspections that is refused for a column of its own, such a column that is taken for a known one or ignored
    /// in silence, and sizes that are lost because their column is misspelt.
    #[test]
    fn other_columns_are_ignored_unless_they_look_like_a_known_one() {
        let truth = parsed(
            "tyre;inspector;shoulder;result;first_location;location_count;size_mm;note\nA;Kim;1;cut;3;2;12,5;x\n",
        );
        let truth = truth.unwrap();
        assert_eq!(truth.ignored, ["inspector", "result"]);
        assert_eq!(truth.shoulders[&("A".to_owned(), 1, None)].cracks[0].size_mm, Some(12.5));
        for misspelt in ["size", "Size (mm)", "szie_mm", "SIZE_MM", "size_nm"] {
            let error = format!("{:#}", parsed(&HEAD.replace("size_mm", misspelt)).unwrap_err());
            let unknown = format!("truth.csv line 1: unknown column {misspelt:?}; the columns are tyre,");
            assert!(error.contains(&unknown) && error.contains(",size_mm"), "{error}");
        }
        // Beside the right one it is another.
        assert_eq!(parsed(&format!("size,{HEAD}9,A,1,3,2,7\n")).unwrap().ignored, ["size"]);
        let needed = format!("{:#}", parsed(&HEAD.replace("location_count", "locaton_count")).unwrap_err());
        assert!(needed.contains("missing column \"location_count\"; the columns are tyre,shoulder,"), "{needed}");
    }

    /// Catches rows of casings that were not scanned, and arcs outside of what was.
    #[test]
    fn rows_are_of_what_was_scanned() {
        let line = Extent { geometry: Geometry::Line, ..ring(9) };
        let scanned = [
            (("A".to_owned(), 1, None), ring(99)),
            (("A".to_owned(), 2, None), ring(99)),
            (("L".to_owned(), 1, None), line),
        ];
        let check = |rows: &str| {
            let truth = parsed(&format!("{HEAD}{rows}")).unwrap();
            truth.check(&scanned.clone().into()).map_err(|error| format!("{error:#}"))
        };
        assert_eq!(check("A,1,98,4,\nA,2,,0,\n"), Ok(()));
        for (rows, expected) in [
            ("B,1,,0,\n", "line 2: tyre \"B\" is in none of the archives, which have 2 tyres"),
            ("A,3,,0,\n", "line 2: tyre A: shoulder is 3; the archives have 1 and 2"),
            ("A,1,100,1,\n", "line 2: tyre A shoulder 1: first_location is 100; it must lie in 0 to 99"),
            ("A,1,5,101,\n", "location_count is 101; from location 5 on it must be at most 100"),
            ("L,1,8,3,\n", "location_count is 3; from location 8 on it must be at most 2"),
            ("A,1,5,4,\nA,1,8,1,\n", "lines 2 and 3: two cracks of tyre A shoulder 1 share a location"),
            ("A,1,98,4,\nA,1,1,1,\n", "lines 2 and 3: two cracks of tyre A shoulder 1 share a location"),
        ] {
            assert!(check(rows).unwrap_err().contains(expected), "{rows}: {:?}", check(rows));
        }
    }
}
