//! CSV tables whose columns have fixed names and any order.
//!
//! Cells are separated as in the header: by commas, semicolons or tabs. Spreadsheets write semicolons if the comma is the
//! decimal sign; numbers may use it if semicolons separate the cells.

use std::fmt::Display;
use std::path::Path;
use std::str::FromStr;

use csv::StringRecord;

use crate::Error;

/// Positions of the columns of a table.
#[derive(Debug)]
struct Table<'a> {
    file: &'a Path,
    separator: u8,
    /// Name and position of every column that exists.
    places: Vec<(&'static str, usize)>,
}

/// One row of a table of text.
#[derive(Debug)]
pub struct Row<'a> {
    table: &'a Table<'a>,
    record: &'a StringRecord,
    /// Line of the file, from 1.
    line: usize,
}

/// Calls `take` for every row of the table `text` of `file`, in order; `optional` columns may be missing and are then
/// empty.
///
/// # Errors
/// The first header or row that does not fit, or the first error of `take`.
pub fn read_rows<E: From<Error>>(
    file: &Path,
    text: &str,
    (columns, optional): (&[&'static str], &[&'static str]),
    mut take: impl FnMut(&Row<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let separator = separator(text);
    let mut reader = reader(text);
    let mut lines = Lines { text: text.as_bytes(), at: 0, line: 1 };
    let mut record = StringRecord::new();
    let mut table: Option<Table<'_>> = None;
    loop {
        let line = lines.of_row_from(usize::try_from(reader.position().byte()).unwrap_or(usize::MAX));
        let is_row = reader.read_record(&mut record).map_err(|e| Error::Syntax {
            file: file.to_owned(),
            line: Some(line),
            reason: e.to_string(),
        })?;
        match &table {
            None => table = Some(Table::new((file, separator), (columns, optional), &record, line)?),
            _ if !is_row => return Ok(()),
            Some(table) => take(&Row::new(table, &record, line)?)?,
        }
    }
}

/// The names of the columns of the table `text`; none if its header cannot be read.
pub fn columns_of(text: &str) -> Vec<String> {
    let header = reader(text).into_records().next().and_then(Result::ok).unwrap_or_default();
    header.iter().map(str::to_owned).collect()
}

fn reader(text: &str) -> csv::Reader<&[u8]> {
    let mut builder = csv::ReaderBuilder::new();
    builder.delimiter(separator(text)).has_headers(false).flexible(true).trim(csv::Trim::All);
    builder.from_reader(text.as_bytes())
}

/// The separator of the cells of the table `text`: that of its header.
fn separator(text: &str) -> u8 {
    let header = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    [b',', b';', b'\t'].into_iter().find(|&separator| header.as_bytes().contains(&separator)).unwrap_or(b',')
}

impl<'a> Table<'a> {
    fn new(
        (file, separator): (&'a Path, u8),
        (columns, optional): (&[&'static str], &[&'static str]),
        header: &StringRecord,
        line: usize,
    ) -> Result<Self, Error> {
        let refuse = |fault, column: &str| Error::Column {
            file: file.to_owned(),
            line,
            fault,
            column: column.to_owned(),
            // If a required column is missing, optional ones are not listed.
            known: if fault == "missing" { columns.join(",") } else { [columns, optional].concat().join(",") },
        };
        for (place, name) in header.iter().enumerate() {
            if !columns.contains(&name) && !optional.contains(&name) {
                return Err(refuse("unknown", name));
            }
            if header.iter().take(place).any(|n| n == name) {
                return Err(refuse("repeated", name));
            }
        }
        let place_of = |column: &'static str| header.iter().position(|n| n == column).map(|place| (column, place));
        let mut places = columns
            .iter()
            .map(|column| place_of(column).ok_or_else(|| refuse("missing", column)))
            .collect::<Result<Vec<_>, _>>()?;
        places.extend(optional.iter().filter_map(|column| place_of(column)));
        Ok(Self { file, separator, places })
    }
}

impl<'a> Row<'a> {
    fn new(table: &'a Table<'a>, record: &'a StringRecord, line: usize) -> Result<Self, Error> {
        let (got, need) = (record.len(), table.places.len());
        if got != need {
            let reason = format!("has {got} cells; the header has {need} columns");
            return Err(Error::Syntax { file: table.file.to_owned(), line: Some(line), reason });
        }
        Ok(Self { table, record, line })
    }

    /// Line of the file, from 1.
    pub fn line(&self) -> usize {
        self.line
    }

    /// The text in `column`; empty if the table has no such column.
    pub fn text(&self, column: &'static str) -> &'a str {
        let place = self.table.places.iter().find(|(name, _)| *name == column);
        place.and_then(|&(_, place)| self.record.get(place)).unwrap_or("")
    }

    /// The cells of the columns that the table has, numbers with a decimal point; `texts` are columns without numbers.
    pub fn cells(&self, texts: &[&str]) -> impl Iterator<Item = (&'static str, String)> {
        self.table.places.iter().map(|&(column, _)| {
            let cell = self.text(column);
            (column, if texts.contains(&column) { cell.to_owned() } else { self.plain(cell) })
        })
    }

    /// The number `cell` with a decimal point.
    fn plain(&self, cell: &str) -> String {
        if self.table.separator == b';' { cell.replace(',', ".") } else { cell.to_owned() }
    }

    /// An error that refuses the value in `column`.
    pub fn refuse(&self, column: &'static str, bound: impl Into<String>) -> Error {
        Error::Cell {
            file: self.table.file.to_owned(),
            line: self.line,
            column,
            value: self.text(column).to_owned(),
            bound: bound.into(),
        }
    }

    /// The whole number in `column`; `None` if the cell is empty.
    ///
    /// # Errors
    /// A cell that has none from `low` to `high`.
    pub fn whole<T: FromStr + PartialOrd + Display>(
        &self,
        column: &'static str,
        low: T,
        high: T,
    ) -> Result<Option<T>, Error> {
        if self.text(column).is_empty() { Ok(None) } else { self.needed(column, low, high).map(Some) }
    }

    /// The whole number in `column`, which must not be empty.
    ///
    /// # Errors
    /// A cell that has none from `low` to `high`.
    pub fn needed<T: FromStr + PartialOrd + Display>(&self, column: &'static str, low: T, high: T) -> Result<T, Error> {
        let number = self.text(column).parse().ok().filter(|n| *n >= low && *n <= high);
        number.ok_or_else(|| self.refuse(column, format!("a whole number from {low} to {high}")))
    }

    /// The number in `column`; `None` if the cell is empty. `low` itself is only allowed if `is_low_in`.
    ///
    /// # Errors
    /// A cell that has none from `low` to `high`.
    pub fn number(&self, column: &'static str, (low, is_low_in): (f64, bool), high: f64) -> Result<Option<f64>, Error> {
        let text = self.text(column);
        if text.is_empty() {
            return Ok(None);
        }
        let number: Option<f64> = self.plain(text).parse().ok();
        number.filter(|&n| (n > low || is_low_in && n >= low) && n <= high).map(Some).ok_or_else(|| {
            let from = if is_low_in { format!("from {low} to") } else { format!("above {low} and at most") };
            self.refuse(column, format!("a number {from} {high}, or empty when unknown"))
        })
    }
}

/// Counts lines along with the CSV reader, which reports the wrong line after a blank one.
struct Lines<'a> {
    text: &'a [u8],
    at: usize,
    line: usize,
}

impl Lines<'_> {
    /// Line of the row that is read from byte `from` on.
    fn of_row_from(&mut self, from: usize) -> usize {
        while let Some(&byte) = self.text.get(self.at)
            && (self.at < from || byte == b'\n' || byte == b'\r')
        {
            self.line += usize::from(byte == b'\n');
            self.at += 1;
        }
        self.line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: &[&str] = &["a", "b"];

    fn parsed(text: &str) -> Result<Vec<(usize, String, String)>, Error> {
        let mut rows = Vec::new();
        read_rows(Path::new("t.csv"), text, (COLUMNS, &["z"]), |row| -> Result<(), Error> {
            rows.push((row.line(), row.text("a").to_owned(), row.text("b").to_owned()));
            Ok(())
        })?;
        Ok(rows)
    }

    fn row(line: usize, a: &str, b: &str) -> (usize, String, String) {
        (line, a.to_owned(), b.to_owned())
    }

    /// Catches columns identified by position, and lines miscounted at blank lines, either line end and quoted breaks.
    #[test]
    fn columns_go_by_name_and_lines_are_counted() {
        assert_eq!(parsed("b,a\n2,1\n").unwrap(), [row(2, "1", "2")]);
        assert_eq!(parsed("b,z,a\n2,9,1\n").unwrap(), [row(2, "1", "2")]);
        let text = "\r\na , b\r\n1,2\r\n\r\n\r\n3,\"4\n4\"\r\n5,6";
        assert_eq!(parsed(text).unwrap(), [row(3, "1", "2"), row(6, "3", "4\n4"), row(8, "5", "6")]);
        assert_eq!(parsed("a,b\n").unwrap(), []);
    }

    /// Catches a table of a spreadsheet that is refused, a decimal comma that splits a cell, and thousands taken for decimals.
    #[test]
    fn spreadsheets_separate_by_semicolons_or_tabs() {
        assert_eq!(parsed("b;a\n2;1\n").unwrap(), [row(2, "1", "2")]);
        assert_eq!(parsed("\nb\ta\n2,5\t\n").unwrap(), [row(3, "", "2,5")]);
        let numbers = |text: &str| {
            let mut numbers = Vec::new();
            read_rows(Path::new("t.csv"), text, (COLUMNS, &[]), |row| -> Result<(), Error> {
                numbers.push(row.number("a", (0.0, true), 10.0)?);
                Ok(())
            })
            .map(|()| numbers)
        };
        assert_eq!(numbers("a;b\n1,5;\n2.5;\n;\n").unwrap(), [Some(1.5), Some(2.5), None]);
        for wrong in ["a;b\n1.001,5;\n", "a,b\n\"1,5\",\n", "a\tb\n1,000\t\n"] {
            let error = numbers(wrong).unwrap_err().to_string();
            assert!(error.contains("line 2: a is \"1"), "{error}");
        }
    }

    /// Catches a header or row that is accepted although it does not fit.
    #[test]
    fn what_does_not_fit_is_refused() {
        for (text, want) in [
            ("", "t.csv line 1: missing column \"a\"; the columns are a,b, in any order"),
            ("a\n", "line 1: missing column \"b\""),
            ("a,b,c\n", "line 1: unknown column \"c\"; the columns are a,b,z, in any order"),
            ("\na,b,a\n", "line 2: repeated column \"a\""),
            ("a,b\n1,2\n1,2,3\n", "line 3: has 3 cells; the header has 2 columns"),
        ] {
            let error = parsed(text).unwrap_err().to_string();
            assert!(error.contains(want), "{error:?} lacks {want:?}");
        }
    }
}
