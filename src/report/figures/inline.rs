//! A picture as an element of a page.

use maud::html;

/// `svg` without what only a separate file needs, as wide as its container, with `label` for screen readers.
pub(crate) fn svg(svg: &str, label: &str) -> String {
    let svg = svg.replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1);
    let name = html! { (label) }.into_string();
    // The view box has the size; a width and height would keep the picture from fitting its container.
    let body = svg.find("viewBox").map_or(svg.as_str(), |start| &svg[start..]);
    // Line ends have no meaning here.
    let body: String = body.lines().map(str::trim_end).collect();
    format!("<svg role=\"img\" aria-label=\"{name}\" {body}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a label that ends its attribute, an address that stays, and a size that keeps the picture from fitting.
    #[test]
    fn a_picture_names_nothing_outside() {
        let drawn =
            "<svg width=\"3\" height=\"4\" viewBox=\"0 0 12 16\" xmlns=\"http://www.w3.org/2000/svg\">\n</svg>\n";
        assert_eq!(
            svg(drawn, "a \"<b>\""),
            "<svg role=\"img\" aria-label=\"a &quot;&lt;b&gt;&quot;\" viewBox=\"0 0 12 16\"></svg>"
        );
    }
}
