//! Which taps the recordings hold: from names of files, from a table, or from the plan of a continuous record.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

use tapline_acquire::{TEXT_COLUMNS, TapRow, read_rows, read_text, tap_columns, tap_rows};
use tapline_wire::csv_cell;

use crate::config::{Config, TAPS_MAX, TapPlan};
use crate::error::{Error, Result, some_of};
use crate::format::{is_recording, open};
use crate::name::{Cells, Pattern};

/// Columns that every tap must have, and those that may be empty.
const NEEDED: [&str; 3] = ["tyre", "shoulder", "location"];
const USUAL: [&str; 4] = ["offset_mm", "velocity_m_per_s", "angle_deg", "repetition"];

/// A file, or a part of it, and the taps in it.
#[derive(Debug)]
pub(crate) struct Record {
    pub file: PathBuf,
    /// The part; empty for the whole file.
    pub part: String,
    pub taps: Vec<TapRow>,
}

/// A tap of a record before its columns are read.
struct Named {
    record: usize,
    cells: Cells,
    /// The table and its line, or the recording, whose name gives the tap.
    from: (PathBuf, Option<usize>),
}

/// The taps of `files`, and the files that cannot be read, though their parts name their taps, with the reason.
pub(crate) fn records(files: &[PathBuf], config: &Config) -> Result<(Vec<Record>, Vec<String>)> {
    if let Some(folder) = files.iter().find(|file| file.is_dir()) {
        let reason = format!("is a folder; give the files in it instead, as {}/*", folder.display());
        return Err(Error::Text { file: folder.clone(), line: None, reason });
    }
    let mut list = List::default();
    match (&config.name, &config.table) {
        (_, Some(table)) => list.add_by_table(files, config, &config.path.with_file_name("").join(table))?,
        (Some(name), _) => {
            let pattern = Pattern::new(name, is_recording).map_err(|reason| config.refuse(reason))?;
            for file in files {
                list.add_by_name(file, &pattern, config)?;
            }
        }
        (None, None) => {
            for file in files {
                list.add(file, String::new(), &Cells::new(), (file.clone(), None), config)?;
            }
        }
    }
    let unread = std::mem::take(&mut list.unread);
    match unread.first() {
        Some(first) if unread.len() == files.len() => {
            Err(config.refuse(format!("name cannot be applied, as no file can be read: {first}")))
        }
        _ => Ok((list.read(config)?, unread)),
    }
}

/// What is the same for all taps, as text.
fn constants(config: &Config) -> Result<Cells> {
    let text = |(column, value): (&String, &toml::Value)| match value {
        toml::Value::String(text) => Ok((column.clone(), csv_cell(text).into_owned())),
        toml::Value::Integer(_) | toml::Value::Float(_) => Ok((column.clone(), value.to_string())),
        _ => Err(config.refuse(format!("tap.{column} is {value}; it must be a text or a number"))),
    };
    config.tap.iter().map(text).collect()
}

#[derive(Default)]
struct List {
    records: Vec<(PathBuf, String)>,
    places: HashMap<(PathBuf, String), usize>,
    taps: Vec<Named>,
    /// Files whose parts cannot be read, and why.
    unread: Vec<String>,
}

impl List {
    /// Adds a record with one tap, or with those of the plan.
    fn add(
        &mut self,
        file: &Path,
        part: String,
        cells: &Cells,
        from: (PathBuf, Option<usize>),
        config: &Config,
    ) -> Result<()> {
        let key = (file.to_owned(), part);
        let known = self.places.get(&key).copied();
        if known.is_some() && config.cut.is_none() {
            let ((file, line), (_, part)) = (from, &key);
            let part = if part.is_empty() { String::new() } else { format!(" part {part:?}") };
            let reason = format!("names {}{part} again; a recording is one tap, unless [cut] cuts it", key.0.display());
            return Err(Error::Text { file, line, reason });
        }
        let record = known.unwrap_or(self.records.len());
        if known.is_none() {
            self.records.push(key.clone());
            self.places.insert(key, record);
        }
        let planned = match &config.plan {
            Some(plan) => cells_of(plan, cells),
            None => vec![cells.clone()],
        };
        if (self.taps.len() + planned.len()) as u64 > TAPS_MAX {
            return Err(config.refuse(format!("there are more than {TAPS_MAX} taps; import them in parts")));
        }
        self.taps.extend(planned.into_iter().map(|cells| Named { record, cells, from: from.clone() }));
        Ok(())
    }

