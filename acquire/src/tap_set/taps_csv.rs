//! `taps.csv`: the tap of each recording.

use std::collections::{BTreeMap, HashMap};
use std::path::{Component, Path, PathBuf};

use tapline_wire::{Geometry, IdError, PlannedTap, Purpose, Serial, TapId, csv_text};

use crate::Error;
use crate::tap_set::extras::{self, Extras, MEASURED};
use crate::tap_set::table::{Row, read_rows};

const COLUMNS: &[&str] =
    &["file", "tyre", "shoulder", "offset_mm", "velocity_m_per_s", "location", "angle_deg", "repetition"];

/// Columns of `taps.csv` that hold text; all others hold numbers.
pub const TEXT_COLUMNS: [&str; 4] = ["file", "tyre", "purpose", "refused"];

/// All columns of `taps.csv`.
pub fn tap_columns() -> Vec<&'static str> {
    [COLUMNS, extras::COLUMNS].concat()
}

/// Largest location; far above any scan, and one more is still a number.
pub(crate) const LOCATION_MAX: u32 = 999_999;

/// Locations of a full turn (section 4 of the method); without angles, location 100 of a ring is location 0 again.
const TURN_LOCATIONS: u32 = 100;

/// Largest error of an angle that means a full turn; far below the 3.6 degrees between locations.
const ANGLE_ROUNDING_DEG: f64 = 0.01;

/// One row of the list.
#[derive(Debug, Clone, PartialEq)]
pub struct TapRow {
    /// Line of the file, from 1.
    pub line: usize,
    /// Path of the recording, relative to the set's folder; empty if the list says why there is none.
    pub file: String,
    /// The tap; at station 0 if the list names none.
    pub tap: PlannedTap,
    /// Measured velocity; in a tap set without a column for it, the only velocity.
    pub velocity_measured_m_per_s: Option<f64>,
    /// The values of the optional columns.
    pub extras: Extras,
}

/// Reads the `text` of `file`.
pub(crate) fn parse(file: &Path, text: &str, geometry: Geometry) -> Result<Vec<TapRow>, Error> {
    let mut rows = tap_rows(file, text, geometry)?;
    // A list with one velocity says how fast each tap was.
    if !text.lines().find(|line| !line.trim().is_empty()).is_some_and(|header| header.contains(MEASURED)) {
        rows.iter_mut().for_each(|row| row.velocity_measured_m_per_s = row.tap.id.velocity_m_per_s());
    }
    refuse_shared_recordings(file, &rows)?;
    Ok(rows)
}

/// The taps listed in `text`, a table with the columns of `taps.csv`; one recording may hold several.
///
/// # Errors
/// [`Error`] with the line and column of `file` for the first cell out of bounds, and for a tap that is listed twice.
pub fn tap_rows(file: &Path, text: &str, geometry: Geometry) -> Result<Vec<TapRow>, Error> {
    let mut rows = Vec::new();
    read_rows(file, text, (COLUMNS, extras::COLUMNS), |row| -> Result<(), Error> {
        rows.push(tap_row(row, geometry)?);
        Ok(())
    })?;
    if rows.is_empty() {
        return Err(Error::NoRows { file: file.to_owned() });
    }
    if geometry == Geometry::Ring {
        mark_closing_taps(&mut rows);
        refuse_turning_angles(file, &rows)?;
    }
    refuse_duplicates(file, &rows)?;
    Ok(rows)
}

