//! Tables that people read at a terminal.

use std::io::IsTerminal as _;

use comfy_table::{ColumnConstraint, ContentArrangement, LineStyle, Table, TableStyle, Width};

/// Columns of a terminal of unknown width, and of output that is not a terminal.
const WIDTH: u16 = 80;

/// A line under the names of the columns, and no other.
const STYLE: TableStyle = TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// An empty table with these columns, whose cells are wrapped to fit the terminal, or 80 columns.
pub fn table<T: ToString>(header: impl IntoIterator<Item = T>) -> Table {
    let mut table = Table::new();
    table.load_style(STYLE).set_content_arrangement(ContentArrangement::Dynamic);
    if !std::io::stdout().is_terminal() {
        table.set_width(WIDTH);
    }
    table.set_header(header.into_iter().map(|cell| cell.to_string()).collect::<Vec<_>>());
    table
}

/// Leaves less space between columns, for a table of many.
pub fn narrow(table: &mut Table) {
    table.column_iter_mut().for_each(|column| {
        column.set_padding((0, 1));
    });
}

/// Wraps only the cells of the last column, between words: all other columns are as wide as their content.
pub fn break_last_column(table: &mut Table) {
    break_between_words(table);
    let last = table.column_count().saturating_sub(1);
    table.column_iter_mut().take(last).for_each(|column| {
        column.set_constraint(ColumnConstraint::ContentWidth);
    });
}

/// Wraps cells only between words, so that numbers stay whole; a table of many columns may then exceed the terminal.
pub fn break_between_words(table: &mut Table) {
    let longest = |text: &str| text.split_whitespace().map(|word| word.chars().count()).max().unwrap_or(0);
    let mut widths = vec![0; table.column_count()];
    for row in table.header().into_iter().chain(table.row_iter()) {
        for (width, cell) in widths.iter_mut().zip(row.cell_iter()) {
            *width = longest(&cell.content()).max(*width);
        }
    }
    for (column, width) in table.column_iter_mut().zip(widths) {
        let with_padding = u16::try_from(width).unwrap_or(u16::MAX).saturating_add(column.padding_width());
        column.set_constraint(ColumnConstraint::LowerBoundary(Width::Fixed(with_padding)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a table that runs over the edge of a narrow terminal.
    #[test]
    fn a_wide_row_is_broken_to_fit() {
        let mut wide = table(["name", "what it is"]);
        wide.add_row(["a device".to_owned(), "words ".repeat(60)]);
        let text = wide.to_string();
        assert!(text.lines().all(|line| line.chars().count() <= usize::from(WIDTH)), "{text}");
        assert!(text.matches("words").count() == 60, "{text}");
    }

    /// Catches a number that is broken because its table has many columns.
    #[test]
    fn numbers_stay_whole() {
        let mut wide = table((0..12).map(|k| format!("column with number {k}")));
        let numbers: Vec<String> = (0..12).map(|k| format!("{k}.0123456789")).collect();
        wide.add_row(&numbers);
        break_between_words(&mut wide);
        let text = wide.to_string();
        assert!(numbers.iter().all(|number| text.contains(number)), "{text}");
    }
}
