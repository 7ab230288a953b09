//! Tables that people read at a terminal.

use std::io::IsTerminal as _;

use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use comfy_table::{ColumnConstraint, ContentArrangement, Table};

/// Columns of a terminal that does not tell how wide it is, and of what is no terminal.
const WIDTH: u16 = 80;

/// An empty table with these columns, which breaks the lines of its cells to fit the terminal, or 80 columns.
pub fn table<T: ToString>(header: impl IntoIterator<Item = T>) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_HORIZONTAL_ONLY).set_content_arrangement(ContentArrangement::Dynamic);
    if !std::io::stdout().is_terminal() {
        table.set_width(WIDTH);
    }
    table.set_header(header.into_iter().map(|cell| cell.to_string()).collect::<Vec<_>>());
    table
}

/// Breaks the cells of the last column alone: all others are as wide as what is in them.
pub fn break_last_column(table: &mut Table) {
    let last = table.column_count().saturating_sub(1);
    table.column_iter_mut().take(last).for_each(|column| {
        column.set_constraint(ColumnConstraint::ContentWidth);
    });
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
}
