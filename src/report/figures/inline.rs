//! A drawn picture as an element of a page.

use maud::html;

/// `svg` without what only a file of its own needs, as wide as its place, and named `label` to who cannot see it.
pub(crate) fn svg(svg: &str, label: &str) -> String {
    let svg = svg.replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1);
    let name = html! { (label) }.into_string();
    // The view box has the size that counts: those of the element would keep it from fitting its place.
    let body = svg.find("viewBox").map_or(svg.as_str(), |start| &svg[start..]);
    // The library writes line ends that mean nothing.
    let body: String = body.lines().map(str::trim_end).collect();
    format!("<svg role=\"img\" aria-label=\"{name}\" {body}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a name that ends its attribute, an address left in, and a size that keeps the picture from fitting.
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
