//! `truth.csv`: what other means (cutting, shearography) found in the casings that a plant has scanned.
//!
//! A row is a crack, or a shoulder that was inspected and is sound: its `location_count` is 0. A shoulder without a row was not
//! inspected.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, Result, anyhow, bail, ensure};
use csv::StringRecord;
use tapline_wire::{Geometry, Serial};

/// Columns that the file must have.
const COLUMNS: [&str; 4] = ["tyre", "shoulder", "first_location", "location_count"];
/// Columns that it may have.
const OPTIONAL: [&str; 2] = ["size_mm", "note"];

/// A shoulder: the serial number of its casing, and its side.
pub(super) type Shoulder = (String, u16);

/// A crack that was found by other means.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Crack {
    pub first_location: u32,
    pub location_count: u32,
    pub size_mm: Option<f64>,
    /// Line of the file it stands on.
    line: u64,
}

/// A shoulder that was inspected.
#[derive(Debug, Clone, Default)]
pub(super) struct Inspected {
    /// What was found; of a sound shoulder nothing.
    pub cracks: Vec<Crack>,
    /// First line of the file that names it.
    line: u64,
}

impl Inspected {
    /// As an archive knows it.
    pub(super) fn of_archive(cracks: Vec<Crack>) -> Self {
        Self { cracks, line: 0 }
    }
}

/// The shoulders that were inspected.
#[derive(Debug, Clone, Default)]
pub(super) struct KnownTruth {
    pub shoulders: BTreeMap<Shoulder, Inspected>,
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
    /// A crack of which no file tells the size.
    pub(super) fn of_archive(first_location: u32, location_count: u32) -> Self {
        Self { first_location, location_count, size_mm: None, line: 0 }
    }

    /// Whether `location` lies on its arc, which goes on over the seam of a ring.
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
    /// A file that cannot be read, or the first thing in it that is wrong: its line, what it is, and what it may be.
    pub(super) fn read(file: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
        Self::parse(&text).with_context(|| file.display().to_string())
    }

    fn parse(text: &str) -> Result<Self> {
        let text = text.trim_start_matches('\u{feff}');
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
        let header = reader.headers()?.clone();
        check_header(&header)?;
        let (mut truth, mut sound_at) = (Self::default(), BTreeMap::new());
        for record in reader.records() {
            let record = record?;
            let line = record.position().map_or(0, csv::Position::line);
            let row = Row { header: &header, record: &record };
            let took = truth.take(&row, line, &mut sound_at);
            took.with_context(|| format!("line {line}"))?;
        }
        ensure!(!truth.shoulders.is_empty(), "it has no row; it must state at least one shoulder");
        Ok(truth)
    }

    fn take(&mut self, row: &Row<'_>, line: u64, sound_at: &mut BTreeMap<Shoulder, u64>) -> Result<()> {
        let tyre = Serial::new(row.text("tyre")).map_err(|error| row.refused("tyre", &error.bound()))?;
        let shoulder = row.whole("shoulder", 1, u32::from(u16::MAX))?;
        let key = (tyre.to_string(), u16::try_from(shoulder).unwrap_or(u16::MAX));
        let what = format!("tyre {tyre} shoulder {shoulder}");
        let location_count = match row.text("location_count") {
            "" => bail!(
                "location_count is empty; it must be the number of cracked locations, or 0 for a shoulder that was inspected \
                 and is sound"
            ),
            _ => row.whole("location_count", 0, u32::MAX)?,
        };
        let size_mm = row.size_mm()?;
        let cracks = &mut self.shoulders.entry(key.clone()).or_insert(Inspected { cracks: Vec::new(), line }).cracks;
        if location_count == 0 {
            for (column, value) in [("first_location", row.text("first_location")), ("size_mm", row.text("size_mm"))] {
                ensure!(value.is_empty(), "{column} is {value:?}; it must be empty where location_count is 0 (sound)");
            }
            if let Some(first) = sound_at.insert(key, line) {
                bail!("{what} is stated to be sound twice; line {first} has it already");
            }
            ensure!(cracks.is_empty(), "{what} is stated to be sound, and line {} has a crack of it", cracks[0].line);
            return Ok(());
        }
        if let Some(first) = sound_at.get(&key) {
            bail!("{what} has a crack, and line {first} states that it is sound");
        }
        let first_location = row.whole("first_location", 0, u32::MAX)?;
        let crack = Crack { first_location, location_count, size_mm, line };
        let is_same = |c: &&Crack| (c.first_location, c.location_count) == (first_location, location_count);
        if let Some(same) = cracks.iter().find(is_same) {
            bail!("names the crack of {what} at location {first_location} again; line {} has it already", same.line);
        }
        cracks.push(crack);
        Ok(())
    }

