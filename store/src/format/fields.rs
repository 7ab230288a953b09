//! Texts of fixed length, serial numbers and absent values, as fields of rows.

use hdf5::types::FixedUnicode;
use tapline_wire::{Serial, TapId};

/// Ends a text that was cut.
const ELLIPSIS: &str = "\u{2026}";

/// `text` in at most `N` bytes; a longer text is cut at the end of a character and ends in an ellipsis.
pub(crate) fn fixed<const N: usize>(text: &str) -> FixedUnicode<N> {
    if let Ok(field) = text.parse() {
        return field;
    }
    let cut = &text[..text.floor_char_boundary(N.saturating_sub(ELLIPSIS.len()))];
    format!("{cut}{ELLIPSIS}").parse().unwrap_or_default()
}

/// The text of a fixed field; `None` if it is not UTF-8.
pub(crate) fn text<const N: usize>(field: &FixedUnicode<N>) -> Option<&str> {
    std::str::from_utf8(field.as_bytes()).ok()
}

/// The serial number in a fixed field, empty if the field is; `None` if it is not a serial number.
pub(crate) fn serial<const N: usize>(field: &FixedUnicode<N>) -> Option<Serial> {
    match text(field)? {
        "" => Some(Serial::default()),
        text => Serial::new(text).ok(),
    }
}

/// `value`, unless it is NaN.
pub(super) fn known(value: f64) -> Option<f64> {
    Some(value).filter(|v| !v.is_nan())
}

/// The tap `id` at `attempt`.
pub(crate) fn at_attempt(mut id: TapId, attempt: u16) -> TapId {
    id.attempt = attempt;
    id
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Catches a cut inside a character, a text that outgrows its field, and a text that fits but is changed.
        #[test]
        fn a_text_is_whole_or_marked(given in "[^\u{0}]{0,40}") {
            let field = fixed::<32>(&given);
            let kept = text(&field).unwrap();
            if given.len() <= 32 {
                prop_assert_eq!(kept, given);
            } else {
                let head = kept.strip_suffix(ELLIPSIS).unwrap();
                prop_assert!(given.starts_with(head) && head.len() > 32 - ELLIPSIS.len() - 4);
            }
        }
    }
}
