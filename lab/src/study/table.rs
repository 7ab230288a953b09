//! What the study finds, as tables: the same cells go to the terminal, to JSON, to CSV and onto the page.

use anyhow::Result;
use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use serde_json::{Map, Value};

/// Digits of a number: more than any of its intervals knows.
const DIGITS: usize = 4;

/// One table.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    /// Name of its file, and its key in JSON.
    pub(super) name: &'static str,
    /// What it shows.
    pub(super) title: &'static str,
    pub(super) columns: Vec<&'static str>,
    pub(super) rows: Vec<Vec<String>>,
    /// Whether it is too long to be read at a terminal or on a page.
    pub(super) is_long: bool,
}

impl Table {
    pub(super) fn new(name: &'static str, title: &'static str, columns: &[&'static str]) -> Self {
        Self { name, title, columns: columns.to_vec(), rows: Vec::new(), is_long: false }
    }

    /// One that only files and JSON show.
    pub(super) fn long(name: &'static str, title: &'static str, columns: &[&'static str]) -> Self {
        Self::new(name, title, columns).into_long()
    }

    pub(super) fn into_long(self) -> Self {
        Self { is_long: true, ..self }
    }

    pub(super) fn push(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }

    /// The cell of `row` in the column of that name; empty where there is none.
    pub(super) fn cell<'a>(&self, row: &'a [String], column: &str) -> &'a str {
        let place = self.columns.iter().position(|&name| name == column);
        place.and_then(|place| row.get(place)).map_or("", String::as_str)
    }

    pub(super) fn csv(&self) -> Result<String> {
        let mut out = csv::Writer::from_writer(Vec::new());
        out.write_record(&self.columns)?;
        self.rows.iter().try_for_each(|row| out.write_record(row))?;
        Ok(String::from_utf8(out.into_inner()?)?)
    }

    /// Its rows as objects; a cell that is a number is one, an empty one is null.
    pub(super) fn json(&self) -> Value {
        let cell = |text: &String| match (text.is_empty(), text.parse::<f64>()) {
            (true, _) => Value::Null,
            (false, Ok(number)) => Value::from(number),
            (false, Err(_)) => Value::from(text.as_str()),
        };
        let row = |row: &Vec<String>| {
            let cells = self.columns.iter().zip(row).map(|(&column, text)| (column.to_owned(), cell(text)));
            Value::Object(cells.collect::<Map<_, _>>())
        };
        Value::Array(self.rows.iter().map(row).collect())
    }

    /// For people at a terminal.
    pub(super) fn text(&self) -> String {
        let mut table = comfy_table::Table::new();
        table.load_style(UTF8_HORIZONTAL_ONLY);
        table.set_header(self.columns.iter().map(|column| column.replace('_', " ")));
        self.rows.iter().for_each(|row| {
            table.add_row(row);
        });
        format!("{}\n{table}\n", self.title)
    }

    /// As it stands on the page.
    pub(super) fn markdown(&self) -> String {
        let line = |cells: &mut dyn Iterator<Item = &str>| format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "));
        let head: Vec<String> = self.columns.iter().map(|column| column.replace('_', " ")).collect();
        let rule = format!("|{}\n", "---|".repeat(head.len()));
        let rows: String = self.rows.iter().map(|row| line(&mut row.iter().map(String::as_str))).collect();
        format!("{}{rule}{rows}", line(&mut head.iter().map(String::as_str)))
    }
}

/// A number as a cell; absent is empty.
pub(super) fn cell(value: impl Into<Option<f64>>) -> String {
    let Some(value) = value.into().filter(|v| v.is_finite()) else { return String::new() };
    let text = format!("{value:.*e}", DIGITS - 1);
    text.parse::<f64>().map_or(text, |rounded| (rounded + 0.0).to_string())
}

/// Both ends of an interval as cells.
pub(super) fn ends(interval: Option<(f64, f64)>) -> [String; 2] {
    [cell(interval.map(|i| i.0)), cell(interval.map(|i| i.1))]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches digits that are made up, an absent value that becomes a number, and a minus before nothing.
    #[test]
    fn cells_are_short() {
        let cells = [Some(0.987_654_32), Some(123_456.0), Some(-0.0), Some(1e-7), Some(f64::NAN), None].map(cell);
        assert_eq!(cells, ["0.9877", "123500", "0", "0.0000001", "", ""]);
        let mut table = Table::new("t", "T", &["name", "auc", "low"]);
        table.push(["x".to_owned(), cell(0.5), String::new()]);
        assert_eq!(table.json().to_string(), r#"[{"auc":0.5,"low":null,"name":"x"}]"#);
        assert_eq!(table.csv().unwrap(), "name,auc,low\nx,0.5,\n");
        assert_eq!(table.markdown(), "| name | auc | low |\n|---|---|---|\n| x | 0.5 |  |\n");
    }
}