    /// Checks each row against the shoulders that were scanned.
    ///
    /// # Errors
    /// The first tyre, shoulder or location that was not, or two cracks that share a location.
    pub(super) fn check(&self, scanned: &BTreeMap<Shoulder, Extent>) -> Result<()> {
        for ((tyre, shoulder), Inspected { cracks, line }) in &self.shoulders {
            let Some(extent) = scanned.get(&(tyre.clone(), *shoulder)) else {
                let sides: Vec<String> = scanned.keys().filter(|k| k.0 == *tyre).map(|k| k.1.to_string()).collect();
                match sides.is_empty() {
                    true => bail!(
                        "line {line}: tyre {tyre:?} is in none of the archives, which have {} tyres",
                        tyres(scanned)
                    ),
                    false => bail!(
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

fn tyres(scanned: &BTreeMap<Shoulder, Extent>) -> usize {
    let mut tyres: Vec<&str> = scanned.keys().map(|(tyre, _)| tyre.as_str()).collect();
    tyres.dedup();
    tyres.len()
}

fn check_header(header: &StringRecord) -> Result<()> {
    for column in COLUMNS {
        ensure!(
            header.iter().any(|name| name == column),
            "line 1: missing column {column:?}; the columns are {}, and optional {}",
            COLUMNS.join(","),
            OPTIONAL.join(",")
        );
    }
    for (place, name) in header.iter().enumerate() {
        let is_known = COLUMNS.contains(&name) || OPTIONAL.contains(&name);
        ensure!(is_known, "line 1: column {name:?} is none of {},{}", COLUMNS.join(","), OPTIONAL.join(","));
        ensure!(!header.iter().take(place).any(|n| n == name), "line 1: column {name:?} is there twice");
    }
    Ok(())
}

/// One row of the file.
struct Row<'a> {
    header: &'a StringRecord,
    record: &'a StringRecord,
}

impl<'a> Row<'a> {
    fn text(&self, column: &str) -> &'a str {
        self.header.iter().position(|name| name == column).and_then(|k| self.record.get(k)).unwrap_or("")
    }

    fn refused(&self, column: &str, bound: &str) -> anyhow::Error {
        anyhow!("{column} is {:?}; it must be {bound}", self.text(column))
    }

    fn whole(&self, column: &str, low: u32, high: u32) -> Result<u32> {
        let value = self.text(column).parse().ok().filter(|value| (low..=high).contains(value));
        value.ok_or_else(|| self.refused(column, &format!("a whole number from {low} to {high}")))
    }

    fn size_mm(&self) -> Result<Option<f64>> {
        let text = self.text("size_mm");
        if text.is_empty() {
            return Ok(None);
        }
        let value = text.parse().ok().filter(|size: &f64| size.is_finite() && *size > 0.0);
        value.map(Some).ok_or_else(|| self.refused("size_mm", "a number above 0, in mm, or empty"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "tyre,shoulder,first_location,location_count,size_mm\n";

    fn refusal(rows: &str) -> String {
        format!("{:#}", KnownTruth::parse(&format!("{HEAD}{rows}")).unwrap_err())
    }

    fn ring(last: u32) -> Extent {
        Extent { geometry: Geometry::Ring, first: 0, last }
    }

    /// Catches a sound shoulder that is assumed, a size that is needed, columns by place, and a crack that is lost.
    #[test]
    fn cracks_and_sound_shoulders_are_read() {
        let truth = KnownTruth::parse(&format!("\u{feff}{HEAD}A,1,98,4,12.5\nA,1,40,2,\nA,2,,0,\n")).unwrap();
        let cracked = &truth.shoulders[&("A".to_owned(), 1)];
        assert_eq!(cracked.cracks.iter().map(|c| c.size_mm).collect::<Vec<_>>(), [Some(12.5), None]);
        assert!(truth.shoulders[&("A".to_owned(), 2)].cracks.is_empty());
        assert_eq!(truth.shoulders.len(), 2);
        let turned = KnownTruth::parse("note,location_count,first_location,shoulder,tyre\ncut,3,7,2,B\n").unwrap();
        assert_eq!(turned.shoulders[&("B".to_owned(), 2)].cracks[0].first_location, 7);
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
            ("A,1,3,2,-2\n", "line 2: size_mm is \"-2\"; it must be a number above 0, in mm, or empty"),
            ("A,1,3,2,NaN\n", "line 2: size_mm is \"NaN\"; it must be a number above 0, in mm, or empty"),
            ("A,0,3,2,\n", "line 2: shoulder is \"0\"; it must be a whole number from 1 to 65535"),
            ("A,1,-3,2,\n", "line 2: first_location is \"-3\"; it must be a whole number from 0 to 4294967295"),
            (
                "A,1,3,2,\nA,1,3,2,7\n",
                "line 3: names the crack of tyre A shoulder 1 at location 3 again; line 2 has it",
            ),
            ("A,1,,0,\nA,1,,0,\n", "line 3: tyre A shoulder 1 is stated to be sound twice; line 2 has it already"),
            ("A,1,,0,\nA,1,3,2,\n", "line 3: tyre A shoulder 1 has a crack, and line 2 states that it is sound"),
            ("A,1,3,2,\nA,1,,0,\n", "line 3: tyre A shoulder 1 is stated to be sound, and line 2 has a crack of it"),
            ("A,1,3,0,\n", "line 2: first_location is \"3\"; it must be empty where location_count is 0 (sound)"),
            ("A,1,,0,5\n", "line 2: size_mm is \"5\"; it must be empty where location_count is 0 (sound)"),
            ("A,1,,,\n", "0 for a shoulder that was inspected and is sound"),
            ("", "it has no row; it must state at least one shoulder"),
        ] {
            assert!(refusal(rows).contains(expected), "{rows}: {}", refusal(rows));
        }
        let missing = format!("{:#}", KnownTruth::parse("tyre,shoulder,first_location\n").unwrap_err());
        assert!(missing.contains("missing column \"location_count\""), "{missing}");
        let unknown = format!("{:#}", KnownTruth::parse(&HEAD.replace("size_mm", "size")).unwrap_err());
        assert!(unknown.contains("column \"size\" is none of"), "{unknown}");
    }

    /// Catches rows of casings that were not scanned, and arcs outside of what was.
    #[test]
    fn rows_are_of_what_was_scanned() {
        let line = Extent { geometry: Geometry::Line, ..ring(9) };
        let scanned = [(("A".to_owned(), 1), ring(99)), (("A".to_owned(), 2), ring(99)), (("L".to_owned(), 1), line)];
        let check = |rows: &str| {
            let truth = KnownTruth::parse(&format!("{HEAD}{rows}")).unwrap();
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
