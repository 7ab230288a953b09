//! Texts in cells of CSV files, which spreadsheets take for formulas when they begin as one.
//!
//! Such a text gets an apostrophe before it, and so does one that begins with apostrophes and goes on as a formula: then
//! every text comes back as it was.

use std::borrow::Cow;

/// Whether a spreadsheet would compute a cell with `text`, apostrophes before it left out.
fn is_formula(text: &str) -> bool {
    text.trim_start_matches('\'').starts_with(['=', '+', '-', '@', '\t', '\r'])
}

/// `text` for a cell of a CSV file, such that no spreadsheet computes it. Numbers are not to be given: `-1` is one.
pub fn csv_cell(text: &str) -> Cow<'_, str> {
    if is_formula(text) { Cow::Owned(format!("'{text}")) } else { Cow::Borrowed(text) }
}

/// The text that [`csv_cell`] gave `cell` for.
pub fn csv_text(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|text| is_formula(text)).unwrap_or(cell)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn formulas_are_made_texts() {
        for text in ["=1+1", "+49", "-5", "@SUM(A1)", "\tx", "\r=x", "'=1", "''-"] {
            assert_eq!(csv_cell(text), format!("'{text}"));
        }
        for text in ["", "A-17", "'", "'A", "O'Brien", " =1"] {
            assert_eq!(csv_cell(text), text);
            assert_eq!(csv_text(text), text);
        }
    }

    proptest! {
        /// Catches a text that does not come back, or is a formula still.
        #[test]
        fn every_text_comes_back(text in "['=+@\t\r -]{0,3}.{0,3}") {
            let cell = csv_cell(&text);
            prop_assert!(!cell.starts_with(['=', '+', '-', '@', '\t', '\r']));
            prop_assert_eq!(csv_text(&cell), text.as_str());
        }
    }
}
