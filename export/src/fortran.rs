//! Numbers and texts in the fixed fields of Fortran's formats.

/// `value` in Fortran's `Ew.d`, with one digit before the point: `width` characters, `digits` after the point, and
/// `letter` before an exponent of a sign and at least two digits.
///
/// A value that is not finite is written by its name, which Fortran 2003 reads.
pub(crate) fn exponent(value: f64, width: usize, digits: usize, letter: char) -> String {
    if !value.is_finite() {
        return format!("{value:>width$}");
    }
    let text = format!("{value:.digits$e}");
    let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
    let (sign, power) = power.strip_prefix('-').map_or(('+', power), |power| ('-', power));
    format!("{:>width$}", format!("{mantissa}{letter}{sign}{power:0>2}"))
}

/// `text` in at most `length` printable ASCII characters, '_' for each that is not.
pub(crate) fn plain(text: &str, length: usize) -> String {
    text.chars().take(length).map(|c| if c == ' ' || c.is_ascii_graphic() { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a field of the wrong width, and an exponent that no Fortran writes.
    #[test]
    fn fields_have_their_width() {
        assert_eq!(exponent(-1.5e-7, 13, 5, 'E'), " -1.50000E-07");
        assert_eq!(exponent(0.0, 13, 5, 'E'), "  0.00000E+00");
        assert_eq!(exponent(273.15, 25, 16, 'D'), "   2.7314999999999998D+02");
        assert_eq!(exponent(-f64::MAX, 13, 5, 'E').len(), 13, "three digits of exponent fit");
        assert_eq!(exponent(f64::NAN, 13, 5, 'E'), "          NaN", "and not 0");
    }

    /// Catches a line that a reader of 80-byte records would split elsewhere.
    #[test]
    fn text_is_one_byte_a_character() {
        assert_eq!(plain("A\u{e9}-1\n", 80), "A_-1_");
        assert_eq!(plain(&"\u{e9}".repeat(99), 80).len(), 80);
    }
}