fn tap_row(row: &Row<'_>, geometry: Geometry) -> Result<TapRow, Error> {
    // A ring is a shoulder of a casing, and a casing has two; a slab may have any number of lines.
    let shoulder_max = if geometry == Geometry::Ring { 2 } else { u16::MAX };
    let velocity_m_per_s = row.number("velocity_m_per_s", (0.0, false), 1000.0)?;
    let velocity_measured_m_per_s = row.number(MEASURED, (0.0, true), 1000.0)?;
    let mut id = TapId::default()
        .with_offset_mm(row.number("offset_mm", (-2000.0, true), 2000.0)?)
        .map_err(|e| refuse_id(row, "offset_mm", &e))?
        .with_velocity_m_per_s(velocity_m_per_s)
        .map_err(|e| refuse_id(row, "velocity_m_per_s", &e))?;
    id.tyre = Serial::new(csv_text(row.text("tyre"))).map_err(|e| refuse_id(row, "tyre", &e))?;
    id.shoulder = row.needed("shoulder", 1, shoulder_max)?;
    id.location = row.needed("location", 0, LOCATION_MAX)?;
    id.repetition = row.whole("repetition", 0, u16::MAX)?.unwrap_or(0);
    let angle_deg = row.number("angle_deg", (0.0, true), 360.0)?;
    let extras = Extras::from_row(row, geometry)?;
    id.station = extras.station.unwrap_or(0);
    // A tap that is known to have no recording needs no file name.
    let is_nameless = extras.refused.is_some() && row.text("file").is_empty();
    Ok(TapRow {
        line: row.line(),
        file: if is_nameless { String::new() } else { file_name(row)? },
        tap: PlannedTap { id, angle_deg, purpose: Purpose::Scan },
        velocity_measured_m_per_s,
        extras,
    })
}

fn refuse_id(row: &Row<'_>, column: &'static str, error: &IdError) -> Error {
    row.refuse(column, error.bound())
}

/// The recording's path. It must stay in the set's folder, because a set may come from a stranger.
fn file_name(row: &Row<'_>) -> Result<String, Error> {
    let text = csv_text(row.text("file"));
    let is_inside = Path::new(text).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if text.is_empty() || text.contains('\0') || !is_inside {
        return Err(row.refuse("file", "the path of a WAV below the folder of the set, without '..'"));
    }
    Ok(text.to_owned())
}

/// Finds the taps that close a ring, and gives each the number of the ring's locations.
fn mark_closing_taps(rows: &mut [TapRow]) {
    #[derive(Default)]
    struct Ring {
        has_first: bool,
        location_max: u32,
        open_max: Option<u32>,
    }
    let mut rings: HashMap<(Serial, u16), Ring> = HashMap::new();
    for row in &*rows {
        let ring = rings.entry((row.tap.id.tyre, row.tap.id.shoulder)).or_default();
        ring.has_first |= row.tap.id.location == 0;
        ring.location_max = ring.location_max.max(row.tap.id.location);
    }
    for row in &mut *rows {
        let Some(ring) = rings.get_mut(&(row.tap.id.tyre, row.tap.id.shoulder)) else { continue };
        let location = row.tap.id.location;
        row.tap.purpose = match (row.extras.purpose, row.tap.angle_deg) {
            (Some(purpose), _) => purpose,
            // A program that rounds may write 360 as a little less.
            (None, Some(angle_deg)) => Purpose::closing_if(angle_deg > 360.0 - ANGLE_ROUNDING_DEG),
            // Locations may be counted from 1, or be more than 100; then location 100 is like the others.
            (None, None) => {
                Purpose::closing_if(location == TURN_LOCATIONS && ring.location_max == TURN_LOCATIONS && ring.has_first)
            }
        };
        if !row.tap.is_closing() {
            ring.open_max = ring.open_max.max(Some(location));
        }
    }
    for row in rows.iter_mut().filter(|r| r.tap.is_closing()) {
        let open_max = rings.get(&(row.tap.id.tyre, row.tap.id.shoulder)).and_then(|r| r.open_max);
        // The closing tap may be listed as location 0 again, and would then have the identity of the first.
        if let Some(open_max) = open_max
            && row.tap.id.location <= open_max
        {
            row.tap.id.location = open_max + 1;
        }
    }
}

