//! What a page needs when it is printed and signed: headers and footers, and room for a decision.

use maud::{Markup, html};

/// The lines at the edges of every sheet of paper.
pub(crate) struct Paper {
    pub top_left: String,
    pub top_right: String,
    pub bottom_left: String,
}

impl Paper {
    /// The rules of the style sheet that print them, with the number of each sheet.
    pub(crate) fn style(&self) -> String {
        let Self { top_left, top_right, bottom_left } = self;
        let edge = |name: &str, content: &str| {
            format!("@{name}{{content:{content};font:8pt system-ui,sans-serif;color:#595959}}")
        };
        let edges = [
            edge("top-left", &css_text(top_left)),
            edge("top-right", &css_text(top_right)),
            edge("bottom-left", &css_text(bottom_left)),
            edge("bottom-right", "\"page \" counter(page) \" of \" counter(pages)"),
        ];
        format!("@page{{size:A4;margin:16mm 12mm;{}}}", edges.concat())
    }
}

/// `text` as a CSS string, in which nothing can end the string or the style sheet.
fn css_text(text: &str) -> String {
    let plain = |c: char| match c {
        c if c.is_alphanumeric() || " .,:-()/".contains(c) => c.to_string(),
        c => format!("\\{:x} ", u32::from(c)),
    };
    format!("\"{}\"", text.chars().map(plain).collect::<String>())
}

/// Room for a person's decision.
pub(crate) fn signature(operator: Option<&str>) -> Markup {
    html! {
        section class="sign" {
            h2 { "Decision" }
            div class="scroll" { table {
                thead { tr { th { "" } th { "name" } th { "date and time" } th { "signature" } } }
                tbody {
                    tr { td { "Operator" } td { (operator.unwrap_or_default()) } td {} td {} }
                    tr { td { "Released, repaired or scrapped by" } td {} td {} td {} }
                }
            } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a serial that ends the style sheet, or the string that it is in.
    #[test]
    fn no_text_leaves_its_string() {
        assert_eq!(css_text("A-17"), "\"A-17\"");
        assert_eq!(css_text("a\"</style>\\"), "\"a\\22 \\3c /style\\3e \\5c \"");
    }
}
