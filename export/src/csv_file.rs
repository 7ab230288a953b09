//! A table as CSV: an absent value is an empty cell, a number is the shortest text that reads back the same, and no
//! text is a spreadsheet formula.

use std::io;

use tapline_wire::csv_cell;

use crate::column::{Cells, Column, Sink};
use crate::{Error, Result};

/// CSV with a header line.
pub(crate) struct CsvFile<W: io::Write> {
    out: csv::Writer<W>,
    has_header: bool,
}

impl<W: io::Write> CsvFile<W> {
    /// CSV into `out`.
    pub(crate) fn new(out: W) -> Self {
        Self { out: csv::Writer::from_writer(out), has_header: false }
    }

    /// Ends the table.
    pub(crate) fn finish(mut self) -> Result<()> {
        self.out.flush().map_err(|error| Error::Csv(error.into()))
    }
}

impl<W: io::Write> Sink for CsvFile<W> {
    fn rows<R>(&mut self, columns: &[Column<R>], rows: impl Iterator<Item = R>) -> Result<()> {
        let columns = || columns.iter().filter(|column| column.is_in_csv);
        if !self.has_header {
            self.out.write_record(columns().map(|column| column.name.as_str()))?;
            self.has_header = true;
        }
        for row in rows {
            self.out.write_record(columns().map(|column| cell_text(&column.cells, &row)))?;
        }
        Ok(())
    }
}

fn cell_text<R>(cells: &Cells<R>, row: &R) -> String {
    match cells {
        Cells::U16(cell) => cell(row).map_or_else(String::new, |value| value.to_string()),
        Cells::U32(cell) => cell(row).map_or_else(String::new, |value| value.to_string()),
        Cells::F64(cell) => cell(row).map_or_else(String::new, number_text),
        Cells::Text(cell) => csv_cell(&cell(row).unwrap_or_default()).into_owned(),
    }
}

/// The shortest text that reads back as `value`; small values have an exponent.
pub(crate) fn number_text(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-5 { format!("{value:e}") } else { value.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a text that a spreadsheet would evaluate, and a number that becomes a text.
    #[test]
    fn texts_are_no_formulas() {
        let columns = [
            Column::text("name", |row: &(String, f64)| row.0.clone()),
            Column::f64("offset_mm", "mm", |row: &(String, f64)| row.1),
        ];
        let mut out = Vec::new();
        let rows = [("=1+1".to_owned(), -5.5), ("A-17".to_owned(), 1.0), ("@x".to_owned(), 0.0)];
        let mut file = CsvFile::new(&mut out);
        for row in rows {
            file.rows(&columns, [row].into_iter()).unwrap();
        }
        file.finish().unwrap();
        assert_eq!(String::from_utf8(out).unwrap(), "name,offset_mm\n'=1+1,-5.5\nA-17,1\n'@x,0\n");
    }
}