/// Refuses a shoulder whose angles do not go around once as its locations ascend: the ends of its damage would be reported
/// wrongly.
fn refuse_turning_angles(file: &Path, rows: &[TapRow]) -> Result<(), Error> {
    let mut shoulders: BTreeMap<(Serial, u16), BTreeMap<u32, (f64, usize)>> = BTreeMap::new();
    for row in rows.iter().filter(|row| !row.tap.is_closing()) {
        if let Some(angle_deg) = row.tap.angle_deg {
            let shoulder = shoulders.entry((row.tap.id.tyre, row.tap.id.shoulder)).or_default();
            shoulder.entry(row.tap.id.location).or_insert((angle_deg, row.line));
        }
    }
    for shoulder in shoulders.values() {
        let mut around_deg = 0.0;
        let last = shoulder.keys().next_back();
        for ((before, (from_deg, _)), (location, (to_deg, line))) in shoulder.iter().zip(shoulder.iter().skip(1)) {
            around_deg += (to_deg - from_deg).rem_euclid(360.0);
            // Rounded angles of neighbours may be the same, but not all of them.
            let is_all_same = Some(location) == last && around_deg <= 0.0;
            if around_deg > 360.0 || is_all_same {
                return Err(Error::Cell {
                    file: file.to_owned(),
                    line: *line,
                    column: "angle_deg",
                    value: to_deg.to_string(),
                    bound: format!(
                        "an angle clockwise of {from_deg}, that of location {before}, and before that of the first: locations are numbered \
                         clockwise, once around"
                    ),
                });
            }
        }
    }
    Ok(())
}

fn refuse_duplicates(file: &Path, rows: &[TapRow]) -> Result<(), Error> {
    let mut line_of = HashMap::with_capacity(rows.len());
    for row in rows {
        if let Some(first) = line_of.insert(row.tap.id, row.line) {
            return Err(Error::Duplicate { file: file.to_owned(), what: name_of(row), first, second: row.line });
        }
    }
    Ok(())
}

/// Refuses a recording that two taps share, also if its paths differ in spelling.
fn refuse_shared_recordings(file: &Path, rows: &[TapRow]) -> Result<(), Error> {
    let mut line_of = HashMap::with_capacity(rows.len());
    for row in rows.iter().filter(|row| !row.file.is_empty()) {
        let plain: PathBuf = Path::new(&row.file).components().filter(|c| *c != Component::CurDir).collect();
        if let Some(first) = line_of.insert(plain, row.line) {
            let what = format!("the recording {}", row.file);
            return Err(Error::Duplicate { file: file.to_owned(), what, first, second: row.line });
        }
    }
    Ok(())
}

