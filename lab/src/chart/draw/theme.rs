//! Light and dark: a picture is drawn for white paper, and a style sheet replaces its colours on a dark screen.

/// For each colour on paper the one on a dark screen. Print is always light.
pub(crate) const DARK_STYLE: &str = include_str!("dark.css");

/// `svg` with its own style, for pictures outside of a page.
pub(crate) fn themed(svg: &str) -> String {
    match svg.split_once('>') {
        Some((head, rest)) => format!("{head}>\n<style>\n{DARK_STYLE}</style>{rest}"),
        None => svg.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plotters::style::RGBColor;
    use tapline_draw::canvas::{GRID, INK, PALE_INK};
    use tapline_draw::palette::COLORS;

    /// Catches a colour that keeps its light value on a dark screen, where ink would be invisible.
    #[test]
    fn every_colour_has_a_dark_one() {
        let white = RGBColor(255, 255, 255);
        for RGBColor(r, g, b) in COLORS.into_iter().chain([INK, PALE_INK, GRID, white]) {
            let name = format!("#{r:02X}{g:02X}{b:02X}");
            assert!(DARK_STYLE.contains(&format!("[fill=\"{name}\"]")), "{name}");
            assert!(DARK_STYLE.contains(&format!("[stroke=\"{name}\"]")), "{name}");
        }
    }
}
