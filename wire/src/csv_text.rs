//! Text in CSV cells that a spreadsheet would take for a formula.
//!
//! Such text is prefixed with an apostrophe, and so is text in which apostrophes precede a formula, so that
//! every text can be restored.

use std::borrow::Cow;

/// Whether a spreadsheet would evaluate a cell with `text`, ignoring leading apostrophes.
fn is_formula(text: &str) -> bool {
    text.trim_start_matches('\'').starts_with(['=', '+', '-', '@', '\t', '\r'])
}

/// `text` for a CSV cell, so that no spreadsheet evaluates it. Not for numbers: `-1` looks like a formula.
pub fn csv_cell(text: &str) -> Cow<'_, str> {
    if is_formula(text) { Cow::Owned(format!("'{text}")) } else { Cow::Borrowed(text) }
}

/// The text from which [`csv_cell`] made `cell`.
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
