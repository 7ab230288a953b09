//! The findings as tables: the same cells go to the terminal, to JSON, to CSV and onto the page.

use std::fmt::{self, Display, Formatter};

use anyhow::Result;
use serde_json::{Map, Value};

/// Digits of a number: more than its interval justifies.
const DIGITS: usize = 4;

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Cell {
    Text(String),
    /// A finite number; shown to a few digits.
    Number(f64),
    Count(u64),
    Empty,
}

impl Display for Cell {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.pad(text),
            Self::Number(value) => f.pad(&rounded(*value, DIGITS)),
            Self::Count(count) => f.pad(&count.to_string()),
            Self::Empty => Ok(()),
        }
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        if text.is_empty() { Self::Empty } else { Self::Text(text) }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        Self::Count(count as u64)
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table {
    /// Name of its file, and its key in JSON.
    pub name: &'static str,
    /// What it shows.
    pub title: &'static str,
    pub columns: Vec<&'static str>,
    pub rows: Vec<Vec<Cell>>,
    /// Whether it is too long to be read at a terminal or on a page.
    pub is_long: bool,
}

impl Table {
    pub(crate) fn new(
        name: &'static str,
        title: &'static str,
        columns: impl IntoIterator<Item = &'static str>,
    ) -> Self {
        Self { name, title, columns: columns.into_iter().collect(), rows: Vec::new(), is_long: false }
    }

    /// One that only files and JSON show.
    pub(crate) fn long(
        name: &'static str,
        title: &'static str,
        columns: impl IntoIterator<Item = &'static str>,
    ) -> Self {
        Self { is_long: true, ..Self::new(name, title, columns) }
    }

    pub(crate) fn push(&mut self, cells: impl IntoIterator<Item = Cell>) {
        self.rows.push(cells.into_iter().collect());
    }

    pub(crate) fn push_texts(&mut self, cells: impl IntoIterator<Item = String>) {
        self.push(cells.into_iter().map(Cell::from));
    }

    pub(crate) fn csv(&self) -> Result<String> {
        let mut out = csv::Writer::from_writer(Vec::new());
        out.write_record(&self.columns)?;
        self.rows.iter().try_for_each(|row| out.write_record(row.iter().map(ToString::to_string)))?;
        Ok(String::from_utf8(out.into_inner()?)?)
    }

    /// Its rows as objects; a cell that is a number is one, an empty one is null.
    pub(crate) fn json(&self) -> Value {
        let value = |cell: &Cell| match cell {
            Cell::Empty => Value::Null,
            Cell::Text(text) => Value::from(text.as_str()),
            Cell::Number(_) | Cell::Count(_) => cell.to_string().parse::<f64>().map_or(Value::Null, Value::from),
        };
        let row = |row: &Vec<Cell>| {
            let cells = self.columns.iter().zip(row).map(|(&column, cell)| (column.to_owned(), value(cell)));
            Value::Object(cells.collect::<Map<_, _>>())
        };
        Value::Array(self.rows.iter().map(row).collect())
    }

    /// For people at a terminal.
    pub(crate) fn text(&self) -> String {
        let mut table = tapline_host::table::table(self.columns.iter().map(|column| column.replace('_', " ")));
        self.rows.iter().for_each(|row| {
            table.add_row(row);
        });
        tapline_host::table::break_between_words(&mut table);
        format!("{}\n{table}\n", self.title)
    }

    pub(crate) fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let head: Vec<String> = self.columns.iter().map(|column| column.replace('_', " ")).collect();
        let rule = format!("|{}\n", "---|".repeat(head.len()));
        let rows: String = self.rows.iter().map(|row| line(row.iter().map(ToString::to_string).collect())).collect();
        format!("{}{rule}{rows}", line(head))
    }
}

/// `value` to so many significant digits, without a minus before zero.
pub(crate) fn rounded(value: f64, digits: usize) -> String {
    let text = format!("{value:.*e}", digits - 1);
    text.parse::<f64>().map_or(text, |rounded| (rounded + 0.0).to_string())
}

/// A number as a cell; absent is empty, and so is one that is not finite.
pub(crate) fn cell(value: impl Into<Option<f64>>) -> Cell {
    value.into().filter(|value| value.is_finite()).map_or(Cell::Empty, Cell::Number)
}

pub(crate) fn yes_or_no(is_so: bool) -> Cell {
    if is_so { "yes" } else { "no" }.into()
}

pub(crate) fn ends(interval: Option<(f64, f64)>) -> [Cell; 2] {
    [cell(interval.map(|i| i.0)), cell(interval.map(|i| i.1))]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches invented digits, an absent value that becomes a number, and a minus before zero.
    #[test]
    fn cells_are_short() {
        let cells = [Some(0.987_654_32), Some(123_456.0), Some(-0.0), Some(1e-7), Some(f64::NAN), None]
            .map(|value| cell(value).to_string());
        assert_eq!(cells, ["0.9877", "123500", "0", "0.0000001", "", ""]);
        let mut table = Table::new("t", "T", ["name", "auc", "low"]);
        table.push(["x".into(), cell(0.5), Cell::Empty]);
        assert_eq!(table.json().to_string(), r#"[{"auc":0.5,"low":null,"name":"x"}]"#);
        assert_eq!(table.csv().unwrap(), "name,auc,low\nx,0.5,\n");
        assert_eq!(table.markdown(), "| name | auc | low |\n|---|---|---|\n| x | 0.5 |  |\n");
    }
}