/// The tap as the list identifies it, without station and attempt.
fn name_of(row: &TapRow) -> String {
    let TapId { tyre, shoulder, location, repetition, .. } = row.tap.id;
    let or_unknown = |value: Option<f64>| value.map_or_else(|| "unknown".to_owned(), |v| v.to_string());
    format!(
        "the tap tyre {tyre} shoulder {shoulder} offset_mm {} velocity_m_per_s {} location {location} repetition {repetition}{}",
        or_unknown(row.tap.id.offset_mm()),
        or_unknown(row.tap.id.velocity_m_per_s()),
        if row.tap.is_closing() { " (closing)" } else { "" },
    )
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const HEADER: &str = "file,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition\n";

    fn parsed(geometry: Geometry, rows: &str) -> Result<Vec<TapRow>, Error> {
        parse(Path::new("taps.csv"), &format!("{HEADER}{rows}"), geometry)
    }

    fn ring(rows: &str) -> Vec<TapRow> {
        parsed(Geometry::Ring, rows).unwrap()
    }

    /// Catches locations that are numbered anticlockwise, an angle that all have, one that lies elsewhere, and rings that begin anywhere
    /// and are refused.
    #[test]
    fn angles_go_around_once() {
        let rows = |angles: &[f64]| -> String {
            (0..).zip(angles).map(|(k, angle)| format!("{k}.wav,T,1,0,1,{k},{angle},0\n")).collect()
        };
        for good in [&[0.0, 90.0, 180.0, 270.0][..], &[300.0, 350.0, 20.0, 290.0], &[359.0, 1.0], &[0.0, 1.0, 1.0, 2.0]]
        {
            assert_eq!(ring(&rows(good)).len(), good.len());
        }
        for (bad, line, before) in [
            (&[0.0, 270.0, 180.0, 90.0][..], 4, "270, that of location 1"),
            (&[0.0, 30.0, 355.0, 90.0, 120.0], 5, "355, that of location 2"),
            (&[5.0, 5.0, 5.0], 4, "5, that of location 1"),
        ] {
            let error = parsed(Geometry::Ring, &rows(bad)).unwrap_err().to_string();
            let wanted = [format!("taps.csv line {line}: angle_deg is "), format!("clockwise of {before}")];
            assert!(wanted.iter().all(|words| error.contains(words)), "{error}");
        }
        assert!(parsed(Geometry::Line, &rows(&[0.0, 270.0, 180.0])).is_ok());
    }

    /// Catches an empty cell read as zero, and a value in the wrong field.
    #[test]
    fn a_row_is_a_tap() {
        let rows = ring("a/b.wav,T 1,2,-5.5,1.85,7,25.2,1\nc.wav,T 1,1,,,0,,\n");
        let id = rows[0].tap.id;
        assert_eq!((rows[0].line, rows[0].file.as_str(), id.tyre.as_str()), (2, "a/b.wav", "T 1"));
        assert_eq!((id.shoulder, id.location, id.repetition, rows[0].tap.angle_deg), (2, 7, 1, Some(25.2)));
        assert_eq!((id.offset_mm(), id.velocity_m_per_s()), (Some(-5.5), Some(1.85)));
        let id = rows[1].tap.id;
        assert_eq!((id.offset_mm(), id.velocity_m_per_s(), rows[1].velocity_measured_m_per_s), (None, None, None));
        assert_eq!((id.repetition, rows[1].tap.angle_deg), (0, None));
    }

    /// Catches a serial, path or reason that keeps the apostrophe which exports put before formulas.
    #[test]
    fn what_an_export_made_a_text_comes_back() {
        let header = HEADER.replace("repetition", "repetition,refused");
        let text = format!("{header}'-5-1/a.wav,'=T,1,,,0,,0,\n,'=T,1,,,1,,0,'@lost\n");
        let rows = parse(Path::new("taps.csv"), &text, Geometry::Ring).unwrap();
        assert_eq!((rows[0].file.as_str(), rows[0].tap.id.tyre.as_str()), ("-5-1/a.wav", "=T"));
        assert_eq!(rows[1].extras.refused.as_deref(), Some("@lost"));
    }

    /// Catches a measured velocity that is mistaken for the planned one, required, or invented where its cell is empty.
    #[test]
    fn a_measured_velocity_has_a_column_of_its_own() {
        let header = HEADER.replace("repetition", "repetition,velocity_measured_m_per_s");
        let text = format!("{header}a.wav,T,1,,1.85,0,,0,2.03\nb.wav,T,1,,1.85,1,,0,\n");
        let rows = parse(Path::new("taps.csv"), &text, Geometry::Ring).unwrap();
        assert_eq!(rows[0].tap.id.velocity_m_per_s(), Some(1.85));
        assert_eq!((rows[0].velocity_measured_m_per_s, rows[1].velocity_measured_m_per_s), (Some(2.03), None));
        let empty_first = parse(Path::new("taps.csv"), &format!("\n{text}"), Geometry::Ring).unwrap();
        assert_eq!(empty_first[0].velocity_measured_m_per_s, Some(2.03));
        assert_eq!(ring("a.wav,T,1,,1.85,0,,0\n")[0].velocity_measured_m_per_s, Some(1.85));
        let listed =
            tap_rows(Path::new("taps.csv"), &format!("{HEADER}a.wav,T,1,,1.85,0,,0\n"), Geometry::Ring).unwrap();
        assert_eq!(listed[0].velocity_measured_m_per_s, None, "of recordings that are imported it is not known");
    }

    /// Catches an optional column that is mistaken for another, required, or invented where its cell is empty, and a
    /// tap that counts as closing although the list says otherwise.
    #[test]
    fn what_an_archive_knows_is_taken() {
        let header = HEADER.replace(
            "repetition",
            "repetition,station,attempt,purpose,tap_time_ns,force_full_scale_n,sound_full_scale_v,sound_full_scale_pa,microphone_distance_m,refused",
        );
        let parsed = |rows: &str| parse(Path::new("taps.csv"), &format!("{header}{rows}"), Geometry::Ring);
        let rows = parsed(
            "a.wav,T,1,,,0,0,0,7,2,closing,5,222,5,,0.05,\n,T,1,,,1,360,0,7,,scan,,,,,,no wire\nc.wav,T,1,,,2,360,1,7,,,,,,,,\n",
        );
        let rows = rows.unwrap();
        let first = Extras {
            station: Some(7),
            attempt: 2,
            purpose: Some(Purpose::Closing),
            tap_time_ns: 5,
            force_full_scale_n: Some(222.0),
            sound_full_scale_v: Some(5.0),
            sound_full_scale_pa: None,
            microphone_distance_m: Some(0.05),
            refused: None,
        };
        assert_eq!((&rows[0].extras, rows[0].tap.id.station), (&first, 7));
        assert_eq!(rows.iter().map(|row| row.tap.is_closing()).collect::<Vec<_>>(), [true, false, true]);
        let refused = Extras {
            station: Some(7),
            purpose: Some(Purpose::Scan),
            refused: Some("no wire".into()),
            ..Extras::default()
        };
        assert_eq!((&rows[1].extras, rows[1].file.as_str()), (&refused, ""));
        assert_eq!(rows[2].extras, Extras { station: Some(7), ..Extras::default() });
        for (row, want) in [
            (",T,1,,,0,0,0,7,,,,,,,,", "line 2: file is \"\""),
            ("a.wav,T,1,,,0,0,0,0,,,,,,,,", "station is \"0\"; it must be a whole number from 1 to 65535"),
            ("a.wav,T,1,,,0,0,0,,64,,,,,,,", "attempt is \"64\"; it must be a whole number from 0 to 63"),
            ("a.wav,T,1,,,0,0,0,,,2,,,,,,", "purpose is \"2\""),
            ("a.wav,T,1,,,0,0,0,,,,1.5,,,,,", "tap_time_ns is \"1.5\"; it must be a whole number of ns"),
            ("a.wav,T,1,,,0,0,0,,,,-1,,,,,", "tap_time_ns is \"-1\""),
            ("a.wav,T,1,,,0,0,0,,,,,0,,,,", "force_full_scale_n is \"0\"; it must be a number above 0"),
            ("a.wav,T,1,,,0,0,0,,,,,,nan,,,", "sound_full_scale_v is \"nan\""),
            ("a.wav,T,1,,,0,0,0,,,,,,,-2,,", "sound_full_scale_pa is \"-2\""),
            ("a.wav,T,1,,,0,0,0,,,,,,,,-1,", "microphone_distance_m is \"-1\"; it must be a number from 0 to 10"),
        ] {
            let error = parsed(row).unwrap_err().to_string();
            assert!(error.contains(want), "{error:?} lacks {want:?}");
        }
        let text = "file,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition,purpose\na.wav,T,1,,,0,,0,closing\n";
        let error = parse(Path::new("taps.csv"), text, Geometry::Line).unwrap_err().to_string();
        assert!(error.contains("a line has no end to close"), "{error}");
    }

    fn turn(count: u32, with_angles: bool, from: u32) -> String {
        (0..count)
            .map(|k| {
                let angle = if with_angles { format!("{}", f64::from(k) * 3.6) } else { String::new() };
                format!("{k}.wav,T,1,,,{},{angle},0\n", k + from)
            })
            .collect()
    }

    fn closing(rows: &[TapRow]) -> Vec<u32> {
        rows.iter().filter(|r| r.tap.is_closing()).map(|r| r.tap.id.location).collect()
    }

    /// Catches a closing tap that is missed, that has the identity of the first tap, or that is found where there is
    /// none.
    #[test]
    fn closing_taps_are_found_and_numbered() {
        assert_eq!(closing(&ring(&(turn(100, true, 0) + "z.wav,T,1,,,0,360,0\n"))), [100]);
        assert_eq!(closing(&ring(&(turn(100, true, 0) + "z.wav,T,1,,,100,360.0,0\n"))), [100]);
        assert_eq!(closing(&ring(&turn(101, true, 0))), [100], "the angle of the last comes out as 360");
        assert_eq!(closing(&ring(&turn(101, false, 0))), [100], "no angles: location 100");
        assert_eq!(closing(&ring(&turn(120, false, 0))), [0; 0], "a finer ring");
        assert_eq!(closing(&ring(&turn(100, false, 1))), [0; 0], "counted from 1");
        assert_eq!(closing(&ring(&(turn(100, true, 1) + "z.wav,T,1,,,1,360,0\n"))), [101], "counted from 1");
        assert_eq!(
            closing(&parsed(Geometry::Line, &turn(101, false, 0)).unwrap()),
            [0; 0],
            "a line has no end to close"
        );
    }

    /// Catches a fault that is accepted, or reported without its line, column, value or bound.
    #[test]
    fn every_fault_names_line_column_value_and_bound() {
        for (row, want) in [
            (
                "a.wav,T,1,,fast,0,,0",
                "taps.csv line 3: velocity_m_per_s is \"fast\"; it must be a number above 0 and at most 1000, or empty",
            ),
            ("a.wav,T,1,,0,0,,0", "line 3: velocity_m_per_s is \"0\""),
            ("a.wav,T,1,,NaN,0,,0", "line 3: velocity_m_per_s is \"NaN\""),
            ("a.wav,T,1,inf,,0,,0", "line 3: offset_mm is \"inf\"; it must be a number from -2000 to 2000"),
            ("a.wav,T,1,,,0,360.5,0", "line 3: angle_deg is \"360.5\"; it must be a number from 0 to 360"),
            ("a.wav,T,1,,,-1,,0", "line 3: location is \"-1\"; it must be a whole number from 0 to 999999"),
            ("a.wav,T,1,,,1e3,,0", "line 3: location is \"1e3\""),
            ("a.wav,T,1,,,,,0", "line 3: location is \"\"; it must be a whole number"),
            ("a.wav,T,3,,,0,,0", "line 3: shoulder is \"3\"; it must be a whole number from 1 to 2"),
            ("a.wav,T,1,,,0,,70000", "line 3: repetition is \"70000\"; it must be a whole number from 0 to 65535"),
            ("a.wav,,1,,,0,,0", "line 3: tyre is \"\""),
            ("a.wav,a/b,1,,,0,,0", "line 3: tyre is \"a/b\""),
            ("../a.wav,T,1,,,0,,0", "line 3: file is \"../a.wav\"; it must be the path of a WAV below the folder"),
            ("/etc/a.wav,T,1,,,0,,0", "line 3: file is \"/etc/a.wav\""),
            ("x/../../a.wav,T,1,,,0,,0", "line 3: file is \"x/../../a.wav\""),
            (",T,1,,,0,,0", "line 3: file is \"\""),
            ("ok.wav,T,1,,,0,,0", "taps.csv line 3: names the recording ok.wav again; line 2 has it already"),
            ("./ok.wav,T,1,,,0,,0", "line 3: names the recording ./ok.wav again; line 2 has it already"),
            ("a.wav,T,1,,,0,,0,9", "line 3: has 9 cells"),
            (
                "a.wav,T,2,,,5,,",
                "line 3: names the tap tyre T shoulder 2 offset_mm unknown velocity_m_per_s unknown location 5 repetition 0 again; line 2 has it already",
            ),
        ] {
            let error = parsed(Geometry::Ring, &format!("ok.wav,T,2,,,5,,0\n{row}\n")).unwrap_err().to_string();
            assert!(error.contains(want), "{error:?} lacks {want:?}");
        }
        let error = parsed(Geometry::Ring, "").unwrap_err().to_string();
        assert_eq!(error, "taps.csv: has no rows below its header");
    }

    proptest! {
        /// Catches a closing tap that has another tap's identity, for any order of rows.
        #[test]
        fn names_stay_distinct(count in 1u32..20, closing_at in 0usize..20) {
            let mut lines: Vec<String> = turn(count, true, 0).lines().map(str::to_owned).collect();
            lines.insert(closing_at.min(lines.len()), "z.wav,T,1,,,0,360,0".to_owned());
            let rows = ring(&lines.join("\n"));
            prop_assert_eq!(closing(&rows), [count]);
        }
    }
}
