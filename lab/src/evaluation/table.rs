//! The findings as tables: the same cells go to the terminal, to JSON, to CSV and onto the page.

use std::fmt::{self, Display, Formatter};

use anyhow::Result;
use serde_json::{Map, Value};

/// Digits of a number: more than its interval justifies.
const DIGITS: usize = 4;

/// Last columns whose cells are sentences.
const NOTES: [&str; 2] = ["remark", "source"];

/// Most columns of a table that has room for sentences in its last.
const BESIDE_TEXT_MAX: usize = 4;

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

    /// For people at a terminal, without columns that are empty. Beside many numbers a sentence would break into a word a line: then
    /// it stands below the table, and its cell has its number.
    pub(crate) fn text(&self) -> String {
        let is_shown =
            |&place: &usize| self.rows.is_empty() || self.rows.iter().any(|row| row.get(place) != Some(&Cell::Empty));
        let shown: Vec<usize> = (0..self.columns.len()).filter(is_shown).collect();
        let mut table = tapline_host::table::table(shown.iter().map(|&place| self.columns[place].replace('_', " ")));
        let has_many = self.columns.len() > BESIDE_TEXT_MAX;
        let has_notes = has_many && self.columns.last().is_some_and(|c| NOTES.contains(c));
        let mut notes: Vec<String> = Vec::new();
        for row in &self.rows {
            let mut cells: Vec<String> = row.iter().map(ToString::to_string).collect();
            if let Some(note) = cells.last_mut().filter(|note| has_notes && !note.is_empty()) {
                let number = notes.iter().position(|known| known == note).unwrap_or_else(|| {
                    notes.push(note.clone());
                    notes.len() - 1
                });
                *note = format!("({})", number + 1);
            }
            table.add_row(shown.iter().filter_map(|&place| cells.get(place)));
        }
        if has_many {
            tapline_host::table::narrow(&mut table);
        }
        tapline_host::table::break_between_words(&mut table);
        let notes: String = notes.iter().zip(1..).map(|(note, number)| format!("({number}) {note}\n")).collect();
        format!("{}\n{table}\n{notes}", self.title)
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

    /// Catches a remark beside many numbers that breaks into a word a line, and one that is printed twice or lost.
    #[test]
    fn sentences_stand_below_a_table_of_many_numbers() {
        let columns = ["called", "cracked", "sound", "auc", "auc_low", "auc_high", "tpr_at_5", "remark"];
        let mut table = Table::new("t", "T", columns);
        let why = "no interval: 1 tyres have cracked ones, 2 have sound ones; 2 of each are needed";
        for (name, remark) in [("locations", why), ("places", ""), ("shoulders by strongest arc", why)] {
            let numbers = [0.1234; 6].map(cell);
            table.push([name.into()].into_iter().chain(numbers).chain([remark.into()]));
        }
        let text = table.text();
        assert!(text.ends_with(&format!("\n(1) {why}\n")) && text.matches(why).count() == 1, "{text}");
        assert!(text.matches("(1)").count() == 3, "{text}");
        assert!(text.lines().filter(|line| !line.contains(why)).all(|line| line.chars().count() <= 80), "{text}");
        // A column without a value takes no room.
        let columns = "shoulders call stated rate rate_low rate_high calls judged consistent remark";
        let mut calls = Table::new("t", "T", columns.split(' '));
        let numbers = [0.001, 0.7076, 0.7076, 0.7076].map(cell).into_iter().chain([3.into(), 3.into()]);
        calls.push(["sound".into(), "not passed".into()].into_iter().chain(numbers).chain(["yes".into(), Cell::Empty]));
        let text = calls.text();
        assert!(!text.contains("remark") && text.contains("consistent"), "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        // Two numbers leave room for it.
        let mut few = Table::new("t", "T", ["what", "count", "remark"]);
        few.push(["archives".into(), 2.into(), why.into()]);
        assert!(!few.text().contains("(1)"), "{}", few.text());
    }
}