    fn add_by_name(&mut self, file: &Path, pattern: &Pattern, config: &Config) -> Result<()> {
        let steps = file.components().filter_map(|step| match step {
            Component::Normal(name) => Some(name.to_string_lossy()),
            _ => None,
        });
        let steps: Vec<_> = steps.collect();
        let name = steps[steps.len().saturating_sub(pattern.steps)..].join("/");
        let refuse = |reason: String| Error::Text { file: file.to_owned(), line: None, reason };
        let unfit = |what: &str| {
            let pattern = config.name.as_deref().unwrap_or_default();
            let why = if file.exists() { "" } else { ", and does not exist" };
            refuse(format!("{what} does not fit name = {pattern:?}{why}"))
        };
        let text_of =
            |cells: Cells| cells.into_iter().map(|(column, value)| (column, csv_cell_if_text(value))).collect();
        if pattern.depth == 0 {
            let cells = pattern.read(&name).map_err(refuse)?.ok_or_else(|| unfit(&format!("{name:?}")))?;
            return self.add(file, String::new(), &text_of(cells), (file.to_owned(), None), config);
        }
        let parts = match open(file).and_then(|opened| opened.parts(pattern.depth)) {
            Ok(parts) => parts,
            Err(fault) => {
                self.unread.push(format!("{}: {fault}", file.display()));
                return Ok(());
            }
        };
        let before = self.taps.len();
        for part in &parts {
            // A file may hold other things besides its taps.
            if let Some(cells) = pattern.read(&format!("{name}/{part}")).map_err(refuse)? {
                self.add(file, part.clone(), &text_of(cells), (file.to_owned(), None), config)?;
            }
        }
        if self.taps.len() == before {
            let parts = some_of(parts.iter().map(String::as_str));
            return Err(unfit(&format!("none of its parts ({parts})")));
        }
        Ok(())
    }

    fn add_by_table(&mut self, files: &[PathBuf], config: &Config, table: &Path) -> Result<()> {
        let text = read_text(table)?;
        let refuse = |line: Option<usize>, reason: String| Error::Text { file: table.to_owned(), line, reason };
        // The table may be a CSV among the recordings.
        let itself = table.canonicalize().ok();
        let is_table = |file: &PathBuf| itself.is_some() && file.canonicalize().ok() == itself;
        let files: Vec<&PathBuf> = files.iter().filter(|file| !is_table(file)).collect();
        let mut by_name: HashMap<&OsStr, Vec<usize>> = HashMap::new();
        for (place, file) in files.iter().enumerate() {
            by_name.entry(file.file_name().unwrap_or_default()).or_default().push(place);
        }
        let (columns, texts) = ([&["part"], &tap_columns()[..]].concat(), [&["part"], &TEXT_COLUMNS[..]].concat());
        let mut used = BTreeSet::new();
        read_rows(table, &text, (&[], &columns), |row| -> Result<()> {
            let line = Some(row.line());
            let mut cells: Cells = row.cells(&texts).map(|(column, cell)| (column.to_owned(), cell)).collect();
            let part = cells.remove("part").unwrap_or_default();
            let name = tapline_wire::csv_text(&cells.remove("file").unwrap_or_default()).to_owned();
            // A list of an export names taps without a recording too.
            let is_refused = cells.get("refused").is_some_and(|reason| !reason.is_empty());
            if name.is_empty() && !is_refused {
                return Err(refuse(line, "file is \"\"; it must name a recording".to_owned()));
            }
            let named = Path::new(&name).file_name().and_then(|last| by_name.get(last)).map_or(&[][..], Vec::as_slice);
            let mut found = named.iter().copied().filter(|&place| files[place].ends_with(&name));
            let file = match (found.next(), found.next()) {
                (Some(place), None) => {
                    used.insert(place);
                    files[place].as_path()
                }
                (Some(one), Some(other)) => {
                    let (one, other) = (files[one].display(), files[other].display());
                    return Err(refuse(
                        line,
                        format!("file is {name:?}; that may be {one} or {other}: name the folder too"),
                    ));
                }
                (None, _) if is_refused => Path::new(""),
                (None, _) => {
                    return Err(refuse(
                        line,
                        format!("file is {name:?}; it must be one of the {} files that are imported", files.len()),
                    ));
                }
            };
            let from = (table.to_owned(), line);
            if file.as_os_str().is_empty() {
                // Each is a record of its own.
                self.records.push((PathBuf::new(), String::new()));
                self.taps.push(Named { record: self.records.len() - 1, cells, from });
            } else {
                self.add(file, part, &cells, from, config)?;
            }
            Ok(())
        })?;
        let forgotten = (0..files.len()).find(|place| !used.contains(place));
        match forgotten.map(|place| files[place]) {
            Some(file) => Err(refuse(None, format!("has no row for {}", file.display()))),
            None if self.taps.is_empty() => Err(refuse(None, "has no rows below its header".to_owned())),
            None => Ok(()),
        }
    }

