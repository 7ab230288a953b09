//! A table as CSV: absent is an empty cell, numbers are the shortest text that reads back the same.

use std::io;

use super::column::{Cells, Column, Sink};
use crate::{Error, Result};

/// CSV with a header line, into `0`.
pub(crate) struct CsvFile<W>(pub(crate) W);

impl<W: io::Write> Sink for CsvFile<W> {
    fn table<R>(self, columns: &[Column<R>], rows: impl Iterator<Item = R>) -> Result<()> {
        let mut out = csv::Writer::from_writer(self.0);
        let columns = || columns.iter().filter(|column| column.is_in_csv);
        out.write_record(columns().map(|column| column.name.as_str()))?;
        for row in rows {
            out.write_record(columns().map(|column| cell_text(&column.cells, &row)))?;
        }
        out.flush().map_err(|error| Error::Csv(error.into()))
    }
}

fn cell_text<R>(cells: &Cells<R>, row: &R) -> String {
    match cells {
        Cells::U16(cell) => cell(row).map_or_else(String::new, |value| value.to_string()),
        Cells::U32(cell) => cell(row).map_or_else(String::new, |value| value.to_string()),
        Cells::F64(cell) => cell(row).map_or_else(String::new, number_text),
        Cells::Text(cell) => cell(row).unwrap_or_default(),
    }
}

/// The shortest text that reads back as `value`, without a row of zeros before small ones.
pub(crate) fn number_text(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-5 { format!("{value:e}") } else { value.to_string() }
}