    /// Reads the columns of all taps as the reader of tap sets does.
    fn read(self, config: &Config) -> Result<Vec<Record>> {
        let constants = constants(config)?;
        let mut columns: BTreeSet<&str> = NEEDED.into_iter().chain(USUAL).collect();
        columns.extend(constants.keys().map(String::as_str));
        columns.extend(self.taps.iter().flat_map(|tap| tap.cells.keys()).map(String::as_str));
        for column in ["file", "part"] {
            if columns.contains(column) {
                return Err(config.refuse(format!("tap.{column} cannot be the same for all taps")));
            }
        }
        let mut out = csv::Writer::from_writer(Vec::new());
        let unwritten = |error: csv::Error| config.refuse(error.to_string());
        out.write_record(std::iter::once("file").chain(columns.iter().copied())).map_err(unwritten)?;
        for (number, Named { cells, from, .. }) in self.taps.iter().enumerate() {
            let refuse = |reason: String| Error::Text { file: from.0.clone(), line: from.1, reason };
            let mut row = vec![format!("{number}.wav")];
            for column in &columns {
                let cell = cells.get(*column).filter(|cell| !cell.is_empty()).or_else(|| constants.get(*column));
                let cell = cell.map(String::as_str).unwrap_or_default();
                if cell.is_empty() && NEEDED.contains(column) {
                    let what = "it must come from the pattern name, from the table, from the plan, or from [tap]";
                    return Err(refuse(format!("a tap has no {column}; {what}")));
                }
                if cell.contains(['\n', '\r']) {
                    return Err(refuse(format!("{column} is {cell:?}; it must be one line")));
                }
                row.push(cell.to_owned());
            }
            out.write_record(&row).map_err(unwritten)?;
        }
        let bytes = out.into_inner().map_err(|error| config.refuse(error.to_string()))?;
        let text = String::from_utf8_lossy(&bytes);
        let rows = tap_rows(&config.path, &text, config.geometry).map_err(|error| self.placed(error, config))?;
        let mut records: Vec<Record> =
            self.records.into_iter().map(|(file, part)| Record { file, part, taps: Vec::new() }).collect();
        for (row, named) in rows.into_iter().zip(&self.taps) {
            records[named.record].taps.push(row);
        }
        Ok(records)
    }

    /// An error of the rows, at the line or the recording that they come from, or at what is the same for all taps.
    fn placed(&self, error: tapline_acquire::Error, config: &Config) -> Error {
        // Below the header, from 1.
        let from = |line: usize| line.checked_sub(2).and_then(|place| self.taps.get(place)).map(|tap| tap.from.clone());
        let (line, reason) = match &error {
            tapline_acquire::Error::Cell { line, column, value, bound, .. } => {
                let tap = line.checked_sub(2).and_then(|place| self.taps.get(place));
                let is_own = tap.is_some_and(|tap| tap.cells.get(*column).is_some_and(|cell| !cell.is_empty()));
                if config.tap.contains_key(*column) && !is_own {
                    return config.refuse(format!("tap.{column} is {value:?}; it must be {bound}"));
                }
                (*line, format!("{column} is {value:?}; it must be {bound}"))
            }
            tapline_acquire::Error::Duplicate { what, first, second, .. } => {
                let first = from(*first).map_or_else(String::new, |(file, line)| {
                    line.map_or_else(|| file.display().to_string(), |line| format!("line {line}"))
                });
                (*second, format!("is {what} again, after {first}"))
            }
            tapline_acquire::Error::Column { column, known, .. } if config.tap.contains_key(column) => {
                return config.refuse(format!("tap.{column} is unknown; it must be one of {known}, ..."));
            }
            tapline_acquire::Error::Column { fault, column, .. } => {
                let place = self.taps.first().map(|tap| tap.from.0.clone()).unwrap_or_default();
                return Error::Text { file: place, line: None, reason: format!("{fault} column {column:?}") };
            }
            _ => return error.into(),
        };
        match from(line) {
            Some((file, line)) => Error::Text { file, line, reason },
            None => error.into(),
        }
    }
}

/// The value of a field for a table: texts that look like formulas are marked, numbers are not.
fn csv_cell_if_text(value: String) -> String {
    if value.parse::<f64>().is_ok() { value } else { csv_cell(&value).into_owned() }
}

/// The taps of a continuous record, in their order; what its name says takes precedence.
fn cells_of(plan: &TapPlan, known: &Cells) -> Vec<Cells> {
    let texts = |values: &[f64]| match values {
        [] => vec![String::new()],
        values => values.iter().map(f64::to_string).collect(),
    };
    let mut all = Vec::new();
    for shoulder in 1..=plan.shoulders.unwrap_or(1) {
        for offset_mm in &texts(&plan.offsets_mm) {
            for velocity_m_per_s in &texts(&plan.velocities_m_per_s) {
                for repetition in 0..plan.repetitions.unwrap_or(1) {
                    let end = plan.locations + u32::from(plan.closing_tap);
                    for location in 0..end {
                        let is_closing = location == plan.locations;
                        let mut cells: Cells = BTreeMap::from([
                            ("location", location.to_string()),
                            ("repetition", repetition.to_string()),
                            ("offset_mm", offset_mm.clone()),
                            ("velocity_m_per_s", velocity_m_per_s.clone()),
                            ("purpose", if is_closing { "closing" } else { "" }.to_owned()),
                        ])
                        .into_iter()
                        .map(|(column, value)| (column.to_owned(), value))
                        .collect();
                        if plan.shoulders.is_some() {
                            cells.insert("shoulder".to_owned(), shoulder.to_string());
                        }
                        cells.extend(known.clone());
                        all.push(cells);
                    }
                }
            }
        }
    }
    all
}
